r"""Stability of the sleeping top
H 4.25: the sleeping top

The pseudo-potential of a top that spins upright: above the critical spin,
$2\sqrt{mghI_1}/I_3$, it has a minimum at the vertical, and the top is stable
(sleeping); below it the top falls to a new minimum. Right: the growth rate of
the instability (H 4.11)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import Top

jaxspace.enable_x64()
A, C, weight = 1.0e-3, 6.0e-4, 0.08
top = Top(A, C, weight)
critical = top.least_spin(0.0)
theta = jnp.radians(jnp.linspace(0.0, 100.0, 400))
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for share in (0.6, 0.8, 1.0, 1.2):
    # (1 - cos)^2 / sin^2 = tan^2(theta / 2).
    turning = (C * share * critical * jnp.tan(0.5 * theta)) ** 2 / (2.0 * A)
    V = turning + weight * (jnp.cos(theta) - 1.0)
    left.plot(jnp.degrees(theta), V / weight, label=f"{share:g}")
left.set(xlabel="θ, deg", ylabel="V' / m g h, 1", ylim=(-0.5, 0.5))
left.legend(title="spin / critical")
share = jnp.linspace(0.0, 1.3, 400)
right.plot(share, top.sleeping_growth_rate(share * critical))
right.set(xlabel="spin / critical spin", ylabel="growth rate, 1/s")
plt.show()

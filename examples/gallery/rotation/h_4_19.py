r"""Effective potential of a heavy top
H 4.19: pseudo-potential of the top

$V' = (p_\phi - p_\psi\cos\theta)^2/(2I_1\sin^2\theta) + mgh\cos\theta$: the
axis is confined to the region where $V'$ is below the energy. The dots are
the turning points of a top released at rest, the crosses the steady
precession with the same momenta (H 4.11)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import Top

jaxspace.enable_x64()
A, C, weight = 1.0e-3, 6.0e-4, 0.08
top = Top(A, C, weight)
theta = jnp.radians(jnp.linspace(2.0, 178.0, 500))
figure, axes = plt.subplots()
for k, spin in enumerate((15.0, 25.0, 40.0)):
    tilt = jnp.radians(40.0)
    h_Z = C * spin * jnp.cos(tilt)
    V = top.pseudo_potential(theta, h_Z, spin)
    axes.plot(jnp.degrees(theta), V, label=f"{spin:g} rad/s")
    motion = top.nutation(top.state([0.0, tilt, 0.0], [0.0, 0.0, spin]))
    ends = jnp.degrees(jnp.stack(motion.turning_points))
    rest = top.pseudo_potential_minimum(h_Z, spin)
    least = top.pseudo_potential(rest, h_Z, spin)
    axes.plot(jnp.degrees(rest), least, "x", color=f"C{k}")
    axes.plot(ends, [weight * jnp.cos(tilt)] * 2, "o-", color=f"C{k}", lw=0.8)
axes.set(xlabel="θ, deg", ylabel="V', J", ylim=(0.0, 0.2))
axes.set(xticks=range(0, 181, 30))
axes.legend(title="spin")
plt.show()

r"""Bifurcation of a bead on a rotating hoop
A bead on a rotating hoop

Equilibrium positions of the bead against the rotation rate of the hoop, in
units of the rate $\sqrt{g/r}$ at which the bottom becomes unstable, and the
squared frequency of small oscillations about these positions, computed with
`studies.modes`."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.mechanics import RotatingHoop
from jaxspace.studies import modes

jaxspace.enable_x64()
g, r = 9.8, 0.5  # m/s^2, m
critical = (g / r) ** 0.5


@jax.jit
@jax.vmap
def growth(rate, theta):
    hoop = RotatingHoop(mass=1.0, radius=r, rate=rate, gravity=g)
    root = modes(hoop, hoop.state(theta)).eigenvalues[0]
    return -jnp.real(root**2)


ratio = jnp.linspace(0.05, 2.5, 200)
side = jnp.arccos(jnp.minimum(1.0, 1.0 / ratio**2))
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for sign in (1.0, -1.0):
    left.plot(ratio, sign * jnp.degrees(side), "C0")
left.plot(ratio, jnp.where(ratio > 1.0, 0.0, jnp.nan), "C1--")
left.set(xlabel="hoop rate / sqrt(g / r)", ylabel="equilibrium angle, deg")
for theta, style in ((side, "C0"), (jnp.zeros_like(side), "C1--")):
    right.plot(ratio, growth(ratio * critical, theta) * r / g, style)
right.set(
    xlabel="hoop rate / sqrt(g / r)", ylabel="squared frequency / (g / r)"
)
right.axhline(0.0, color="0.4", lw=0.8)
plt.show()

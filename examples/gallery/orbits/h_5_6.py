"""Stability of circular orbits
H 5.6: pseudo-potentials

$U + L^2/(2r^2)$ for attractions $k/r^n$ with the same circular orbit at
$r = 1$. Up to $n = 3$ the circular orbit is at a minimum; beyond, it is at a
maximum and unstable (H 5.4)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.central_force import power_law_potential
from jaxspace.orbits.radial_motion import effective_potential

jaxspace.enable_x64()
r = jnp.linspace(0.35, 3.0, 400)
figure, axes = plt.subplots()
for n in (-1.0, 1.0, 2.0, 3.0, 4.0):

    def potential(radius, n=n):
        return power_law_potential(radius, 1.0, n)

    # L = 1: the attraction k = 1 holds the unit circle.
    level = effective_potential(potential, jnp.array(1.0), 1.0)
    shape = effective_potential(potential, r, 1.0) - level
    axes.plot(r, shape, label=f"{n:g}")
axes.plot(1.0, 0.0, "ko", ms=4)
axes.set(xlabel="r", ylabel="effective potential above the circular orbit")
axes.set(ylim=(-0.4, 0.6))
axes.legend(title="n")
plt.show()

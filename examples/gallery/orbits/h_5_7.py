r"""Closed orbits of power laws
H 5.7: closed and precessing orbits

The angle between periapsis and apoapsis for attractions $k/r^n$, from nearly
circular orbits, where it is $\pi/\sqrt{3 - n}$, to very eccentric ones. Two
lines are horizontal: the orbits of the linear spring and of gravity are
closed for any shape (H 5.4)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.central_force import power_law_potential
from jaxspace.orbits.radial_motion import radial_motion

jaxspace.enable_x64()
ratio = jnp.geomspace(1.0, 50.0, 120)
figure, axes = plt.subplots()
for n in (-1.0, 0.0, 1.0, 1.5, 2.0, 2.2, 2.4):

    def potential(radius, n=n):
        return power_law_potential(radius, 1.0, n)

    angle = radial_motion(potential, jnp.ones_like(ratio), ratio)
    degrees = jnp.degrees(angle.apsidal_angle)
    axes.semilogx(ratio, degrees, label=f"{n:g}")
    axes.plot(1.0, 180.0 / jnp.sqrt(3.0 - n), "ko", ms=3)
axes.set(xlabel="outer / inner radius", ylabel="apsidal angle, deg")
axes.set_xticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
axes.minorticks_off()
axes.set(yticks=range(60, 301, 30))
axes.legend(title="n", loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.show()

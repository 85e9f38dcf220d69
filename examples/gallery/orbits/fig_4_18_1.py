"""Nodal and apsidal precession due to J2
Fig. 4.18-1: effects of the Earth's oblateness on an orbit

Mean rates of the node and of the periapsis due to J2, in degrees per day,
against the inclination, at 500 km altitude. The dotted line is the mean
motion of the Sun: where the node rate equals it, the orbit is
sun-synchronous. At 63.4 degrees the periapsis is stationary."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from jaxspace.orbits.oblateness import apsidal_rate, node_regression_rate

jaxspace.enable_x64()
i = jnp.radians(jnp.linspace(0.0, 180.0, 361))
orbit = (RADIUS_EARTH + 500e3, 0.0, i, MU_EARTH, J2_EARTH, RADIUS_EARTH)
node = -jnp.degrees(node_regression_rate(*orbit)) * 86400.0
apsis = jnp.degrees(apsidal_rate(*orbit)) * 86400.0

figure, axes = plt.subplots()
axes.plot(jnp.degrees(i), node, label="node")
axes.plot(jnp.degrees(i), apsis, label="periapsis")
axes.axhline(360.0 / 365.2422, color="0.4", lw=0.9, ls=":")
axes.text(2.0, 1.3, "Sun", fontsize=8, color="0.4")
sun = int(jnp.argmin(jnp.abs(node - 360.0 / 365.2422)))
axes.plot(jnp.degrees(i[sun]), node[sun], "ko", ms=4)
critical = float(jnp.degrees(jnp.arctan(2.0)))
axes.plot([critical, 180.0 - critical], [0.0, 0.0], "ks", ms=4)
axes.set(xlabel="inclination, deg", ylabel="rate, deg/day")
axes.set(xticks=range(0, 181, 30))
axes.legend()
plt.show()

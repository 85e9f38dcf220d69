"""Reachable region of a projectile
Envelope of trajectories

The trajectories launched at a given speed in all directions are bounded by an
ellipse with one focus at the centre of the Earth and the other at the launch
point (2.3 P6 considers the flat Earth, where the envelope is a parabola)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.kepler import kepler_flow

jaxspace.enable_x64()
# In radii of the Earth and units of the speed of the lowest satellite.
speed, start = 0.75, jnp.array([0.0, 1.0, 0.0])
angles = jnp.radians(jnp.linspace(0.0, 180.0, 19))
velocities = speed * jnp.stack(
    [jnp.cos(angles), jnp.sin(angles), 0.0 * angles]
)
t = jnp.linspace(0.0, 3.6, 300)
x, y, _ = kepler_flow(
    start[:, None, None], velocities[:, None, :], t[:, None], 1.0
)[0]
x, y = (jnp.where(x**2 + y**2 < 0.999, jnp.nan, z) for z in (x, y))

figure, axes = plt.subplots(figsize=(5.6, 4.6))
axes.add_patch(plt.Circle((0, 0), 1.0, color="0.9"))
axes.plot(x, y, lw=0.8, color="C0")
# The distances from both foci add up to 4 a - r.
long_axis = 4.0 / (2.0 - speed**2) - 1.0
turn = jnp.linspace(0.0, 2.0 * jnp.pi, 400)
across = 0.5 * jnp.sqrt(long_axis**2 - 1.0) * jnp.cos(turn)
axes.plot(across, 0.5 + 0.5 * long_axis * jnp.sin(turn), "--", color="C1")
axes.plot(0.0, 1.0, "o", color="C3", ms=4)
axes.set(xlabel="x / R", ylabel="y / R", aspect="equal")
axes.set(xlim=(-1.35, 1.35), ylim=(-0.4, 1.6))
axes.set_title("Launches at 0.75 of the circular speed, and their envelope")
plt.show()

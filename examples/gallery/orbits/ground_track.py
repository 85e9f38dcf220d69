"""Ground track of a satellite
Ground track of a Molniya orbit

Two revolutions of half a sidereal day each, relative to the rotating Earth:
the satellite remains over the northern hemisphere for hours. One dot per
hour."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.constants import MU_EARTH
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.rotating_earth import planet_frame

jaxspace.enable_x64()
day = 86164.1
rate = 2.0 * jnp.pi / day
size = (MU_EARTH * (0.5 * day / (2.0 * jnp.pi)) ** 2) ** (1.0 / 3.0)
r, v = orbit_from_radius(
    *(size * (1.0 - 0.74), MU_EARTH, 0.74, jnp.radians(63.4)),
    node=jnp.radians(50.0),
    argument_of_periapsis=-0.5 * jnp.pi,
)
t = jnp.linspace(0.0, day, 1441)
place, _ = kepler_flow(r[:, None], v[:, None], t, MU_EARTH)
x, y, z = planet_frame(rate * t, rate).attitude.rotate_back(place)
latitude = jnp.degrees(jnp.arctan2(z, jnp.hypot(x, y)))
longitude = jnp.degrees(jnp.arctan2(y, x))
jump = jnp.abs(jnp.diff(longitude, append=longitude[-1:])) > 180.0
line = jnp.where(jump, jnp.nan, longitude)

figure, axes = plt.subplots(figsize=(7.4, 3.9))
axes.plot(line, latitude)
axes.plot(longitude[::60], latitude[::60], "o", ms=3, color="C1")
axes.set(xlim=(-180, 180), ylim=(-90, 90), aspect="equal")
axes.set(xticks=range(-180, 181, 60), yticks=range(-90, 91, 30))
axes.set(xlabel="longitude, deg", ylabel="latitude, deg")
plt.show()

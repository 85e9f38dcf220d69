"""North-seeking gyrocompass
Path of the axis of a gyrocompass

The end of the axis, released 5 degrees off the meridian (6.5): without
damping it moves on an ellipse about its equilibrium, slightly above the
horizon; with the bail offset to the east it spirals to an equilibrium
slightly off the meridian. Closed form of the slow equations; the elevation is
enlarged twenty times, and the dots are ten minutes apart."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros import Gyrocompass

jaxspace.enable_x64()
minute = 60.0
time = jnp.linspace(0.0, 160.0 * minute, 1601)
figure, both = plt.subplots(
    1, 2, figsize=(8.4, 3.6), sharex=True, sharey=True
)
for axes, offset, title in zip(
    both, (0.0, 1.5), ("Without damping", "With damping"), strict=True
):
    compass = Gyrocompass(
        spin_momentum=3000.0,
        tilt_inertia=1.8,
        azimuth_inertia=1.8,
        pendulous_moment=75.0,
        latitude=jnp.radians(45.0),
        damping_moment=offset,
    )
    tilt, azimuth = compass.slow_motion(time, 0.0, jnp.radians(5.0))
    # Of the ellipse one round alone.
    once = slice(0, 922) if offset == 0.0 else slice(None)
    tilt, azimuth = jnp.degrees(tilt[once]), jnp.degrees(azimuth[once])
    axes.plot(azimuth, tilt)
    axes.plot(azimuth[::100], tilt[::100], "o", color="C0", ms=3)
    rest = (
        jnp.degrees(compass.rest_azimuth),
        jnp.degrees(compass.rest_tilt),
    )
    axes.plot(*rest, "P", color="C1", ms=7, label="equilibrium")
    axes.axhline(0.0, color="0.4", lw=0.8)
    axes.axvline(0.0, color="0.4", lw=0.8)
    axes.set(xlabel="azimuth west of north, deg", title=title, aspect=20.0)
both[0].set_ylabel("elevation, deg")
both[0].invert_xaxis()
both[1].legend(loc="lower left")
plt.show()

"""Centrodes of a plane motion
Centrodes of a ladder

The instantaneous centre of a sliding ladder moves on a circle about the
corner in space, and on a circle through the ends of the ladder relative to
the ladder: the small circle rolls within the large one (3.3)."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.rotations import Quaternion
from jaxspace.rotations.moving_frame import instantaneous_centre

jaxspace.enable_x64()
tilt = jnp.radians(jnp.linspace(1.0, 89.0, 45))  # of a ladder of length one


def foot(angle):
    return jnp.stack([jnp.cos(angle), 0.0 * angle, 0.0 * angle])


# Down at unit rate: the ladder turns about the z axis with it.
place, velocity = jax.jvp(foot, (tilt,), (-jnp.ones_like(tilt),))
spin = jnp.stack([0.0 * tilt, 0.0 * tilt, jnp.ones_like(tilt)])
space = instantaneous_centre(place, velocity, spin)
# From the foot, along the ladder and across it.
body = Quaternion.about(2, jnp.pi - tilt).rotate_back(space - place)

figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 3.8))
for k in range(0, 45, 6):
    left.plot([float(place[0, k]), 0], [0, float(jnp.sin(tilt[k]))], "0.75")
left.plot(space[0], space[1], "o-", ms=3)
left.set(title="Space centrode", xlabel="x / length", ylabel="y / length")
right.plot([0, 1], [0, 0], color="0.75", lw=3)
right.plot(body[0], body[1], "o-", ms=3, color="C1")
right.set(title="Body centrode", xlabel="position along the ladder / length")
for axes in (left, right):
    axes.set_aspect("equal")
plt.show()

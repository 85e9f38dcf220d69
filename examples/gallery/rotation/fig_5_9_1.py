"""Rolling cones of a free body
Fig. 5.9-1 and 5.9-2: direct and retrograde precession

The body cone (red), about the axis, rolls without slip on the space cone
(blue), about the angular momentum; they touch along the angular velocity. The
space cone is outside the body cone for a slender body and inside for a flat
body. The black curve is the path of the axis."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.torque_free import cone_angles, space_cone_angle
from jaxspace.rotations import Quaternion

jaxspace.enable_x64()
turn = jnp.linspace(0.0, 2.0 * jnp.pi, 60)
height = jnp.array([0.0, 1.0])[:, None]


def cone(half_angle, tilt):
    """A cone about an axis that leans by `tilt` towards x, sides of one."""
    across, up = jnp.sin(half_angle), jnp.cos(half_angle)
    points = jnp.stack(
        [
            height * across * jnp.cos(turn),
            height * across * jnp.sin(turn),
            height * up * jnp.ones_like(turn),
        ]
    )
    return Quaternion.about(1, tilt).rotate(points)


figure = plt.figure(figsize=(7.6, 3.8))
for k, (ratio, name) in enumerate(((0.4, "direct"), (1.6, "retrograde"))):
    tilt = jnp.radians(35.0)
    omega = jnp.stack([jnp.sin(tilt), 0.0 * tilt, jnp.cos(tilt) / ratio])
    _, gamma = cone_angles(omega, 1.0, ratio)
    space = space_cone_angle(omega, 1.0, ratio)
    axes = figure.add_subplot(1, 2, k + 1, projection="3d")
    axes.plot_surface(*cone(gamma, tilt), color="C1", alpha=0.35, lw=0)
    axes.plot_surface(*cone(space, 0.0), color="C0", alpha=0.55, lw=0)
    axes.plot(
        jnp.sin(tilt) * jnp.cos(turn),
        jnp.sin(tilt) * jnp.sin(turn),
        *(jnp.cos(tilt), "k-"),
        lw=1.0,
    )
    for angle, label in ((0.0, "h"), (tilt, "axis"), (tilt - gamma, "ω")):
        x, z = 1.25 * jnp.sin(angle), 1.25 * jnp.cos(angle)
        axes.plot([0, x], [0, 0], [0, z], color="k", lw=1.2)
        axes.text(x, 0, z, label, fontsize=8)
    axes.set(xlim=(-0.7, 1.1), ylim=(-0.8, 0.8), zlim=(0.0, 1.3))
    axes.set_box_aspect((1.8, 1.6, 1.3), zoom=1.4)
    axes.view_init(18, -70)
    axes.set_axis_off()
    axes.set_title(f"C / A = {ratio:g}: {name}")
plt.show()

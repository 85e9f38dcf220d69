r"""Cone angles of a free body
Fig. 5.8-2: cones of a free symmetric body

The axis, the angular velocity and the angular momentum are coplanar. Against
the angle $\theta$ between axis and momentum: the half-angles of the body cone
and of the space cone of the angular velocity, negative if the cones are
external to each other."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.torque_free import cone_angles, space_cone_angle

jaxspace.enable_x64()
tilt = jnp.radians(jnp.linspace(0.1, 89.9, 300))
figure, (left, right) = plt.subplots(1, 2, figsize=(8.2, 3.9))
for k, ratio in enumerate((0.2, 0.5, 0.8, 1.2, 1.6, 2.0)):
    # C / A; the momentum has the angle theta with the axis.
    omega = jnp.stack([jnp.sin(tilt), 0.0 * tilt, jnp.cos(tilt) / ratio])
    theta, gamma = cone_angles(omega, 1.0, ratio)
    space = space_cone_angle(omega, 1.0, ratio)
    left.plot(jnp.degrees(theta), jnp.degrees(gamma), label=f"{ratio:g}")
    right.plot(jnp.degrees(theta), jnp.degrees(space), color=f"C{k}")
left.set(title="Body cone", ylabel="half-angle, deg")
right.set(title="Space cone")
left.legend(title="C / A")
for axes in (left, right):
    axes.set(xlabel="θ, deg", xticks=range(0, 91, 15))
plt.show()

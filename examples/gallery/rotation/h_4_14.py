r"""Angular momentum in body axes
H 4.14 to 4.16: Binet's diagrams

In body axes the angular momentum is on a sphere, because its magnitude is
constant, and on the energy ellipsoid, whose semi-axes are $\sqrt{2TI}$. Its
path is their intersection: about the shortest semi-axis, or, beyond the
intermediate one, about the longest (H 4.9)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.polhode import Polhode
from jaxspace.bodies import PrincipalInertia
from jaxspace.bodies.principal_frame import free_turn

jaxspace.enable_x64()
moments = jnp.array([2.0, 3.0, 4.0])
semi_axes = jnp.sqrt(moments)  # at 2 T = 1
figure = plt.figure(figsize=(9.0, 3.4))
u, v = jnp.meshgrid(
    jnp.linspace(0, 2 * jnp.pi, 40), jnp.linspace(0, jnp.pi, 20)
)
ball = jnp.stack(
    [jnp.cos(u) * jnp.sin(v), jnp.sin(u) * jnp.sin(v), jnp.cos(v)]
)
for k, size in enumerate((1.6, 1.72, 1.85)):
    # In the plane of the outer axes.
    share = 0.5 * size**2 - 1.0
    momentum = semi_axes * jnp.sqrt(jnp.array([1.0 - share, 0.0, share]))
    polhode = Polhode.of(moments, momentum / moments)
    t = jnp.linspace(0.0, polhode.period, 300)
    _, rate = free_turn(
        *(t, PrincipalInertia(moments[:, None])),
        (momentum / moments)[:, None] + 0.0 * t,
    )
    path = moments[:, None] * rate
    axes = figure.add_subplot(1, 3, k + 1, projection="3d")
    axes.plot_surface(
        *(semi_axes[:, None, None] * ball), color="C0", alpha=0.15
    )
    axes.plot_surface(*(size * ball), color="C1", alpha=0.25)
    for sign in (1.0, -1.0):
        # About the first axis, or about the third one.
        axis = 0 if polhode.about_least else 2
        mirror = jnp.ones((3, 1)).at[axis].set(sign)
        curve = mirror * path
        # What lies behind is dotted.
        front = jnp.array([0.76, 0.53, 0.37]) @ curve > 0.0
        axes.plot(*jnp.where(front, curve, jnp.nan), color="k", zorder=9)
        axes.plot(*curve, ":", color="0.4", lw=0.8, zorder=8)
    axes.set(xlim=(-2, 2), ylim=(-2, 2), zlim=(-2, 2))
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.view_init(22, 35)
    axes.set_axis_off()
    axes.set_title(f"|L| = {size:g}")
plt.show()

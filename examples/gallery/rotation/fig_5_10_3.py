"""Polhodes of a free body
Fig. 5.10-3: polhodes on Poinsot's ellipsoid

The angular velocities of a given energy form an ellipsoid in the body, on
which each motion follows a closed curve: about the axis of greatest inertia
(red) or about that of least inertia (blue), with the separatrix (black)
between them."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.polhode import Polhode
from jaxspace.bodies import PrincipalInertia
from jaxspace.bodies.principal_frame import free_turn

jaxspace.enable_x64()
moments = jnp.array([1.0, 2.0, 3.0])
# From the axis of greatest moment to that of least, at the energy T = 1/2.
angles = jnp.radians(jnp.array([15, 30, 45, 60, 70, 75, 80, 85.0]))
start = jnp.stack([jnp.sin(angles), 0.0 * angles, jnp.cos(angles)])
start = start / jnp.sqrt(jnp.sum(moments[:, None] * start**2, axis=0))
# A turn away from the separatrix, where it meets the middle plane.
border = jnp.array([[jnp.sqrt(0.5)], [1e-9], [jnp.sqrt(1.0 / 6.0)]])
inertia = PrincipalInertia(moments)
shares = jnp.linspace(0.0, 1.0, 200)[:, None]
period = Polhode.of(moments[:, None], start).period
_, path = free_turn(shares * period, inertia, start[:, None, :])
_, edge = free_turn(24.0 * shares - 12.0, inertia, border[:, None, :])

figure, axes = plt.subplots(subplot_kw={"projection": "3d"}, figsize=(5.6, 5))
u, v = jnp.meshgrid(
    jnp.linspace(0, 2 * jnp.pi, 40), jnp.linspace(0, jnp.pi, 20)
)
ball = (jnp.cos(u) * jnp.sin(v), jnp.sin(u) * jnp.sin(v), jnp.cos(v))
size = 0.985 / jnp.sqrt(moments)
axes.plot_surface(
    *(s * b for s, b in zip(size, ball, strict=True)),
    color="0.93",
    shade=False,
)
toward = jnp.array([0.75, 0.45, 0.5])


def draw(curve, color):
    # Only what lies on the side towards the reader.
    front = jnp.einsum("i,it->t", toward * moments, curve) > 0.0
    axes.plot(
        *jnp.where(front, curve, jnp.nan), color=color, lw=1.3, zorder=9
    )


for k in range(angles.size):
    least = moments[0] * start[0, k] ** 2 * 1.0 > 0.5 * 1.0
    for sign in (1.0, -1.0):
        flip = jnp.array([[sign], [sign], [1.0]]) if not least else sign
        draw(path[:, :, k] * flip, "C0" if least else "C1")
for sign in (1.0, -1.0):
    for other in (1.0, -1.0):
        draw(edge[:, :, 0] * jnp.array([[sign], [1.0], [other]]), "k")
axes.view_init(30, 31)
axes.set(xlim=(-1, 1), ylim=(-0.75, 0.75), zlim=(-0.62, 0.62))
axes.set_box_aspect((2.0, 1.5, 1.24))
axes.set(xlabel="ω₁", ylabel="ω₂", zlabel="ω₃")
axes.set(xticks=[-1, 0, 1], yticks=[-0.5, 0, 0.5], zticks=[-0.5, 0, 0.5])
plt.show()

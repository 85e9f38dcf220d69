"""Nutation of a heavy top
Fig. 5.13-3 to 5.13-5: wavy, cuspidal and looping nutation

The path of the axis of a top on the sphere. Released at rest, it falls and
reaches cusps; an initial forward precession gives waves, a backward one
loops. The dashed circles are the turning points in closed form."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate_batch
from jaxspace.attitude import Top

jaxspace.enable_x64()
top = Top(transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08)
tilt = jnp.radians(35.0) * jnp.ones(3)
push = jnp.array([1.2, 0.0, -4.0])
start = top.state(
    [0.0 * tilt, tilt, 0.0 * tilt],
    [push, 0.0 * tilt, 60.0 - push * jnp.cos(tilt)],
)
run = simulate_batch(top, start, jnp.linspace(0.0, 1.9, 2400))
path = run.states.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None, None])
circles = top.nutation(start).turning_points

figure = plt.figure(figsize=(9.0, 3.5))
u, v = jnp.meshgrid(
    jnp.linspace(0, 2 * jnp.pi, 120), jnp.linspace(0, 0.92, 12)
)
for k, title in enumerate(("waves", "cusps", "loops")):
    axes = figure.add_subplot(1, 3, k + 1, projection="3d")
    axes.plot_surface(
        *(jnp.cos(u) * jnp.sin(v), jnp.sin(u) * jnp.sin(v), jnp.cos(v)),
        color="0.94",
        shade=False,
        rcount=12,
        ccount=120,
    )
    for angle in circles:
        ring = jnp.sin(angle[k]) * jnp.stack([jnp.cos(u[0]), jnp.sin(u[0])])
        axes.plot(
            *ring, jnp.cos(angle[k]), "--", color="0.5", lw=0.8, zorder=8
        )
    axes.plot(*(1.002 * path[:, :, k]), color=f"C{k}", zorder=9)
    axes.set(xlim=(-0.8, 0.8), ylim=(-0.8, 0.8), zlim=(0.55, 1.05))
    axes.set_box_aspect((1.6, 1.6, 0.5), zoom=1.3)
    axes.view_init(55, -60)
    axes.set_axis_off()
    axes.set_title(title)
plt.show()

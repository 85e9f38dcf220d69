"""Interception trajectories
Fig. 4.16-1: interception

Conics between two points with a transfer angle of 120 degrees and a radius
ratio of 1.5, for different times: the shorter the time, the straighter the
trajectory."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert

jaxspace.enable_x64()
start = jnp.array([1.0, 0.0, 0.0])
angle = jnp.radians(120.0)
target = 1.5 * jnp.stack([jnp.cos(angle), jnp.sin(angle), 0.0 * angle])
durations = jnp.array([1.0, 1.5, 2.0, 2.8, 4.0, 7.0])
v, _ = lambert(start[:, None], target[:, None], durations, 1.0)
share = jnp.linspace(0.0, 1.0, 200)[:, None]
x, y, _ = kepler_flow(
    start[:, None, None], v[:, None, :], share * durations, 1.0
)[0]

figure, axes = plt.subplots(figsize=(6.2, 4.6))
axes.add_patch(plt.Circle((0, 0), 0.5, color="0.88"))
for k, t in enumerate(durations):
    period = float(t) / (2.0 * jnp.pi)
    axes.plot(x[:, k], y[:, k], color=f"C{k}", label=f"{period:.2f}")
axes.plot(*start[:2], "ko", ms=5)
axes.plot(*target[:2], "ks", ms=5)
axes.set(xlabel="x / r", ylabel="y / r", aspect="equal")
axes.set_xticks([-0.5, 0.0, 0.5, 1.0])
axes.legend(
    title="time / period of\nthe initial orbit",
    loc="center left",
    bbox_to_anchor=(1.0, 0.5),
)
plt.show()

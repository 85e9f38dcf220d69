"""Spin about a non-principal axis
Fig. 7.4-3: a tilted spin axis

A nearly symmetric body spins about an axis 0.05 rad from its principal axis.
In inertial space, the marked axis circles the principal axis once per
revolution, while the principal axis circles the angular momentum."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.rotations import Quaternion

jaxspace.enable_x64()
beta, n = 0.05, 10.0  # rad, rad/s
t = jnp.linspace(0.0, 2.5, 1000)
figure, panels = plt.subplots(1, 2, figsize=(8.2, 4.0))
for axes, ratio in zip(panels, (0.4, 1.6), strict=True):  # C / A
    # In principal axes the marked axis, about which it spins, leans by beta.
    marked = jnp.array([jnp.sin(beta), 0.0, jnp.cos(beta)])
    start = BodyState(attitude=Quaternion.about(1, -beta), omega=n * marked)
    body = TorqueFreeBody(jnp.array([1.0, 1.0, ratio]))
    y = simulate(body, start, t).states
    tip = y.attitude.rotate(marked[:, None])
    principal = y.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None])
    axes.plot(1e3 * tip[0], 1e3 * tip[1], label="marked axis")
    axes.plot(1e3 * principal[0], 1e3 * principal[1], label="principal axis")
    axes.plot(0.0, 0.0, "ko", ms=4)
    axes.set(xlabel="X, mrad", title=f"C / A = {ratio:g}", aspect="equal")
panels[0].set_ylabel("Y, mrad")
lines, names = panels[1].get_legend_handles_labels()
figure.legend(lines, names, loc="outside lower center", ncols=2)
plt.show()

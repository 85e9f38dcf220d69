r"""Axis of a spinning body after an impulse
Fig. 7.3-2: angle of attack of a spinning body

The tip of the axis of a free symmetric body with an initial transverse rate,
viewed along its initial direction: a circle of radius $\omega_0/(nC/A)$
through the initial point. Dots every tenth of a second."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.rotations import Quaternion

jaxspace.enable_x64()
n, w0 = 6.0, 0.15  # rad/s
t = jnp.linspace(0.0, 4.0, 401)
figure, axes = plt.subplots(figsize=(5.6, 4.4))
for ratio in (0.3, 0.5, 1.0, 1.6):  # C / A
    start = BodyState(
        attitude=Quaternion.identity(), omega=jnp.array([w0, 0.0, n])
    )
    body = TorqueFreeBody(jnp.array([1.0, 1.0, ratio]))
    y = simulate(body, start, t).states
    x = jnp.degrees(y.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None]))
    (line,) = axes.plot(x[0], x[1], label=f"{ratio:g}")
    axes.plot(x[0, ::10], x[1, ::10], ".", color=line.get_color(), ms=4)
axes.plot(0.0, 0.0, "ko", ms=4)
axes.set(xlabel="X component of the axis direction, deg", aspect="equal")
axes.set(ylabel="Y component of the axis direction, deg")
axes.legend(title="C / A")
plt.show()

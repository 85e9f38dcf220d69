"""Spherical pendulum
Spherical pendulum from above

The bob of a pendulum that also moves around the vertical (Ex. 9.8-1), viewed
from above: between two circles it follows an ellipse that precesses forward,
faster for larger amplitudes. The conical pendulum moves on a single
circle."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate_batch
from jaxspace.attitude import SphericalPendulum

jaxspace.enable_x64()
length, tilt = 2.0, jnp.radians(60.0)
pendulum = SphericalPendulum(length, 9.80665)
conical = pendulum.conical_rate(tilt)
rates = jnp.stack([0.15, 0.4, 1.0]) * conical
y0 = pendulum.state(tilt, psi_rate=rates)
time = jnp.linspace(0.0, 12.0, 1501)
run = simulate_batch(pendulum, y0, time, accuracy=1e-9)
x, y, _ = length * run.states.direction
figure, three = plt.subplots(1, 3, figsize=(8.4, 3.2), sharey=True)
for k, axes in enumerate(three):
    radius = jnp.hypot(x[:, k], y[:, k])
    for edge in (jnp.min(radius), jnp.max(radius)):
        ring = plt.Circle((0.0, 0.0), edge, fill=False, color="0.6", ls=":")
        axes.add_patch(ring)
    axes.plot(x[:, k], y[:, k], lw=1.0)
    axes.plot(x[0, k], y[0, k], "o", color="C1", ms=5)
    share = float(rates[k] / conical)
    axes.set_title(f"{share:.2f} x conical rate")
    axes.set(
        xlabel="x, m", aspect="equal", xlim=(-1.9, 1.9), ylim=(-1.9, 1.9)
    )
three[0].set_ylabel("y, m")
plt.show()

"""Attitude drift caused by flexible antennas
Fig. 9.8-3: drift of a satellite with whip antennas

The drift rate of the axis of a spinning satellite caused by the bending of
its antennas, against its tilt: it peaks at the resonance, where the cosine of
the tilt is the inverse ratio of spin to antenna frequency."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import AttitudeDrift

jaxspace.enable_x64()
theta = jnp.linspace(0.0, 0.5 * jnp.pi, 500)
figure, axes = plt.subplots(figsize=(7.4, 4.0))
for ratio in (0.6, 1.2, 1.6):
    drift = AttitudeDrift(6.6e-4, ratio, 0.05)
    axes.semilogy(
        jnp.degrees(theta), drift.rate(theta), label=f"ratio {ratio}"
    )
    if ratio > 1.0:
        axes.axvline(
            jnp.degrees(jnp.arccos(1.0 / ratio)), color="0.4", lw=0.8
        )
axes.set(xlabel="tilt, deg", ylabel="tilt rate, rad/s", ylim=(1e-6, 1.0))
axes.legend()
plt.show()

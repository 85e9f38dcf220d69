r"""Speed and flight-path angle along an orbit
Fig. 4.13-2 and 4.13-3: speed and flight-path angle along an orbit

The flight-path angle $\beta$ against $\lambda = rv^2/\mu$, on lines of
constant eccentricity, along which an orbit moves, and on lines of constant
true anomaly. An impulse moves the state from one point to another."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.burnout import elements_from_burnout

jaxspace.enable_x64()
lam = jnp.linspace(0.02, 2.8, 300)
beta = jnp.radians(jnp.linspace(0.0, 89.0, 300))[:, None]
orbit = elements_from_burnout(1.0, jnp.sqrt(lam), beta, 1.0)
figure, axes = plt.subplots(figsize=(6.8, 4.8))
lines = axes.contour(
    *(lam, jnp.degrees(beta[:, 0]), orbit.eccentricity),
    levels=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5],
    colors="C0",
    linewidths=1.0,
)
axes.clabel(lines, fontsize=7)
lines = axes.contour(
    *(lam, jnp.degrees(beta[:, 0]), jnp.degrees(orbit.true_anomaly)),
    levels=[15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165],
    colors="C1",
    linewidths=0.8,
    linestyles="--",
)
axes.clabel(lines, fontsize=7, fmt="%.0f deg")
axes.set(xlabel="λ, 1", ylabel="β, deg")
axes.set_title("Eccentricity (blue) and true anomaly (red)")
plt.show()

r"""Gravity-gradient stability of a satellite
Stability map of the gravity gradient

A body at rest in the axes of its circular orbit (7.4 P14), by its inertia
ratios:
$k_\text{roll} = (I_\text{normal} - I_\text{outward})/I_\text{tangent}$ and
$k_\text{yaw} = (I_\text{normal} - I_\text{tangent})/I_\text{outward}$. Growth
rate of the fastest mode, from the equations of small librations; white is
stable."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace

jaxspace.enable_x64()
roll, yaw = jnp.meshgrid(jnp.linspace(-1, 1, 401), jnp.linspace(-1, 1, 401))
# Pitch: s^2 + 3 k_pitch = 0, in units of the orbital rate.
pitch = (roll - yaw) / (1.0 - roll * yaw)
# Roll and yaw: s^4 + (1 + 3 k_r + k_r k_y) s^2 + 4 k_r k_y = 0.
half = 0.5 * (1.0 + 3.0 * roll + roll * yaw) + 0j
root = jnp.sqrt(half**2 - 4.0 * roll * yaw)
squares = jnp.stack([-3.0 * pitch + 0j, -half + root, -half - root])
growth = jnp.max(jnp.sqrt(squares).real, axis=0)
growth = jnp.where(growth > 1e-6, growth, jnp.nan)

figure, axes = plt.subplots(figsize=(5.8, 4.8))
shades = axes.pcolormesh(roll, yaw, growth, cmap="YlOrBr", vmin=0.0)
figure.colorbar(shades, label="growth rate / orbital rate")
axes.axhline(0.0, color="0.4", lw=0.8)
axes.axvline(0.0, color="0.4", lw=0.8)
axes.plot([-1, 1], [-1, 1], color="0.4", lw=0.8)
axes.set(xlabel="k_roll", ylabel="k_yaw", aspect="equal")
axes.text(0.52, 0.2, "Lagrange", fontsize=8)
axes.annotate(
    *("DeBra and Delp", (-0.12, -0.62), (0.15, -0.75)),
    arrowprops={"arrowstyle": "-", "color": "0.3"},
    fontsize=8,
)
axes.grid(False)
plt.show()

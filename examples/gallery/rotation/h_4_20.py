r"""Spin for a steady precession
H 4.20: steady precession against spin

At each angle there is a slow and a fast precession above the minimum spin; a
hanging top (above 90 degrees) precesses at any spin, in both directions. The
dashed line is the gyroscopic rate $mgh/(I_3\omega)$ (H 4.11)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import Top

jaxspace.enable_x64()
top = Top(transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08)
spin = jnp.linspace(0.5, 100.0, 600)
figure, axes = plt.subplots()
for k, degrees in enumerate((0.01, 30.0, 60.0, 80.0, 120.0)):
    tilt = jnp.radians(degrees)
    # From the least spin on, where both rates meet.
    least = top.least_spin(tilt)
    above = jnp.where(degrees < 90.0, least * (1.0 + 1e-9), 0.5)
    n = above + (100.0 - above) * jnp.linspace(0.0, 1.0, 600) ** 2
    slow, fast = top.steady_precession_rates(tilt, n)
    axes.plot(n, slow, color=f"C{k}", label=f"{degrees:.0f} deg")
    axes.plot(n, fast, color=f"C{k}")
axes.plot(spin, 0.08 / (6.0e-4 * spin), "--", color="0.5", lw=1.0)
axes.set(xlabel="spin, rad/s", ylabel="precession rate, rad/s")
axes.set(ylim=(-30.0, 80.0), xlim=(0.0, 100.0))
axes.legend(title="θ")
plt.show()

r"""Horizontal launches
Fig. 4.10-1: launches along the horizon

Launches from one point at several speeds: $e = \lvert\lambda - 1\rvert$.
Below $\lambda = 1$ the burnout point is the apoapsis, above it the periapsis;
from $\lambda = 2$ on the orbit is open."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.burnout import elements_from_burnout

jaxspace.enable_x64()
figure, axes = plt.subplots(figsize=(6.4, 4.4))
axes.add_patch(plt.Circle((0, 0), 0.9, color="0.88"))
for lam in (0.75, 1.0, 1.3, 1.6, 2.0, 2.5):
    orbit = elements_from_burnout(1.0, jnp.sqrt(lam), 0.0, 1.0)
    e, p = orbit.eccentricity, orbit.semi_latus_rectum
    f = jnp.linspace(0.0, 2.0 * jnp.pi, 2000) + orbit.true_anomaly
    r = p / (1.0 + e * jnp.cos(f))
    r = jnp.where((r > 0.0) & (r < 12.0), r, jnp.nan)
    turn = f - orbit.true_anomaly
    label = f"{lam:g}: e = {float(e):.2f}"
    axes.plot(r * jnp.cos(turn), r * jnp.sin(turn), label=label)
axes.plot(1.0, 0.0, "ko", ms=4)
axes.set(xlim=(-5.2, 2.2), ylim=(-3.0, 3.0), aspect="equal")
axes.set(
    xlabel="x / r", ylabel="y / r", title="Orbits by lambda = r v^2 / mu"
)
axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.show()

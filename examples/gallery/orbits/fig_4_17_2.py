r"""Range of a ballistic flight
Fig. 4.17-2: range of a ballistic flight

The central angle against the flight-path angle at burnout, for several
$\lambda = Rv^2/\mu$. The dashed line connects the maximum ranges: for
$\lambda = 1$ it reaches half of the Earth's circumference for a horizontal
launch."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.ballistic import ballistic_flight, longest_range

jaxspace.enable_x64()
beta = jnp.radians(jnp.linspace(0.01, 89.9, 300))
figure, axes = plt.subplots(figsize=(6.8, 4.6))
for k, lam in enumerate((0.2, 0.4, 0.6, 0.8, 0.9, 1.0, 1.1)):
    flight = ballistic_flight(1.0, jnp.sqrt(lam), beta, 1.0)
    line = jnp.degrees(flight.range_angle)
    axes.plot(jnp.degrees(beta), line, color=f"C{k}", label=f"{lam:g}")
speed = jnp.sqrt(jnp.linspace(0.01, 0.9999, 200))
longest, best = longest_range(1.0, speed, 1.0)
axes.plot(jnp.degrees(best), jnp.degrees(longest), "--", color="0.4", lw=1.0)
axes.set(xlabel="flight-path angle at burnout, deg", ylabel="range, deg")
axes.set(yticks=range(0, 361, 60), xticks=range(0, 91, 15))
axes.legend(title="lambda")
plt.show()

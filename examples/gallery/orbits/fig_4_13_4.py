r"""Time of flight from periapsis
Fig. 4.13-4 and 4.13-5: time of flight from the periapsis

Time against the true anomaly, in units of $\sqrt{r_p^3/\mu}$, for ellipses,
the parabola and hyperbolas, computed with one formula."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.time_of_flight import time_of_flight

jaxspace.enable_x64()
figure, axes = plt.subplots(figsize=(6.8, 4.6))
for k, e in enumerate((0.0, 0.3, 0.6, 0.9, 1.0, 1.5, 2.0, 3.0, 5.0)):
    # An open orbit comes from infinity where 1 + e cos f is zero.
    end = jnp.pi if e < 1.0 else jnp.arccos(-1.0 / e)
    f = jnp.linspace(0.0, 1.0, 300) * end * (1.0 if e < 1.0 else 0.999)
    t = time_of_flight(0.0, f, 1.0 + e, e, 1.0)
    style = "-" if e < 1.0 else "--" if e == 1.0 else ":"
    axes.semilogy(
        jnp.degrees(f)[1:], t[1:], style, color=f"C{k % 7}", label=f"{e:g}"
    )
axes.set(xlabel="true anomaly, deg", ylabel="time / sqrt(r_p^3 / mu)")
axes.set(ylim=(0.01, 200.0), xticks=range(0, 181, 30))
axes.legend(title="eccentricity", ncols=2)
plt.show()

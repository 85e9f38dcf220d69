"""Time to flat spin
Fig. 7.6-4: attitude drift by structural damping

The angle between the axis of a slender body and its angular momentum against
time, in units of the inverse drift constant K: the body ends in a flat spin,
which it approaches ever more slowly. The drift is fastest at 35.3 degrees
(dots)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import AttitudeDrift

jaxspace.enable_x64()
drift = AttitudeDrift(drift_constant=1.0)
fastest = jnp.arctan(jnp.sqrt(0.5))
figure, axes = plt.subplots()
for k, degrees in enumerate((0.5, 1.0, 5.0, 20.0)):
    start = jnp.radians(degrees)
    on = jnp.linspace(start, jnp.radians(86.0), 400)
    time = drift.drift_time(start, on)
    axes.plot(time, jnp.degrees(on), label=f"{degrees:g} deg")
    at = drift.drift_time(start, fastest), jnp.degrees(fastest)
    axes.plot(*at, "o", color=f"C{k}", ms=4)
axes.set(xlabel="K t", ylabel="angle to the angular momentum, deg")
axes.set(yticks=range(0, 91, 15), xlim=(0.0, 16.0))
axes.legend(title="initial angle")
plt.show()

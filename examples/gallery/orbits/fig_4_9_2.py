r"""Orbit from burnout conditions
Fig. 4.9-2: shape of the orbit from the burnout

Eccentricity and true anomaly at burnout against the speed,
$\lambda = rv^2/\mu$, for several flight-path angles $\beta$."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.burnout import elements_from_burnout

jaxspace.enable_x64()
speed = jnp.sqrt(jnp.linspace(0.02, 2.6, 400))
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 4.0))
for degrees in (0.01, 10.0, 20.0, 30.0, 45.0, 60.0):
    orbit = elements_from_burnout(1.0, speed, jnp.radians(degrees), 1.0)
    left.plot(speed**2, orbit.eccentricity, label=f"{degrees:.0f} deg")
    anomaly = jnp.degrees(orbit.true_anomaly) % 360.0
    right.plot(speed**2, anomaly)
left.axvline(2.0, color="0.6", lw=0.8, ls="--")
left.text(2.02, 0.05, "escape", fontsize=8, color="0.4")
left.set(xlabel="lambda, 1", ylabel="eccentricity, 1", ylim=(0.0, 1.65))
left.legend(title="β")
right.set(xlabel="lambda, 1", ylabel="true anomaly at burnout, deg")
right.set(yticks=range(0, 181, 30))
plt.show()

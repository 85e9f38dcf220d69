"""Settling coin
Rattle of a settling coin

A half dollar that spins down under a small contour resistance: as it settles,
its contact point moves around the rim with increasing frequency, and stops
abruptly at the end (5.16). Simulation, with the closed forms for small tilts
dotted."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate
from jaxspace.attitude import RollingDisk, Top
from jaxspace.attitude.disk_tilt import disk_tilt

jaxspace.enable_x64()
m, R, g, damping = 0.0113, 0.0153, 9.80665, 4.0e-9
coin = RollingDisk(m, R, 0.25 * m * R**2, 0.5 * m * R**2, g, damping)
tilt = jnp.array(0.12)
rate = jnp.sqrt(4.0 * g / (R * jnp.sin(tilt)))
# Without spin about the normal: it rattles round at one place.
start = coin.state([0.0, tilt, 0.0], [rate, 0.0, -rate * jnp.cos(tilt)])
end = coin.settling_time(tilt)
t = end * (1.0 - jnp.linspace(1.0, 0.05, 500) ** 2)
states = simulate(coin, start, t, accuracy=1e-10).states
small = tilt * jnp.sqrt(1.0 - t / end)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
left.plot(t, jnp.degrees(disk_tilt(states.attitude)))
left.plot(t, jnp.degrees(small), "k:", lw=1.2)
left.set(xlabel="time, s", ylabel="tilt, deg")
right.plot(t, Top.rates(states)[0] / (2.0 * jnp.pi), color="C1")
right.plot(t, jnp.sqrt(4.0 * g / (R * small)) / (2.0 * jnp.pi), "k:", lw=1.2)
right.set(xlabel="time, s", ylabel="rattle, 1/s")
plt.show()

"""Onset of chaos
Poincare section of a double pendulum

Each time the upper rod swings through the vertical to the right, the angle
and rate of the lower rod are plotted as a dot (9.3). At low energy every
motion lies on a closed curve, a mixture of the two modes; at higher energy
the curves between them break up and a single chaotic motion fills an area."""

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxspace
from jaxspace import simulate_batch
from jaxspace.mechanics import DoublePendulum

jaxspace.enable_x64()
swing = DoublePendulum(2.0, 1.0, 1.0, 0.8, 9.80665)
bottom = swing.energy(0.0, swing.state(0.0, 0.0))
time = jnp.linspace(0.0, 240.0, 12001)
figure, both = plt.subplots(1, 2, figsize=(8.4, 3.8))
for axes, energy in zip(both, (1.5, 17.0), strict=True):
    # All start hanging straight, with other shares of the energy below.
    share = jnp.linspace(-0.95, 0.95, 10)
    rate = share * jnp.sqrt(2.0 * energy / 0.64)
    # (m1 + m2) l1^2 a'^2 / 2 + m2 l1 l2 a' b' + m2 l2^2 b'^2 / 2 = E
    rest = (0.8 * rate) ** 2 - 6.0 * (0.32 * rate**2 - energy)
    upper = (-0.8 * rate + jnp.sqrt(jnp.maximum(rest, 0.0))) / 3.0
    y0 = swing.state(0.0 * rate, 0.0 * rate, upper, rate)
    run = simulate_batch(swing, y0, time, accuracy=1e-8)
    q, v = np.asarray(run.states.coordinates), np.asarray(run.states.rates)
    for k in range(len(share)):
        a, b, w = q[0, :, k], q[1, :, k], v[1, :, k]
        i = np.flatnonzero((a[:-1] < 0.0) & (a[1:] >= 0.0))
        # Between two states 0.02 s apart the motion is nearly straight.
        part = -a[i] / (a[i + 1] - a[i])
        angle = b[i] + part * (b[i + 1] - b[i])
        angle = np.degrees((angle + np.pi) % (2.0 * np.pi) - np.pi)
        axes.plot(angle, w[i] + part * (w[i + 1] - w[i]), ".", ms=2.0)
    axes.set(xlabel="lower angle, deg", title=f"Energy {energy:g} J")
both[0].set_ylabel("lower angle rate, rad/s")
plt.show()

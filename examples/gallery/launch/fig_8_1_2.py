"""Velocity at burnout
Burnout velocity of a single stage

A single stage that rises vertically (8.1): burnout speed against the
remaining mass fraction, for three specific impulses; thrust-to-weight ratio
1.5 (dashed) and 3."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.rockets.rocket_equation import vertical_burnout_velocity

jaxspace.enable_x64()
g, left = 9.80665, jnp.linspace(0.02, 0.6, 200)

figure, axes = plt.subplots()
for k, impulse in enumerate((200.0, 300.0, 400.0)):
    for ratio, line in ((1.5, "--"), (3.0, "-")):
        time = impulse / ratio * (1.0 - left)
        v = vertical_burnout_velocity(impulse * g, 1.0 / left, time, g)
        label = f"I = {impulse:.0f} s" if ratio == 3.0 else None
        axes.plot(left, v / 1e3, line, color=f"C{k}", label=label)
axes.set(xlabel="burnout mass / initial mass", ylabel="speed, km/s")
axes.set(xlim=(0.0, 0.6), ylim=(0.0, None))
axes.legend()
plt.show()

"""Gravity turns
Trajectories of gravity turns

Thrust along the velocity, with the trajectory curved by gravity only (8.5):
thrust-to-weight ratio 1.5, from 120 m/s at angles of 2 to 30 degrees from the
vertical, up to 85 degrees; dots every 20 s. Closed form."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.rockets import GravityTurnState
from jaxspace.rockets.gravity_turn import gravity_turn, gravity_turn_after

jaxspace.enable_x64()
n, g, v0 = 1.5, 9.81, 120.0

figure, axes = plt.subplots(figsize=(5.8, 4.0))
for degrees in (2, 5, 10, 20, 30):
    start = jnp.radians(degrees)
    angle = jnp.linspace(start, jnp.radians(85.0), 200)
    time, path = gravity_turn(angle, n, g, v0, start)
    label = f"{degrees} deg"
    (line,) = axes.plot(path.range / 1e3, path.height / 1e3, label=label)
    first = GravityTurnState(v0, start, 0.0, 0.0)
    dots = gravity_turn_after(jnp.arange(0.0, time[-1], 20.0), n, g, first)
    axes.plot(
        dots.range / 1e3, dots.height / 1e3, ".", color=line.get_color()
    )
axes.set(xlabel="range, km", ylabel="height, km", aspect="equal")
axes.legend(title="initial angle")
plt.show()

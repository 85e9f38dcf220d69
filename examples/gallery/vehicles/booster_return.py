"""Return of a first stage
A first stage returns under a parachute

A launcher from a scene file: after the first stage the mission branches. The
second stage continues into its orbit, and the empty first stage falls and
descends under a parachute. Crosses mark the ends of the phases; right: the
speed relative to the ground."""

from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.core.vectors import cross, norm

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "booster_return.toml")
run = file.nominal_mission(samples=60)
planet = file.values["planet"]
radius, turn = planet["radius"], jnp.array([0.0, 0.0, 7.2921159e-5])

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.4))
lines = {"launcher": run.without_branches(), "first stage": run["booster"]}
for name, line in lines.items():
    r, v, t = (
        jnp.concatenate([getattr(phase, part) for phase in parts], axis=-1)
        for parts, part in (
            ([phase.states for phase in line], "position"),
            ([phase.states for phase in line], "velocity"),
            (line.phases, "ts"),
        )
    )
    height = norm(r) - radius
    # From the pad, which turns with the planet.
    east = radius * (jnp.arctan2(r[1], r[0]) - turn[2] * t)
    speed = norm(v - cross(turn[:, None], r))
    (curve,) = left.plot(east / 1e3, height / 1e3, label=name)
    right.plot(t, speed / 1e3)
    ends = jnp.arange(60, t.size + 1, 60) - 1
    left.plot(east[ends] / 1e3, height[ends] / 1e3, "x", c=curve.get_color())
    print(name, "east, km", east[-1] / 1e3, "speed, m/s", speed[-1])
left.set(xlabel="ground range, km", ylabel="height, km")
left.legend()
right.set(xlabel="time, s", ylabel="ground speed, km/s")
plt.show()

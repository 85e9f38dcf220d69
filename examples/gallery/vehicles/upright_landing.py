"""Upright powered landing
An upright landing on a pad

A stage of one tonne lands with a throttled and gimballed engine with rate
limits, in random winds. Left: the trajectories of some flights; middle: the
tilt of their axes; right: the touchdown points of a thousand flights about
the centre of the pad."""

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate_mission_batch

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "upright_landing.toml")
campaign = file.campaign()


@jax.jit
def fly(numbers):
    samples = campaign.samples(jax.random.key(1), numbers)
    mission, y0 = file.build(samples)
    run = simulate_mission_batch(mission, y0, num_saved=61, accuracy=1e-4)
    return run.phases[0], run.final


phase, final = fly(jnp.arange(1000))
up = jnp.array([0.0, 0.0, 1.0])
tilt = jnp.degrees(jnp.arccos(final.attitude.rotate(up[:, None])[2]))
speed = jnp.linalg.norm(final.velocity, axis=0)
away = jnp.linalg.norm(final.position[:2], axis=0)
for name, x in {
    "tilt, deg": tilt,
    "speed, m/s": speed,
    "away, m": away,
}.items():
    print(name, jnp.mean(x), jnp.percentile(x, 99.0), jnp.max(x))
print("burnt, kg", jnp.mean(1100.0 - final.mass), jnp.std(final.mass))

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(8.4, 3.2))
x, _, z = phase.states.position
left.plot(x[:, :12], z[:, :12], lw=0.9, color="C0")
left.set(xlabel="east of the pad, m", ylabel="height, m")
axis = phase.states.attitude.rotate(up[:, None, None])
lean = jnp.degrees(jnp.arccos(jnp.minimum(axis[2], 1.0)))
middle.plot(phase.ts[:, :12], lean[:, :12], lw=0.9, color="C1")
middle.set(xlabel="time, s", ylabel="tilt, deg")
right.plot(*final.position[:2], ".", ms=2)
right.plot(0.0, 0.0, "k+", ms=8)
right.set(xlabel="east, m", ylabel="north, m", aspect="equal")
plt.show()

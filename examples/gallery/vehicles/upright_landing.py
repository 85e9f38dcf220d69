"""An upright landing

A stage of a tonne lands by an engine that is throttled and turned at limited
rates, in winds that scatter. On the left the paths of some flights with the
axis of the body every two seconds; on the right where a thousand touch the
ground, by their tilt there."""

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

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 4.4))
x, _, z = phase.states.position
axis = phase.states.attitude.rotate(up[:, None, None])
for k in range(6):
    left.plot(x[:, k], z[:, k], lw=0.9, color="C0")
    # As long as 40 m, so that it is seen.
    for i in range(0, 61, 4):
        tip = x[i, k] + 40.0 * axis[0, i, k], z[i, k] + 40.0 * axis[2, i, k]
        left.plot((x[i, k], tip[0]), (z[i, k], tip[1]), color="C1", lw=1.2)
left.set(xlabel="east of the pad, m", ylabel="height, m", aspect="equal")
dots = right.scatter(*final.position[:2], c=tilt, s=5, cmap="YlOrBr")
figure.colorbar(dots, label="tilt at the ground, deg")
right.set(xlabel="east, m", ylabel="north, m", aspect="equal")
plt.show()

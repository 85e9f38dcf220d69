"""Air brake to a target apogee
An air brake controls the apogee

A sounding rocket with dispersed motor, mass and drag: the apogees of a
thousand flights, with initial gains, and with gains optimised by gradient
descent over 64 flights. Right: the brake deflection in ten flights; the
apogee is predicted twenty times per second."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxspace
from jaxspace import simulate_mission_batch

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "air_brake.toml")
campaign, target = file.campaign(), 3000.0
guess = jnp.array([0.05, 4e-4, 0.3])


def gains(mission):
    law = mission.phases[0].system.controller
    return [law.gain, law.drag, law.share]


@jax.jit
def fly(law, numbers):
    samples = campaign.samples(jax.random.key(1), numbers)
    mission, y0 = file.build(samples)
    mission = eqx.tree_at(gains, mission, list(law * guess))
    run = simulate_mission_batch(mission, y0, num_saved=121, accuracy=1e-4)
    phase = run.phases[0]
    return run.final.position[2], phase.ts, phase.states.part("air_brake")


@jax.jit
def miss(law, along):
    """The root mean square of the misses of 64 flights, and its slopes."""
    numbers = jnp.arange(64)

    def squares(law):
        return jnp.sqrt(jnp.mean((fly(law, numbers)[0] - target) ** 2))

    return jax.vmap(lambda d: jax.jvp(squares, (law,), (d,)))(along)


law, step = jnp.ones(3), 0.3
for _ in range(14):
    found, slope = miss(law, jnp.eye(3))
    law = law - step * slope / jnp.linalg.norm(slope)
    step *= 0.8
print("gain, drag and share", law * guess, "miss of 64", found[0])

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for values, name in (
    (jnp.ones(3), "initial gains"),
    (law, "optimised gains"),
):
    apogees, ts, share = fly(values, jnp.arange(64, 1064))
    error = np.abs(apogees - target)
    print(name, np.mean(error), np.max(error), np.mean(error < 5.0))
    left.hist(apogees - target, 40, alpha=0.8, label=name)
left.set(xlabel="apogee - 3000 m, m", ylabel="number of flights (of 1000)")
left.legend()
right.plot(ts[:, :10], share[:, :10], color="C1", lw=0.9)
right.set(xlabel="time, s", ylabel="brake opening, 0 to 1")
plt.show()

"""Roll control with canards
Roll held by canards

A sounding rocket with randomly misaligned tail fins, with a standard
deviation of half a degree, in a thousand flights: without control the roll
rate increases with speed (grey); with a controller that moves four canards
fifty times per second the roll angle is held. Left: some of the flights;
right: the final roll angle of all but a few flights whose misalignment
exceeds the control authority."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate_mission_batch

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "roll_control.toml")
campaign = file.campaign()


def gains(mission):
    law = mission.phases[0].system.controller
    return [law.gain, law.damping, law.integral]


@jax.jit
def fly(power, numbers):
    """Times, s, roll rates, rad/s, and angles of the body's roll, deg."""
    samples = campaign.samples(jax.random.key(1), numbers)
    mission, y0 = file.build(samples)
    law = [power * gain for gain in gains(mission)]
    mission = eqx.tree_at(gains, mission, law)
    run = simulate_mission_batch(mission, y0, num_saved=101, accuracy=1e-4)
    phase = run.phases[0]
    w, _, _, z = phase.states.attitude.wxyz
    return (
        phase.ts,
        phase.states.omega[2],
        jnp.degrees(2.0 * jnp.arctan2(z, w)),
    )


figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
ts, rate, _ = fly(0.0, jnp.arange(1000))
left.plot(ts[:, :8], rate[:, :8] / (2.0 * jnp.pi), color="0.6", lw=0.9)
print("left alone", rate[-1].mean(), rate[-1].std())
ts, rate, roll = fly(1.0, jnp.arange(1000))
left.plot(ts[:, :8], rate[:, :8] / (2.0 * jnp.pi), color="C1", lw=0.9)
print("held within 2 deg", jnp.mean(jnp.abs(roll[-1]) < 2.0), rate[-1].std())
left.set(xlabel="time, s", ylabel="roll rate, rev/s")
right.hist(roll[-1], 40, range=(-4.0, 4.0))
right.set(
    xlabel="final roll angle, deg", ylabel="number of flights (of 1000)"
)
plt.show()

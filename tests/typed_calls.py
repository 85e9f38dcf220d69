"""What type checkers see of the verbs: `make types` reads it, and nothing runs it.

A line with an `ignore` must be an error of its kind, or it is one itself."""

# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnnecessaryTypeIgnoreComment=true

from typing import assert_type

import jax.numpy as jnp

from jaxspace import (
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    Trajectory,
    simulate,
    simulate_batch,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.control import ClosedLoop, LoopRun
from jaxspace.simulation import Accuracy, MissionTrajectory
from jaxspace.studies import (
    MissionCovariance,
    MissionSensitivity,
    Sensitivity,
    propagate_covariance,
    sensitivity,
)


def systems(scene: Scene, y0: BodyState, event: Event) -> None:
    """Runs of a system, at times that are an array or a list."""
    run = simulate(scene, y0, [0.0, 1.0], accuracy=1e-9, events=[event], dense=True, throw=False)
    assert_type(run, Trajectory)
    assert_type(simulate_batch(scene, y0, jnp.zeros(2), accuracy=Accuracy(1e-6)), Trajectory)
    simulate(scene, y0)  # pyright: ignore[reportCallIssue]
    simulate(scene, y0, [0.0, 1.0], num_saved=3)  # pyright: ignore[reportCallIssue]
    simulate(scene, y0, [0.0, 1.0], accuracy="high")  # pyright: ignore[reportArgumentType]
    simulate_mission(scene, y0)  # pyright: ignore[reportArgumentType]
    simulate_mission_batch(scene, y0)  # pyright: ignore[reportArgumentType]


def missions(mission: Mission, y0: BodyState, event: Event) -> None:
    """Runs of a mission, from zero or another time."""
    assert_type(simulate_mission(mission, y0), MissionTrajectory)
    # A name may be that of a branch, which is a mission: the type is for the reader to say.
    phase: Trajectory = simulate_mission(mission, y0, 1.0, num_saved=3)["up"]
    assert_type(phase, Trajectory)
    assert_type(simulate_mission_batch(mission, y0, jnp.zeros(2)), MissionTrajectory)
    simulate(mission, y0, [0.0, 1.0])  # pyright: ignore[reportArgumentType]
    simulate_batch(mission, y0, [0.0, 1.0])  # pyright: ignore[reportArgumentType]
    simulate_mission(mission, y0, events=[event])  # pyright: ignore[reportCallIssue]


def sensitivities(scene: Scene, mission: Mission, y0: BodyState) -> None:
    """Derivatives of a run: what comes back follows from what is given."""
    ts = jnp.zeros(2)
    assert_type(sensitivity(scene, y0, ts, dense=True), tuple[Trajectory, Sensitivity])
    assert_type(sensitivity(mission, y0, num_saved=3), tuple[MissionTrajectory, MissionSensitivity])
    run, covariance = propagate_covariance(mission, y0, num_saved=3)
    assert_type(run, MissionTrajectory)
    assert_type(covariance, MissionCovariance)
    assert_type(propagate_covariance(scene, y0, ts)[0], Trajectory)


def loops(loop: ClosedLoop, event: Event, y0: BodyState) -> Mission:
    """Runs of a loop, alone and as a phase."""
    assert_type(loop.simulate(y0, [0.0, 1.0], events=event, steps=2), LoopRun)
    assert_type(loop.simulate_batch(y0, [0.0, 1.0], throw=True), LoopRun)
    return Mission([Phase(loop, event)])

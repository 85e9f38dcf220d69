"""The verb that propagates a covariance along a run or through a mission."""

import functools
from collections.abc import Sequence
from typing import overload

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import AbstractSystem, InputError, State
from ..integration.layout import broadcast_state
from ..simulation import Accuracy, Event, Mission, MissionTrajectory, Trajectory
from ..simulation.batch_layout import InAxes
from ..simulation.dispatch import simulate_any
from ..simulation.legs import check_one_line
from ..simulation.runnable import AbstractRunnable
from ._factors import Factors, factors_of
from ._mission_covariance import MissionCovariance, covariance_of, uncertain_mission
from .coordinates import Coordinates
from .covariance import Noise, Uncertain


@overload
def propagate_covariance(
    system: AbstractSystem,
    y0: State,
    ts: Float[ArrayLike, "times *#runs"],
    covariance: Float[ArrayLike, "n n *#runs"] | None = None,
    *,
    noise: Noise = None,
    batch: bool = False,
    in_axes: InAxes = None,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    throw: bool | None = None,
) -> tuple[Trajectory, Float[Array, "n n times *runs"]]:
    """The covariance along a run of a system."""
    ...


@overload
def propagate_covariance(
    system: Mission,
    y0: State,
    ts: Float[ArrayLike, "*runs"] = 0.0,
    covariance: Float[ArrayLike, "n n *#runs"] | None = None,
    *,
    noise: Noise | Sequence[Noise] = None,
    batch: bool = False,
    in_axes: InAxes = None,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    num_saved: int = 2,
    throw: bool | None = None,
) -> tuple[MissionTrajectory, MissionCovariance]:
    """The covariance along the phases of a mission."""
    ...


def propagate_covariance(
    system: AbstractSystem | Mission,
    y0: State,
    ts: Float[ArrayLike, "*times"] = 0.0,
    covariance: Float[ArrayLike, "n n *#runs"] | None = None,
    *,
    noise: Noise | Sequence[Noise] = None,
    batch: bool = False,
    in_axes: InAxes = None,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    num_saved: int | None = None,
    throw: bool | None = None,
) -> (
    tuple[Trajectory, Float[Array, "n n times *runs"]] | tuple[MissionTrajectory, MissionCovariance]
):
    """The run of the mean with the covariance of its state under white noise, to first order.

    **Arguments**

    - `system`, `y0`, `ts`: a system and its save times, as in `simulate`, or a mission and the time
      of its start, as in `simulate_mission`.
    - `covariance`: that of the initial state, (n, n), in the coordinates of `Sensitivity.rows`;
      zero by default.
    - `noise`: the spectral density Q of the process noise, (n, n), per s, or a function of the time
      and the state; for a mission common to all phases, or a list with one for each.
    - `batch`: whether the last axis is the batch axis, as in `simulate_batch`; `in_axes` as there.
    - `accuracy`: as in `simulate`.
    - `events`, `dense`: as in `simulate`, for a system; an event here reads a `MeanCovariance`.
    - `num_saved`: as in `simulate_mission`, for a mission.
    - `throw`: whether to raise `SimulationError` for a failed run; by default for a single run, not
      for a batch.

    **Returns** the run, whose states are `MeanCovariance`, and its covariance, (n, n, times,
    *runs); for a mission a `MissionCovariance`, propagated through its events and jumps. Without
    noise, `Sensitivity.covariance` is cheaper.

    **Raises** `InputError` as `simulate` does, for a covariance or a noise of a wrong size, for a
    closed-loop phase, whose commands are not part of the state, and for branches."""
    run_mean = functools.partial(
        simulate_any,
        accuracy=accuracy,
        events=events,
        dense=dense,
        num_saved=num_saved,
        batch=batch,
        in_axes=in_axes,
        throw=throw,
    )
    if not isinstance(system, Mission):
        t0 = jnp.asarray(ts)[0]
        # Before the covariance is made, which has the runs of the parameters, too.
        y0 = broadcast_state(system, t0, y0)
        size = Coordinates.of(y0, int(batch))
        uncertain = Uncertain(system, _density(noise, size))
        run = run_mean(uncertain, uncertain.about(y0, _initial(covariance, size, 0)), ts)
        assert isinstance(run, Trajectory)
        return run, run.states.covariance
    # Two branches have different delays: one matrix cannot represent both.
    check_one_line(system, "propagate_covariance")
    if any(isinstance(phase.system, AbstractRunnable) for phase in system.phases):
        raise InputError(
            "A phase of the mission is a closed loop: use a campaign for its covariance or, "
            "without noise, Sensitivity.covariance."
        )
    y0 = broadcast_state(system.phases[0].moving, jnp.asarray(ts), y0)
    size = Coordinates.of(y0, int(batch))
    each = noise if isinstance(noise, list | tuple) else [noise] * len(system.phases)
    if len(each) != len(system.phases):
        raise InputError(
            f"noise has {len(each)} entries: it must have one for each of the {len(system.phases)} "
            "phases, or be common to all."
        )
    # A jump may change the structure of the state: the size is checked where the first phase
    # starts.
    first, *others = each
    mission = uncertain_mission(system, (_density(first, size), *others))
    # One more than the state has: the delay of the start, which is known to be none.
    uncertain = mission.phases[0].moving
    assert isinstance(uncertain, Uncertain)
    run = run_mean(mission, uncertain.about(y0, _initial(covariance, size, 1)), ts)
    assert isinstance(run, MissionTrajectory)
    return run, covariance_of(run)


def _initial(covariance: ArrayLike | None, size: Coordinates, more: int) -> Factors:
    """The covariance of the initial state, (n, n, *runs), and of `more` exactly known
    coordinates."""
    n, runs = size.count, size.trailing[0]
    P = jnp.zeros((n, n), size.dtype) if covariance is None else jnp.asarray(covariance, size.dtype)
    _check("covariance", P.shape, size)
    P = jnp.broadcast_to(P.reshape(P.shape + (1,) * (2 + len(runs) - P.ndim)), (n, n, *runs))
    # What is known exactly has a variance and covariances of zero.
    return factors_of(jnp.pad(P, ((0, more), (0, more), *((0, 0),) * len(runs))))


def _density(noise: PyTree, size: Coordinates) -> PyTree:
    """The process noise in the precision of the state."""
    if noise is None or callable(noise):
        return noise
    Q = jnp.asarray(noise, size.dtype)
    _check("noise", Q.shape, size)
    return Q


def _check(name: str, shape: tuple[int, ...], size: Coordinates) -> None:
    if shape[:2] != (size.count,) * 2:
        raise InputError(
            f"{name} has the shape {shape}: it must be ({size.count}, {size.count}) for "
            f"{', '.join(size.labels)}."
        )

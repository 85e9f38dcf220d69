"""The verb: from a system and an initial state to a trajectory whose accuracy is accounted for."""

from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractSystem, InputError, Scalar, State, check_finite, is_concrete
from ..integration._accuracy import Accuracy, as_accuracy, settled, state_dtype, with_method
from ..integration._events import Event
from ..integration._segment import alike
from ..integration._selection import shape
from ..integration._status import Status, raise_if_bad
from ..integration._stiffness import Starts
from ..solvers import AbstractFixedStep
from ._mission import Mission
from ._runs import Span, run_mission, run_system, through
from ._trajectory import MissionTrajectory, Trajectory

TRAILING = "A run ended in trouble: call simulate with throw=False and read the status, or outside of jit for its sentence."


@overload
def simulate(
    system: AbstractSystem,
    y0: State,
    ts: Float[Array, " times"],
    *,
    accuracy: Accuracy | Scalar = 1e-9,
    events: tuple[Event, ...] = (),
    throw: bool = True,
) -> Trajectory: ...


@overload
def simulate(
    system: Mission,
    y0: State,
    ts: Scalar = 0.0,
    *,
    accuracy: Accuracy | Scalar = 1e-9,
    samples: int = 2,
    throw: bool = True,
) -> MissionTrajectory: ...


def simulate(
    system: Any,
    y0: State,
    ts: Any = 0.0,
    *,
    accuracy: Accuracy | Scalar = 1e-9,
    events: tuple[Event, ...] = (),
    samples: int = 2,
    throw: bool = True,
) -> Any:
    """Run a system or a mission from the state `y0`.

    - `system`: any `AbstractSystem`, and then `ts`, s, holds the times of the states asked for: the
      first is that of `y0`; descending times run backwards. Or a `Mission`, and then `ts` is the
      time of its start, and each phase returns `samples` states from its start to its end.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`.
    - `events`: the run stops at the first zero of one of these `Event`s (a mission's phases bring
      their own).
    - `throw`: raise `SimulationError` when the run ends badly; otherwise read `status`.

    Returns a `Trajectory`, or a `MissionTrajectory`. Equal steps that prove too few are repeated
    with up to eight times as many (outside of `jit` and derivatives). Differentiable with respect
    to every number in `system`, `y0` and `accuracy`-independent inputs, in reverse mode by default,
    in forward mode with `Accuracy(adjoint=diffrax.ForwardMode())`.

    Raises `InputError` for times that are not finite, ascending or descending, for a tolerance that
    the precision cannot reach, for an initial state that is not finite or of mixed precision;
    `SimulationError` for a run that ended badly."""
    accuracy = as_accuracy(accuracy)
    check_start(y0)
    if isinstance(system, Mission):
        if events:
            raise InputError(
                "events are given with a mission: each of its phases must bring its own, as Phase.until."
            )
        ts = jnp.asarray(ts, state_dtype(y0))
    else:
        ts = check_times(ts, y0)
        accuracy = settled(accuracy, system, y0, Starts.of(system, y0, ts))
    result = _flown(system, y0, ts, tuple(events), samples, accuracy)
    if is_concrete(result.status) and (error := missed_by(result, accuracy)):
        result = _flown(
            system, y0, ts, tuple(events), samples, accuracy.with_more_steps(float(error))
        )
    return thrown(result) if throw else result


def _flown(
    system: Any, y0: State, ts: Array, events: tuple[Event, ...], samples: int, accuracy: Accuracy
) -> Any:
    """One run of a system or a mission."""
    if isinstance(system, Mission):
        return _mission_run(system, y0, ts, samples, accuracy)
    span = _system_run(system, y0, ts, events, accuracy)
    return Trajectory(span.ts, span.states, span.status, span.event, span.stats, system, accuracy)


def missed_by(result: Trajectory | MissionTrajectory, accuracy: Accuracy) -> np.ndarray:
    """The largest local error of each run, in units of the tolerance, that missed it by too few
    equal steps; zero for others."""
    missed = np.asarray(result.status) == Status.TOLERANCE_MISSED
    if not (isinstance(accuracy.method, AbstractFixedStep) and np.any(missed)):
        return np.zeros(missed.shape)
    spans = result.phases if isinstance(result, MissionTrajectory) else (result,)
    error = np.max([np.asarray(span.stats["largest_local_error"]) for span in spans], axis=0)
    return np.where(missed & np.isfinite(error), error, 0.0)


@eqx.filter_jit
def _system_run(
    system: AbstractSystem, y0: State, ts: Array, events: tuple[Event, ...], accuracy: Accuracy
) -> Span:
    return run_system(system, y0, ts, events, accuracy, 0)


def _mission_run(
    mission: Mission, y0: State, t0: Array, samples: int, accuracy: Accuracy
) -> MissionTrajectory:
    spans, final, end, status = run_mission(mission, y0, t0, samples, accuracy, 0)
    phases = []
    for s, phase in zip(spans, mission.phases, strict=True):
        how = with_method(accuracy, phase.system, jax.tree.map(lambda x: shape(x, 1), s.states))
        phases.append(Trajectory(s.ts, s.states, s.status, s.event, s.stats, phase.system, how))
    return MissionTrajectory(
        tuple(phases), tuple(p.name for p in mission.phases), final, end, status
    )


def check_start(y0: State) -> None:
    """Raise `InputError` for an initial state that is not finite, or of mixed precision."""
    state_dtype(y0)
    for path, leaf in jax.tree_util.tree_flatten_with_path(y0)[0]:
        check_finite("y0" + jax.tree_util.keystr(path), leaf)


def check_times(ts: Any, y0: State) -> Array:
    """The times in the precision of the state. Raises `InputError` unless they are finite and
    ascend or descend."""
    ts = jnp.asarray(ts, state_dtype(y0))
    if ts.ndim != 1 or ts.shape[0] < 2:
        raise InputError(f"ts has the shape {ts.shape}: it must be one axis of at least two times.")
    if is_concrete(ts):
        steps = np.diff(np.asarray(ts, dtype=float))
        check_finite("ts", ts)
        if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            raise InputError("ts turns around: its times must ascend or descend.")
    return ts


def thrown(result):
    """The result, unless a run in it ended badly: then `SimulationError`, or under `jit` an error
    when it is computed."""
    if is_concrete(result.status):
        raise_if_bad(result.status)
        return result
    return eqx.tree_at(
        lambda r: r.status,
        result,
        eqx.error_if(result.status, jnp.any(result.status > Status.EVENT), TRAILING),
    )


def repeated(trajectory: Trajectory, factor: float) -> State:
    """The final states of the runs of a trajectory at a tolerance `factor` times as tight, by way
    of the middle of the span."""
    from ._batch import repeat_batch

    assert trajectory.accuracy is not None and trajectory.system is not None
    accuracy = trajectory.accuracy.tightened(factor, trajectory.dtype())
    if trajectory.shared is not None:
        return repeat_batch(trajectory, accuracy)
    return repeat(trajectory.system, trajectory.initial, trajectory.ts, accuracy, 0)


def repeat(
    system: AbstractSystem, y0: State, ts: Array, accuracy: Accuracy, run_axes: int
) -> State:
    """The state at the last of `ts`, by way of a state within the span: a closed form makes its own
    errors then, too. Not a number where the steps run out on the way."""
    ends = jnp.stack([ts[0], ts[0] + 0.4 * (ts[-1] - ts[0]), ts[-1]])
    states, status, _ = through(system, alike(system, ts[0], y0), ends, accuracy, run_axes)
    return jax.tree.map(lambda x: jnp.where(status == Status.MAX_STEPS, jnp.nan, x[-1]), states)

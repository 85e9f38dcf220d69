"""Result of an integration: states, status, statistics, and its steps on request; and the outcome
of the loop, from which it follows."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import Flag, State
from ..core.barrier import barrier
from ..core.groups import project
from ..core.status import Status, status_from
from ..solvers.protocol import solver_traits
from ._event_state import EventState, FirstEvent
from ._individual_state import IndividualLoop
from ._loop_settings import LoopSettings
from ._loop_state import LoopState
from ._packed import Packing
from .config import IntegrationConfig
from .layout import times_behind_components
from .normalised_time import ScaledVectorField, Segments


class Outcome(NamedTuple):
    """Outcome of an integration; `states` have the times on the first axis here.

    - `states`: at the save times, or only the last one.
    - `max_local_error`, `out_of_steps`: of each run; the former in units of the tolerance.
    - `step_ends`, `step_states`: of the accepted steps, if requested.
    - `event_state`: of the first event of each run, if events are sought; the last of the `states`
      is the state there.
    - `outside`: whether a step of each run ended outside the range of the system; `None` where none
      was asked."""

    states: State
    max_local_error: Array
    out_of_steps: Array
    num_accepted: Array
    num_rejected: Array
    step_ends: Array | None
    step_states: State | None
    event_state: EventState | None = None
    outside: Array | None = None

    def unpacked(self, packing: Packing) -> "Outcome":
        """The outcome with states in place of the packed vectors of one run."""
        states, step_states, event_state = self.states, self.step_states, self.event_state
        if step_states is not None:
            step_states = jax.vmap(packing.state)(step_states)
        if event_state is not None:
            y0, y = packing.state(event_state.y0), packing.state(event_state.y)
            event_state = event_state._replace(y0=y0, y=y)
        states = jax.vmap(packing.state)(states)
        return self._replace(states=states, step_states=step_states, event_state=event_state)


def outcome_of(loop: LoopState, settings: LoopSettings) -> Outcome:
    """The outcome of the loop."""
    event_state = loop.event_state
    finished = loop.t >= settings.end
    # A run that failed needs no more steps.
    short = ~finished & settings.tolerance.alive(loop.y)
    if event_state is not None:
        # Nor does one that waits at its event.
        short = short & ~event_state.waiting
    if loop.buffers.saved is None:
        # The state that was reached belongs to another time if the steps ran out.
        y = jax.tree.map(lambda x: jnp.where(finished, x, jnp.nan), loop.y)
        states = jax.tree.map(
            lambda x: x[None], y if event_state is None else event_state.stopped(y)
        )
    else:
        states = loop.buffers.saved.states
    return Outcome(
        states,
        loop.worst,
        loop.left_out | short,
        loop.accepted,
        loop.rejected,
        loop.buffers.ends_of(loop.accepted),
        loop.buffers.step_states,
        event_state,
        loop.outside,
    )


def outcome_of_individual_steps(loop: IndividualLoop, settings: LoopSettings) -> Outcome:
    """The outcome of runs with individual steps, in regularised variables."""
    finished = loop.y.segment >= settings.end
    if loop.buffers.saved is None:
        states = jax.tree.map(lambda x: jnp.where(finished, x, jnp.nan)[None], loop.y)
    else:
        states = loop.buffers.saved.states
    alive = jnp.isfinite(loop.worst)
    return Outcome(
        states,
        loop.worst,
        ~finished & alive & (loop.iterations >= settings.max_steps),
        loop.accepted,
        loop.rejected,
        loop.buffers.ends_of(loop.count),
        loop.buffers.step_states,
    )


class DenseOutput(NamedTuple):
    """The accepted steps of a run, from which states between the save times follow.

    - `ts`: times, s, of the start of every step and of the last end, (steps, *runs); infinite
      beyond it.
    - `states`: the states there, times behind the components."""

    ts: Float[Array, "steps *#runs"]
    states: State


class IntegrationResult(NamedTuple):
    """Result of an integration.

    - `states`: at the save times, or only at the end: (components, times, *runs).
    - `status`: of each run.
    - `stats`: steps, rejected steps, evaluations of the vector field, and the largest local error
      of each run in units of the tolerance.
    - `dense`: the steps, if requested.
    - `events`: those that ended the runs, if events are sought."""

    states: State
    status: Int[Array, "*runs"]
    stats: dict[str, Array]
    dense: DenseOutput | None
    events: FirstEvent | None = None


def within_model(result: IntegrationResult, outside: Flag | None) -> IntegrationResult:
    """The result with the status for runs that were `outside` the range of their system."""
    if outside is None:
        return result
    # Failures of steps outside the model result from leaving it.
    failures = (Status.MAX_STEPS, Status.NOT_FINITE)
    explained = result.status <= Status.TOLERANCE_MISSED
    for failure in failures:
        explained = explained | (result.status == failure)
    left = outside & explained
    status = jnp.where(left, Status.OUTSIDE_MODEL, result.status).astype(jnp.int32)
    return result._replace(status=status)


def result_of(
    outcome: Outcome,
    field: ScaledVectorField,
    y0: State,
    settings: LoopSettings,
    config: IntegrationConfig,
    landed: Float[Array, "times *#runs"] | None,
) -> IntegrationResult:
    """The result in the layout of results, with status and statistics.

    **Arguments**

    - `outcome`: the outcome of the loop.
    - `field`, `y0`, `settings`, `config`: of the integration.
    - `landed`: the save times as fractions of the duration, where every segment ends in a saved
      state; `None` where the states are those at the save times already.

    **Returns** an `IntegrationResult`."""
    run_axes = settings.tolerance.run_axes
    error = outcome.max_local_error
    states = outcome.states
    if landed is not None:
        states = _at_fractions(states, field.segments.u, landed, run_axes)
    last = jax.tree.map(lambda x: x[-1], states)
    if outcome.event_state is not None:
        last = outcome.event_state.stopped(last)
    finite = settings.tolerance.alive(last)
    finite = finite | outcome.out_of_steps  # a state that was not reached is NaN, too
    traits = solver_traits(config.solver)
    taken = outcome.num_accepted + outcome.num_rejected
    if outcome.event_state is not None:
        taken = taken + outcome.event_state.repetitions
    stats = {
        "steps": outcome.num_accepted * traits.steps,
        "rejected_steps": outcome.num_rejected,
        "evaluations": taken * traits.evaluations,
        "largest_local_error": error,
    }
    # With many states each would be selected with a separate status.
    status = barrier(status_from(outcome.out_of_steps, finite, error))
    dense = None
    if settings.dense:
        dense = _dense_output(outcome, field.segments, y0, run_axes)
    # States within a step deviate from the groups and the constraints by its error.
    states = times_behind_components(states, run_axes)
    states = project(states)
    if settings.save_ts is not None and landed is None:
        times = jax.vmap(field.segments.time)(settings.save_ts)
        on_constraints = field.system.projected(times, states)
        states = states if on_constraints is None else on_constraints
    return IntegrationResult(states, status, stats, dense)


def _at_fractions(states: State, u: Array, fractions: Array, run_axes: int) -> State:
    """Select the states at `fractions` of each run, from those at all ends of segments."""
    if u.ndim == 1:
        index = jnp.searchsorted(u, fractions)
        return jax.tree.map(lambda x: x[index], states)
    of_runs = fractions.reshape(*fractions.shape, *(1,) * (u.ndim - fractions.ndim))
    index = jnp.sum(u[:, None] < of_runs, axis=0)

    def leaf(x: Array) -> Array:
        missing = (1,) * (x.ndim - 1 - run_axes)
        where = index.reshape(index.shape[0], *missing, *index.shape[1:])
        return jnp.take_along_axis(x, where, axis=0)

    return jax.tree.map(leaf, states)


def _dense_output(outcome: Outcome, segments: Segments, y0: State, run_axes: int) -> DenseOutput:
    """The steps of a run in time, the start among them."""
    ends = outcome.step_ends
    assert ends is not None
    taken = jnp.isfinite(ends)
    # For an infinite end the time would be NaN, and so would its derivative.
    times = jax.vmap(segments.time)(jnp.where(taken, ends, 0.0))
    every = taken.reshape(*taken.shape, *(1,) * (times.ndim - taken.ndim))
    start = jnp.broadcast_to(segments.t0, times.shape[1:])[None]
    ts = jnp.concatenate([start, jnp.where(every, times, jnp.inf)])

    # Beyond the last step the buffer is empty.
    def with_start(first: Array, others: Array) -> Array:
        missing = (1,) * (others.ndim - taken.ndim)
        rows = taken.reshape(taken.shape[0], *missing, *taken.shape[1:])
        return jnp.concatenate([first[None], jnp.where(rows, others, jnp.nan)])

    states = jax.tree.map(with_start, y0, outcome.step_states)
    return DenseOutput(ts, times_behind_components(states, run_axes))

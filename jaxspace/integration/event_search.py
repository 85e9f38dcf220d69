"""The search for the first event of each run, outside every derivative.

A run whose steps have a polynomial is searched step by step (`_event_state`), and one in closed
form as if it were a single step. Of other runs the zero is bracketed on samples, and then closed in
by Newton's method within its bracket (`_event_runs`). A dip between samples of one sign is
examined, too, where one of the tangents at its ends reaches zero.

A zero at the start, to rounding, is the event at which the previous run ended. A search that does
not converge, a condition that is not finite, and events that follow each other faster than the time
resolves each have a status.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractSystem, Scalar, State
from ..core.status import Status
from ..solvers.tolerances import Tolerance
from ._event_runs import ConditionOnRun, first_zero
from ._event_state import EventState, FirstEvent, StepToSearch, TerminalEvents, located
from ._step_zero import FlowCondition
from .config import IntegrationConfig
from .events import Event
from .integrate import integrate, locates_events
from .normalised_time import StepTimes


def first_event(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    run_axes: int,
    start_known: Float[Array, "events *#runs"] | None = None,
) -> FirstEvent:
    """The first event of each run between `t0` and `t1`, s. Not differentiable.

    `start_known`, for a run that goes on after events: the known state of each condition at `t0`.
    Infinite where it is a zero at which the event has acted, which is then no event even with
    `Event.at_start`; minus infinity where it is not a zero, however small; 0 where the search
    decides, by the rounding of the condition."""
    system, y0, t0, t1, events = jax.tree.map(fixed, (system, y0, t0, t1, events))
    if config.method == "closed_form":
        return _first_on_flow(system, y0, t0, t1, events, run_axes, start_known)
    if locates_events(config, system, y0, t0):
        result = integrate(
            system, y0, t0, t1, None, config, run_axes, until=events, start_known=start_known
        )
        assert result.events is not None
        return result.events
    conditions = [ConditionOnRun(system, event, config, run_axes) for event in events]
    starts = [None] * len(events) if start_known is None else list(start_known)
    zeros = [
        first_zero(each, y0, t0, t1, start) for each, start in zip(conditions, starts, strict=True)
    ]
    when = t1
    which = -jnp.ones(jnp.shape(t1), jnp.int32)
    for number, zero in enumerate(zeros):
        # By distance from the start, because a run may go backwards in time.
        sooner = zero.hit & ((jnp.abs(zero.time - t0) < jnp.abs(when - t0)) | (which < 0))
        when = jnp.where(sooner, zero.time, when)
        which = jnp.where(sooner, number, which)
    status = jnp.full(jnp.shape(t1), Status.COMPLETED, jnp.int32)
    # A failure after the first event does not concern the run.
    earliest = jnp.abs(when - t0)
    failed = jnp.full_like(earliest, jnp.inf)
    for zero in zeros:
        sooner = zero.failed <= earliest
        earliest = jnp.where(sooner, zero.failed, earliest)
        failed = jnp.where(sooner, zero.failed, failed)
        status = jnp.where(sooner, zero.status, status)
    return FirstEvent(
        when,
        which,
        status,
        failed,
        jnp.stack([zero.hit for zero in zeros]),
        jnp.stack([zero.size for zero in zeros]),
        times=jnp.stack([zero.time for zero in zeros]),
        spacings=jnp.stack([jnp.abs(t1 - t0) / event.samples for event in events]),
    )


def _first_on_flow(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    events: tuple[Event, ...],
    run_axes: int,
    start_known: Array | None,
) -> FirstEvent:
    """`first_event` of a system in closed form, which is searched as a single step is."""
    finite = Tolerance(0.0, 0.0, run_axes)
    alive = finite.alive(y0)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    t0, t1 = (jnp.broadcast_to(jnp.asarray(t, dtype), alive.shape) for t in (t0, t1))
    begin, end = jnp.zeros((), dtype), jnp.ones((), dtype)
    # The whole run is one step of a method, whose dense output is the flow itself.
    segment = StepTimes(begin, end, t0, t1 - t0, jnp.zeros_like(t0))
    start, length = jnp.zeros_like(t0), jnp.ones_like(t0)

    def condition_of(event: Event) -> FlowCondition:
        return FlowCondition(event, segment, system, y0, alive.shape)

    terminal = TerminalEvents.of(events, system, t0, y0, run_axes, start_known)
    none = EventState.none_yet(terminal, start, y0, finite)
    step = StepToSearch(condition_of, start, length, y0, y0, length)
    yes = jnp.ones(t0.shape, bool)
    event_state = located(none, terminal, step, yes, alive, yes, (t0, t1 - t0))
    return event_state.located(segment, t0, t1)._replace(state=None)


# A system may have functions among its leaves.
def fixed(x: object) -> object:
    """The leaf without its derivatives."""
    return jax.lax.stop_gradient(x) if eqx.is_array(x) else x

"""One integration: from a state at t0 to states until t1, by the closed form or step by step.

The path is `resolve` (how), `integrate` (here), `solve` (the loop and its derivatives), `result_of`
(states, status and statistics).
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractRegularised, AbstractSystem, Flag, Scalar, State
from ..core.barrier import barrier
from ..core.jit import quick_jit
from ..core.tables import breaks_of
from ..solvers.dense_output import AbstractDenseOutput
from ..solvers.protocol import SolverTraits, bind, field_of_step, for_second_order, solver_traits
from ..solvers.regularised_step import evaluations_of
from ..solvers.step_control import FIRST_STEP
from ..solvers.tolerances import Tolerance
from ..solvers.vector_field import TERM
from ._event_state import TerminalEvents
from ._exact import at_once, by_closed_form, joined
from ._in_turn import in_turn
from ._loop_settings import LoopSettings
from ._save_times import at_save_times
from ._selection import is_second_order
from ._solve import solve, solve_individual_steps
from .config import IntegrationConfig
from .events import Event
from .field_trace import field_trace
from .normalised_time import ScaledVectorField, Segments, hoist, segments_of
from .result import IntegrationResult, Outcome, result_of, within_model


@quick_jit
def integrate(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    fractions: Float[Array, "times *#runs"] | None,
    config: IntegrationConfig,
    run_axes: int,
    *,
    dense: bool = False,
    trimmed: bool = False,
    for_search: bool = False,
    until: tuple[Event, ...] = (),
    start_known: Array | None = None,
) -> IntegrationResult:
    """Integrate a system from `t0` to `t1`, s.

    **Arguments**

    - `system`, `y0`: `y0` is broadcast to the runs of the system (`broadcast_state`).
    - `t0`, `t1`: scalars or (*runs,).
    - `fractions`: save times as fractions of the duration, ascending within [0, 1]; `None` saves
      the state at the end. With fractions of each run, in any order, steps end at them.
    - `config`: from `resolve`.
    - `run_axes`: number of trailing batch axes.
    - `dense`: whether to return the ends of the steps, and the states there.
    - `trimmed`: of a short run: whether to try a first step of its whole length, and to leave out
      segments of no length at both ends. Only where just the final state is saved and nothing is
      differentiated: a break at one of its ends would have a derivative.
    - `for_search`: whether the states at the fractions are samples for a search, for which a small
      program counts: a closed form computes them `in_turn`, and the first step is not estimated.
    - `until`: events that end the runs, for a method that `locates_events`; their times have the
      derivatives of a fixed part of the run, which `newton_correct` makes those of the events.
      Differentiable where no states are saved on the way.
    - `start_known`: of these events, as in `first_event`.

    **Returns** an `IntegrationResult`, differentiable with respect to `system`, `y0`, `t0` and
    `t1`."""
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    t0 = jnp.asarray(t0, dtype)
    t1 = jnp.asarray(t1, dtype)
    if config.method == "closed_form":
        closed_form = system.closed_form()
        assert closed_form is not None
        rows = in_turn if for_search else at_once
        result = by_closed_form(closed_form, y0, t1 - t0, fractions, run_axes, rows)
        result = within_model(result, closed_form.outside(t1 - t0, y0))
        left = _any_outside(system, t0, t1, fractions, result.states, run_axes)
        return within_model(result, left)
    request = _Request(fractions, dense, trimmed, for_search, until, start_known)
    if not config.decoupled:
        return _by_steps(system, y0, t0, t1, config, run_axes, request)
    decoupled = system.decoupled()
    assert decoupled is not None
    rest = dataclasses.replace(config, decoupled=False)
    # The events and the samples of a search are those of the whole motion.
    request = request._replace(for_search=False, until=(), start_known=None)
    result = _by_steps(decoupled.rest, decoupled.rest_of(y0), t0, t1, rest, run_axes, request)
    return joined(decoupled, y0, t1 - t0, fractions, result, run_axes)


def _any_outside(
    system: AbstractSystem,
    t0: Scalar,
    t1: Scalar,
    fractions: Array | None,
    states: State,
    run_axes: int,
) -> Flag | None:
    """Whether one of the saved states is outside the range of the system; `None` where none can.

    For a closed form, without steps, nothing else is checked; for steps the ends are checked as
    well, between which a run may be outside."""
    if fractions is None:
        ts = t1[None]
    else:
        shares = fractions.reshape(fractions.shape + (1,) * (t1.ndim + 1 - fractions.ndim))
        ts = t0 + shares * (t1 - t0)

    states = jax.tree.map(jax.lax.stop_gradient, states)
    times_first = jax.tree.map(lambda x: jnp.moveaxis(x, x.ndim - 1 - run_axes, 0), states)
    flags = jax.vmap(system.outside)(ts, times_first)
    return None if flags is None else jnp.any(flags, axis=0)


class _Request(NamedTuple):
    """A request for an integration; fields as the arguments of `integrate`."""

    fractions: Float[Array, "times *#runs"] | None
    dense: bool
    trimmed: bool
    for_search: bool
    until: tuple[Event, ...]
    start_known: Array | None


def _by_steps(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    config: IntegrationConfig,
    run_axes: int,
    request: _Request,
) -> IntegrationResult:
    """The result of an integration step by step."""
    fractions, traits = request.fractions, solver_traits(config.solver)
    segments = segments_of(system, t0, t1, None)
    # If the runs differ in their breaks, or in their save times, the save times become ends of
    # segments, which all runs reach together.
    landing = fractions is not None and (
        traits.lands_on_save_times or segments.u.ndim > 1 or fractions.ndim > 1
    )
    if landing:
        segments = segments_of(system, t0, t1, fractions)
    terminal = None
    if request.until:
        start, y = jax.tree.map(jax.lax.stop_gradient, (t0, y0))
        terminal = TerminalEvents.of(request.until, system, start, y, run_axes, request.start_known)
    method = _method(config, system, y0)
    settings = _settings(config, method, segments, landing, run_axes, request, terminal)
    field = ScaledVectorField(system, segments)
    outcome, form = _outcome(field, y0, config, settings, request, landing)
    result = result_of(outcome, field, y0, settings, config, fractions if landing else None)
    if outcome.event_state is not None:
        events = outcome.event_state.located(segments, t0, t1)
        result = result._replace(events=barrier(events))
    if form is not None:
        taken = outcome.num_accepted + outcome.num_rejected
        result.stats["evaluations"] = taken * evaluations_of(form)
    result = within_model(result, outcome.outside)
    left = _any_outside(system, t0, t1, fractions, result.states, run_axes)
    return within_model(result, left)


def _outcome(
    field: ScaledVectorField[Segments],
    y0: State,
    config: IntegrationConfig,
    settings: LoopSettings,
    request: _Request,
    landing: bool,
) -> tuple[Outcome, AbstractRegularised | None]:
    """The outcome of the loop that suits the method, and the variables in which runs choose their
    own steps."""
    traits = solver_traits(config.solver)
    if traits.individual_steps:
        return solve_individual_steps(hoist(field, y0, traits.needs), y0, settings)
    # Where events are sought, `locates_events` has excluded closures over traced arrays.
    axes = 0 if settings.together else settings.tolerance.run_axes
    seen = field if request.until else hoist(field, y0, traits.needs, axes)
    outcome = solve(seen, y0, settings)
    if request.fractions is None or landing:
        return outcome, None
    assert settings.save_ts is not None
    states = at_save_times(
        outcome.states, field.system, field.segments, settings.save_ts, request.fractions
    )
    return outcome._replace(states=states), None


def locates_events(
    config: IntegrationConfig, system: AbstractSystem, y0: State, t0: Scalar
) -> bool:
    """Whether the steps of a run can be searched for events as they are taken: by a method that
    `searches_steps`, where the system hides nothing in closures."""
    return searches_steps(config) and not field_trace(system, t0, y0).closes_over_tracers


def searches_steps(config: IntegrationConfig) -> bool:
    """Whether the steps of the method can be searched for events: they need a polynomial."""
    if config.method == "closed_form" or config.decoupled:
        return False
    traits = solver_traits(config.solver)
    if traits.individual_steps or traits.fixed_step:
        return False
    # Some solvers of diffrax make theirs by a partial function.
    interpolation = config.solver.interpolation_cls
    dense = isinstance(interpolation, type) and issubclass(interpolation, AbstractDenseOutput)
    return dense and not traits.lands_on_save_times


def _method(config: IntegrationConfig, system: AbstractSystem, y0: State) -> diffrax.AbstractSolver:
    """The method, in its form for second-order systems where the system is one."""
    form = for_second_order(config.solver)
    return form if form is not config.solver and is_second_order(system, y0) else config.solver


def _settings(
    config: IntegrationConfig,
    method: diffrax.AbstractSolver,
    segments: Segments,
    landing: bool,
    run_axes: int,
    request: _Request,
    terminal: TerminalEvents | None = None,
) -> LoopSettings:
    """Settings of the loop for these segments, from the configuration."""
    # Normalised time counts segments: their ends are the whole numbers.
    ends = jnp.arange(len(segments) + 1, dtype=segments.u.dtype)
    fractions, save_ts = request.fractions, None
    if fractions is not None:
        save_ts = ends if landing else segments.normalised(fractions.astype(ends.dtype))
    traits = solver_traits(config.solver)
    # The loop sees a fixed-step method as one that takes one step in each segment.
    together = run_axes > 0 and traits.fixed_step
    max_steps = min(len(segments), config.max_steps) if traits.fixed_step else config.max_steps
    tolerance = Tolerance(config.rtol, config.atol, run_axes)
    # The search for events reads the polynomial of every step.
    method = bind(
        method,
        tolerance=tolerance,
        save_ts=save_ts,
        run_axes=run_axes,
        searched=terminal is not None,
    )
    reach, first_step = _reach_and_first_step(segments, request, terminal, traits)
    return LoopSettings(
        method,
        tolerance,
        *_lengths(segments, config.max_step, together),
        save_ts,
        reach,
        max_steps,
        request.dense,
        terminal,
        first_step=first_step,
        derivative_control=config.derivative_control,
        fixed_step=traits.fixed_step,
        together=together,
    )


def _reach_and_first_step(
    segments: Segments,
    request: _Request,
    terminal: TerminalEvents | None,
    traits: SolverTraits,
) -> tuple[tuple[Array, Array] | None, float | None]:
    """Start and end of the steps, by default those of the run, and the first step, by default an
    estimated one."""
    if request.trimmed and not traits.fixed_step and not traits.individual_steps:
        # A short run, for which a single step is mostly short enough.
        return segments.reach(), 1.0
    # The estimate would be another copy of the vector field in addition to that of the search.
    searched = request.for_search or terminal is not None
    return None, FIRST_STEP if searched else None


def _lengths(
    segments: Segments, max_step: Scalar | None, together: bool
) -> tuple[Array, Array | None]:
    """The lengths of the segments and the longest steps in them, of each run or of all
    `together`."""
    lengths = segments.lengths()
    longest = None if max_step is None else segments.longest_steps(max_step)
    if together:
        lengths = _of_all(lengths, jnp.mean)
        longest = None if longest is None else _of_all(longest, jnp.min)
    return lengths, longest


def _of_all(values: Array, reduction: Callable[..., Array]) -> Array:
    """Values for each segment, of all runs together."""
    return reduction(values.reshape(values.shape[0], -1), axis=1)


def take_step(
    system: AbstractSystem,
    y: State,
    t0: Scalar,
    t1: Scalar,
    config: IntegrationConfig,
    run_axes: int,
) -> State:
    """The state at `t1`, s, one step of the method after the state `y` at `t0`.

    For times within an accepted step of the same run: there it is as accurate as the run."""
    assert not isinstance(config.method, str)
    zero = jnp.zeros_like(t1 - t0, shape=())
    # A single segment from t0 to t1, so that normalised time runs from 0 to 1.
    u = jnp.stack([zero, zero + 1.0])
    # The step may begin or end at a break.
    segments = Segments(u, t0, t1 - t0, breaks_of(system) is not None)
    field = ScaledVectorField(system, segments)
    request = _Request(None, False, False, False, (), None)
    method = _method(config, system, y)
    settings = _settings(config, method, field.segments, False, run_axes, request)
    method = settings.method
    seen = field_of_step(method, field, u[0], u[1])
    state = method.init(TERM, u[0], u[1], y, seen)
    y1, *_ = method.step(TERM, u[0], u[1], y, seen, state, jnp.array(False))
    return y1

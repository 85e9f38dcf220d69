"""One integration: from a state at t0 to states until t1, by the closed form or step by step.

The path is `resolve` (how), `integrate` (here), `solve` (the loop and its derivatives). Times lead
inside the loop, where a state is one row of a buffer; results have the components first, then the
times, then the runs.
"""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from ..core import AbstractClosedForm, AbstractSystem, Flag, Scalar, State, breaks_of, project
from ..solvers import Tolerance, bind, solver_traits
from ._config import IntegrationConfig
from ._loop import TERM, LoopSettings
from ._normalised_time import ScaledVectorField, Segments, hoist, segments_of
from ._solve import Outcome, solve
from ._status import Status, status_from


class DenseOutput(NamedTuple):
    """The accepted steps of a run, from which states between the save times follow.

    - `ts`: times, s, of the start of every step and of the last end, (steps, *runs); infinite
      beyond it.
    - `states`: the states there, times behind the components."""

    ts: Float[Array, "steps *#runs"]
    states: State


class IntegrationResult(NamedTuple):
    """What an integration leaves.

    - `states`: at the save times, or at the end alone: (components, times, *runs).
    - `status`: of each run.
    - `stats`: steps, rejected steps, evaluations of the vector field, and the largest local error
      of each run in units of the tolerance.
    - `step_ends`: normalised times of the ends of the steps, infinite beyond the last, if asked
      for.
    - `dense`: the steps, if asked for."""

    states: State
    status: Int[Array, "*runs"]
    stats: dict[str, Array]
    step_ends: Float[Array, " steps"] | None
    dense: DenseOutput | None


def broadcast_state(system: AbstractSystem, t: Scalar, y: State) -> State:
    """The state with every block broadcast to the runs that the system or another block carries."""
    # A block can learn of runs from another one only through the derivative of a third: three
    # passes are enough for every system, and one is for most.
    for _ in range(3):
        shape = jax.eval_shape(system.vector_field, t, y)
        before = jax.tree.map(jnp.shape, y)
        y = jax.tree.map(
            lambda a, b: jnp.broadcast_to(a, jnp.broadcast_shapes(a.shape, b.shape)), y, shape
        )
        if jax.tree.map(jnp.shape, y) == before:
            break
    return y


def times_behind_components(states: State, run_axes: int) -> State:
    """States with the times first, as a loop stores them, in the layout of results."""
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, x.ndim - 1 - run_axes), states)


def times_first(states: State, run_axes: int) -> State:
    """States in the layout of results, with the times first."""
    return jax.tree.map(lambda x: jnp.moveaxis(x, x.ndim - 1 - run_axes, 0), states)


def state_at(states: State, index: int, run_axes: int) -> State:
    """The state at one of the times, in the layout of results."""
    return jax.tree.map(
        lambda x: x[..., index] if run_axes == 0 else x[(..., index, *(slice(None),) * run_axes)],
        states,
    )


@eqx.filter_jit
def integrate(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    fractions: Float[Array, " times"] | None,
    config: IntegrationConfig,
    run_axes: int,
    *,
    plan: Float[Array, " nodes"] | None = None,
    record_steps: bool = False,
    dense: bool = False,
) -> IntegrationResult:
    """Integrate a system from `t0` to `t1`, s.

    **Arguments**

    - `system`, `y0`: `y0` is broadcast to the runs of the system (`broadcast_state`).
    - `t0`, `t1`: scalars or (*runs,).
    - `fractions`: save times as fractions of the duration, ascending within [0, 1]; `None` saves
      the state at the end.
    - `config`: from `resolve`.
    - `run_axes`: how many trailing axes carry runs.
    - `plan`: steps that are fixed beforehand, as nodes in normalised time.
    - `record_steps`, `dense`: whether to return the ends of the steps, and the states there.

    **Returns** an `IntegrationResult`, differentiable with respect to `system`, `y0`, `t0` and
    `t1`."""
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    t0 = jnp.asarray(t0, dtype)
    t1 = jnp.asarray(t1, dtype)
    if config.method == "closed_form":
        closed_form = system.closed_form()
        assert closed_form is not None
        result = _by_closed_form(closed_form, y0, t1 - t0, fractions, run_axes)
        return _within_model(result, closed_form.outside(t1 - t0, y0))
    traits = solver_traits(config.solver)
    segments = segments_of(system, t0, t1, None)
    # Runs with their own breaks have their own segments: the save times become ends of segments,
    # which all runs reach together.
    landing = fractions is not None and (traits.lands_on_save_times or segments.u.ndim > 1)
    if landing:
        segments = segments_of(system, t0, t1, fractions)
    settings = _settings(config, segments, fractions, landing, run_axes, plan, record_steps, dense)
    field = ScaledVectorField(system, segments)
    if config.adjoint is None and traits.replayable:
        outcome = solve(hoist(field, y0, traits.needs), y0, settings)
    else:
        outcome = _by_diffrax(hoist(field, y0, traits.needs), y0, settings, config.adjoint)
    result = _result(outcome, field, y0, settings, config, fractions if landing else None)
    return _within_model(result, system.outside(t1, state_at(result.states, -1, run_axes)))


def _within_model(result: IntegrationResult, outside: Flag | None) -> IntegrationResult:
    """The result with its status where a run ends `outside` of what its system describes."""
    if outside is None:
        return result
    left = outside & (result.status == Status.COMPLETED)
    status = jnp.where(left, Status.OUTSIDE_MODEL, result.status).astype(jnp.int32)
    return result._replace(status=status)


def _by_closed_form(
    closed_form: AbstractClosedForm,
    y0: State,
    duration: Array,
    fractions: Float[Array, " times"] | None,
    run_axes: int,
) -> IntegrationResult:
    # Without a map over a single duration, which would double what there is to trace.
    if fractions is None:
        final = closed_form.flow(duration, y0)
        states = jax.tree.map(lambda x: x[None], final)
    else:
        durations = jnp.multiply.outer(fractions, duration)
        states = jax.vmap(lambda d: closed_form.flow(d, y0))(durations)
        final = jax.tree.map(lambda x: x[-1], states)
    finite = Tolerance(0.0, 0.0, run_axes).alive(final)
    status = status_from(jnp.array(False), finite, jnp.zeros(finite.shape))
    states = times_behind_components(states, run_axes)
    return IntegrationResult(states, status, {"evaluations": jnp.array(0)}, None, None)


def _settings(
    config: IntegrationConfig,
    segments: Segments,
    fractions: Float[Array, " times"] | None,
    landing: bool,
    run_axes: int,
    plan: Array | None,
    record_steps: bool,
    dense: bool,
) -> LoopSettings:
    """What the loop needs of the configuration for these segments."""
    # Normalised time counts segments: their ends are the whole numbers.
    ends = jnp.arange(len(segments) + 1, dtype=segments.u.dtype)
    save_ts = None
    if fractions is not None:
        save_ts = ends if landing else jnp.interp(fractions.astype(ends.dtype), segments.u, ends)
    traits = solver_traits(config.solver)
    # To the loop, a fixed-step method takes one step a segment.
    if traits.fixed_step:
        plan = ends
    longest = None
    if config.max_step is not None:
        longest = segments.longest_steps(config.max_step)
    max_steps = config.max_steps if plan is None else min(plan.shape[0] - 1, config.max_steps)
    tolerance = Tolerance(config.rtol, config.atol, run_axes)
    method = bind(config.solver, tolerance=tolerance, save_ts=save_ts, run_axes=run_axes)
    return LoopSettings(
        method,
        tolerance,
        segments.lengths(),
        longest,
        save_ts,
        plan,
        max_steps,
        record_steps,
        dense,
    )


def _result(
    outcome: Outcome,
    field: ScaledVectorField,
    y0: State,
    settings: LoopSettings,
    config: IntegrationConfig,
    landed: Float[Array, " times"] | None,
) -> IntegrationResult:
    """The result in the layout of results, with status and statistics."""
    run_axes = settings.tolerance.run_axes
    error = outcome.max_local_error
    if settings.plan is not None and config.max_step is not None:
        longest = _longest_step(settings.plan, field.segments)
        # A plan that keeps the limit to rounding keeps it.
        error = jnp.maximum(error, longest / config.max_step - 1e-3)
    states = outcome.states
    if landed is not None:
        states = _at_fractions(states, field.segments.u, landed, run_axes)
    finite = settings.tolerance.alive(jax.tree.map(lambda x: x[-1], states))
    finite = finite | outcome.out_of_steps  # a state that was not reached is NaN, too
    traits = solver_traits(config.solver)
    taken = outcome.num_accepted + outcome.num_rejected
    stats = {
        "steps": outcome.num_accepted * traits.steps,
        "rejected_steps": outcome.num_rejected,
        "evaluations": taken * traits.evaluations,
        "largest_local_error": error,
    }
    status = status_from(outcome.out_of_steps, finite, error)
    dense = None
    if settings.dense:
        dense = _dense_output(outcome, field.segments, y0, run_axes)
    # States within a step are off the group by its error.
    states = project(times_behind_components(states, run_axes))
    return IntegrationResult(states, status, stats, outcome.step_ends, dense)


def _longest_step(plan: Array, segments: Segments) -> Array:
    """The longest of the planned steps, s, in each run."""
    times = jax.vmap(segments.time)(jnp.minimum(plan, float(len(segments))))
    return jax.lax.stop_gradient(jnp.max(jnp.abs(jnp.diff(times, axis=0)), axis=0))


def _at_fractions(states: State, u: Array, fractions: Array, run_axes: int) -> State:
    """Of the states at all ends of segments, those at `fractions` of each run."""
    if u.ndim == 1:
        index = jnp.searchsorted(u, fractions)
        return jax.tree.map(lambda x: x[index], states)
    index = jnp.sum(u[:, None] < fractions.reshape(-1, *(1,) * (u.ndim - 1)), axis=0)

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
    times = jax.vmap(segments.time)(jnp.where(taken, ends, 0.0))
    taken = taken.reshape(-1, *(1,) * (times.ndim - 1))
    start = jnp.broadcast_to(segments.t0, times.shape[1:])[None]
    ts = jnp.concatenate([start, jnp.where(taken, times, jnp.inf)])
    reached = jnp.isfinite(ends)

    # Beyond the last step the buffer is uninitialised.
    def with_start(first: Array, others: Array) -> Array:
        rows = reached.reshape(-1, *(1,) * (others.ndim - 1))
        return jnp.concatenate([first[None], jnp.where(rows, others, jnp.nan)])

    states = jax.tree.map(with_start, y0, outcome.step_states)
    return DenseOutput(ts, times_behind_components(states, run_axes))


def _by_diffrax(
    field: PyTree,
    y0: State,
    settings: LoopSettings,
    adjoint: diffrax.AbstractAdjoint | None,
) -> Outcome:
    """The outcome by diffrax's loop: for its adjoints, and for methods that carry on more than a
    state from step to step."""
    end = settings.end
    saves = [
        diffrax.SubSaveAt(t1=True)
        if settings.save_ts is None
        else diffrax.SubSaveAt(ts=settings.save_ts)
    ]
    if settings.record_steps or settings.dense:
        saves.append(diffrax.SubSaveAt(steps=True))
    solution: Any = diffrax.diffeqsolve(
        TERM,
        settings.solver(),
        jnp.zeros_like(end),
        end,
        None,
        y0,
        field,
        saveat=diffrax.SaveAt(subs=saves, solver_state=True),
        stepsize_controller=settings.controller(),
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        max_steps=settings.max_steps,
        throw=False,
    )
    out_of_steps = solution.result == diffrax.RESULTS.max_steps_reached
    states = jax.tree.map(lambda x: jnp.where(out_of_steps, jnp.nan, x), solution.ys[0])
    return Outcome(
        states,
        solution.solver_state[1],
        out_of_steps,
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"],
        solution.ts[1] if len(saves) > 1 else None,
        solution.ys[1] if settings.dense else None,
    )


def take_step(
    system: AbstractSystem,
    y: State,
    t0: Scalar,
    t1: Scalar,
    config: IntegrationConfig,
    run_axes: int,
) -> State:
    """The state at `t1`, s, one step of the method after the state `y` at `t0`.

    For times within an accepted step of the same run, where it is as accurate as the run."""
    assert not isinstance(config.method, str)
    zero = jnp.zeros_like(t1 - t0, shape=())
    u = jnp.stack([zero, zero + 1.0])
    # The step may begin or end at a break.
    segments = Segments(u, t0, t1 - t0, breaks_of(system) is not None)
    field = ScaledVectorField(system, segments)
    settings = _settings(config, field.segments, None, False, run_axes, None, False, False)
    method = settings.method
    state = method.init(TERM, u[0], u[1], y, field)
    y1, *_ = method.step(TERM, u[0], u[1], y, field, state, jnp.array(False))
    return y1

"""One span of one system: from a state at t0 to states until t1, by the closed form or by one
integration.

The integration runs on the clock of segments (`_clock.py`)."""

from typing import Any, cast, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import AbstractClosedForm, AbstractSystem, Scalar, State, safe_divide
from ..solvers import Tolerance, solver_traits
from ._accuracy import Accuracy
from ._integrate import Manner, integrate
from ._normalised_time import Rate
from ._status import judged


@final
class Propagation(eqx.Module):
    """States along a span: `states` with the times on the first axis, the `status` of each run, and
    what it cost.

    `plan` holds the ends of the accepted steps on the clock where they were asked for (padded with
    infinity)."""

    states: State
    status: Int[Array, "*runs"]
    stats: dict[str, Array]
    plan: Float[Array, " steps"] | None


def alike(system: AbstractSystem, t: Scalar, y: State) -> State:
    """The state with every block broadcast to the runs that the system or another block carries."""
    for _ in range(3):
        rate, before = jax.eval_shape(system.vector_field, t, y), y
        y = jax.tree.map(
            lambda a, b: jnp.broadcast_to(a, jnp.broadcast_shapes(a.shape, b.shape)), y, rate
        )
        if jax.tree.map(jnp.shape, y) == jax.tree.map(jnp.shape, before):
            break
    return y


@eqx.filter_jit
def propagate(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    fractions: Float[Array, " times"] | None,
    accuracy: Accuracy,
    run_axes: int,
    plan: Float[Array, " nodes"] | None = None,
    record: bool = False,
) -> Propagation:
    """States at `fractions` (ascending, within [0, 1]) of the span, or at its end alone where they
    are `None`.

    `y0` is `alike` to the system; `t0` and `t1` are scalars or (*runs,); `run_axes` counts the axes
    of runs; `plan` fixes the steps on the clock beforehand; `record` asks for the steps that were
    taken."""
    closed_form = system.closed_form() if accuracy.method == "auto" else None
    if closed_form is not None:
        return _by_flow(closed_form, y0, t1 - t0, fractions, run_axes)
    return _by_integration(system, y0, t0, t1, fractions, accuracy, run_axes, plan, record)


def _by_flow(
    system: AbstractClosedForm, y0: State, span: Scalar, fractions: Any, run_axes: int
) -> Propagation:
    if (
        fractions is None
    ):  # without a map over a single duration, which would double what there is to trace
        states = jax.tree.map(lambda x: x[None], system.flow(span, y0))
    else:
        states = jax.vmap(lambda duration: system.flow(duration, y0))(
            jnp.multiply.outer(fractions, span)
        )
    final = jax.tree.map(lambda x: x[-1], states)
    finite = Tolerance(0.0, 0.0, run_axes).alive(final)
    return Propagation(
        states,
        judged(jnp.array(False), finite, jnp.zeros(finite.shape)),
        {"evaluations": jnp.array(0)},
        None,
    )


def _segments(system: AbstractSystem, t0: Scalar, span: Scalar, extra: Array | None) -> Array:
    """The fractions u of the span at which a segment begins or ends, ascending, for each run."""
    inner = []
    breaks = system.breaks()
    breaks = jnp.zeros((0,)) if breaks is None else breaks.astype(span.dtype)
    if breaks.shape[0] > 0:
        breaks = breaks.reshape(
            breaks.shape[0], *(1,) * (span.ndim - breaks.ndim + 1), *breaks.shape[1:]
        )
        inner.append(jnp.clip(safe_divide(breaks - t0, span), 0.0, 1.0))
    if extra is not None:
        inner.append(extra.reshape(extra.shape + (1,) * (inner[0].ndim - 1 if inner else 0)))
    runs = jnp.broadcast_shapes(*(x.shape[1:] for x in inner)) if inner else ()
    zero, one = jnp.zeros((1, *runs), span.dtype), jnp.ones((1, *runs), span.dtype)
    cut = [jnp.broadcast_to(x, (x.shape[0], *runs)).astype(span.dtype) for x in inner]
    u = jnp.concatenate([zero, *cut, one])
    return jnp.sort(u, axis=0) if inner else u


def _by_integration(
    system: AbstractSystem,
    y0: State,
    t0: Any,
    t1: Any,
    fractions: Any,
    accuracy: Accuracy,
    run_axes: int,
    plan: Any,
    record: bool,
) -> Propagation:
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    t0, t1 = jnp.asarray(t0, dtype), jnp.asarray(t1, dtype)
    u = _segments(system, t0, t1 - t0, None)
    traits = solver_traits(cast(diffrax.AbstractSolver, accuracy.method))
    per_run = (u.ndim > 1 or traits.lands_on_save_times) and fractions is not None
    if per_run:
        u = _segments(system, t0, t1 - t0, fractions)
    atol = 1e-3 * accuracy.rtol if accuracy.atol is None else accuracy.atol
    tolerance = Tolerance(jnp.asarray(accuracy.rtol, dtype), jnp.asarray(atol, dtype), run_axes)
    lengths = jnp.maximum(jnp.mean(jnp.diff(u, axis=0).reshape(u.shape[0] - 1, -1), axis=1), 1e-6)
    if traits.fixed_step:
        plan = jnp.arange(u.shape[0], dtype=dtype)
    longest = (
        None
        if accuracy.max_step is None
        else _longest(jnp.asarray(accuracy.max_step, dtype), t1 - t0, u)
    )
    manner = Manner(
        accuracy, tolerance, lengths, longest, _kept(u, fractions, per_run), plan, record
    )
    rate = Rate(system, u, t0, t1 - t0)
    course = integrate(rate, y0, manner)
    account = course.account
    if plan is not None and accuracy.max_step is not None:
        account = jnp.maximum(
            account, _longest_of(plan, rate) / jnp.asarray(accuracy.max_step, dtype) - 1e-3
        )
    states = (
        _at_fractions(course.states, u, fractions, run_axes)
        if per_run and fractions is not None
        else course.states
    )
    finite = tolerance.alive(jax.tree.map(lambda x: x[-1], states))
    stats = {
        "steps": course.accepted * traits.steps,
        "rejected_steps": course.rejected,
        "evaluations": (course.accepted + course.rejected) * traits.evaluations,
        "largest_local_error": account,
    }
    return Propagation(states, judged(course.out_of_steps, finite, account), stats, course.ends)


def _longest(max_step: Array, span: Array, u: Array) -> Array:
    """How long on the clock a step may be in each segment, for all the runs that share it."""
    width = jnp.diff(u, axis=0)
    durations = jnp.abs(width.reshape(*width.shape, *(1,) * (span.ndim + 1 - width.ndim)) * span)
    allowed = jnp.where(
        durations > 0.0, max_step / jnp.where(durations > 0.0, durations, 1.0), jnp.inf
    )
    return jnp.min(allowed.reshape(allowed.shape[0], -1), axis=1)


def _longest_of(plan: Array, rate: Rate) -> Array:
    """The longest of the steps that were fixed beforehand, s, in each run."""
    times = jax.vmap(rate.time)(jnp.minimum(plan, rate.u.shape[0] - 1.0))
    return jax.lax.stop_gradient(jnp.max(jnp.abs(jnp.diff(times, axis=0)), axis=0))


def _kept(u: Array, fractions: Any, per_run: bool) -> Array | None:
    """Where on the clock states are kept: at its end (`None`), at every segment's end, or at the
    `fractions` of the span."""
    if fractions is None:
        return None
    clock = jnp.arange(u.shape[0], dtype=u.dtype)
    return clock if per_run else jnp.interp(fractions.astype(u.dtype), u, clock)


def _at_fractions(states: State, u: Array, fractions: Array, run_axes: int) -> State:
    """Of the states at all segment ends, those that belong to `fractions`, for each run."""
    if u.ndim == 1:
        return jax.tree.map(lambda x: x[jnp.searchsorted(u, fractions)], states)
    index = jnp.sum(u[:, None] < fractions.reshape(-1, *(1,) * (u.ndim - 1)), axis=0)

    def leaf(x):
        where = index.reshape(index.shape[0], *(1,) * (x.ndim - 1 - run_axes), *index.shape[1:])
        return jnp.take_along_axis(x, where, axis=0)

    return jax.tree.map(leaf, states)

"""A local minimum under constraints and bounds, by gradients.

    minimise f(x)   subject to   c(x) = 0,   d(x) >= 0,   a <= x <= b

    method           how                                                      for
    "multipliers"    L-BFGS inside the method of multipliers                  many unknowns
    "sqp"            quadratic programmes with the full Jacobian              up to about a hundred

Files: `_multipliers.py`, `_sqp.py`, `_bounds.py`. Valid for smooth functions. `f` may be infinite
outside its domain: both methods turn back.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from ..core import InputError, Scalar
from . import _multipliers as multipliers
from . import _sqp as sqp
from . import _sqp_state as sqp_state
from ._bounds import Bounds, as_bounds
from ._criterion import Criterion, Minimum, Point, StopReason, stop_reason
from ._drive import Progress, drive, is_traced
from ._gradient_check import GRADIENT_TOLERANCE, refuse, sizes_of

METHODS = ("multipliers", "sqp")


def minimise(
    problem: Callable[[Point], Criterion],
    start: Point | Minimum,
    *,
    bounds: Any = None,
    method: str = "multipliers",
    tolerance: Scalar = 1e-9,
    max_steps: int = 200,
    max_rounds: int = 20,
    check_gradient: bool = True,
    adam_steps: int = 0,
    adam_rate: Scalar = 0.03,
    exact_hessian: bool = False,
    scale: Point | None = None,
    progress: Progress | None = None,
) -> Minimum:
    """A local minimum of `problem(x).objective` under its constraints.

    **Arguments**

    - `problem`: from a point to its `Criterion`.
    - `start`: the point at which the descent begins, a tree of arrays; or a `Minimum` that ended
      before its time, whose search goes on with the same options.
    - `bounds`: a pair of lower and upper bounds, each a tree like `start`, a number or `None`.
    - `method`: "multipliers" or "sqp".
    - `tolerance`: for the gradient and for the violation; of "sqp" after its scaling.
    - `max_steps`: of one descent, or of "sqp"; `max_rounds`: number of descents.
    - `check_gradient`: whether to compare the gradient at the start with the slope of the
      objective, by four more evaluations, and to refuse to begin where they differ; under `jit`
      the search ends there with the reason `WRONG_GRADIENT`.
    - `adam_steps`, `adam_rate`: steps of Adam before the first descent of "multipliers", for flat
      or rough starts.
    - `exact_hessian`: of "sqp": curvature by second derivatives in place of BFGS, for problems that
      are cheap to differentiate twice.
    - `scale`: of "sqp": sizes of the unknowns, a tree like `start`; by default the range of the
      bounds, or the larger of the start and 1.
    - `progress`: called after each round or step with its number, objective, violation and
      gradient; not under `jit`. Ctrl-C ends such a search with what it has reached.

    **Returns** the `Minimum`, which reports in `converged` whether the tolerance was met and in
    `sentence()` why it ended. It is not differentiable in what `problem` closes over. The problem
    and its derivatives are compiled once; wrap the call in `jax.jit` where it is repeated.

    **Raises** `InputError` for an unknown method, bounds that do not fit, or a gradient that is
    not the slope.
    """
    if method not in METHODS:
        raise InputError(f"method is {method!r}: it must be one of {', '.join(METHODS)}.")
    before = start if isinstance(start, Minimum) else None
    x = start.x if isinstance(start, Minimum) else start
    limits = as_bounds(bounds, x)
    # Traced once for its shapes and its derivatives.
    problem = jax.jit(problem)
    if before is not None and before.search is None:
        raise InputError("start is a Minimum that keeps no search: start from its x.")
    common = _Common(problem, x, limits, tolerance, check_gradient and before is None, progress)
    if method == "sqp":
        found = _by_sqp(common, max_steps, exact_hessian, scale, before)
    else:
        rounds = (max_steps, max_rounds, adam_steps, adam_rate)
        found = _by_multipliers(common, bounds is not None, rounds, before)
    if check_gradient and not is_traced(found.gradient_error):
        refuse(float(found.gradient_error))
    return found


class _Common(NamedTuple):
    """What both methods need."""

    problem: Callable[[Point], Criterion]
    start: Point
    limits: Bounds
    tolerance: Scalar
    check: bool
    progress: Progress | None


def minimise_from(
    problem: Callable[[Point], Criterion], starts: Point, **options: Any
) -> tuple[Minimum, Minimum]:
    """The best minimum from several starts, searched in one batch.

    **Arguments**

    - `problem`: as in `minimise`.
    - `starts`: trees whose arrays carry the starts on the last axis.
    - `options`: of `minimise`.

    **Returns** the best one, which is that of the least objective among those that converged, or of
    the least violation where none did; and all of them, with the starts on the last axis.
    """
    search = eqx.filter_jit(
        jax.vmap(lambda x: minimise(problem, x, **options), in_axes=-1, out_axes=-1)
    )
    every = search(starts)
    order = jnp.where(every.converged, every.criterion.objective, jnp.inf)
    order = jnp.where(jnp.any(every.converged), order, every.violation)
    # `argmin` would take a NaN for the least.
    best = jnp.argmin(jnp.where(jnp.isnan(order), jnp.inf, order))
    return jax.tree.map(lambda x: x[..., best], every), every


def _by_multipliers(
    common: _Common, bounded: bool, rounds: tuple[int, int, int, Scalar], before: Minimum | None
) -> Minimum:
    """Descents in free numbers, from which the bounds make x."""
    max_steps, max_rounds, adam_steps, adam_rate = rounds
    limits, problem = common.limits, common.problem
    first = limits.free(common.start) if bounded else common.start
    q0, unravel = ravel_pytree(first)

    def inside(q: Array) -> Point:
        return limits.inside(unravel(q)) if bounded else unravel(q)

    shapes = jax.eval_shape(problem, common.start)
    blank = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)
    state = multipliers.begin(q0, sizes_of(first), blank, max_rounds, adam_steps, common.check)
    if before is not None:
        state = _taken_up(before, state)

    def evaluate(s: multipliers.Descent) -> multipliers.Evaluation:
        x, to_free = jax.vjp(inside, s.trial)
        flat, back = ravel_pytree(x)

        def value(flat: Array) -> tuple[Array, tuple[Array, Criterion]]:
            criterion = problem(back(flat))
            total = multipliers.lagrangian(criterion, s.dual, s.rho)
            return total, (total, criterion)

        # In x, where the slope is what a bound takes; in the free numbers it is zero there.
        held, (total, criterion) = jax.grad(value, has_aux=True)(flat)
        slopes, _ = ravel_pytree(to_free(back(held))[0])
        return multipliers.Evaluation(total, slopes, held, criterion)

    options = multipliers.Options(common.tolerance, max_steps, adam_rate)
    last, interrupted = drive(
        evaluate,
        lambda s, found: multipliers.advance(s, found, options),
        lambda s: multipliers.unfinished(s, options),
        state,
        common.progress,
    )
    x = inside(last.x)
    held = ravel_pytree(x)[1](last.held if bounded else jnp.zeros_like(last.held))
    missed = last.violation > common.tolerance
    converged = (last.gradient <= common.tolerance) & ~missed
    finite = jnp.isfinite(last.value)
    limited = (last.taken >= max_rounds) & ~missed
    return Minimum(
        x=x,
        criterion=last.criterion,
        multipliers=last.dual,
        gradient=last.gradient,
        violation=last.violation,
        steps=last.steps,
        converged=converged,
        gradient_error=last.wrong,
        reason=_reason(last.wrong, interrupted, finite, converged, limited, missed),
        bound_multipliers=held,
        history=_rows(before, last.rows),
        search=last,
    )


def _by_sqp(
    common: _Common,
    max_steps: int,
    exact_hessian: bool,
    scale: Point | None,
    before: Minimum | None,
) -> Minimum:
    """Quadratic programmes in scaled unknowns, with scaled objective and constraints."""
    problem = common.problem
    x0, unravel = ravel_pytree(common.start)
    low, high = (ravel_pytree(b)[0] for b in common.limits)
    size = _sizes(x0, low, high) if scale is None else ravel_pytree(scale)[0]

    if before is not None and isinstance(before.search, sqp_state.SqpState):
        # The search goes on in its own scaled unknowns.
        size = before.search.size

    def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
        criterion = problem(unravel(size * z))
        parts = (criterion.objective, criterion.equal_zero, criterion.non_negative)
        stacked = jnp.concatenate([jnp.ravel(x) for x in parts if x is not None])
        return stacked, (stacked, criterion)

    shapes = jax.eval_shape(problem, common.start)
    me = 0 if shapes.equal_zero is None else shapes.equal_zero.size
    mi = 0 if shapes.non_negative is None else shapes.non_negative.size
    # Forward mode costs a run for each unknown, reverse mode several for each number, and more to
    # compile.
    mode = jax.jacfwd if x0.size <= 16 * (1 + me + mi) else jax.jacrev
    derivatives = mode(numbers, has_aux=True)

    def evaluate(s: sqp_state.SqpState) -> sqp_state.Found:
        jacobian, (values, criterion) = derivatives(s.trial)
        return sqp_state.Found(values, jacobian, criterion)

    curvature = jax.hessian(lambda z, w: w @ numbers(z)[0]) if exact_hessian else None
    limits = sqp_state.Limits(low / size, high / size, jnp.asarray(common.tolerance, x0.dtype))
    blank = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)
    # A start far outside of the bounds would leave the first programme without a solution.
    z0 = jnp.clip(x0, low, high) / size
    state = sqp_state.begin(z0, size, me, mi, blank, max_steps, common.check)
    if before is not None:
        state = _taken_up(before, state)
    last, interrupted = drive(
        evaluate,
        lambda s, found: sqp.advance(s, found, limits, curvature),
        lambda s: sqp_state.unfinished(s, limits),
        state,
        common.progress,
    )
    return _sqp_minimum(last, unravel, size, common.tolerance, interrupted, before)


def _sqp_minimum(
    last: sqp_state.SqpState,
    unravel: Callable[[Array], Point],
    size: Array,
    tolerance: Scalar,
    interrupted: bool,
    before: Minimum | None,
) -> Minimum:
    """The result in the units of the problem."""
    me, weight = last.y.size, last.weight
    c, d = last.at.report.equal_zero, last.at.report.non_negative
    # The search has scaled objective and constraints: a multiplier is the quotient of both scales.
    y = last.y * weight[1 : 1 + me] / weight[0]
    nu = last.nu * weight[1 + me :] / weight[0]
    slope = (last.at.g + last.at.J.T @ last.y - last.at.K.T @ last.nu) / (weight[0] * size)
    violation = jnp.zeros_like(last.gradient)
    if c is not None:
        violation = jnp.maximum(violation, jnp.max(jnp.abs(c)))
    if d is not None:
        violation = jnp.maximum(violation, jnp.max(-d))
    missed = last.violation > tolerance
    converged = (last.gradient <= tolerance) & ~missed
    finite = jnp.isfinite(last.at.f) & jnp.all(jnp.isfinite(last.at.g))
    limited = last.taken >= last.rows.shape[0]
    rows = _rows(before, last.rows)
    return Minimum(
        x=unravel(size * last.x),
        criterion=last.at.report,
        multipliers=Criterion(
            jnp.ones_like(last.at.f),
            None if c is None else y.reshape(c.shape),
            None if d is None else nu.reshape(d.shape),
        ),
        gradient=last.gradient,
        violation=violation,
        steps=last.taken if before is None else last.taken + before.steps,
        converged=converged,
        gradient_error=last.wrong,
        reason=_reason(last.wrong, interrupted, finite, converged, limited, missed),
        bound_multipliers=unravel(slope),
        history=rows,
        search=last,
    )


def _reason(
    wrong: Array, interrupted: bool, finite: Array, converged: Array, limited: Array, missed: Array
) -> Int[Array, ""]:
    """The reason of the end, of which a wrong gradient and an interruption come first."""
    reason = stop_reason(finite, converged, limited, missed)
    if interrupted:
        reason = jnp.full_like(reason, StopReason.INTERRUPTED)
    return jnp.where(wrong > GRADIENT_TOLERANCE, StopReason.WRONG_GRADIENT, reason).astype(int)


def _taken_up(before: Minimum, blank: Any) -> Any:
    """The state in which a search ended, with room for as many further steps."""
    last = before.search
    if type(last) is not type(blank) or last.trial.shape != blank.trial.shape:
        raise InputError("start is a Minimum of another problem or method: start from its x.")
    # What was pending when it ended is evaluated first.
    return last._replace(rows=blank.rows, taken=jnp.asarray(0))


def _rows(before: Minimum | None, rows: Array) -> Float[Array, "rows 3"]:
    """The history, with that of the search that was taken up before it."""
    if before is None:
        return rows
    old = before.history
    # Rows that were not taken are NaN, and would stand between both searches.
    return jnp.concatenate([old[~jnp.isnan(old[:, 0])], rows])


def _sizes(x: Array, low: Array, high: Array) -> Array:
    """The range of the bounds, or the larger of the start and 1."""
    both = jnp.isfinite(low) & jnp.isfinite(high)
    return jnp.where(both, jnp.where(both, high - low, 1.0), jnp.maximum(jnp.abs(x), 1.0))

"""A local minimum under constraints and bounds, by gradients.

    minimise f(x)   subject to   c(x) = 0,   d(x) >= 0,   a <= x <= b

    method           how                                                      for
    "multipliers"    L-BFGS inside the method of multipliers                  many unknowns
    "sqp"            quadratic programmes with the full Jacobian              up to about a hundred

Files: `_multipliers.py`, `_sqp.py`, `_bounds.py`. Valid for smooth functions. `f` may be infinite
outside its domain: both methods turn back.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..core import InputError, Scalar, is_concrete
from ._bounds import Bounds, as_bounds
from ._criterion import Criterion, Minimum, Point, stop_reason
from ._gradient_check import gradient_error, warn_of_gradient
from ._multipliers import solve_multipliers
from ._sqp import Values, solve_sqp

METHODS = ("multipliers", "sqp")


def minimise(
    problem: Callable[[Point], Criterion],
    start: Point,
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
) -> Minimum:
    """A local minimum of `problem(x).objective` under its constraints.

    **Arguments**

    - `problem`: from a point to its `Criterion`.
    - `start`: the point at which the descent begins, a tree of arrays.
    - `bounds`: a pair of lower and upper bounds, each a tree like `start`, a number or `None`.
    - `method`: "multipliers" or "sqp".
    - `tolerance`: for the gradient and for the violation; of "sqp" after its scaling.
    - `max_steps`: of one descent, or of "sqp"; `max_rounds`: number of descents.
    - `check_gradient`: whether to compare the gradient at the start with the slope of the
      objective, by four more evaluations. A warning names the difference; under `jit` it stands in
      `gradient_error`.
    - `adam_steps`, `adam_rate`: steps of Adam before the first descent of "multipliers", for flat
      or rough starts.
    - `exact_hessian`: of "sqp": curvature by second derivatives in place of BFGS, for problems that
      are cheap to differentiate twice.
    - `scale`: of "sqp": sizes of the unknowns, a tree like `start`; by default the range of the
      bounds, or the larger of the start and 1.

    **Returns** the `Minimum`, which reports in `converged` whether the tolerance was met and in
    `sentence()` why it ended. It is not differentiable in what `problem` closes over. Wrap the call
    in `jax.jit` where it is repeated.

    **Raises** `InputError` for an unknown method, or bounds that do not fit.
    """
    if method not in METHODS:
        raise InputError(f"method is {method!r}: it must be one of {', '.join(METHODS)}.")
    limits = as_bounds(bounds, start)
    if method == "sqp":
        found = _by_sqp(
            problem, start, limits, tolerance, max_steps, check_gradient, exact_hessian, scale
        )
    else:
        options = (tolerance, max_steps, max_rounds, check_gradient, adam_steps, adam_rate)
        found = _by_multipliers(problem, start, limits if bounds is not None else None, options)
    if is_concrete(found.gradient_error):
        warn_of_gradient(float(found.gradient_error), stacklevel=2)
    return found


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
    best = jnp.argmin(jnp.where(jnp.isnan(order), jnp.inf, order))
    return jax.tree.map(lambda x: x[..., best], every), every


def _by_multipliers(
    problem: Callable[[Point], Criterion], start: Point, bounds: Bounds | None, options: Any
) -> Minimum:
    """Descents in free numbers, from which the bounds make x."""
    inner, first = problem, start
    if bounds is not None:
        first = bounds.free(start)
        inner = lambda q: problem(bounds.inside(q))  # noqa: E731
    last = solve_multipliers(inner, first, *options)
    tolerance, max_rounds = options[0], options[2]
    x = last.x if bounds is None else bounds.inside(last.x)
    held = jax.tree.map(jnp.zeros_like, x)
    if bounds is not None:
        # With the multipliers as they are, the slope in x is what a bound takes.
        held = jax.grad(lambda x: _plain_lagrangian(problem(x), last.dual))(x)
    missed = last.violation > tolerance
    converged = (last.gradient <= tolerance) & ~missed
    finite = jnp.isfinite(last.criterion.objective)
    return Minimum(
        x=x,
        criterion=last.criterion,
        multipliers=last.dual,
        gradient=last.gradient,
        violation=last.violation,
        steps=last.steps,
        converged=converged,
        gradient_error=last.gradient_error,
        reason=stop_reason(finite, converged, (last.rounds >= max_rounds) & ~missed, missed),
        bound_multipliers=held,
        history=last.history,
    )


def _plain_lagrangian(criterion: Criterion, dual: Criterion) -> Float[Array, ""]:
    """f + lambda . c - nu . d."""
    total = criterion.objective
    for values, weights, sign in (
        (criterion.equal_zero, dual.equal_zero, 1.0),
        (criterion.non_negative, dual.non_negative, -1.0),
    ):
        if values is not None and weights is not None:
            total = total + sign * jnp.sum(weights * values)
    return total


def _by_sqp(
    problem: Callable[[Point], Criterion],
    start: Point,
    bounds: Bounds,
    tolerance: Scalar,
    max_steps: int,
    check_gradient: bool,
    exact_hessian: bool,
    scale: Point | None,
) -> Minimum:
    """Quadratic programmes in scaled unknowns, with scaled objective and constraints."""
    x0, unravel = ravel_pytree(start)
    low, high = (ravel_pytree(b)[0] for b in bounds)
    size = _sizes(x0, low, high) if scale is None else ravel_pytree(scale)[0]

    def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
        criterion = problem(unravel(size * z))
        parts = [jnp.ravel(criterion.objective)]
        parts += [
            jnp.ravel(x) for x in (criterion.equal_zero, criterion.non_negative) if x is not None
        ]
        stacked = jnp.concatenate(parts)
        return stacked, (stacked, criterion)

    shapes = jax.eval_shape(problem, start)
    me = 0 if shapes.equal_zero is None else shapes.equal_zero.size
    mi = 0 if shapes.non_negative is None else shapes.non_negative.size
    # Forward mode costs a run for each unknown, reverse mode several for each number.
    mode = jax.jacfwd if x0.size <= 4 * (1 + me + mi) else jax.jacrev
    derivatives = mode(numbers, has_aux=True)
    # Evaluated once before the loop: every place is one more copy of the problem to compile.
    z0 = jnp.clip(x0, low, high) / size
    first = derivatives(z0)
    first_jacobian = first[0]
    weight = _weights(first_jacobian)

    def scaled(found: tuple[Array, tuple[Array, Criterion]]) -> Values:
        jacobian, (values, criterion) = found
        values, jacobian = weight * values, weight[:, None] * jacobian
        f, c, d = values[0], values[1 : 1 + me], values[1 + me :]
        return Values(f, c, d, jacobian[0], jacobian[1 : 1 + me], jacobian[1 + me :], criterion)

    def lagrangian(z: Array, y: Array, nu: Array) -> Array:
        return jnp.concatenate([jnp.ones(1, z.dtype), y, -nu]) @ (weight * numbers(z)[0])

    curvature = jax.hessian(lagrangian) if exact_hessian else None
    wrong = jnp.zeros((), x0.dtype)
    if check_gradient:
        mixed = weight * jnp.cos(1.3 * jnp.arange(weight.size, dtype=weight.dtype))
        slope = mixed @ first_jacobian
        wrong = gradient_error(lambda z: mixed @ numbers(z)[0], z0, slope)
    last = solve_sqp(
        lambda z: scaled(derivatives(z)),
        z0,
        scaled(first),
        low / size,
        high / size,
        tolerance,
        max_steps,
        curvature,
    )
    return _sqp_minimum(last, unravel, size, weight, tolerance, max_steps, wrong)


def _sqp_minimum(
    last: Any,
    unravel: Callable[[Array], Point],
    size: Array,
    weight: Array,
    tolerance: Scalar,
    max_steps: int,
    wrong: Array,
) -> Minimum:
    """The result in the units of the problem."""
    me = last.y.size
    c, d = last.at.report.equal_zero, last.at.report.non_negative
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
        steps=last.steps,
        converged=converged,
        gradient_error=wrong,
        reason=stop_reason(finite, converged, last.steps >= max_steps, missed),
        bound_multipliers=unravel(slope),
        history=last.rows,
    )


def _sizes(x: Array, low: Array, high: Array) -> Array:
    """The range of the bounds, or the larger of the start and 1."""
    both = jnp.isfinite(low) & jnp.isfinite(high)
    return jnp.where(both, jnp.where(both, high - low, 1.0), jnp.maximum(jnp.abs(x), 1.0))


def _weights(jacobian: Float[Array, "rows n"]) -> Float[Array, " rows"]:
    """The inverse of the size of each row of the Jacobian; 1 for a row of zeros."""
    row = jnp.max(jnp.abs(jacobian), axis=1)
    usable = (row > 0.0) & jnp.isfinite(row)
    return jnp.where(usable, 1.0 / jnp.where(usable, row, 1.0), 1.0)

"""Gradient-based local minimisation under constraints and bounds.

    minimise f(x)   subject to   c(x) = 0,   d(x) >= 0,   a <= x <= b

Files: `_scaling.py`, `_search.py`, `_sqp.py` (quadratic programmes), `_descent.py` (optimisers of
optax), `_bounds.py`. Valid for smooth functions; the quadratic programmes for up to a few hundred
unknowns. `f` may be infinite outside its domain: the search backtracks.
"""

import os
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..core import InputError, Scalar
from ..core.formula import POSITIVE, formula
from ..core.jit import compiled
from ..core.status import sentence_alone
from ..core.tracing import is_traced
from ._bounds import as_bounds
from ._criterion import Criterion, Minimum, Point, StopReason, worst_number
from ._drive import Progress
from ._entry import as_point, check_scale, check_steps
from ._gradient_check import has_kink, refuse
from ._scaling import scaled_problem
from ._search import FORWARD_RATIO, search
from .optimiser import SQP, Optimiser, check_optimiser, kept_optimiser
from .search_store import SearchStore, as_store


@formula(tolerance=POSITIVE)
def minimise(
    problem: Callable[[Point], Criterion],
    start: PyTree | Minimum,
    *,
    optimiser: Optimiser = SQP,
    bounds: tuple[PyTree, PyTree] | None = None,
    tolerance: Scalar = 1e-9,
    max_steps: int = 200,
    check_gradient: bool = True,
    exact_hessian: bool = False,
    scale: PyTree | None = None,
    progress: Progress | None = None,
    store: SearchStore | str | os.PathLike[str] | None = None,
    resume: bool = False,
    forward_ratio: float = FORWARD_RATIO,
) -> Minimum:
    """A local minimum of `problem(x).objective` under its constraints.

    **Arguments**

    - `problem`: a function from a point to its `Criterion`.
    - `start`: the starting point, a pytree of floats, moved to the nearest one within the bounds;
      or a `Minimum` whose search ended early, to be continued with the same options.
    - `optimiser`: "sqp" for sequential quadratic programming, which needs the fewest evaluations
      with many constraints; or any optimiser of optax, such as `optax.adam(1e-2)` or
      `optax.lbfgs()`. Its rates are in units of `scale`; constraints are handled with multipliers
      (an augmented Lagrangian), and the best point is returned. Most require more steps than the
      default of `max_steps`.
    - `bounds`: a pair of lower and upper bounds, each a pytree like `start`, a number or `None`.
    - `tolerance`: for the gradient and for the violation, both scaled.
    - `max_steps`: the largest number of steps.
    - `check_gradient`: whether to compare the gradient at the start with the slope of the
      objective, by four more evaluations (up to 25 where the slope changes very close to the start,
      as near a singularity), and to raise an error if they differ; under `jit` the search ends
      there with the reason `WRONG_GRADIENT`.
    - `exact_hessian`: whether the quadratic programmes use exact second derivatives instead of
      BFGS, for problems that are cheap to differentiate twice.
    - `scale`: typical sizes of the unknowns, a pytree like `start`; by default the range of the
      bounds, or the larger of the start and 1. Objective and constraints are scaled by their
      derivatives at the start, or by their values where those derivatives are far smaller.
      Convergence is assessed with those at the result, with which the search continues if the start
      was much steeper.
    - `progress`: called after each step with its number, objective, scaled violation and
      gradient; not under `jit`. Ctrl-C ends such a search with the best result so far, from its
      first step on.
    - `store`: the path of a file in which the search saves its state; not under `jit`.
    - `resume`: whether to continue from that file, if it exists, after an interrupted process: with
      bit-identical steps.
    - `forward_ratio`: number of unknowns per objective and constraint up to which derivatives are
      computed in forward mode, and beyond it in reverse mode; 0 for reverse mode.

    **Returns** the `Minimum`, which reports in `converged` whether the tolerance was reached and in
    `sentence()` why the search ended. It is not differentiable with respect to closed-over values
    of `problem`. The problem and its derivatives are compiled once; wrap the call in `jax.jit`
    where it is repeated.

    **Raises** `InputError` for incompatible bounds or scale, unknowns that are not floats, a
    problem that does not return a `Criterion` of arrays, a `Minimum` of another problem or
    optimiser, an invalid optimiser, a gradient that disagrees with finite differences, or a store
    that exists or belongs to another search; `SimulationError` for a run of the problem that fails.
    """
    kept = as_store(store, resume)
    before = start if isinstance(start, Minimum) else None
    check_steps(max_steps)
    check_optimiser(optimiser, exact_hessian)
    x = as_point(start.x if isinstance(start, Minimum) else start)
    if scale is not None:
        check_scale(scale, x)
    limits = as_bounds(bounds, x)
    # Traced once for its shapes and its derivatives. One that is a tree of arrays is an argument.
    problem = compiled(problem)
    if before is not None and before.search is None:
        raise InputError("start is a Minimum without the state of its search: start from its x.")
    check = check_gradient and before is None
    # A run of the problem may fail.
    with sentence_alone():
        scaled = scaled_problem(problem, x, limits, scale, before, bounds is not None)
        minimum = search(
            scaled,
            optimiser,
            tolerance,
            max_steps,
            exact_hessian,
            check,
            progress,
            before,
            kept,
            forward_ratio,
        )
    if check_gradient and not is_traced(minimum.gradient_error):

        def kink() -> bool:
            row = int(minimum.search.worst)
            numbers = lambda z: scaled.numbers(z)[0]  # noqa: E731
            return has_kink(numbers, scaled.start, scaled.low, scaled.high, row)

        refuse(float(minimum.gradient_error), worst_number(minimum), minimum.unread, kink)
    return minimum


@formula(tolerance=POSITIVE)
def minimise_from(
    problem: Callable[[Point], Criterion],
    starts: PyTree,
    *,
    optimiser: Optimiser = SQP,
    bounds: tuple[PyTree, PyTree] | None = None,
    tolerance: Scalar = 1e-9,
    max_steps: int = 200,
    check_gradient: bool = True,
    exact_hessian: bool = False,
    scale: PyTree | None = None,
) -> tuple[Minimum, Minimum]:
    """The best minimum from several starts, searched in one batch.

    **Arguments**

    - `problem`: as in `minimise`.
    - `starts`: pytrees whose arrays have the starts on the last axis.
    - The others: as in `minimise`, for every start.

    **Returns** the best one, with the least objective among those that converged, or the least
    violation if none did; and all of them, with the starts on the last axis.

    **Raises** as `minimise` does; `InputError` for a wrong gradient at any of the starts.
    """
    points = as_point(starts, "starts")
    first = jax.tree.map(lambda x: x[..., 0], points)
    check_steps(max_steps)
    check_optimiser(optimiser, exact_hessian)
    if scale is not None:
        check_scale(scale, first)
        scale = jax.tree.map(jnp.asarray, scale)
    # As arrays, which are arguments of the program: searches with other bounds share it.
    limits = None if bounds is None else tuple(as_bounds(bounds, first))
    optimiser = optimiser if optimiser == SQP else kept_optimiser(optimiser)
    options = (optimiser, max_steps, check_gradient, exact_hessian)
    numbers = (limits, jnp.asarray(tolerance, jnp.result_type(float)), scale)
    with sentence_alone():
        every = jax.block_until_ready(compiled(_from_each)(problem, points, numbers, options))
    if check_gradient and not is_traced(every.gradient_error):
        # As for one start, but at the end, because a search in a batch cannot be rejected before.
        worst = jnp.argmax(every.gradient_error)
        first = jax.tree.map(lambda x: x[..., worst], every)
        refuse(float(first.gradient_error), worst_number(first), first.unread)
    order = jnp.where(every.converged, every.criterion.objective, jnp.inf)
    # A start whose numbers are not finite has no violation either.
    begun = jnp.where(every.reason == StopReason.NOT_FINITE, jnp.inf, every.violation)
    order = jnp.where(jnp.any(every.converged), order, begun)
    # `argmin` would take NaN as the least.
    best = jnp.argmin(jnp.where(jnp.isnan(order), jnp.inf, order))
    return jax.tree.map(lambda x: x[..., best], every), every


def _from_each(
    problem: Callable[[Point], Criterion],
    starts: PyTree,
    numbers: tuple[tuple[PyTree, PyTree] | None, Scalar, PyTree | None],
    options: tuple[Optimiser, int, bool, bool],
) -> Minimum:
    """The minima from each start: of `minimise_from`, with its arguments that are `numbers`
    (bounds, tolerance and scale), and its other `options`."""
    bounds, tolerance, scale = numbers
    optimiser, max_steps, check_gradient, exact_hessian = options

    def one(start: PyTree) -> Minimum:
        return minimise(
            problem,
            start,
            optimiser=optimiser,
            bounds=bounds,
            tolerance=tolerance,
            max_steps=max_steps,
            check_gradient=check_gradient,
            exact_hessian=exact_hessian,
            scale=scale,
        )

    return jax.vmap(one, in_axes=-1, out_axes=-1)(starts)

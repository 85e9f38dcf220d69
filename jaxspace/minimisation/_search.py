"""Search for the minimum of a scaled problem, by quadratic programmes (`_sqp.py`) or by an
optimiser of optax (`_descent.py`), from its start or from the end of an earlier search, to a
`Minimum` in the units of the problem (`_result.py`)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import InputError, Scalar
from ..core.tracing import is_traced
from . import _descent as descent
from . import _descent_state as descent_state
from . import _sqp as sqp
from . import _sqp_state as sqp_state
from ._criterion import Minimum, farthest
from ._drive import Progress, at_once, drive
from ._free_numbers import free_numbers
from ._result import End, minimum_of
from ._scaling import ScaledProblem
from .optimiser import SQP, as_stepper
from .search_store import SearchStore

# In sizes of the unknowns: a line search of optax continues with its largest step, 1e6 at most,
# where the objective falls without bound.
FARTHEST_BY_OPTAX = 1e7

# How many unknowns there may be for each number that is differentiated, up to which forward mode
# compiles and runs sooner.
FORWARD_RATIO = 16.0


class Method(NamedTuple):
    """The interface of a search for `drive`; `end`: the place of its result, from its last
    state."""

    state: Any
    evaluate: Callable[[Any], Any]
    advance: Callable[[Any, Any], Any]
    unfinished: Callable[[Any], Array]
    end: Callable[[Any], End]


def search(
    scaled: ScaledProblem,
    optimiser: object,
    tolerance: Scalar,
    max_steps: int,
    exact_hessian: bool,
    check: bool,
    progress: Progress | None,
    before: Minimum | None,
    store: SearchStore | None = None,
    ratio: float = FORWARD_RATIO,
) -> Minimum:
    """The minimum of a scaled problem; the arguments are those of `minimise`, `check` says whether
    the gradient at the start is compared with differences, `before` is the search to
    continue, `store` saves its state, and `ratio` determines the mode of differentiation."""
    z0 = scaled.start
    least = jnp.asarray(tolerance, z0.dtype)
    by_programmes = optimiser == SQP
    most = farthest(z0) if by_programmes else farthest(z0, FARTHEST_BY_OPTAX)
    limits = sqp_state.Limits(scaled.low, scaled.high, least, most)
    if by_programmes:
        method = _by_programmes(scaled, limits, max_steps, exact_hessian, check, ratio)
    else:
        method = _by_optax(scaled, limits, optimiser, max_steps, check, ratio)
    state = method.state if before is None else _resumed(before, method.state)
    if store is not None:
        if is_traced(state):
            raise InputError(
                "store is given under jit: a traced search has no concrete values to store."
            )
        state = store.begin(state, (limits, scaled.size, state))
    steps = (method.evaluate, method.advance, method.unfinished)
    last, interrupted = drive(*steps, state, progress, store)
    minimum = at_once(_minimum, method.end, last, limits, interrupted)
    history = minimum.history
    if before is not None:
        # Rows of steps not taken are NaN, and would separate the two searches.
        old = before.history
        history = jnp.concatenate([old[~jnp.isnan(old[:, 0])], history])
    x = scaled.point(minimum.x / scaled.size)
    held = scaled.unravel(minimum.bound_multipliers)
    places = lambda m: (m.x, m.bound_multipliers, m.history)  # noqa: E731
    return eqx.tree_at(places, minimum, (x, held, history))


def _by_programmes(
    scaled: ScaledProblem,
    limits: sqp_state.Limits,
    max_steps: int,
    exact_hessian: bool,
    check: bool,
    ratio: float,
) -> Method:
    curvature = jax.hessian(lambda z, w: w @ scaled.numbers(z)[0]) if exact_hessian else None
    return Method(
        at_once(
            sqp_state.begin,
            scaled.start,
            scaled.size,
            scaled.me,
            scaled.mi,
            scaled.blank,
            max_steps,
            check,
            limits,
        ),
        # Trees of arrays and of functions of this module: their programs are reused by other
        # searches.
        eqx.Partial(_evaluated, scaled, ratio),
        eqx.Partial(sqp.advance, limits=limits, curvature=curvature),
        eqx.Partial(sqp_state.unfinished, limits=limits),
        eqx.Partial(_end_of_programmes, limits),
    )


def _evaluated(scaled: ScaledProblem, ratio: float, s: sqp_state.SqpState) -> sqp_state.Evaluation:
    jacobian, (values, criterion) = scaled.derivatives(s.trial, ratio)
    return sqp_state.Evaluation(values, jacobian, criterion)


def _end_of_programmes(limits: sqp_state.Limits, s: sqp_state.SqpState) -> End:
    return End(
        s.x,
        s.at,
        s.y,
        s.nu,
        s.pending.y,
        s.pending.nu,
        sqp_state.diverged(s, limits),
        sqp_state.at_rounding(s, limits),
        s.judged,
    )


def _minimum(
    end: Callable[[PyTree], End], last: PyTree, limits: sqp_state.Limits, interrupted: bool
) -> Minimum:
    return minimum_of(end(last), last, limits, interrupted)


def _by_optax(
    scaled: ScaledProblem,
    limits: sqp_state.Limits,
    optimiser: object,
    max_steps: int,
    check: bool,
    ratio: float,
) -> Method:
    q0, z0, free = scaled.start, scaled.start, None
    if scaled.bounded:
        free = free_numbers(scaled.start, scaled.low, scaled.high)
        q0, z0 = free.first(), free.start
    stepper = as_stepper(optimiser, q0, scaled.unravel)
    setting = descent_state.Setting(scaled, ratio, free, stepper, limits, check)
    begin = (q0, z0, scaled.size, (scaled.me, scaled.mi), scaled.blank, max_steps, check)
    evaluate, advance = descent.evaluate, eqx.Partial(descent.advance, setting=setting)
    if stepper.restarts:
        # A line search evaluates the problem within its step, which then is one program with it.
        evaluate, advance = descent.evaluated_step, _taken
    return Method(
        at_once(descent_state.begin, *begin, stepper, limits),
        # Trees, as those of `_by_programmes`: another search with an equal optimiser compiles
        # nothing.
        eqx.Partial(evaluate, setting=setting),
        advance,
        eqx.Partial(descent_state.unfinished, limits=limits),
        eqx.Partial(descent_state.end, limits=limits),
    )


def _taken(s: descent_state.DescentState, after: descent_state.DescentState) -> PyTree:
    """The state that `evaluated_step` returned in place of an evaluation."""
    del s
    return after


def _resumed(before: Minimum, blank: PyTree) -> PyTree:
    """The state in which a search ended, with space for as many further steps."""
    last = before.search
    # Another number of constraints means another problem; the rows are for the new limit of steps.
    if _shapes(last) != _shapes(blank):
        raise InputError("start is a Minimum of another problem or optimiser: start from its x.")
    return last.resumed(blank.rows)


def _shapes(state: PyTree) -> tuple[PyTree, list[tuple[int, ...]]]:
    leaves, structure = jax.tree.flatten(state._replace(rows=None))
    return structure, [x.shape for x in leaves]

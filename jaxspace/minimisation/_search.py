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
from ._criterion import Criterion, Minimum, farthest
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
    continue, `store` keeps its state, and `ratio` decides the mode of differentiation."""
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


def _derivatives(scaled: ScaledProblem, ratio: float) -> Callable[[Array], PyTree]:
    """The Jacobian of the stacked numbers in z, together with the numbers and the criterion: in
    forward mode for up to `ratio` unknowns per number."""

    def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
        stacked, criterion = scaled.numbers(z)
        return stacked, (stacked, criterion)

    # Forward mode costs a run for each unknown; reverse mode costs several runs for each number,
    # and compiles for longer.
    forward = scaled.start.size <= ratio * (1 + scaled.me + scaled.mi)
    mode = jax.jacfwd if forward else jax.jacrev
    return mode(numbers, has_aux=True)


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
    jacobian, (values, criterion) = _derivatives(scaled, ratio)(s.trial)
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
    q0, z0, inside = scaled.start, scaled.start, None
    if scaled.bounded:
        free = free_numbers(scaled.start, scaled.low, scaled.high)
        q0, z0, inside = free.first(), free.start, free.inside
    stepper = as_stepper(optimiser, q0, scaled.unravel)
    counts = (scaled.me, scaled.mi)
    derivatives = _derivatives(scaled, ratio)
    values, constrained = _values(scaled, derivatives), counts != (0, 0)
    setting = descent_state.Setting(
        derivatives, values, inside, stepper, limits, scaled.me, constrained, check
    )
    begin = (q0, z0, scaled.size, counts, scaled.blank, max_steps, check, stepper, limits)
    return Method(
        at_once(descent_state.begin, *begin),
        *_steps(setting),
        lambda s: descent_state.unfinished(s, limits),
        lambda s: descent_state.end(s, limits),
    )


def _values(
    scaled: ScaledProblem, derivatives: Callable[[Array], PyTree]
) -> Callable[[Array], Array]:
    """The stacked numbers in z, whose derivative is by the mode of `derivatives`: a line search
    differentiates them once more."""

    @jax.custom_jvp
    def values(z: Array) -> Array:
        return scaled.numbers(z)[0]

    @values.defjvp
    def by_jacobian(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        jacobian, (stacked, _) = derivatives(*primals)
        return stacked, jacobian @ tangents[0]

    return values


def _steps(
    setting: descent_state.Setting,
) -> tuple[
    Callable[[descent_state.DescentState], PyTree],
    Callable[[PyTree, PyTree], descent_state.DescentState],
]:
    """`evaluate` and `advance` of a search by an optimiser of optax."""

    def evaluate(s: descent_state.DescentState) -> sqp_state.Evaluation:
        return descent.evaluate(s, setting)

    def advance(s: PyTree, found: sqp_state.Evaluation) -> descent_state.DescentState:
        return descent.advance(s, found, setting)

    if setting.stepper.restarts:
        # A line search evaluates the problem within its step, which then is one program with it.
        return lambda s: advance(s, evaluate(s)), lambda s, after: after
    return evaluate, advance


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

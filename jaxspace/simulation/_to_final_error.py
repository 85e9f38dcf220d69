"""The tolerance that yields the final error requested by the user (`FinalError`).

Runs with ever smaller tolerances r_0 > r_1 > ... differ at their ends by d_k = |y_k - y_k+1|, which
is about the error of the run k, and errors fall with the tolerance by a power p:

    E_k+1 = S max(d_k (r_k+1 / r_k)^p, d_k-1 (r_k+1 / r_k-1)^p)
    p     = log(d_k-1 / d_k) / log(r_k-1 / r_k)

with a safety S; of two differences, because the errors of two runs may be equal by chance. After
jumps at events the errors follow no power: the latest difference is not taken to fall. The run with
E <= 1, in units of the requested error, is returned. A tolerance is a number of the program: all
runs are one program. Each run of a batch has its own, which is unchanged when the others need more.
Under a transformation the search is a loop without derivatives, and the last run is made once more,
with them.

Of a closed form the error is that of its roundings: `AMPLIFIED` times the change due to rounding of
the initial state and of the times.
"""

import dataclasses
import functools
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from ..core import AbstractSystem, InputError, Scalar
from ..core.captured import captured_as_leaves
from ..core.status import Status
from ..core.tracing import is_traced
from ..integration.accuracy import least_tolerance
from ..integration.initial_state import InitialState, state_dtype
from ._final_error import FinalError, Measured, distance, rounding
from .finish import checked
from .mission_result import Result, Simulated

# Tolerances: one for each run of a batch, or of a run alone.
Rtol: TypeAlias = Float[Array | np.ndarray, "*runs"]

# The first two tolerances lie so far apart. A looser first run would cost less, and the error of
# the second would be guessed across a gap in which that of edges of forces follows no power.
TOLERANCE_RATIO = 10.0
# In units of the error that a motion without growth would have.
SECOND = 0.5
# Below the tolerance from which "auto" takes another method: all runs are one program.
CHOSEN_AT = 9e-6
# The largest of all.
LOOSEST_TOLERANCE = 3e-5
# The error of one step falls with the tolerance, and that of all with the steps of a method of
# order 8 by a ninth less; the power is measured from the third run on, and not believed beyond.
POWER, FLATTEST, STEEPEST = 0.85, 0.5, 1.1
# Margin for errors hidden in the difference of two runs: with it all runs of `python -m validation`
# that report a reached error are within it, the worst at 0.99.
SAFETY = 3.0
# How much larger than the first difference an error after jumps may be, in units of the safety:
# that the errors of two runs are so close by chance is rare, and no earlier run shows it.
FIRST = 2.0
# Contribution of rounding in the steps to a tolerance, in units in the last place: below it errors
# do not decrease further.
ROUNDED = 64.0
# A following run aims below the requested error, and its tolerance is smaller by at most this
# factor.
AIM, LONGEST, SHORTEST = 0.7, 1e-3, 0.3
MOST_RUNS = 8
# Number of perturbed roundings of the inputs of a closed form, and the factor from their effect to
# its rounding error.
ROUNDINGS, AMPLIFIED = 2, 3.0


class Search(NamedTuple):
    """The search after a run, or after a batch of runs that each search for themselves.

    - `rtol`: the tolerance of the next run, or of the result; `made`: those of the last two, the
      later one last.
    - `last`: the measured errors of the last run; `apart`: how far it is from the one before.
    - `estimate`: its error, in units of the requested one.
    - `loose`: the tolerance of the first run, whether it is good, and its evaluations.
    - `price`: factor on the evaluations for a tenth of the error.
    - `over`: whether the last run is the result.
    - `runs`: number of runs, with their total `evaluations`."""

    rtol: Float[Array, "*runs"]
    made: Float[Array, "2 *#runs"]
    last: Measured
    apart: Float[Array, "*runs"]
    estimate: Float[Array, "*runs"]
    loose: tuple[Float[Array, "*runs"], Bool[Array, "*runs"], Array]
    price: Float[Array, "*runs"]
    over: Bool[Array, "*runs"]
    runs: Array
    evaluations: Array


def to_final_error(
    verb: Callable[..., Result],
    run: tuple[PyTree, PyTree, PyTree],
    asked: FinalError,
    throw: bool,
    options: dict[str, Any],
    runs: tuple[int, ...] = (),
) -> Result:
    """The result of a verb with the error that is `asked` for.

    **Arguments**

    - `verb`: one of the four; `run`: its system or mission, its initial state and its times.
    - `throw`, `options`: its further arguments.
    - `runs`: number of runs of a batch."""
    y0, dtype = InitialState.of(run[1], batch=bool(runs))
    if isinstance(run[0], AbstractSystem):
        # Before anything is compiled; the jumps of a mission may lead to other blocks.
        asked.check_blocks(y0)

    def simulated(parts: tuple, rtol: Rtol) -> Result:
        run, options = parts
        accuracy = dataclasses.replace(asked.accuracy, rtol=rtol, chosen_at=CHOSEN_AT)
        return verb(*run, accuracy=accuracy, throw=False, **options)

    # The numbers that functions capture have derivatives, too, which a search has not.
    parts = captured_as_leaves(((run[0], y0, run[2]), options))

    least = 2.0 * least_tolerance(dtype)
    second = jnp.clip(
        SECOND * asked.usual_tolerance(y0, runs), least, LOOSEST_TOLERANCE / TOLERANCE_RATIO
    )
    first = jnp.broadcast_to((TOLERANCE_RATIO * second).astype(dtype), runs)
    if is_traced((parts, asked)):
        result, search = _traced(simulated, parts, asked, first, least)
    else:
        result, search = _known(simulated, parts, asked, np.asarray(first), least)
    good = result.status <= Status.EVENT
    missed = good & (search.estimate > 1.0)
    result = _with_estimate(result, search, missed)
    return checked(result, throw, lambda: _best(search), stacklevel=3)


def _known(
    simulated: Callable[[tuple, Rtol], Result],
    parts: tuple,
    asked: FinalError,
    first: np.ndarray,
    least: float,
) -> tuple[Result, Search]:
    rtol, search = first, None
    while True:
        # The warnings are those of the run that is returned.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = simulated(parts, rtol)
        now = asked.measured(result)
        if _is_exact(result):
            return result, _exact(now, rtol, _rounded(simulated, parts, asked, rtol))
        search = begun(now, rtol, least) if search is None else advance(search, now, least)
        if np.all(search.over):
            again = np.any(search.rtol != rtol)
            return simulated(parts, np.asarray(search.rtol)) if again else result, search
        rtol = np.asarray(search.rtol)


def _traced(
    simulated: Callable[[tuple, Rtol], Result],
    parts: tuple,
    asked: FinalError,
    first: Rtol,
    least: float,
) -> tuple[Result, Search]:
    still = _without_derivatives(parts)

    def measured(rtol: Rtol) -> Measured:
        return _without_derivatives(asked.measured(simulated(still, rtol)))

    first = jax.lax.stop_gradient(first)
    shape = eqx.filter_eval_shape(simulated, still, first)
    if _is_exact(shape):
        result = simulated(parts, first)
        rounded = _without_derivatives(_rounded(simulated, still, asked, first))
        return result, _exact(_without_derivatives(asked.measured(result)), first, rounded)
    blank = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(measured, first))
    # Of a run that was not made nothing is good, so that the first pass only remembers.
    start = begun(blank, first * TOLERANCE_RATIO, least)._replace(rtol=first, runs=jnp.asarray(0))

    def step(search: Search) -> Search:
        now = measured(search.rtol)
        first, after = begun(now, search.rtol, least), advance(search, now, least)
        return jax.tree.map(lambda a, b: jnp.where(search.runs == 0, a, b), first, after)

    search = jax.lax.while_loop(lambda search: ~jnp.all(search.over), step, start)
    return simulated(parts, search.rtol), search


def _without_derivatives(tree: PyTree) -> PyTree:
    numbers, rest = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.lax.stop_gradient(numbers), rest)


def begun(now: Measured, rtol: Rtol | float, least: float) -> Search:
    """The search after the first run."""
    # In the precision of what is compared.
    rtol = jnp.broadcast_to(jnp.asarray(rtol, now.allowed[0].dtype), now.good.shape)
    infinite = jnp.full_like(rtol, jnp.inf)
    return Search(
        jnp.maximum(rtol / TOLERANCE_RATIO, least),
        jnp.stack([rtol, rtol]),
        now,
        infinite,
        infinite,
        (rtol, now.good, now.evaluations),
        # The error of a closed form, without another run.
        jnp.ones_like(infinite),
        jnp.zeros_like(now.good),
        jnp.asarray(1),
        now.evaluations,
    )


def _rounded(
    simulated: Callable[[tuple, Rtol], Result], parts: tuple, asked: FinalError, rtol: Rtol
) -> list[Measured]:
    """The measured errors of closed forms after rounding of the initial state and of the times."""
    (system, y0, ts), options = parts
    eps, runs = float(jnp.finfo(state_dtype(y0)).eps), rtol.ndim
    # By other signs, because the effects of two roundings may cancel.
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (ROUNDINGS, 4))

    def run(row: np.ndarray) -> Measured:
        def rounded(x: Array) -> Array:
            # Each component by itself; zeros stay.
            some = np.resize(row, x.shape[0]) if x.ndim > runs else row[:1]
            sign = some.reshape(-1, *(1,) * (x.ndim - 1)) if x.ndim else some[0]
            return x * (1.0 + eps * sign).astype(x.dtype)

        times = jax.tree.map(lambda t: t * (1.0 + eps * float(row[3])), ts)
        moved = (system, jax.tree.map(rounded, y0), times), options
        return asked.measured(simulated(moved, rtol))

    return [run(row) for row in signs]


def _exact(now: Measured, rtol: Rtol, rounded: list[Measured]) -> Search:
    """The search of a closed form, whose error is that of its roundings: `rounded` is measured with
    those of its inputs."""
    search = begun(now, rtol, 0.0)
    changes = [distance(now, other) for other in rounded]
    estimate = AMPLIFIED * functools.reduce(jnp.maximum, changes, rounding(now))
    runs = jnp.asarray(1 + len(rounded))
    spent = sum((other.evaluations for other in rounded), now.evaluations)
    over = jnp.ones_like(now.good)
    return search._replace(estimate=estimate, over=over, runs=runs, evaluations=spent)


@jax.jit
def advance(s: Search, now: Measured, least: Scalar) -> Search:
    """The search after a further run, with the tolerance `s.rtol`."""
    before, rtol = s.made[1], s.rtol
    apart = distance(s.last, now)
    seen = jnp.log(s.apart / apart) / jnp.log(s.made[0] / before)
    power = jnp.where(jnp.isfinite(seen), jnp.clip(seen, 0.0, STEEPEST), POWER)
    rounded = ROUNDED * jnp.finfo(apart.dtype).eps

    def fall(start: Array, exponent: Array | float) -> Array:
        return ((rtol + rounded) / (start + rounded)) ** exponent

    first = ~jnp.isfinite(s.apart)
    power = jnp.where(now.jumps, jnp.clip(power, POWER, STEEPEST), power)
    slower = jnp.where(first, FIRST, 1.0)
    latest = apart * jnp.where(now.jumps, slower, fall(before, power))
    earlier = jnp.where(first, 0.0, s.apart) * fall(s.made[0], power)
    estimate = SAFETY * jnp.maximum(latest, earlier)
    smaller = jnp.clip((AIM / estimate) ** (1.0 / jnp.maximum(power, FLATTEST)), LONGEST, SHORTEST)
    runs = s.runs + 1
    # A run that failed has its own status.
    over = ~now.good | (estimate <= 1.0) | (rtol <= 1.01 * least) | (runs >= MOST_RUNS)
    price = _price(s.loose, rtol, now, power)
    following = jnp.where(over, rtol, jnp.maximum(rtol * smaller, least))
    # An edge that steps cannot pass within their tolerance: the run before it is the best one.
    back = now.missed & s.last.good
    following, estimate = jnp.where(back, before, following), jnp.where(back, s.estimate, estimate)
    made = jnp.stack([before, rtol])
    # One that was over before is the same run again.
    own = jax.tree.map(
        lambda old, new: jnp.where(s.over, old, new),
        (s.rtol, s.made, s.apart, s.estimate, s.price, s.over),
        (following, made, apart, estimate, price, over),
    )
    rtol, made, apart, estimate, price, over = own
    spent = s.evaluations + now.evaluations
    return Search(rtol, made, now, apart, estimate, s.loose, price, over, runs, spent)


def _price(
    loose: tuple[Rtol, Bool[Array, "*runs"], Array], rtol: Rtol, now: Measured, power: Rtol
) -> Float[Array, "*runs"]:
    """Factor on the evaluations of this run for a tenth of its error.

    Evaluations grow with the tolerance by a power, which is that between the loosest run and this
    one: the steps of two closer ones would differ by their roundings to whole numbers. Not a
    number for a run that failed."""
    first, good, spent = loose
    more = jnp.log(jnp.asarray(now.evaluations, rtol.dtype) / jnp.asarray(spent, rtol.dtype))
    growth = more / jnp.log(first / rtol)
    return jnp.where(good & now.good, 10.0 ** (growth / jnp.maximum(power, FLATTEST)), jnp.nan)


def _is_exact(result: Simulated) -> bool:
    """Whether the result consists of closed forms only. Raises `InputError` where no tolerance
    decides the steps."""
    configs = [phase.config for phase in result.phases]
    for config in configs:
        if config.fixed_step:
            raise InputError(
                "FinalError requires a method with an error estimate, and "
                f"{type(config.method).__name__} does not adapt its steps to a tolerance: use "
                "another method, or set its number of steps."
            )
    return all(config.method == "closed_form" for config in configs)


def _with_estimate(result: Result, search: Search, missed: Bool[Array, "*runs"]) -> Result:
    """The result with the estimate among its numbers, and the status of runs that `missed`."""
    stats = {
        "final_error": search.estimate,
        "final_error_price": search.price,
        "final_error_runs": search.runs,
        "final_error_evaluations": search.evaluations,
    }
    status = jnp.where(missed, Status.FINAL_ERROR_MISSED, result.status).astype(jnp.int32)
    *others, last = result.phases
    last = dataclasses.replace(last, stats={**last.stats, **stats})
    return result.with_phases((*others, last), status)


def _best(search: Search) -> str:
    """The message about the reached error."""
    estimate = np.asarray(search.estimate)
    if estimate.ndim > 0 or not np.isfinite(estimate):
        return ""
    return (
        f"With a tolerance of {float(search.rtol):.2g} the error estimate is "
        f"{float(estimate):.3g} times the requested one."
    )

"""What accuracy costs in time, measured on the run that is asked about.

The true error of every setting is taken against the closed form where the system has one, and
otherwise against DOP853 (or the exponential method, for a stiff run that DOP853 does not bring to
its end) at a hundredth of the tightest tolerance; that reference is compared with itself at ten
times its tolerance. The gradient is that of one number of the final state in the initial state, by
reverse mode, measured with every block of the initial state in units of its own size.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..core import AbstractSystem, InputError, Scalar, State, check_positive
from ..integration import Accuracy, SimulationError, Status, least_tolerance, select_method
from ..simulation import Mission
from ..simulation._trajectory import relative_change
from ..solvers import DOP853, ExponentialRosenbrock, Tsit5
from ._cost_table import CLOSED_FORM, AccuracyCost, Cost
from ._flights import (
    Flight,
    Program,
    aot_compile,
    blocks,
    checked_start,
    distance,
    flight,
    in_precision,
    timed,
)

TOLERANCES = tuple(10.0**-k for k in range(4, 13))
PRECISIONS = ("float64", "float32")
REPEATS = 5
PART = 0.381966  # of a span, in no simple ratio to the rest


class _Case(NamedTuple):
    """What runs, in one precision: its arrays, and what is left of it without them."""

    numbers: Any
    rest: Any

    def accuracy(self, method: Any, rtol: Any) -> Accuracy:
        return (
            Accuracy(method="closed_form")
            if method == CLOSED_FORM
            else Accuracy(rtol=rtol, method=method)
        )

    def run(self, method: Any) -> Callable[[Any, Any], Flight]:
        """The run as a function of its arrays and the tolerance."""

        def run(numbers: Any, rtol: Any) -> Flight:
            system, y0, ts = eqx.combine(numbers, self.rest)
            return flight(system, y0, ts, self.accuracy(method, rtol))

        return run

    def slope(self, method: Any, output: Callable[[State], Scalar]) -> Callable[[Any, Any], State]:
        """The gradient of the output in the initial state, as a function of the arrays and the
        tolerance."""

        def slope(numbers: Any, rtol: Any) -> State:
            system, y0, ts = eqx.combine(numbers, self.rest)
            return jax.grad(
                lambda y: output(flight(system, y, ts, self.accuracy(method, rtol)).final)
            )(y0)

        return slope


class _Reference(NamedTuple):
    """What errors are measured against."""

    name: str
    final: State
    error: float
    gradient: State | None
    output: Callable[[State], Scalar]


def accuracy_cost(
    system: AbstractSystem | Mission,
    y0: State,
    ts: Any = 0.0,
    *,
    tolerances: Sequence[float] = TOLERANCES,
    methods: Sequence[Any] | None = None,
    precisions: Sequence[str] = PRECISIONS,
    gradient: bool = False,
    output: Callable[[State], Scalar] | None = None,
    repeats: int = REPEATS,
) -> AccuracyCost:
    """What accuracy costs in time for this very system, scene or mission, from `y0` over `ts` as in
    `simulate`.

    - `tolerances`: relative ones, as in `Accuracy.rtol`. `methods`: diffrax solvers with an error
      estimate, or "closed form"; by default DOP853, Tsit5, and what `"auto"` stands for if that is
      another. `precisions`: "float64", "float32".
    - `gradient`: whether to measure the gradient of `output(final state)` in the initial state as
      well; by default the sum of the final state's numbers, each over the length of its block.
    - `repeats`: of every run, whose median time counts; compilation is told apart.

    Returns an `AccuracyCost`: print it, `plot` it, ask it for the `cheapest` setting. A tolerance
    that a precision cannot reach is left out and noted. Raises `InputError` for input that cannot
    be used, and unless double precision is enabled; `SimulationError` when no good reference is
    found."""
    _check(system, tolerances, precisions, repeats)
    y0, ts = checked_start(system, y0, ts)
    chosen = _by_name(
        system, _default_methods(system, y0, ts, tolerances) if methods is None else methods
    )
    own = jnp.result_type(*jax.tree.leaves(y0)).name
    cases = {
        name: _Case(*eqx.partition(in_precision((system, y0, ts), name), eqx.is_array))
        for name in PRECISIONS
    }
    programs: dict[str, Program] = {}
    reference = _reference(
        system, chosen, cases["float64"], min(tolerances), gradient, output, programs
    )
    rows: list[Cost] = []
    notes: list[str] = []
    for precision in precisions:
        least = least_tolerance(precision)
        good = sorted((r for r in tolerances if r >= least), reverse=True)
        if len(good) < len(tolerances):
            notes.append(
                f"{precision}: tolerances below {least:.1e} are left out, which this precision cannot reach."
            )
        for name, method in chosen.items():
            try:
                known = programs.get(name) if precision == "float64" else None
                rows += _rows(
                    cases[precision], name, method, precision, good, reference, repeats, known
                )
            except (TypeError, ValueError) as error:
                if precision == own:
                    raise
                notes.append(
                    f"{precision}: {name} does not run: {str(error).strip().splitlines()[0]}"
                )
    return AccuracyCost(tuple(rows), reference.name, reference.error, own, tuple(notes), chosen)


def _check(system: Any, tolerances: Any, precisions: Any, repeats: int) -> None:
    """Raise `InputError` for input that cannot be used."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError(
            "The precision of jax is float32: it must be float64, for the reference; call jaxspace.enable_x64()."
        )
    check_positive("repeats", repeats)
    if not len(tolerances):
        raise InputError("tolerances is empty: it must hold at least one relative tolerance.")
    for rtol in tolerances:
        check_positive("tolerances", rtol)
        if rtol < least_tolerance("float64"):
            raise InputError(
                f"tolerances holds {rtol:.3g}: it must be at least {least_tolerance('float64'):.2g}."
            )
    wrong = [p for p in precisions if p not in PRECISIONS]
    if wrong or not len(precisions):
        raise InputError(
            f"precisions is {tuple(precisions)}: it must hold one or both of {', '.join(PRECISIONS)}."
        )
    if not isinstance(system, AbstractSystem | Mission):
        raise InputError(
            f"system is of type {type(system).__name__}: it must be a system, a scene or a mission."
        )


def _default_methods(
    system: Any, y0: State, ts: Any, tolerances: Sequence[float]
) -> tuple[Any, ...]:
    """DOP853, Tsit5, and what `"auto"` stands for at one of the tolerances."""
    if _has_closed_form(system):
        return DOP853(), Tsit5(), CLOSED_FORM
    if isinstance(system, Mission):
        return DOP853(), Tsit5()
    return (
        DOP853(),
        Tsit5(),
        *(select_method(system, y0, rtol, ts) for rtol in (max(tolerances), min(tolerances))),
    )


def _by_name(system: Any, methods: Sequence[Any]) -> dict[str, Any]:
    """The methods by name. Raises `InputError` for what is none."""
    exact = _has_closed_form(system)
    for method in methods:
        if method == CLOSED_FORM and not exact:
            raise InputError(
                f"methods holds {CLOSED_FORM!r}: {type(system).__name__} has none, it must hold solvers."
            )
        if method != CLOSED_FORM and not isinstance(method, diffrax.AbstractAdaptiveSolver):
            allowed = f"solvers with an error estimate, such as DOP853(), or {CLOSED_FORM!r}"
            raise InputError(f"methods holds {method!r}: it must hold {allowed}.")
    return {m if m == CLOSED_FORM else type(m).__name__: m for m in methods}


def _has_closed_form(system: Any) -> bool:
    systems = [p.system for p in system.phases] if isinstance(system, Mission) else [system]
    return all(s.closed_form() is not None for s in systems)


def _unit_sum(final: State) -> Callable[[State], Scalar]:
    """The sum of a state's numbers, each over the length of its block in the state `final`."""
    sizes = [float(np.linalg.norm(x)) or 1.0 for x, _ in blocks(final)]
    return lambda y: sum(
        jnp.sum(x) / size for x, size in zip(jax.tree.leaves(y), sizes, strict=True)
    )


def _reference(
    system: Any,
    chosen: dict[str, Any],
    case: _Case,
    tightest: float,
    gradient: bool,
    output: Any,
    programs: dict[str, Program],
) -> _Reference:
    """The reference, and into `programs` the runs that it compiled."""
    exact = isinstance(system, AbstractSystem) and system.closed_form() is not None
    stiff = {name: m for name, m in chosen.items() if isinstance(m, ExponentialRosenbrock)}
    candidates: dict[str, Any] = (
        {CLOSED_FORM: CLOSED_FORM} if exact else {"DOP853": DOP853(), **stiff}
    )
    # Rounding may keep a run from the tightest of these.
    for (name, method), factor in itertools.product(candidates.items(), (1e-2, 1e-1, 1.0)):
        if name not in programs:
            programs[name] = aot_compile(case.run(method), case.numbers, tightest)
        program, rtol = programs[name], max(factor * tightest, 2.0 * least_tolerance("float64"))
        run = program.call(case.numbers, rtol)
        if Status(int(run.status)).good:
            break
    else:
        raise SimulationError(
            f"The reference, {name} at {rtol:.0e}, ended badly. {Status(int(run.status)).sentence}"
        )
    other = _in_two_parts(case) if exact else program.call(case.numbers, 10.0 * rtol).final
    # Nothing is known better than its last digit.
    error = max(distance(other, run.final), float(np.finfo(float).eps))
    output = _unit_sum(run.final) if output is None else output
    slope = jax.jit(case.slope(method, output))(case.numbers, rtol) if gradient else None
    words = "the closed form" if exact else f"{name} at {rtol:.0e} in float64"
    return _Reference(words, run.final, error, slope, output)


def _in_two_parts(case: _Case) -> State:
    """The final state of a closed form that is passed in two parts, which no whole number of turns
    may hide."""
    system, y0, ts = eqx.combine(case.numbers, case.rest)
    flow = jax.jit(lambda duration, y: system.closed_form().flow(duration, y))
    first = PART * (ts[-1] - ts[0])
    return flow(ts[-1] - ts[0] - first, flow(first, y0))


def _rows(
    case: _Case,
    name: str,
    method: Any,
    precision: str,
    tolerances: list[float],
    reference: _Reference,
    repeats: int,
    known: Any,
) -> list[Cost]:
    """The rows of one method in one precision."""
    dtype = jnp.dtype(precision)
    if not tolerances and name != CLOSED_FORM:
        return []
    run = aot_compile(case.run(method), case.numbers, 1.0) if known is None else known
    drifts = jax.jit(lambda numbers, spans: _drifts(eqx.combine(numbers, case.rest)[0], spans))
    slope = None if reference.gradient is None else jax.jit(case.slope(method, reference.output))
    rows = []
    for rtol in [None] if name == CLOSED_FORM else tolerances:
        given = 1.0 if rtol is None else rtol
        flown, seconds = timed(run.call, repeats, case.numbers, given)
        status = Status(int(flown.status))
        row = Cost(
            method=name,
            precision=dtype.name,
            tolerance=rtol,
            error=distance(flown.final, reference.final),
            seconds=seconds,
            compile_seconds=run.seconds,
            evaluations=sum(int(n) for n in flown.evaluations),
            steps=sum(int(n) for n in flown.steps),
            memory=run.memory,
            drift={k: float(v) for k, v in drifts(case.numbers, flown.spans).items()},
            trouble="" if status.good else status.sentence,
        )
        if slope is not None:
            found, seconds = timed(slope, repeats, case.numbers, given)
            row = row._replace(
                gradient_error=_gradient_error(found, reference.gradient, case),
                gradient_seconds=seconds,
            )
        rows.append(row)
    return rows


def _drifts(system: Any, spans: tuple[Any, ...]) -> dict[str, Any]:
    """The largest relative change of every invariant, over all phases of a mission."""
    worst: dict[str, Any] = {}
    systems = [p.system for p in system.phases] if isinstance(system, Mission) else [system]
    for phase, (ts, states) in zip(systems, spans, strict=True):
        kept = jax.vmap(phase.invariants, in_axes=(0, -1), out_axes=-1)(ts, states)
        for name, values in kept.items():
            change = jnp.max(relative_change(values, 0))
            worst[name] = jnp.maximum(change, worst.get(name, 0.0))
    return worst


def _gradient_error(gradient: State, reference: Any, case: _Case) -> float:
    """|difference| / |gradient|, with every block of the initial state in units of its own size."""
    _, y0, _ = eqx.combine(case.numbers, case.rest)
    sizes = [float(np.linalg.norm(x)) or 1.0 for x, _ in blocks(y0)]
    found, exact = (
        [s * x.ravel() for s, (x, _) in zip(sizes, blocks(g), strict=True)]
        for g in (gradient, reference)
    )
    exact = np.concatenate(exact)
    return float(np.linalg.norm(np.concatenate(found) - exact) / (np.linalg.norm(exact) or 1.0))

"""What accuracy costs in time, measured on the run in question.

The true error of every setting is taken against the closed form where the system has one.
Otherwise the reference is DOP853 at a hundredth of the tightest tolerance, or the exponential
method for a stiff run that DOP853 does not bring to its end. The reference is compared with itself
at ten times its tolerance. The gradient is that of one number of the final state with respect to
the initial state, by reverse mode, with every block of the initial state in units of its own size.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import InputError, Scalar, State, check_positive
from ..integration import (
    Accuracy,
    SimulationError,
    Status,
    eligible_methods,
    least_tolerance,
    select_method,
)
from ..integration._accuracy import state_dtype
from ..simulation import Mission
from ..simulation._simulate import resolve_phases
from ..simulation._trajectory import relative_change
from ..solvers import DOP853, ExponentialRosenbrock, Tsit5, solver_traits
from ._cost_table import (
    CLOSED_FORM,
    FIXED_STEP_RTOL,
    AccuracyCost,
    Cost,
    Method,
    method_name,
)
from ._runs import (
    Program,
    RunOutcome,
    aot_compile,
    blocks,
    check_start,
    distance,
    in_precision,
    run_once,
    systems_of,
    timed,
)
from ._scene_effects import Runnable, numbered

TOLERANCES = tuple(10.0**-k for k in range(4, 13))
PRECISIONS = ("float64", "float32")
REPEATS = 5
# Of the duration: where a closed form is cut in two. In no simple ratio to the rest, so that no
# whole number of revolutions hides an error.
FIRST_PART = 0.381966


class _Case(NamedTuple):
    """What runs, in one precision: its arrays, and what is left of it without them."""

    arrays: PyTree[Array]
    static: PyTree

    @classmethod
    def of(cls, system: Runnable, y0: State, ts: Array, precision: str) -> "_Case":
        return cls(*eqx.partition(in_precision((system, y0, ts), precision), eqx.is_array))

    def restored(self, arrays: PyTree[Array]) -> tuple[Any, State, Array]:
        """System, initial state and times, with these arrays."""
        return eqx.combine(arrays, self.static)

    def run(self, method: Method) -> Callable[[PyTree[Array], Scalar], RunOutcome]:
        """The run as a function of its arrays and the tolerance."""

        def run(arrays: PyTree[Array], rtol: Scalar) -> RunOutcome:
            return run_once(*self.restored(arrays), _accuracy(method, rtol))

        return run

    def gradient(
        self, method: Method, output: Callable[[State], Scalar]
    ) -> Callable[[PyTree[Array], Scalar], State]:
        """The gradient of the output with respect to the initial state, as a function of the
        arrays and the tolerance."""

        def gradient(arrays: PyTree[Array], rtol: Scalar) -> State:
            system, y0, ts = self.restored(arrays)
            accuracy = _accuracy(method, rtol)
            return jax.grad(lambda y: output(run_once(system, y, ts, accuracy).final))(y0)

        return gradient


def _accuracy(method: Method, rtol: Scalar) -> Accuracy:
    return Accuracy(rtol=rtol, method=method)  # pyright: ignore[reportArgumentType]


def _methods_of_phases(mission: Mission, y0: State, rtol: float) -> list[Method]:
    """What "auto" stands for in each phase of a mission."""
    return [config.method for config in resolve_phases(mission, y0, _accuracy("auto", rtol))]


class _Reference(NamedTuple):
    """What errors are measured against.

    - `name`: in words.
    - `final`, `gradient`: the exact final state and gradient, as far as they are known.
    - `error`: an estimate of the error of `final`.
    - `output`: the number whose gradient is taken.
    - `programs`: what was compiled for it in double precision, by the name of the method: the run,
      and the gradient if it is measured."""

    name: str
    final: State
    error: float
    gradient: State | None
    output: Callable[[State], Scalar]
    programs: dict[str, "_Programs"]


class _Programs(NamedTuple):
    """The run and its gradient, compiled for one method in one precision."""

    run: Program
    gradient: Callable[[PyTree[Array], Scalar], State] | None


def accuracy_cost(
    system: Runnable,
    y0: State,
    ts: Float[ArrayLike, " times"] | Float[ArrayLike, ""] = 0.0,
    *,
    tolerances: Sequence[float] = TOLERANCES,
    methods: Sequence[Method] | None = None,
    precisions: Sequence[str] = PRECISIONS,
    gradient: bool = False,
    output: Callable[[State], Scalar] | None = None,
    repeats: int = REPEATS,
) -> AccuracyCost:
    """What accuracy costs in time for this system, scene or mission.

    **Arguments**

    - `system`, `y0`, `ts`: as in `simulate`; for a mission `ts` is the time of its start, s.
    - `tolerances`: relative ones, as in `Accuracy.rtol`.
    - `methods`: those that `Accuracy.method` and scene files take: solvers, "auto" and
      "closed_form". By default the methods that "auto" may stand for in this run, and "auto" itself
      for a mission, whose phases it serves by different methods.
    - `precisions`: "float64", "float32" or both.
    - `gradient`: whether to measure the gradient of `output` with respect to the initial state.
    - `output`: a number of the final state; by default the sum of all its numbers, each over the
      length of its block.
    - `repeats`: of every run, whose median time counts; compilation is timed apart.

    **Returns** an `AccuracyCost`: print it, `plot` it, take the `cheapest` setting from it. A
    tolerance that a precision cannot reach is left out and noted. A fixed-step method has one row,
    because the tolerance does not change its steps.

    **Raises** `InputError` for input that cannot be used, and unless double precision is enabled;
    `SimulationError` when no good reference is found."""
    _check(system, tolerances, precisions, repeats)
    y0, ts = check_start(system, y0, ts)
    if methods is None:
        methods = _default_methods(system, y0, ts, tolerances)
    by_name = _methods_by_name(system, y0, ts, methods, min(tolerances))
    own = state_dtype(y0).name
    case = _Case.of(system, y0, ts, "float64")
    reference = _reference(system, by_name, case, min(tolerances), gradient, output)
    rows: list[Cost] = []
    notes: list[str] = []
    for precision in precisions:
        case = _Case.of(system, y0, ts, precision)
        reachable = [r for r in tolerances if r >= least_tolerance(precision)]
        reachable.sort(reverse=True)
        if len(reachable) < len(tolerances):
            notes.append(
                f"{precision}: tolerances below {least_tolerance(precision):.1e} are left out, "
                f"which this precision cannot reach."
            )
        for name, method in by_name.items():
            own_tolerances = _tolerances_of(method, system, y0, reachable)
            try:
                rows += _rows(case, name, method, precision, own_tolerances, reference, repeats)
            except (TypeError, ValueError) as error:
                # A system may hold numbers whose precision the study cannot change.
                if precision == own:
                    raise
                first_line = str(error).strip().splitlines()[0]
                notes.append(f"{precision}: {name} does not run: {first_line}")
    return AccuracyCost(tuple(rows), reference.name, reference.error, own, tuple(notes), by_name)


def _check(
    system: Runnable, tolerances: Sequence[float], precisions: Sequence[str], repeats: int
) -> None:
    """Raise `InputError` for input that cannot be used."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError(
            "The precision of jax is float32: it must be float64, for the reference; call "
            "jaxspace.enable_x64()."
        )
    check_positive("repeats", repeats)
    if not len(tolerances):
        raise InputError("tolerances is empty: it must hold at least one relative tolerance.")
    least = least_tolerance("float64")
    for rtol in tolerances:
        check_positive("tolerances", rtol)
        if rtol < least:
            raise InputError(f"tolerances holds {rtol:.3g}: it must be at least {least:.2g}.")
    wrong = [p for p in precisions if p not in PRECISIONS]
    if wrong or not len(precisions):
        raise InputError(
            f"precisions is {tuple(precisions)}: it must hold one or both of "
            f"{', '.join(PRECISIONS)}."
        )
    if not isinstance(system, Runnable):
        raise InputError(
            f"system is of type {type(system).__name__}: it must be a system, a scene or a mission."
        )


def _default_methods(
    system: Runnable, y0: State, ts: Array, tolerances: Sequence[float]
) -> tuple[Method, ...]:
    """The methods that "auto" may stand for; for a mission those that serve all of its phases."""
    if not isinstance(system, Mission):
        # The loosest tolerance is among them, so that every table has the method for it.
        ends = (max(*tolerances, TOLERANCES[0]), min(tolerances))
        return eligible_methods(system, y0, ends, ts)
    if all(s.closed_form() is not None for s in systems_of(system)):
        return DOP853(), Tsit5(), CLOSED_FORM
    chosen = _methods_of_phases(system, y0, min(tolerances))
    same = all(isinstance(method, DOP853) for method in chosen)
    # Where phases differ, no method but "auto" stands for what "auto" takes.
    return (DOP853(), Tsit5()) if same else (DOP853(), Tsit5(), "auto")


def _methods_by_name(
    system: Runnable, y0: State, ts: Array, methods: Sequence[Method], rtol: float
) -> dict[str, Method]:
    """The methods by name.

    **Raises** `InputError` for what is no method, and for a closed form that there is not."""
    exact = all(s.closed_form() is not None for s in systems_of(system))
    found: list[Method] = []
    for method in methods:
        if method == "auto" and not isinstance(system, Mission):
            method = select_method(system, y0, rtol, ts)
        if method == CLOSED_FORM and not exact:
            raise InputError(
                f"methods holds {CLOSED_FORM!r}: {type(system).__name__} has none, it must hold "
                f"solvers."
            )
        if method not in ("auto", CLOSED_FORM) and not _has_error_estimate(method):
            raise InputError(
                f"methods holds {method!r}: it must hold solvers with an error estimate or with "
                f"fixed steps, such as DOP853(), or {CLOSED_FORM!r}."
            )
        if method not in found:
            found.append(method)
    names = numbered([method_name(method) for method in found])
    return dict(zip(names, found, strict=True))


def _has_error_estimate(method: Method) -> bool:
    """Whether it is a solver whose steps a tolerance controls or judges."""
    if not isinstance(method, diffrax.AbstractSolver):
        return False
    return isinstance(method, diffrax.AbstractAdaptiveSolver) or solver_traits(method).fixed_step


def _tolerances_of(
    method: Method, system: Runnable, y0: State, tolerances: list[float]
) -> list[float | None]:
    """The tolerances at which the method is run; `None` where it has none."""
    if method == CLOSED_FORM:
        return [None]
    if method == "auto" and isinstance(system, Mission):
        # The tolerance is traced, so that "auto" stands for what it takes at tight ones. Looser
        # ones, for which it takes another method, would show the wrong row.
        tight = _methods_of_phases(system, y0, 2.0 * least_tolerance(state_dtype(y0)))
        return [r for r in tolerances if _methods_of_phases(system, y0, r) == tight]
    if isinstance(method, diffrax.AbstractSolver) and solver_traits(method).fixed_step:
        return [None]
    return list(tolerances)


def _reference(
    system: Runnable,
    by_name: dict[str, Method],
    case: _Case,
    tightest: float,
    gradient: bool,
    output: Callable[[State], Scalar] | None,
) -> _Reference:
    """The reference: the closed form, or the tightest run that ends well."""
    exact = not isinstance(system, Mission) and system.closed_form() is not None
    candidates: dict[str, Method] = {"DOP853": DOP853()}
    if exact:
        candidates = {CLOSED_FORM: CLOSED_FORM}
    for name, method in by_name.items():
        if not exact and isinstance(method, ExponentialRosenbrock):
            candidates[name] = method
    compiled: dict[str, Program] = {}
    # Rounding may keep a run from the tightest of these.
    for (name, method), factor in itertools.product(candidates.items(), (1e-2, 1e-1, 1.0)):
        if name not in compiled:
            compiled[name] = aot_compile(case.run(method), case.arrays, tightest)
        program = compiled[name]
        rtol = max(factor * tightest, 2.0 * least_tolerance("float64"))
        run = program.call(case.arrays, rtol)
        if Status(int(run.status)).good:
            break
    else:
        raise SimulationError(
            f"The reference, {name} at {rtol:.0e}, failed. {Status(int(run.status)).sentence}"
        )
    other = _in_two_parts(case) if exact else program.call(case.arrays, 10.0 * rtol).final
    # Nothing is known better than its last digit.
    error = max(distance(other, run.final), float(np.finfo(float).eps))
    output = _scaled_sum(run.final) if output is None else output
    programs = {key: _Programs(run, None) for key, run in compiled.items()}
    exact_gradient = None
    if gradient:
        of_method = jax.jit(case.gradient(method, output))
        exact_gradient = of_method(case.arrays, rtol)
        programs[name] = _Programs(program, of_method)
    words = "the closed form" if exact else f"{name} at {rtol:.0e} in float64"
    return _Reference(words, run.final, error, exact_gradient, output, programs)


def _scaled_sum(final: State) -> Callable[[State], Scalar]:
    """The sum of a state's numbers, each over the length of its block in the state `final`."""
    sizes = [block.size for block in blocks(final)]

    def output(y: State) -> Scalar:
        terms = zip(jax.tree.leaves(y), sizes, strict=True)
        return sum((jnp.sum(x) / size for x, size in terms), 0.0)

    return output


def _in_two_parts(case: _Case) -> State:
    """The final state of a closed form whose duration is passed in two parts."""
    system, y0, ts = case.restored(case.arrays)
    flow = jax.jit(lambda duration, y: system.closed_form().flow(duration, y))
    first = FIRST_PART * (ts[-1] - ts[0])
    return flow(ts[-1] - ts[0] - first, flow(first, y0))


def _rows(
    case: _Case,
    name: str,
    method: Method,
    precision: str,
    tolerances: Sequence[float | None],
    reference: _Reference,
    repeats: int,
) -> list[Cost]:
    """The rows of one method in one precision."""
    if not tolerances:
        return []
    # In double precision the reference has compiled a method already.
    known = reference.programs.get(name) if precision == "float64" else None
    program = (
        aot_compile(case.run(method), case.arrays, FIXED_STEP_RTOL) if known is None else known.run
    )
    gradient = None if known is None else known.gradient
    if gradient is None and reference.gradient is not None:
        gradient = jax.jit(case.gradient(method, reference.output))
    drifts = jax.jit(lambda arrays, phases: _drifts(case.restored(arrays)[0], phases))
    rows = []
    for tolerance in tolerances:
        rtol = FIXED_STEP_RTOL if tolerance is None else tolerance
        run, seconds = timed(program.call, repeats, case.arrays, rtol)
        status = Status(int(run.status))
        drift = drifts(case.arrays, run.phases)
        row = Cost(
            method=name,
            precision=precision,
            tolerance=tolerance,
            error=distance(run.final, reference.final),
            seconds=seconds,
            compile_seconds=program.seconds,
            evaluations=sum(int(n) for n in run.evaluations),
            steps=sum(int(n) for n in run.steps),
            memory=program.memory,
            drift={key: float(value) for key, value in drift.items()},
            failure="" if status.good else status.sentence,
        )
        if gradient is not None:
            found, seconds = timed(gradient, repeats, case.arrays, rtol)
            error = _gradient_error(found, reference.gradient, case)
            row = row._replace(gradient_error=error, gradient_seconds=seconds)
        rows.append(row)
    return rows


def _drifts(
    system: Runnable, phases: tuple[tuple[Float[Array, " times"], State], ...]
) -> dict[str, Float[Array, ""]]:
    """The largest relative change of every invariant, over all phases of a mission."""
    largest: dict[str, Array] = {}
    for phase, (ts, states) in zip(systems_of(system), phases, strict=True):
        kept = jax.vmap(phase.invariants, in_axes=(0, -1), out_axes=-1)(ts, states)
        for name, values in kept.items():
            change = jnp.max(relative_change(values, 0))
            largest[name] = jnp.maximum(change, largest[name]) if name in largest else change
    return largest


def _gradient_error(gradient: State, reference: State, case: _Case) -> float:
    """|difference| / |gradient|, with every block of the initial state in units of its own size."""
    _, y0, _ = case.restored(case.arrays)
    sizes = [block.size for block in blocks(y0)]

    def scaled(tree: State) -> np.ndarray:
        pairs = zip(sizes, blocks(tree), strict=True)
        return np.concatenate([size * block.values.ravel() for size, block in pairs])

    exact = scaled(reference)
    return float(np.linalg.norm(scaled(gradient) - exact) / (np.linalg.norm(exact) or 1.0))

"""Computing time as a function of accuracy, measured for a given run.

The error of every setting is that relative to the closed form, if the system has one. Otherwise the
reference is DOP853 at a hundredth of the tightest tolerance, with up to 64 times the steps of a
run; or the exponential method for a stiff run that DOP853 does not complete, or another adaptive
method of the table. The reference is compared with itself at ten times its tolerance. The gradient
is that of one number of the final state with respect to the initial state, by reverse mode, with
every block of the initial state in units of its norm.
"""

from collections.abc import Callable, Sequence

import jax
from jaxtyping import ArrayLike, Float

from ..core import InputError, Scalar, State
from ..core.checks import check_positive
from ..integration.accuracy import least_tolerance
from ..integration.initial_state import state_dtype
from ._cost_case import Case
from ._cost_methods import TOLERANCES, default_methods, methods_by_name, tolerances_of
from ._cost_reference import reference_of
from ._cost_rows import cost_rows
from ._runs import check_start
from ._scene_effects import Runnable
from .cost_table import MAX_STEPS, AccuracyCost, Cost, Method

PRECISIONS = ("float64", "float32")
REPEATS = 5


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
    max_steps: int = MAX_STEPS,
) -> AccuracyCost:
    """Computing time as a function of accuracy for a system, scene or mission.

    **Arguments**

    - `system`, `y0`, `ts`: as in `simulate`; or a mission, its state and the time of its start,
      s, as in `simulate_mission`.
    - `tolerances`: relative ones, as in `Accuracy.rtol`.
    - `methods`: as for `Accuracy.method` and in scene files: solvers, "auto" and "closed_form". By
      default the methods that "auto" may select for this run, and "auto" itself for a mission,
      whose phases may have different methods.
    - `precisions`: "float64", "float32" or both.
    - `gradient`: whether to measure the gradient of `output` with respect to the initial state.
    - `output`: a number of the final state; by default the sum of all its numbers, each over the
      length of its block.
    - `repeats`: of every run, of which the median time is used; compilation is timed separately.
    - `max_steps`: maximum number of steps of a run, as in `Accuracy`; the reference may use more.

    **Returns** an `AccuracyCost`: it can be printed and plotted (`plot`), and provides the
    `cheapest` setting. A tolerance that a precision cannot reach is omitted and noted. A
    fixed-step method has one row, because the tolerance does not change its steps. Without a valid
    reference run the rows have no errors and no gradients, and a note gives the reason.

    **Raises** `InputError` for invalid input, and unless double precision is
    enabled."""
    _check(system, tolerances, precisions, repeats)
    check_positive("max_steps", max_steps)
    y0, ts = check_start(system, y0, ts)
    if methods is None:
        methods = default_methods(system, y0, ts, tolerances)
    by_name = methods_by_name(system, y0, ts, methods, min(tolerances))
    own = state_dtype(y0).name
    # The reference is in double precision, whatever the state is given in.
    case = Case.of(system, y0, ts, "float64", max_steps)
    reference = reference_of(system, by_name, case, min(tolerances), gradient, output)
    rows: list[Cost] = []
    notes: list[str] = [reference.problem] if reference.problem else []
    for precision in precisions:
        case = Case.of(system, y0, ts, precision, max_steps)
        reachable = [r for r in tolerances if r >= least_tolerance(precision)]
        # From loose to tight, as in a work-precision diagram.
        reachable.sort(reverse=True)
        if len(reachable) < len(tolerances):
            notes.append(
                f"{precision}: tolerances below {least_tolerance(precision):.1e} are omitted, "
                "because this precision cannot reach them."
            )
        for name, method in by_name.items():
            own_tolerances = tolerances_of(method, system, y0, reachable)
            try:
                rows += cost_rows(case, name, method, precision, own_tolerances, reference, repeats)
            except (TypeError, ValueError) as error:
                # A system may contain numbers whose precision the study cannot change.
                if precision == own:
                    raise
                first_line = str(error).strip().splitlines()[0]
                notes.append(f"{precision}: {name} does not run: {first_line}")
    shown = (tuple(rows), reference.name, reference.error, own, tuple(notes))
    return AccuracyCost(*shown, by_name, max_steps)


def _check(
    system: Runnable, tolerances: Sequence[float], precisions: Sequence[str], repeats: int
) -> None:
    """Raise `InputError` for invalid input."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError(
            "JAX uses float32: the reference requires float64; call jaxspace.enable_x64()."
        )
    check_positive("repeats", repeats)
    if not len(tolerances):
        raise InputError("tolerances is empty: it must contain at least one relative tolerance.")
    least = least_tolerance("float64")
    for rtol in tolerances:
        check_positive("tolerances", rtol)
        if rtol < least:
            raise InputError(f"tolerances contains {rtol:.3g}: it must be at least {least:.2g}.")
    wrong = [p for p in precisions if p not in PRECISIONS]
    if wrong or not len(precisions):
        raise InputError(
            f"precisions is {tuple(precisions)}: it must contain one or both of "
            f"{', '.join(PRECISIONS)}."
        )
    if not isinstance(system, Runnable):
        raise InputError(
            f"system is of type {type(system).__name__}: it must be a system, a scene or a mission."
        )

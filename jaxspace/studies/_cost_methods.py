"""The methods that a study of accuracy and cost compares, and at which tolerances."""

from collections.abc import Sequence

import diffrax
from jaxtyping import Array

from ..core import InputError, State
from ..integration import eligible_methods, select_method
from ..integration.accuracy import least_tolerance
from ..integration.initial_state import state_dtype
from ..integration.methods import HIGH_ORDER, LOW_ORDER
from ..simulation import Mission
from ..simulation.phases import resolve_phases
from ..solvers.protocol import solver_traits
from ._cost_case import accuracy_of
from ._runs import systems_of
from ._scene_effects import Runnable, numbered
from .cost_table import CLOSED_FORM, Method, method_name

TOLERANCES = tuple(10.0**-k for k in range(4, 13))


def _methods_of_phases(mission: Mission, y0: State, rtol: float) -> list[Method]:
    """The methods for "auto" in each phase of a mission."""
    return [config.method for config in resolve_phases(mission, y0, accuracy_of("auto", rtol))]


def default_methods(
    system: Runnable, y0: State, ts: Array, tolerances: Sequence[float]
) -> tuple[Method, ...]:
    """The methods that "auto" may select; for a mission those that apply to all of its phases."""
    if not isinstance(system, Mission):
        # The loosest tolerance is among them, so that every table has the method for it.
        ends = (max(*tolerances, TOLERANCES[0]), min(tolerances))
        return eligible_methods(system, y0, ends, ts)
    if all(s.closed_form() is not None for s in systems_of(system)):
        return HIGH_ORDER, LOW_ORDER, CLOSED_FORM
    chosen = _methods_of_phases(system, y0, min(tolerances))
    same = all(isinstance(method, type(HIGH_ORDER)) for method in chosen)
    # If the phases have different methods, only "auto" itself selects them all.
    return (HIGH_ORDER, LOW_ORDER) if same else (HIGH_ORDER, LOW_ORDER, "auto")


def methods_by_name(
    system: Runnable, y0: State, ts: Array, methods: Sequence[Method], rtol: float
) -> dict[str, Method]:
    """The methods by name.

    **Raises** `InputError` for an unknown method, and for a closed form of a system without one."""
    exact = all(s.closed_form() is not None for s in systems_of(system))
    result: list[Method] = []
    for method in methods:
        if method == "auto" and not isinstance(system, Mission):
            method = select_method(system, y0, rtol, ts)
        if method == CLOSED_FORM and not exact:
            raise InputError(
                f"methods contains {CLOSED_FORM!r}, which {type(system).__name__} does not have: "
                "it must contain solvers."
            )
        if method not in ("auto", CLOSED_FORM) and not _has_error_estimate(method):
            raise InputError(
                f"methods contains {method!r}: it must contain solvers with an error estimate or "
                f"with fixed steps, such as DOP853(), or {CLOSED_FORM!r}."
            )
        # "auto" may select a method that is named as well.
        if method not in result:
            result.append(method)
    names = numbered([method_name(method) for method in result])
    return dict(zip(names, result, strict=True))


def _has_error_estimate(method: Method) -> bool:
    """Whether it is a solver with an error estimate, for which a tolerance is meaningful."""
    if not isinstance(method, diffrax.AbstractSolver):
        return False
    traits = solver_traits(method)
    # One that chooses its steps itself does so by the tolerance, without an estimate of diffrax.
    known = traits.fixed_step or traits.individual_steps
    return known or isinstance(method, diffrax.AbstractAdaptiveSolver)


def tolerances_of(
    method: Method, system: Runnable, y0: State, tolerances: list[float]
) -> list[float | None]:
    """The tolerances at which the method is run; `None` where it has none."""
    if method == CLOSED_FORM:
        return [None]
    if method == "auto" and isinstance(system, Mission):
        # The tolerance is traced, so that "auto" is the method for tight ones. Looser ones, for
        # which it selects another method, would show the wrong row.
        tight = _methods_of_phases(system, y0, 2.0 * least_tolerance(state_dtype(y0)))
        return [r for r in tolerances if _methods_of_phases(system, y0, r) == tight]
    if isinstance(method, diffrax.AbstractSolver) and solver_traits(method).fixed_step:
        return [None]
    return list(tolerances)

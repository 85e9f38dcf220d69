"""Influence of the effects on an output of a run, and selection of those that may be omitted.

    q(s):   the output when the load of effect k is multiplied by s_k
    -dq/ds_k at s = 1       change without effect k, to first order
    q(s_k = 0) - q(1)       change without effect k

All of this is one compiled program: the scene of scaled effects, with its derivative along one
factor in forward mode.
"""

import dataclasses
import inspect
from collections.abc import Callable

import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..core import InputError, Scalar, State
from ..core.checks import check_positive
from ..core.declarations import Output
from ..core.quantities import quantities
from ..core.status import SimulationError, Status
from ..integration.accuracy import DEFAULT_RTOL, Accuracy, as_accuracy, least_tolerance
from ..integration.initial_state import state_dtype
from ..solvers.protocol import refine, solver_traits
from ._effect_choice import negligible, timed_run, verified
from ._effect_rows import influence_of, shares_of
from ._runs import OutputOfRun, check_start
from ._scaled_runs import scaled_runs
from ._scene_effects import Runnable, phases_by_effect
from .budget_table import EffectBudget

REPEATS = 5


def effect_budget(
    scene: Runnable,
    y0: State,
    ts: Float[ArrayLike, " times"] | Float[ArrayLike, ""] = 0.0,
    *,
    output: str | Callable[..., Array] | None = None,
    tolerance: float | None = None,
    accuracy: Accuracy | Scalar | None = None,
    repeats: int = REPEATS,
) -> EffectBudget:
    """Influence of each effect of a scene, or of the scenes of a mission, on an output of a run.

    **Arguments**

    - `scene`, `y0`, `ts`: as in `simulate`; or a mission, its state and the time of its start,
      s, as in `simulate_mission`.
    - `output`: of the final state: the name of a part, such as "position", "velocity", "attitude"
      (its change is an angle), "omega" or "mass"; a function of the final state; or one declared
      with `core.output`, of the final state `y`, its time `t` and parts of it by name. By default
      the first part of the state.
    - `tolerance`: acceptable change of the output, in its unit. If given, the effects that may be
      omitted are determined, least influential first, and verified by a run with exactly the
      others.
    - `accuracy`: of the runs. Influences below the error of the integration are not resolved; a run
      at a hundredth of the tolerance, or with twice as many fixed steps, shows that error.
    - `repeats`: of the timed runs.

    **Returns** an `EffectBudget`, which can be printed and plotted (`plot`).

    **Raises** `InputError` for a system without effects, an output that is not in the state or a
    tolerance that is not positive; `SimulationError` if the run itself fails."""
    # Checked before anything is compiled, as all that follows up to the runs.
    of_final, name, unit = _output(output, y0)
    if tolerance is not None:
        check_positive("tolerance", tolerance)
    check_positive("repeats", repeats)
    phases_of = phases_by_effect(scene)
    y0, ts = check_start(scene, y0, ts)
    resolved = as_accuracy(accuracy)
    if resolved.rtol is None:
        # Here and not in the run, which takes the tolerance as a traced number.
        resolved = dataclasses.replace(resolved, rtol=DEFAULT_RTOL[state_dtype(y0).name])
    is_attitude = name == "attitude"
    runs = scaled_runs(scene, y0, ts, of_final, resolved, tuple(phases_of), is_attitude)
    nominal = runs.run()
    if not nominal.status.good:
        raise SimulationError(nominal.status.sentence)
    # A tolerance does not change fixed steps: twice as many show the error of the integration.
    if not isinstance(resolved.method, str) and solver_traits(resolved.method).fixed_step:
        twice = dataclasses.replace(resolved, method=refine(resolved.method, 2))
        finer = scaled_runs(scene, y0, ts, of_final, twice, runs.names, is_attitude).run()
    else:
        least = 2.0 * least_tolerance(state_dtype(y0))
        # Not below what the precision resolves, where the finer run would only round.
        finer = runs.run(tighter=max(1e-2, least / runs.rtol))
    # NaN where the finer run failed.
    noise = float(np.linalg.norm(runs.change(finer.value, nominal.value)))
    shares = shares_of(scene, nominal)
    rows = [
        influence_of(runs, effect, phases, shares[effect], nominal.value, noise)
        for effect, phases in phases_of.items()
    ]
    # The choice of what may be left out reads the rows from their end.
    rows.sort(key=lambda row: -row.influence)
    table = EffectBudget(name, unit, nominal.value, noise, tuple(rows), tolerance)
    if tolerance is None:
        return table

    def plain_run(system: Runnable) -> tuple[np.ndarray, Status, float]:
        return timed_run(system, y0, ts, of_final, resolved, repeats)

    return verified(table, runs, negligible(table, runs), scene, plain_run)


def _output(output: str | Callable[..., Array] | None, y0: State) -> tuple[OutputOfRun, str, str]:
    """The output as a function, its name and its unit."""
    if callable(output):
        declared: Output | None = getattr(output, "output", None)
        # A plain function does not declare its inputs, and receives the state only.
        if declared is None:
            return lambda t, y: output(y), "output", ""
        return _by_name(output), getattr(output, "__name__", "output"), declared.unit
    units = {
        name: declared.unit
        for name, declared in quantities(type(y0)).items()
        if getattr(y0, name, None) is not None
    }
    if output is None and units:
        output = next(iter(units))
    if output not in units:
        raise InputError(
            f"output is {output!r}: it must be one of {', '.join(units)}, or a function of the "
            f"final state."
        )
    if output == "attitude":
        # A small rotation moves the quaternion by half its angle.
        return lambda t, y: 2.0 * y.attitude.wxyz, output, "rad"
    return lambda t, y: getattr(y, output), output, units[output]


def _by_name(output: Callable[..., Array]) -> OutputOfRun:
    """A declared output as a function of time and state.

    Raises `InputError` for one that requires more than a run provides."""
    names = tuple(inspect.signature(output).parameters)

    def of_run(t: Scalar, y: State) -> Array:
        given = {"t": t, "y": y}
        for name in names:
            if name not in given:
                given[name] = getattr(y, name, None)
            if given[name] is None:
                raise InputError(
                    f"output {getattr(output, '__name__', '')} reads {name}: it must read only "
                    "parts of the final state, the state y and the time t."
                )
        return output(**{name: given[name] for name in names})

    return of_run

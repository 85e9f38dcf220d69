"""The rows of a table of effects: the change of the output without each of them, and the
savings."""

import numpy as np

from ..scene import budget
from ._runs import counts_of, in_precision
from ._scaled_runs import ScaledOutcome, ScaledRuns
from ._scene_effects import Runnable, effect_names, scenes
from .budget_table import Influence

# Fraction of the influence: where the prediction deviates by more, the run without the effect
# counts.
NONLINEAR = 0.1


def influence_of(
    runs: ScaledRuns,
    name: str,
    phases: tuple[str, ...],
    share: float,
    nominal: np.ndarray,
    noise: float,
) -> Influence:
    """The row of one effect.

    **Arguments**

    - `runs`: with all effects scaled.
    - `name`, `phases`, `share`: of the effect: where it acts, and its cost.
    - `nominal`: the output with all effects.
    - `noise`: the error of the integration in the output.

    **Returns** the row."""
    predicted = -runs.run(along=name).derivative
    without = runs.run(without=(name,))
    linear = float(np.linalg.norm(predicted))
    # Without a run that omits the effect, only the first order is known.
    if not without.status.good:
        change = tuple(predicted.ravel().tolist())
        failure = without.status.sentence
        return Influence(name, phases, linear, linear, None, False, change, share, failure)
    result = runs.change(without.value, nominal)
    left_out = float(np.linalg.norm(result))
    off = float(np.linalg.norm(result - predicted))
    # A difference explained by integration errors does not indicate nonlinearity.
    nonlinear = off > NONLINEAR * left_out and not off <= 10.0 * noise
    change = tuple((result if nonlinear else predicted).ravel().tolist())
    influence = left_out if nonlinear else linear
    return Influence(name, phases, influence, linear, left_out, nonlinear, change, share)


def shares_of(system: Runnable, nominal: ScaledOutcome) -> dict[str, float]:
    """Share of the arithmetic that a run saves without an effect: operations of one evaluation
    times evaluations."""
    saved: dict[str, float] = {}
    total = 0.0
    evaluations = counts_of(nominal.run, "evaluations")
    for k, _, scene in scenes(system):
        # Counted in double precision, in which most users run.
        phase = nominal.run.phases[k]
        start = in_precision((phase.ts[0], phase.initial), "float64")
        rows = budget(in_precision(scene, "float64"), *start)
        count = evaluations[k]
        for name, row in zip(effect_names(scene), rows[:-1], strict=True):
            saved[name] = saved.get(name, 0.0) + count * row.operations
        total += count * sum(row.operations for row in rows)
    # A scene may cost no operation at all.
    return {name: value / max(total, 1.0) for name, value in saved.items()}

"""The error at the end that is asked for (`FinalError`), and what comes of it, in the scenes of
`asked.py`: whether it is met where the run says so, and what that costs beside the cheapest
tolerance that would have done, which is known only afterwards."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxspace import Accuracy, FinalError
from jaxspace.simulation import Status

# By precision; that of float32 resolves 2e-6.
WITHIN = {"float64": (1e-3, 1e-5, 1e-7, 1e-9, 1e-11), "float32": (1e-2, 1e-4)}
# Three for each power of ten, from the least that the precision resolves.
LADDER = {
    "float64": tuple(10.0 ** (-k / 3.0) for k in range(9, 43)),
    "float32": tuple(10.0 ** (-k / 3.0) for k in range(6, 17)),
}


class AtTheEnd(NamedTuple):
    """A run that was asked for its error at the end.

    - `error`: the true one, in units of what was asked; `met`: whether the run says that it is met.
    - `cost`: evaluations of the vector field by all of its runs, beside those of the cheapest
      tolerance of the ladder; NaN where none would have done, or the run says that it failed."""

    error: float
    met: bool
    cost: float


def measured(
    run: Callable[[Any], Any], apart: Callable[[Any], float], precision: str, max_steps: int
) -> list[AtTheEnd]:
    """The runs of a scene in one precision, by `run` with an accuracy; `apart` is the error of a
    final state."""
    ladder = []
    for rtol in LADDER[precision]:
        one = run(Accuracy(rtol, max_steps=max_steps))
        if Status(int(one.status)).good:
            ladder.append((float(_evaluations(one)), apart(one.final)))
    return [
        _asked(
            run(FinalError(within, accuracy=Accuracy(max_steps=max_steps))), apart, within, ladder
        )
        for within in WITHIN[precision]
    ]


def _asked(
    run: Any, apart: Callable[[Any], float], within: float, ladder: list[tuple[float, float]]
) -> AtTheEnd:
    enough = [evaluations for evaluations, error in ladder if error <= within]
    met = Status(int(run.status)).good
    spent = float(_last(run).stats["final_error_evaluations"])
    cost = spent / min(enough) if met and enough else math.nan
    return AtTheEnd(apart(run.final) / within, met, cost)


def _last(run: Any) -> Any:
    return run if hasattr(run, "stats") else run.phases[-1]


def _evaluations(run: Any) -> Any:
    return run.stats["evaluations"] if hasattr(run, "stats") else run.evaluations


HEAD = """
## Ask for the error itself

[`FinalError(1e-9)`](accuracy_and_derivatives.md#ask-for-the-error) in place of a tolerance asks for
the error at the end, here relative to every block. {summary}

A cell is the true error in units of what was asked, and in brackets the evaluations of the vector
field by all of its runs together, beside those of the cheapest tolerance that would have done, of
three for each power of ten: it is known only afterwards. *Not met* is what the run says of itself.

| Scene | {columns} |
|---|{rules}
"""


def text(found: dict[str, dict[str, list[AtTheEnd]]]) -> str:
    """The part of the page, of all scenes by their names and precisions."""
    every = [one for scene in found.values() for runs in scene.values() for one in runs]
    met = [one for one in every if one.met]
    costs = [one.cost for one in met if not math.isnan(one.cost)]
    late = sum(one.error > 1.0 for one in met)
    worst = max(one.error for one in met)
    within = f"All of them are within it, the worst at {worst:.2g} of it"
    verb = "is" if late == 1 else "are"
    beyond = f"{late} of these {verb} not within it, the worst at {worst:.2g} times what was asked"
    summary = (
        f"Of {len(every)} runs {len(met)} say that it is met. {beyond if late else within}; in the "
        f"median they take {np.median(costs):.2g} times the evaluations of the cheapest tolerance, "
        f"nine of ten less than {np.quantile(costs, 0.9):.2g} times."
    )
    settings = [(p, within) for p, some in WITHIN.items() for within in some]
    columns = [f"{x:.0e}" + (" float32" if p == "float32" else "") for p, x in settings]
    head = HEAD.format(summary=summary, columns=" | ".join(columns), rules="--:|" * len(columns))
    rows = [
        f"| {name} | " + " | ".join(_cell(one) for runs in scene.values() for one in runs) + " |"
        for name, scene in found.items()
    ]
    return head + "\n".join(rows) + "\n"


def _cell(one: AtTheEnd) -> str:
    if not one.met:
        return "not met"
    beside = "" if math.isnan(one.cost) else f" ({one.cost:.2g})"
    shown = f"{one.error:.1g}{beside}"
    return shown if one.error <= 1.0 else f"**{shown}**"

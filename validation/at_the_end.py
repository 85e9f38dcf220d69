"""The error at the end that is asked for (`FinalError`), and what comes of it, in the scenes of
`requested.py` and in those of `drawn.py`: whether it is met where the run says so, and what that
costs beside the cheapest tolerance that would have done, which is known only afterwards."""

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
      tolerance of the ladder, and `last` by the last one alone; NaN where none would have done, or
      the run says that it failed."""

    error: float
    met: bool
    cost: float
    last: float


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
        _requested(
            run(FinalError(within, accuracy=Accuracy(max_steps=max_steps))), apart, within, ladder
        )
        for within in WITHIN[precision]
    ]


def _requested(
    run: Any, apart: Callable[[Any], float], within: float, ladder: list[tuple[float, float]]
) -> AtTheEnd:
    enough = [evaluations for evaluations, error in ladder if error <= within]
    met = Status(int(run.status)).good
    spent = float(_last(run).stats["final_error_evaluations"])
    # A run that moves on a line, or at one rate, needs no step at any tolerance.
    least = min(enough) if met and enough else math.nan
    last = float(_evaluations(run))
    return AtTheEnd(apart(run.final) / within, met, spent / least, last / least)


def _last(run: Any) -> Any:
    return run if hasattr(run, "stats") else run.phases[-1]


def _evaluations(run: Any) -> Any:
    return run.stats["evaluations"] if hasattr(run, "stats") else run.evaluations


HEAD = """
## Requested final errors

The table is for [`FinalError(1e-9)`](accuracy_and_derivatives.md#requesting-a-final-error) and
other values, relative to every block. A cell contains the true error divided by the requested
error. The number in brackets is the number of evaluations of the vector field in all runs of the
search, divided by that of a run at the cheapest sufficient tolerance; three tolerances were tested
for each power of ten. *Not met* means that the run itself reported that the requested error was not
reached. The scenes with names in lower case were selected at random from the registry of systems of
the tests; those with a closed form are integrated for this comparison.

| Scene | {columns} |
|---|{rules}
"""


def summary(found: dict[str, dict[str, list[AtTheEnd]]]) -> str:
    """What comes of all runs, in a few sentences."""
    every = [one for scene in found.values() for runs in scene.values() for one in runs]
    met = [one for one in every if one.met]
    late = [one for one in met if one.error > 1.0]
    worst = max(one.error for one in met)
    within = (
        "The true errors of all of these runs are within the request; the largest one is "
        f"{worst:.2g} times the requested error."
    )
    verb = "is" if len(late) == 1 else "are"
    beyond = (
        f"{len(met) - len(late)} of these errors are within the request, and {len(late)} {verb} "
        f"not: the largest is {worst:.2g} times the request."
    )

    def times(costs: list[float]) -> tuple[str, str]:
        known = [x for x in costs if math.isfinite(x)]
        return f"{np.median(known):.2g}", f"{np.quantile(known, 0.9):.2g}"

    together, most = times([one.cost for one in met])
    last, most_last = times([one.last for one in met])
    return (
        f"Instead of a tolerance, the final error can be requested. In {len(found)} scenes, "
        f"{len(met)} of {len(every)} runs report that the requested error was reached. "
        f"{beyond if late else within}\n\nThe cost is the number of evaluations of the vector "
        "field, divided by that of a run at the cheapest sufficient tolerance, which is known only "
        f"afterwards. For the whole search its median is {together} and its 90th percentile "
        f"{most}; for the last run of the search alone, {last} and {most_last}."
    )


def text(found: dict[str, dict[str, list[AtTheEnd]]]) -> str:
    """The part of the page, of all scenes by their names and precisions."""
    settings = [(p, within) for p, some in WITHIN.items() for within in some]
    columns = [f"{x:.0e}" + (" float32" if p == "float32" else "") for p, x in settings]
    head = HEAD.format(columns=" | ".join(columns), rules="--:|" * len(columns))
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

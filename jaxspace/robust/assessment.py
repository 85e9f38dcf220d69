"""Assessment of designs on independent runs: table and figure."""

__all__ = ["Estimate", "AssessedDesign", "AssessedLimit"]

import os
from pathlib import Path
from typing import Any, NamedTuple, final

import equinox as eqx
import numpy as np
from jax.tree_util import tree_leaves_with_path

from ..core.listed import Listed
from ..core.printing import printed
from ..core.structure import HashedModule
from ..core.suggestions import suggests
from ..core.text import aligned
from ..statistics import Dispersion
from ..statistics.limits import Probability
from ..statistics.requirements import Verdict
from ._optimum import DesignOptimum, name_of
from ._runs import Design
from .statistics import Constraint, Measured

# An error below this share of the value is that of rounding.
ROUNDING = 1e-9


@printed()
class Estimate(NamedTuple):
    """A `value` with its standard `error`, in the unit of the output; NaN if unknown."""

    value: float
    error: float

    def __str__(self) -> str:
        if not np.isfinite(self.error) or self.error <= ROUNDING * abs(self.value):
            return f"{self.value:.6g}"
        # The error with two digits, and the value to its last one.
        place = max(1 - int(np.floor(np.log10(self.error))), 0)
        return f"{self.value:.{place}f} ± {self.error:.{place}f}"


@suggests
class AssessedLimit(NamedTuple):
    """A limit assessed on independent runs.

    - `constraint`: the limit; `value`: of its statistic.
    - `verdict`: share of the runs that violate its requirement on each run, with its interval;
      `None` if it has no requirement on single runs."""

    constraint: Constraint
    value: Estimate
    verdict: Verdict | None

    @property
    def fails(self) -> bool:
        """Whether the runs show that the limit is violated: by the verdict, or by two standard
        errors."""
        if self.verdict is not None:
            return self.verdict.word == "fail"
        # At an optimum the limit is just satisfied: half of all estimates are beyond it, one in
        # forty by more than two errors.
        over = self.value.value - self.constraint.limit
        return (over if self.constraint.upper else -over) > 2.0 * self.value.error


@suggests
class AssessedDesign(NamedTuple):
    """A design assessed on independent runs.

    - `x`: the design; `runs`: the independent campaign.
    - `measured`: the statistic that was minimised.
    - `limits`: the constraints; `failed`: the share of failed runs."""

    x: Design
    runs: Dispersion
    measured: Measured
    limits: tuple[AssessedLimit, ...]
    failed: Probability

    @property
    def value(self) -> Estimate:
        """The statistic that was minimised."""
        return Estimate(self.measured.value, self.measured.error)


@final
class DesignAssessment(HashedModule):
    """Designs assessed on the same independent runs.

    - `designs`: a `AssessedDesign` for each, by name; the optimum of the search is "robust".
    - `optimum`: the result of the search.
    - `on_search`: the statistic on the runs of the search.
    - `seed`: of the independent runs.
    """

    designs: dict[str, AssessedDesign]
    optimum: DesignOptimum
    on_search: Measured
    seed: int = eqx.field(static=True)

    @property
    def gap(self) -> Estimate:
        """Excess of the minimised statistic on independent runs over that on the runs of the
        search, with the error of both."""
        fresh = self.designs["robust"].measured
        # Two independent samples, whose errors add in squares.
        both = np.hypot(fresh.error, self.on_search.error)
        return _difference(fresh.value, self.on_search.value, float(both))

    def worth(self, name: str) -> Estimate:
        """Excess of the minimised statistic of another design over that of the optimum. The error
        is smaller than that of either, because they have the same inputs."""
        own, other = self.designs["robust"].measured, self.designs[name].measured
        # Run by run, because the inputs are the same: what both designs have in common cancels.
        change = other.influence - own.influence
        return _difference(other.value, own.value, float(np.sqrt(np.sum(change**2))))

    @property
    def sentences(self) -> tuple[str, ...]:
        """Messages about worth, gap, tails and warnings."""
        objective = self.optimum.problem.objective
        fresh = self.designs["robust"].runs
        result = []
        for name, design in self.designs.items():
            if name == "robust":
                continue
            more = self.worth(name)
            size = Estimate(abs(more.value), more.error)
            side = "larger" if more.value >= 0.0 else "smaller"
            fails = ", which violates a constraint" if any(x.fails for x in design.limits) else ""
            result.append(f"The {objective.text()} is {size} {side} for {name}{fails}.")
        gap = self.gap
        side = "larger" if gap.value >= 0.0 else "smaller"
        result.append(
            f"For robust, it was {Estimate(self.on_search.value, 0.0)} in the optimisation; on "
            f"independent runs it is {Estimate(abs(gap.value), gap.error)} {side}."
        )
        for statistic in self.optimum.problem.statistics:
            if statistic.tail is not None:
                # As many as its error rests on, however many runs there are.
                beyond = f"{statistic.tail * fresh.runs:.0f} of {fresh.runs} independent runs"
                result.append(f"{beyond} are in the tail of the {statistic.text()}.")
        return Listed([*result, *self.optimum.warnings])

    def __repr__(self) -> str:
        lines = [*aligned(self._rows()).splitlines(), *self.sentences]
        return "\n".join([self._heading(), *(f"  {line}" for line in lines)])

    def _heading(self) -> str:
        count = self.designs["robust"].runs.runs
        return f"Designs on {count} independent runs with seed {self.seed}"

    def _rows(self) -> list[tuple[str, ...]]:
        """The table: statistics, shares of violations and failures, and unknowns of each design."""
        rows = [("", *self.designs)]
        rows.append((self.optimum.problem.objective.text(), *self._each(lambda d: str(d.value))))
        for k, constraint in enumerate(self.optimum.problem.constraints):
            rows.append((constraint.label(), *self._each(lambda d, k=k: str(d.limits[k].value))))
            # A limit of a mean has no share of violations.
            if self.designs["robust"].limits[k].verdict is not None:
                rows.append(("  violated", *self._each(lambda d, k=k: _shares(d.limits[k]))))
        rows.append(("failed", *self._each(lambda d: _percent(d.failed))))
        # All designs have the structure of the optimum.
        for number, (path, leaf) in enumerate(tree_leaves_with_path(self.optimum.x)):
            for index in np.ndindex(np.shape(leaf)):
                values = [
                    np.asarray(tree_leaves_with_path(d.x)[number][1])[index]
                    for d in self.designs.values()
                ]
                rows.append((name_of(path, index), *(f"{value:.6g}" for value in values)))
        return rows

    def page(self, path: str | os.PathLike[str], title: str = "Design under dispersion") -> Path:
        """Write a self-contained HTML page: the table of the designs, its findings, overlaid
        histograms of each output of the search, and the course of the search.

        **Arguments**

        - `path`: of the HTML file; `title`: of the page.

        **Returns** the path. **Raises** `ImportError` without matplotlib."""
        from ..plots import designs_page

        problem = self.optimum.problem
        figures = {f"Runs: {name}": self.plot(name) for name in problem.outputs}
        figures["Search"] = self.optimum.plot()
        said = [*self.sentences, self.optimum.sentence()]
        return designs_page(path, title, f"{self._heading()}.", self._rows(), said, figures)

    def _each(self, text: Any) -> list[str]:
        return [text(design) for design in self.designs.values()]

    def plot(self, output: str | None = None, title: str = "") -> Any:
        """A figure with the histograms of an output of all designs, by matplotlib.

        **Arguments**

        - `output`: its name; by default that of the statistic that was minimised.
        - `title`: of the figure.

        **Raises** `InputError` for an unknown output, and `ImportError` without matplotlib."""
        from ..plots import designs_figure

        output = self.optimum.problem.objective.output if output is None else output
        required = [
            c.requirement
            for c in self.optimum.problem.constraints
            if c.statistic.output == output and c.requirement is not None
        ]
        limits = [x for one in required for x in (one.low, one.high) if x is not None]
        runs = {name: design.runs for name, design in self.designs.items()}
        return designs_figure(runs, output, limits, title)


def _difference(a: float, b: float, error: float) -> Estimate:
    """a - b with its error, both zero if they are due to rounding."""
    least = ROUNDING * max(abs(a), abs(b))
    known = abs(a - b) > least
    return Estimate(a - b if known else 0.0, error if error > least else 0.0)


def _percent(share: Probability) -> str:
    """A share with its interval."""
    low, value, high = (100.0 * x for x in (share.low, share.value, share.high))
    # Two digits of a share near all runs would be 1e+02.
    digits = 3 if high >= 99.5 else 2
    return f"{value:.3g} % ({low:.{digits}g} to {high:.{digits}g})"


def _shares(limit: AssessedLimit) -> str:
    """Share of violations and verdict of a limit with a requirement on each run."""
    assert limit.verdict is not None
    verdict = limit.verdict
    allowed = 100.0 * verdict.allowed
    return f"{_percent(verdict.violation)}, {allowed:.3g} % allowed: {verdict.word}"

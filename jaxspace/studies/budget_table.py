"""The table of the influence of each effect on an output."""

__all__ = ["Influence"]

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from ..core.printing import printed
from ..core.suggestions import suggests
from ..core.text import aligned
from ._duration import duration
from ._scene_effects import effect_names as effect_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@printed()
class Influence(NamedTuple):
    """One effect, in all phases that have it.

    - `effect`: its name; `phases` that it acts in.
    - `influence`: the size of the change of the output without it, in the output's unit: the
      `linear` prediction, or `left_out`, from a run without it, if both differ by more than a
      tenth: then it is `nonlinear`.
    - `left_out` is `None` if the run without the effect fails; see `failure`.
    - `change`: of the output without the effect, component by component.
    - `share`: of the arithmetic of the whole run."""

    effect: str
    phases: tuple[str, ...]
    influence: float
    linear: float
    left_out: float | None
    nonlinear: bool
    change: tuple[float, ...]
    share: float
    failure: str = ""


@suggests
@final
@dataclass(frozen=True, eq=False)
class EffectBudget:
    """Influence of effects on an output of a run.

    - `output`: name of the output.
    - `unit`: of the output.
    - `nominal`: the output with all effects.
    - `noise`: change of the output under a finer integration (with a hundredth of the tolerance, or
      twice as many equal steps); NaN if that run did not reach its end.
    - `rows`: an `Influence` for every effect, the largest first.
    - `tolerance`: acceptable change of the output; with `None` the fields below are undefined.
    - `kept`: the smallest set of effects within the tolerance.
    - `dropped`: the other effects.
    - `change`: change of the output in a run with the `kept` effects only.
    - `seconds`, s: median time of the run with all effects.
    - `seconds_kept`, s: median time of the run with the `kept` effects only."""

    output: str
    unit: str
    nominal: np.ndarray
    noise: float
    rows: tuple[Influence, ...]
    tolerance: float | None = None
    kept: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    change: float | None = None
    seconds: float | None = None
    seconds_kept: float | None = None

    def renamed(self, names: Mapping[str, str]) -> "EffectBudget":
        """The same with other names of effects, such as those of a scene file; names that are not
        among the keys of `names` are unchanged."""
        return dataclasses.replace(
            self,
            rows=tuple(r._replace(effect=names.get(r.effect, r.effect)) for r in self.rows),
            kept=tuple(names.get(effect, effect) for effect in self.kept),
            dropped=tuple(names.get(effect, effect) for effect in self.dropped),
        )

    def __getitem__(self, effect: str) -> Influence:
        """The row of an effect."""
        return next(row for row in self.rows if row.effect == effect)

    def plot(self) -> "Figure":
        """A bar for every effect, a matplotlib figure.

        **Raises** `ImportError` if matplotlib is not installed."""
        from ..plots import effect_budget_figure

        return effect_budget_figure(self)

    def __repr__(self) -> str:
        unit = f" [{self.unit}]" if self.unit else ""
        rows = [("effect", "phases", f"influence{unit}", "first order", "left out", "", "share")]
        for row in self.rows:
            cells = (
                row.effect,
                ", ".join(row.phases),
                f"{row.influence:.3g}",
                f"{row.linear:.3g}",
                # A dash and no zero: without the effect the run has no end to compare.
                "-" if row.left_out is None else f"{row.left_out:.3g}",
                "fails" if row.failure else "nonlinear" if row.nonlinear else "",
                f"{100.0 * row.share:.1f} %",
            )
            rows.append(cells)
        # One digit: the noise is an order of magnitude, and no measurement.
        finer = "did not reach its end" if np.isnan(self.noise) else f"moves it by {self.noise:.1g}"
        return "\n".join(
            [
                aligned(rows, left=2),
                *(f"without {r.effect} the run fails: {r.failure}" for r in self.rows if r.failure),
                f"Influence: the change of the final {self.output} without the effect. Finer "
                f"integration {finer}.",
                "Share: of the arithmetic of the run, by operation counts of compiled evaluations.",
                *self._smallest_set(),
            ]
        )

    def _smallest_set(self) -> list[str]:
        """A description of the effects that may be omitted."""
        if self.tolerance is None:
            return []
        unit = f" {self.unit}" if self.unit else ""
        within = f"within {self.tolerance:g}{unit}"
        if (
            not self.dropped
            or self.change is None
            or self.seconds is None
            or self.seconds_kept is None
        ):
            return [f"{within}: every effect is needed"]
        arithmetic = sum(row.share for row in self.rows if row.effect in self.dropped)
        return [
            f"{within}: keep {', '.join(self.kept) or 'nothing'}; omit {', '.join(self.dropped)}",
            f"a run with only these changes the {self.output} by {self.change:.3g}{unit}, "
            f"saves {100.0 * arithmetic:.0f} % of the arithmetic, and takes "
            f"{duration(self.seconds_kept)} instead of {duration(self.seconds)}",
        ]

"""The estimate of a small probability, and its confidence interval."""

import math
from typing import NamedTuple

# Fewer independent violations are few, and a share of this size that may be missing matters.
FEW, DOUBTFUL = 4, 0.01
# A larger share that may be missing is an estimate too rough for an interval.
UNTRUSTED = 0.3
# From fewer distinct runs the chains of a level do not reach all of it: of 760
# intervals for 19 problems with 4000 runs, 98 of 161 with fewer missed the probability, and 16 of
# 599 with more.
FEW_SEEDS = 10


class Estimate(NamedTuple):
    """A probability as a sum of the weights of violations.

    - `value`: the sum.
    - `variation`: its standard error over the value.
    - `heaviest`: the largest possible contribution of a single violation to the sum.
    - `unseen`: estimated share of the violations in regions without draws.
    - `runs`: number of runs made.
    - `seeds`: the least number of distinct runs from which the chains of a level start; infinite
      without chains."""

    value: float
    variation: float
    heaviest: float
    unseen: float
    runs: int
    seeds: float = math.inf

    @property
    def reliable(self) -> bool:
        """Whether the interval contains the probability as often as it states: the searches agree
        on the regions of violation, and the chains of all levels have enough starts."""
        return self.unseen <= UNTRUSTED and self.seeds >= FEW_SEEDS

    @property
    def warning(self) -> str:
        """A message if the value is uncertain; empty otherwise."""
        if self.value == 0.0 and self.reliable:
            return "No violation was found: the probability is at most `high`."
        sentences = []
        if self.value == 0.0:
            sentences.append("No violation was found.")
        elif self.variation > FEW**-0.5:
            sentences.append(
                f"The value rests on about {1.0 / self.variation**2:.2g} independent violations."
            )
        if self.unseen > DOUBTFUL:
            sentences.append(
                "One search for violations does not cover all violations found by another one: "
                f"about {100.0 * self.unseen:.2g} % of the probability may be missing."
            )
        if self.seeds < FEW_SEEDS:
            sentences.append(
                f"The chains of a level start from {self.seeds} distinct runs: most steps of the "
                "chains leave the level."
            )
        if not self.reliable:
            sentences.append("The interval is not reliable.")
        if sentences:
            sentences.append("Use more runs.")
        return " ".join(sentences)

    def interval(self) -> tuple[float, float]:
        """The limits of 95 % confidence, those of a weighted sum of Poisson counts (Fay and Feuer,
        Stat. Med. 16 (1997), 791): wider than the normal ones where few violations, or one of a
        large weight, decide, and above zero where there are none."""
        from scipy.special import gammaincinv

        low, square = 0.0, 0.0
        if self.value > 0.0 and math.isfinite(self.variation):
            square = (self.value * self.variation) ** 2
            low = self.value
        if square > 0.0:
            low = square / self.value * float(gammaincinv(self.value**2 / square, 0.025))
        total, spread = self.value + self.heaviest, square + self.heaviest**2
        high = total
        if spread > 0.0:
            high = spread / total * float(gammaincinv(total**2 / spread, 0.975))
        return low, min(high / (1.0 - self.unseen), 1.0)

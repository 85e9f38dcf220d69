"""Requirements on the outputs of a campaign, and their verification by its runs.

A requirement allows a share of the runs to violate it. The true share of violations is bounded by a
Clopper-Pearson interval: if the interval is below the allowed share, the requirement is satisfied;
if above, it is violated; if it contains the allowed share, more runs are required for a decision.
"""

__all__ = ["Requirement", "Verdict"]

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from ..core import InputError
from ..core.printing import printed
from .limits import Probability, check_share, clopper_pearson

Word: TypeAlias = Literal["pass", "fail", "not yet known"]
# The requested run of an output.
WHICH = ("worst", "least", "greatest")
# Beyond this number of runs a verdict is not expected from more of them.
MOST_RUNS = 10**9


@printed()
class Requirement(NamedTuple):
    """A requirement on an output.

    - `low`, `high`: the least and the greatest allowed value; `None` for no limit.
    - `allowed`: the share of the runs that may violate it, between 0 and 1; `None` for no verdict.
    - `confidence`: of the interval that decides."""

    low: float | None = None
    high: float | None = None
    allowed: float | None = None
    confidence: float = 0.95

    def check(self, name: str) -> None:
        """Raise `InputError`, by the `name` of the requirement, for limits in the wrong order, and
        for shares that are not between 0 and 1."""
        if self.low is not None and self.high is not None and self.low > self.high:
            raise InputError(
                f"{name} is from {self.low:g} to {self.high:g}: the lower limit must not exceed "
                "the upper one."
            )
        check_share(f"{name}: confidence", self.confidence)
        if self.allowed is not None:
            check_share(f"{name}: allowed", self.allowed)

    @property
    def record(self) -> tuple[float | None, ...]:
        """Its numbers for the record of a campaign, without defaults."""
        plain = self == Requirement(self.low, self.high)
        return (self.low, self.high) if plain else tuple(self)


@printed()
class Verdict(NamedTuple):
    """Whether a requirement is satisfied.

    - `word`: "pass", "fail" or "not yet known".
    - `violation`: the probability of a violation, with its interval.
    - `allowed`: the share that may violate it.
    - `runs_needed`: the number of runs that decides if the share of violations stays as it is,
      rounded up to two digits; `None` for a verdict that is known, and where no number of runs up
      to 1e9 decides, because the share of violations equals the allowed one."""

    word: Word
    violation: Probability
    allowed: float
    runs_needed: int | None = None


def requirement_of(limits: Sequence[float | None]) -> Requirement:
    """The requirement of a pair of limits, or of the numbers of a record."""
    return Requirement(*limits)  # type: ignore[arg-type]


def verdict_of(violation: Probability, allowed: float) -> Verdict:
    """The verdict on a requirement that allows this share of violations."""
    word: Word = "not yet known"
    if violation.high <= allowed:
        word = "pass"
    elif violation.low > allowed:
        word = "fail"
    needed = _runs_needed(violation, allowed) if word == "not yet known" else None
    return Verdict(word, violation, allowed, needed)


def _runs_needed(violation: Probability, allowed: float) -> int | None:
    """The number of runs from which the interval excludes the allowed share of violations, at the
    present share."""

    def decides(runs: int) -> bool:
        # Rounded towards the allowed share, so that the number is rather too large than too small.
        side = math.ceil if violation.value < allowed else math.floor
        count = side(runs * violation.count / violation.runs)
        expected = clopper_pearson(count, runs, violation.confidence)
        return expected.high <= allowed or expected.low > allowed

    runs = violation.runs
    while not decides(runs):
        runs *= 2
        if runs > MOST_RUNS:
            return None
    # By whole counts `decides` is only nearly monotonic, which the rounding covers.
    few = runs // 2
    while runs - few > 1:
        middle = (few + runs) // 2
        few, runs = (few, middle) if decides(middle) else (middle, runs)
    unit = 10 ** max(len(str(runs)) - 2, 0)
    return -(-runs // unit) * unit


def extreme_place(
    which: str, output: str, x: np.ndarray, low: float | None, high: float | None
) -> int:
    """The index of the run that is "least", "greatest" or "worst" according to the values `x` of an
    output, (runs,), NaN for excluded runs; `low` and `high` are its limits. Raises `InputError` as
    `Dispersion.run_of` does."""
    if which not in WHICH:
        raise InputError(f"which is {which!r}: it must be one of {', '.join(WHICH)}.")
    if which == "worst" and low is None and high is None:
        raise InputError(
            f"{output} has no requirement that defines the worst run: use least or greatest, or "
            "give the output at_least or at_most."
        )
    # By the nearer of both limits; negative where the requirement is violated.
    margins = [*([] if low is None else [x - low]), *([] if high is None else [high - x])]
    by = {"least": x, "greatest": -x}.get(which)
    by = np.min(margins, axis=0) if by is None else by
    if np.isnan(by).all():
        raise InputError(f"{output} is not finite in any successful run.")
    return int(np.nanargmin(by))

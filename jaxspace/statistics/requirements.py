"""Requirements on the outputs of a campaign, and whether its runs show that they are met.

A requirement allows a share of the runs to violate it. The true share of violations is known to an
interval of Clopper and Pearson: below the allowed share the requirement is met, above it is not,
and while the allowed share lies within, more runs have to decide.
"""

__all__ = ["Requirement", "Verdict"]

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

from ..core import InputError
from ..core.printing import printed
from .limits import Probability, check_share

Word: TypeAlias = Literal["pass", "fail", "not yet known"]


@printed()
class Requirement(NamedTuple):
    """What is required of an output.

    - `low`, `high`: the least and the greatest value that is allowed; `None` for no limit.
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
                f"{name} is from {self.low:g} to {self.high:g}: the least value must not be above "
                f"the greatest."
            )
        check_share(f"{name}: confidence", self.confidence)
        if self.allowed is not None:
            check_share(f"{name}: allowed", self.allowed)

    @property
    def record(self) -> tuple[float | None, ...]:
        """Its numbers for the record of a campaign, without those that are the default."""
        plain = self == Requirement(self.low, self.high)
        return (self.low, self.high) if plain else tuple(self)


@printed()
class Verdict(NamedTuple):
    """Whether a requirement is met.

    - `word`: "pass", "fail" or "not yet known".
    - `violation`: the probability of a violation, with its interval.
    - `allowed`: the share that may violate it."""

    word: Word
    violation: Probability
    allowed: float


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
    return Verdict(word, violation, allowed)

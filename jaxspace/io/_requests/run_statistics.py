"""Statistics of an output over the runs of [dispersion] for [optimize], as given in a file.

    take               of the runs                                             by default
    "mean"             the mean                                                this one
    "mean + 3 std"     the mean and three standard deviations; or less them
    "99 %"             what 99 % of them are not worse than
    "beyond 99 %"      the mean of the 1 % that are worse than that
    "worst"            the worst one
    "above 6 m/s"      the share of them with more; or `below`, with less

Worse is more of what is minimised or has an `at_most`, and less of what is maximised or has an
`at_least`. A failed run counts as a bad one in a share. For an output that is an extreme along each
run, both are given in order: take = ["greatest", "99 %"]."""

import re
from typing import NamedTuple

from ...core import argument
from .._kinds.errors import wrong
from .._kinds.kind import Value
from .._mission.parsed import Parsed
from ..units import read_number
from .output_entries import TAKES, read_share, unit_of
from .output_spec import OutputSpec

MEAN, WORST, SPREAD, QUANTILE, BEYOND = "mean", "worst", "spread", "quantile", "beyond"
ABOVE, BELOW = "above", "below"
FORMS = '"mean", "mean + 3 std", "99 %", "beyond 99 %", "worst", or "above" or "below" a value'
ALONG = f"or one of {', '.join(TAKES)} along each run; or a list of one of these and of those"
WITH_STD = re.compile(r"mean\s*([+-])\s*(\d+\.?\d*)\s*std")
LIMIT = re.compile(rf"({ABOVE}|{BELOW})\s+(.+)")
PERCENT = re.compile(rf"({BEYOND}\s+)?(\d+\.?\d*\s*%)")


class RunStatistic(NamedTuple):
    """A statistic over the runs: its `kind`, and its `number`: a number of standard deviations, a
    share, or a limit in the unit of the output."""

    kind: str
    number: float = 0.0

    @property
    def is_share(self) -> bool:
        """Whether it is a share of the runs, and not in the unit of the output."""
        return self.kind in (ABOVE, BELOW)


def split_take(take: Value) -> tuple[Value, Value]:
    """The extreme along each run, and the statistic over the runs; `None` for a missing one."""
    if isinstance(take, list) and len(take) == 2 and take[0] in TAKES:
        return take[0], take[1]
    return (take, None) if isinstance(take, str) and take in TAKES else (None, take)


def read_statistic(key: str, text: Value, spec: OutputSpec, file: Parsed) -> RunStatistic:
    """The statistic over the runs that a text describes. Raises `ValueError` with the complete
    message."""
    words = text.strip() if isinstance(text, str) else ""
    if words in (MEAN, WORST):
        return RunStatistic(words)
    if spread := WITH_STD.fullmatch(words):
        return RunStatistic(SPREAD, float(spread[1] + spread[2]))
    if percent := PERCENT.fullmatch(words):
        share = read_share(key, percent[2])
        assert share is not None
        return RunStatistic(BEYOND if percent[1] else QUANTILE, share)
    if limit := LIMIT.fullmatch(words):
        try:
            value = read_number(limit[2], argument(unit_of(spec, file), doc="limit"))[0]
        except ValueError as error:
            raise ValueError(wrong(key, text, f"{limit[1]} a limit, {error}")) from None
        return RunStatistic(limit[1], spec.factor * value)
    raise ValueError(wrong(key, text, f"{FORMS}, for the runs; {ALONG}"))

"""The price list of accuracy: what each error at the end costs at least, by the runs of a table."""

import math
from collections.abc import Callable
from typing import NamedTuple

from ..core import InputError
from ..core.printing import printed
from ..core.text import aligned
from ._duration import duration

# From all that is wrong to more digits than any precision has.
ERRORS = tuple(10.0**-k for k in range(16))


@printed(seconds="s")
class Price(NamedTuple):
    """What an error at the end costs at least.

    - `error`: relative, of the final state.
    - `setting`: the method and the tolerance that reach it, in words; `seconds`: the time of a run.
    - `tenth`: how many times as long a tenth of this error takes; NaN where no run reaches it."""

    error: float
    setting: str
    seconds: float
    tenth: float


def price_list(cheapest: Callable[[float], tuple[str, float]]) -> tuple[Price, ...]:
    """The prices of the errors that differ, one for each power of ten, from the largest on.

    `cheapest(error)` gives setting and time, s; it raises `InputError` for an error that no run
    reaches. The largest errors that one setting serves all are one line, that of the least of
    them."""
    known = []
    for error in ERRORS:
        # Also where no run ended well.
        try:
            known.append((error, *cheapest(error)))
        except InputError:
            break
    following = [seconds for _, _, seconds in known[1:]] + [math.nan] * min(len(known), 1)
    prices = [
        Price(error, setting, seconds, tenth / seconds)
        for (error, setting, seconds), tenth in zip(known, following, strict=True)
    ]
    first = next((k for k, p in enumerate(prices) if p.setting != prices[0].setting), len(prices))
    return tuple(prices[max(first - 1, 0) :])


def price_table(prices: tuple[Price, ...]) -> str:
    """The price list as a table."""
    rows = [("error", "setting", "time", "a tenth of this error")]
    for price in prices:
        tenth = "-" if math.isnan(price.tenth) else f"{price.tenth:.2g} times the time"
        rows.append((f"{price.error:.0e}", price.setting, duration(price.seconds), tenth))
    return aligned(rows, left=2)

"""One line of the page: a number of ours beside that of a source, and what the source allows."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

# Begins the reason of a limit that no source gives, and that was set with the difference in view.
JUDGED = "our judgement, "


@dataclass(frozen=True)
class Row:
    """A comparison with a source.

    - `what`: is computed; `quantity`: which number of it, with its unit.
    - `source`: where the number of the others stands.
    - `ours`, `theirs`: of a vector or a course the place where they differ most.
    - `difference`, `allowed`: in the unit of the quantity; `why` that much is allowed.
    - `note`: what explains a row that fails; a row that fails has to have one."""

    what: str
    source: str
    quantity: str
    ours: float
    theirs: float
    difference: float
    allowed: float
    why: str
    note: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the difference is within what the source allows; NaN is not."""
        return self.difference <= self.allowed


def compared(ours: Any, theirs: Any, allowed: Any, **said: str) -> Row:
    """The row of two arrays of one shape, where their difference is largest beside the `allowed`
    one (a number, or one for each); `said`: the words of the row."""
    found, truth = np.broadcast_arrays(np.asarray(ours, float), np.asarray(theirs, float))
    limits = np.broadcast_to(np.asarray(allowed, float), truth.shape).ravel()
    apart = np.abs(found - truth).ravel()
    shares = [math.inf if math.isnan(d) else d / a for d, a in zip(apart, limits, strict=True)]
    at = int(np.argmax(shares))
    numbers = (found.ravel()[at], truth.ravel()[at], apart[at], limits[at])
    ours_there, theirs_there, difference, limit = (float(x) for x in numbers)
    return Row(ours=ours_there, theirs=theirs_there, difference=difference, allowed=limit, **said)

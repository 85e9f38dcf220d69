"""The runs of a campaign that ended badly, by the reason."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..core.printing import printed
from ..core.status import Status


@printed()
class Failure(NamedTuple):
    """The number of runs that failed with a status, and the message of this status."""

    status: Status
    count: int
    sentence: str


def failures_of(codes: np.ndarray) -> Iterator[Failure]:
    """The failures of runs by the codes of their `Status`, the most frequent first."""
    codes, counts = np.unique(codes, return_counts=True)
    # Stable, so that equal counts stay in the order of their codes.
    for k in np.argsort(-counts, kind="stable"):
        status = Status(int(codes[k]))
        yield Failure(status, int(counts[k]), status.sentence)

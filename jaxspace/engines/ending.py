"""The end of a campaign by a rule: as soon as a percentile is known well enough.

The rule is checked after 1, 2, ... 8 chunks and then at counts that grow by an eighth, with exactly
the runs up to there. The end therefore depends on the campaign, the seed and the chunk size only,
not on the engine, the order of the chunks, or a restart.
"""

from collections.abc import Iterable

import numpy as np

from ..core import InputError
from ..statistics.spread import StopRule
from ..stores.results import RunResults
from ..stores.store import Store

EACH, GROWTH = 8, 8


def checkpoints(chunks: int) -> list[int]:
    """Numbers of finished chunks, all below `chunks`, at which the rule is checked."""
    result = []
    count = 1
    while count < chunks:
        result.append(count)
        count += 1 if count < EACH else count // GROWTH
    return result


def check_rule(rule: StopRule, outputs: Iterable[str]) -> None:
    """Raise `InputError` for a rule on an unknown output."""
    if rule.output not in outputs:
        raise InputError(
            f"until.output is {rule.output!r}: it must be one of {', '.join(outputs)}."
            f"{InputError.hint(rule.output, outputs)}"
        )


class Ending:
    """Evaluation of a stopping rule on the chunks that are complete.

    **Arguments**

    - `rule`: decides when the runs are enough.
    - `chunks`: their largest number."""

    def __init__(self, rule: StopRule, chunks: int):
        self.rule = rule
        self.waiting = checkpoints(chunks)
        self.values: dict[int, np.ndarray] = {}
        self.met: int | None = None

    def add(self, chunk: int, results: RunResults) -> None:
        """Count the runs of a chunk; a failed one is NaN."""
        self.values[chunk] = results.outputs[self.rule.output]

    def read(self, store: Store, chunks: list[int]) -> None:
        """Count the runs of these chunks of a store."""
        for chunk in chunks:
            if chunk not in self.values:
                self.values[chunk] = store.values(self.rule.output, [chunk])

    def enough(self) -> int | None:
        """Number of chunks at which the rule is met; `None` as long as it is not."""
        while self.met is None and self.waiting:
            count = self.waiting[0]
            # In order, because an earlier count must decide before a later one.
            if not all(k in self.values for k in range(count)):
                break
            x = np.concatenate([self.values[k] for k in range(count)])
            # If all runs have failed so far, a percentile does not exist.
            if not np.isnan(x).all() and self.rule.met(x):
                self.met = count
            self.waiting = self.waiting[1:]
        return self.met

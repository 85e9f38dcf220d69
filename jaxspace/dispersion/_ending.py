"""A campaign that ends itself, when a percentile is known well enough.

The rule is asked after 1, 2, ... 8 chunks and then at counts that grow by an eighth, of all runs up
to there and of no others. So the end depends on the campaign, the seed and the size of the chunks
alone: not on the engine, on the order in which chunks come, nor on a restart.
"""

from collections.abc import Iterable

import numpy as np

from ..core import InputError
from ._run_results import RunResults
from ._store import Store
from .spread import StopRule

EACH, GROWTH = 8, 8


def checkpoints(chunks: int) -> list[int]:
    """Numbers of finished chunks, all below `chunks`, at which the rule is checked."""
    found, count = [], 1
    while count < chunks:
        found.append(count)
        count += 1 if count < EACH else count // GROWTH
    return found


def check_rule(rule: StopRule, outputs: Iterable[str]) -> None:
    """Raise `InputError` for a rule of an output that there is not, or with impossible numbers."""
    rule.check()
    if rule.output not in outputs:
        raise InputError(
            f"until.output is {rule.output!r}: it must be one of {', '.join(outputs)}."
            f"{InputError.hint(rule.output, outputs)}"
        )


class Ending:
    """Evaluation of a stopping rule on the chunks that are complete.

    **Arguments**

    - `rule`: when there are enough runs.
    - `chunks`: how many there are at most."""

    def __init__(self, rule: StopRule, chunks: int):
        self.rule = rule
        self.waiting = checkpoints(chunks)
        self.values: dict[int, np.ndarray] = {}
        self.met: int | None = None

    def add(self, chunk: int, results: RunResults) -> None:
        """Count the runs of a chunk; a failed one is NaN."""
        self.values[chunk] = results.outputs[self.rule.output]

    def read(self, store: Store, chunks: list[int]) -> None:
        """Count what a store has of these chunks."""
        for chunk in chunks:
            if chunk not in self.values:
                self.values[chunk] = store.values(self.rule.output, [chunk])

    def enough(self) -> int | None:
        """Number of chunks at which the rule is met; `None` as long as it is not."""
        while self.met is None and self.waiting:
            count = self.waiting[0]
            # In order: a later count must not answer before an earlier one is known.
            if not all(k in self.values for k in range(count)):
                break
            x = np.concatenate([self.values[k] for k in range(count)])
            # Where all have failed so far there is no percentile to ask for.
            if not np.isnan(x).all() and self.rule.met(x):
                self.met = count
            self.waiting = self.waiting[1:]
        return self.met

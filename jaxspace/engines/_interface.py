"""Interfaces: an engine computes chunks of runs, in any order and with the same bits anywhere, by a
runner, which computes runs by their numbers."""

import time
from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from typing import NamedTuple, TypeAlias

import jax
from jaxtyping import PyTree

from ..core import InputError
from ..core.processors import cores
from ..core.suggestions import suggests
from ..stores.results import RunResults

RETRIES = 3
"""Default maximum number of losses of a chunk with its worker."""


class AbstractRunner(ABC):
    """Computes runs by their numbers: those of a campaign, whatever it simulates.

    - `prepared`: everything on which the numbers of a run depend, from which another process makes
      the runner again.
    - `modules`: name and text of Python files that must have run before `prepared` is read there.
    - `units`: of inputs and outputs, by name."""

    prepared: PyTree
    modules: tuple[tuple[str, str], ...] = ()
    units: dict[str, str]

    @classmethod
    @abstractmethod
    def in_worker(cls, prepared: PyTree, devices: Sequence[jax.Device]) -> "AbstractRunner":
        """The runner of one of several processes."""

    @property
    @abstractmethod
    def example(self) -> RunResults:
        """The results of one run, for names and shapes."""

    @abstractmethod
    def run(self, first: int, count: int) -> RunResults:
        """The results of `count` runs from the number `first` on, which follow from `prepared` and
        the number of the run only, bit for bit."""


class Extent(NamedTuple):
    """A chunk by its number, its first run and the number of its runs."""

    chunk: int
    first: int
    runs: int


class Done(NamedTuple):
    """A chunk that has been computed, its results, and the processor time that it took, s."""

    chunk: int
    results: RunResults
    cpu: float


Computed: TypeAlias = Generator[Done, None, None]


def workers_or_cores(engine: str, workers: int | None) -> int:
    """The number of workers of an engine of this name: by default one for each core.

    Raises `InputError` for less than one."""
    count = cores() if workers is None else workers
    if count < 1:
        raise InputError(f"{engine}.workers is {count}: it must be at least 1.")
    return count


@suggests
class AbstractEngine(ABC):
    """Computes chunks, in any order."""

    @abstractmethod
    def compute(self, runner: AbstractRunner, extents: Sequence[Extent]) -> Computed:
        """The chunks, each as soon as it is there.

        The caller commits a chunk before it requests the next one. At most `workers` chunks are
        begun and not committed at any time, and have to be computed again if this process dies.

        **Raises** `StoreError` where a chunk cannot be computed after all retries."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """Number of chunks that are computed at the same time."""

    @property
    def leads(self) -> bool:
        """Whether this process makes the store; one of several that share a campaign does."""
        return True

    @property
    def shares(self) -> bool:
        """Whether several processes share a campaign, each of which computes a part."""
        return False

    @property
    def host(self) -> int | None:
        """Number of this process among those that share a campaign; `None` without other hosts."""
        return None

    def share(self, extents: Sequence[Extent]) -> list[Extent]:
        """The chunks that this process computes."""
        return list(extents)

    def sync(self, stage: str) -> None:
        """Wait until all processes that share a campaign have reached this stage."""
        del stage


def timed(runner: AbstractRunner, extent: Extent) -> Done:
    """The runs of a chunk, with the processor seconds that they took in this process."""
    before = time.process_time()
    results = runner.run(extent.first, extent.runs)
    return Done(extent.chunk, results, time.process_time() - before)

"""Engines by name, and those that start no processes: the local one, and those of several processes
that share a campaign, with or without a connection between them."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, final

import jax

from ..core import InputError
from ._dask import DaskCluster, is_client
from ._interface import AbstractEngine, AbstractRunner, Computed, Extent, timed
from ._process_pool import ProcessPool

if TYPE_CHECKING:
    from distributed import Client


@final
class InProcess(AbstractEngine):
    """Engine in this process: all cores of its CPU, or all of its accelerators, share every
    chunk."""

    @property
    def workers(self) -> int:
        return 1

    def compute(self, runner: AbstractRunner, extents: Sequence[Extent]) -> Computed:
        for extent in extents:
            yield timed(runner, extent)


@final
class MultiHost(AbstractEngine):
    """Engine on the processes of `jax.distributed`, on one machine or many, each with its own
    accelerators or cores. Every one of them makes the same call of `disperse` after
    `jax.distributed.initialize`; a store that is visible to all of them is required.

    A new store replaces an old one when each process has written its first chunk."""

    @property
    def workers(self) -> int:
        return jax.process_count()

    @property
    def leads(self) -> bool:
        return jax.process_index() == 0

    @property
    def shares(self) -> bool:
        return True

    @property
    def host(self) -> int | None:
        return jax.process_index()

    def share(self, extents: Sequence[Extent]) -> list[Extent]:
        # In turn, so that all processes end together.
        return list(extents[jax.process_index() :: jax.process_count()])

    def sync(self, stage: str) -> None:
        from jax.experimental.multihost_utils import sync_global_devices

        sync_global_devices(f"jaxspace campaign {stage}")

    def compute(self, runner: AbstractRunner, extents: Sequence[Extent]) -> Computed:
        return InProcess().compute(runner, extents)


@final
class Part(AbstractEngine):
    """Engine of one of several tasks that share a campaign without knowing of each other, such as
    those of an array job of SLURM: this process computes one part of the chunks on all of its cores
    or accelerators, and writes them to a store on a file system that all tasks share.

    The tasks can run at the same time or one after the other, and a task that was ended is started
    again by the same call. `disperse` returns the runs that are in the store when the task ends;
    the last task returns all of them.

    - `part`: number of the part, from 1 to `parts`.
    - `parts`: number of parts."""

    def __init__(self, part: int, parts: int):
        # In Python a bool is an integer, but here it can only be a mistake.
        whole = all(isinstance(x, int) and not isinstance(x, bool) for x in (part, parts))
        if not whole or not 1 <= part <= parts:
            raise InputError(
                f"part is {part!r} of {parts!r}: it must be a whole number from 1 to the number of "
                "parts."
            )
        self.part, self.parts = part, parts

    @property
    def workers(self) -> int:
        return 1

    @property
    def host(self) -> int | None:
        return self.part - 1

    def chunk(self, runs: int, chunk: int) -> int:
        """Number of runs in a chunk with which each of the parts has one; at most `chunk`."""
        return min(chunk, -(-runs // self.parts))

    def compute(self, runner: AbstractRunner, extents: Sequence[Extent]) -> Computed:
        return InProcess().compute(runner, extents)


ENGINES: dict[str, Callable[[], AbstractEngine]] = {
    "local": InProcess,
    "processes": ProcessPool,
    "dask": DaskCluster,
    "hosts": MultiHost,
}


def as_engine(engine: "str | AbstractEngine | Client") -> AbstractEngine:
    """An engine by its name, by the address of a Dask scheduler, or by a client of Dask; an engine
    passes.

    Raises `InputError` for anything else."""
    if isinstance(engine, AbstractEngine):
        return engine
    if isinstance(engine, str) and engine in ENGINES:
        return ENGINES[engine]()
    if is_client(engine) or isinstance(engine, str) and "://" in engine:
        return DaskCluster(engine)
    raise InputError(
        f"engine is {engine!r}: it must be one of {', '.join(ENGINES)}, or the address of a Dask "
        f'scheduler, such as "tcp://10.0.0.5:8786".'
    )

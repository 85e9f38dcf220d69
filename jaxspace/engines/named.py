"""Engines by name, and the two that start no processes: the local one, and the one of several hosts
that share a campaign."""

from collections.abc import Callable, Sequence
from typing import final

import jax

from ..core import InputError
from ._dask import DaskCluster
from ._interface import AbstractEngine, AbstractRunner, Computed, Extent, timed
from ._process_pool import ProcessPool


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


ENGINES: dict[str, Callable[[], AbstractEngine]] = {
    "local": InProcess,
    "processes": ProcessPool,
    "dask": DaskCluster,
    "hosts": MultiHost,
}


def as_engine(engine: str | AbstractEngine) -> AbstractEngine:
    """An engine by its name or by the address of a Dask scheduler; an engine passes.

    Raises `InputError` for anything else."""
    if isinstance(engine, AbstractEngine):
        return engine
    if isinstance(engine, str) and engine in ENGINES:
        return ENGINES[engine]()
    if isinstance(engine, str) and "://" in engine:
        return DaskCluster(engine)
    raise InputError(
        f"engine is {engine!r}: it must be one of {', '.join(ENGINES)}, or the address of a Dask "
        f'scheduler, such as "tcp://10.0.0.5:8786".'
    )

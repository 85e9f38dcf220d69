"""Chunks from an engine to memory or to a store, up to where a rule ends the campaign."""

import contextlib
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from typing import TypeAlias

from ..core.record import Record
from ..statistics import Dispersion
from ..statistics.spread import StopRule
from ..stores import DamagedStore
from ..stores.columns import columns_of
from ..stores.results import RunResults
from ..stores.store import ENOUGH, Store
from ..stores.stored_runs import as_dispersion
from ..stores.writer import StoreWriter
from ._interface import AbstractEngine, AbstractRunner, Extent
from .ending import Ending

Progress: TypeAlias = Callable[[int, int], None] | None
Computed: TypeAlias = Generator[tuple[int, tuple[RunResults, float]], None, None]


def in_memory(
    runner: AbstractRunner,
    engine: AbstractEngine,
    chunk: int,
    total: int,
    progress: Progress,
    until: StopRule | None,
) -> dict[int, tuple[RunResults, float]]:
    """The results of the chunks, up to where the rule is met, with the processor time of each."""
    firsts = range(0, total, chunk)
    extents = [Extent(k, first, min(chunk, total - first)) for k, first in enumerate(firsts)]
    ending = None if until is None else Ending(until, len(extents))
    chunks = {}
    enough = None
    with contextlib.closing(_computed(runner, engine, extents, total, progress)) as computed:
        for k, result in computed:
            chunks[k] = result
            if ending is not None:
                ending.add(k, result[0])
                enough = ending.enough()
            if enough is not None:
                break
    # Without the chunks beyond that other processes have computed in the meantime.
    return {k: x for k, x in chunks.items() if enough is None or k < enough}


def stored(
    writer: StoreWriter,
    runner: AbstractRunner,
    engine: AbstractEngine,
    attributes: Record,
    progress: Progress,
    until: StopRule | None,
) -> Dispersion:
    """Compute the missing chunks of a store and write them, up to where the rule is met."""
    columns = columns_of(runner.example, runner.units)
    if engine.leads:
        # One process makes the store, and the others join it when it is there.
        writer.prepare(columns, attributes)
    engine.sync("prepared")
    writer.host = engine.host
    store = writer.store if engine.leads else writer.join(columns, attributes)
    missing, damages = writer.missing()
    # No process writes before all have read the store.
    engine.sync("counted")
    for damage in damages:
        warnings.warn(
            f"{store.path}: {damage} The chunk is computed again.", DamagedStore, stacklevel=4
        )
    ending = None if until is None else Ending(until, store.count)
    if ending is not None:
        ending.read(store, sorted(set(store.finished()) - set(missing)))
    enough = None if ending is None else ending.enough()
    extents = [Extent(chunk, *store.extent(chunk)) for chunk in missing]
    storing = 0.0
    # A new store is published once each process has written a chunk of it.
    borders = [] if ending is None else ending.waiting
    if not writer.published:
        borders = sorted({*borders, engine.workers})
    for number, part in enumerate(_parts(extents, engine, borders)):
        if enough is not None:
            break
        # Results stored by earlier calls and parts count as done.
        done = store.runs - sum(e.runs for e in extents if e.chunk >= part[0].chunk)
        computed = _computed(runner, engine, engine.share(part), store.runs, progress, done)
        storing += _written(writer, computed, ending)
        engine.sync(f"part {number}")
        if not writer.published:
            # All processes wait here: none writes into the folder that moves.
            if engine.leads:
                writer.publish()
            engine.sync("published")
            writer.write_to_path()
        if ending is not None:
            # The rule sees the chunks of all processes, so that all of them stop after the same
            # part.
            ending.read(store, [extent.chunk for extent in part if engine.shares])
            enough = ending.enough()
    engine.sync("finished")
    if engine.leads:
        _finish(writer, store, enough, storing)
    # Before any process reads the store, chunks beyond the end have been removed.
    engine.sync("ended")
    store = store.read()
    return as_dispersion(store, store.finished())


def _written(writer: StoreWriter, computed: Computed, ending: Ending | None) -> float:
    """Write the computed chunks, up to where the rule is met; returns the time for it, s."""
    last = time.perf_counter()
    storing = 0.0
    # Closed as soon as the rule ends the campaign, so that other processes stop.
    with contextlib.closing(computed):
        for chunk, (results, cpu) in computed:
            before = time.perf_counter()
            writer.commit(chunk, results, before - last, cpu)
            last = time.perf_counter()
            storing += last - before
            if ending is not None:
                ending.add(chunk, results)
                if ending.enough() is not None:
                    break
    return storing


def _finish(writer: StoreWriter, store: Store, enough: int | None, storing: float) -> None:
    if enough is None and ENOUGH in store.attributes:
        # The rule ended the campaign before; later chunks may still have to be removed.
        enough = store.count
    if enough is not None:
        writer.end_at(enough)
    writer.note(storing_seconds=storing + store.attributes.get("storing_seconds", 0.0))


def _parts(
    extents: list[Extent], engine: AbstractEngine, borders: Sequence[int]
) -> list[list[Extent]]:
    """The chunks in parts after which the processes that share them synchronise: between these
    numbers of chunks."""
    edges = [0, *(borders if engine.shares else ()), sys.maxsize]
    parts = [[e for e in extents if a <= e.chunk < b] for a, b in itertools.pairwise(edges)]
    return [part for part in parts if part]


def _computed(
    runner: AbstractRunner,
    engine: AbstractEngine,
    extents: list[Extent],
    total: int,
    progress: Progress,
    done: int = 0,
) -> Computed:
    """The results of these chunks with the processor time of each; `done` runs exist already."""
    runs_of = {extent.chunk: extent.runs for extent in extents}
    # Closed as soon as the rule ends the campaign, so that other processes stop.
    with contextlib.closing(engine.compute(runner, extents)) as computed:
        for result in computed:
            # When the loop continues, the yielded chunk has been stored. Only then is it reported,
            # so that progress that a user has seen survives an interruption.
            yield result.chunk, (result.results, result.cpu)
            done += runs_of[result.chunk]
            if progress is not None:
                progress(done, total)

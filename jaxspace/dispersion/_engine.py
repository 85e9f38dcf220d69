"""The verb of campaigns: many runs, by any engine, stored chunk by chunk."""

import contextlib
import dataclasses
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..core import InputError, Scalar, check_positive
from ..integration._accuracy import DEFAULT_RTOL, Accuracy, as_accuracy
from ..integration._config import check_tolerance
from ._batch_runner import BatchRunner, RunResults
from ._campaign import Campaign
from ._engines import AbstractEngine, Extent, MultiHost, as_engine
from ._record import record
from ._statistics import Dispersion
from ._store import StoreWriter, columns_of
from ._stored import DamagedStore, as_dispersion

CHUNK = 8192
"""Runs in a chunk: large enough that storing them takes a percent of the time to compute them."""


def disperse(
    campaign: Campaign,
    runs: int,
    *,
    seed: int = 0,
    chunk: int = CHUNK,
    accuracy: Accuracy | Scalar | None = None,
    store: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    samples: int = 0,
    engine: str | AbstractEngine = "local",
    notes: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
    devices: int | Sequence[jax.Device] | None = None,
) -> Dispersion:
    """Run a campaign many times.

    **Arguments**

    - `campaign`: what runs, with which random inputs and outputs.
    - `runs`: how many.
    - `seed`: of the random inputs. Run number i has the same inputs and outputs, bit for bit,
      whatever `runs`, `chunk`, `engine` and `devices`, and after a restart, on one kind of
      processor and by one set of versions.
    - `chunk`: after how many runs results are fetched and stored, rounded up to whole calls of 512
      (2^14 on an accelerator). It bounds the memory.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`.
    - `store`: the path of a Zarr store, which gets every chunk as soon as it is finished. The
      columns of the result are then read from it when they are asked for.
    - `overwrite`: whether a store that is there may be replaced; it is refused otherwise.
    - `resume`: whether to complete the store that is there: only chunks that are missing or damaged
      are computed. A store of another campaign is refused, and the difference named.
    - `samples`: how many states of each phase, from its start to its end, the store keeps of every
      run besides the outputs; none by default, else at least 2.
    - `engine`: "local" (this process, with all of its cores or accelerators), "processes", "dask",
      the address of a Dask scheduler, "hosts" (the processes of `jax.distributed`), or an engine
      object.
    - `notes`: what else the attributes of the store shall say, by name.
    - `progress`: called as `progress(done, total)` after every chunk.
    - `devices`: how many of the local devices to use, or which; all of them by default.

    **Returns** a `Dispersion`. A run that fails marks its own row.

    **Raises** `InputError` for numbers that are not positive and for a tolerance that the precision
    cannot reach; `StoreError`, before anything is computed where that can be, for a store that
    refuses or cannot be written; `SimulationError` when the nominal run fails."""
    check_positive("runs", runs)
    check_positive("chunk", chunk)
    started = time.perf_counter()
    accuracy = _resolved(as_accuracy(accuracy))
    if samples and (samples < 2 or store is None):
        raise InputError(f"samples is {samples}: it must be 0, or at least 2 with a store.")
    using, local = as_engine(engine), _devices(devices)
    if isinstance(using, MultiHost) and store is None:
        raise InputError("store is missing: several hosts meet in it.")
    with contextlib.ExitStack() as stack:
        writer = None
        # Locked before the runner compiles: what can be refused is refused at once.
        if store is not None:
            writer = StoreWriter(store, overwrite=overwrite, resume=resume)
            # Of several processes that share the campaign, one holds the lock for all.
            if using.leads:
                stack.enter_context(writer)
            if writer.lock.stale:
                warnings.warn(writer.lock.stale, DamagedStore, stacklevel=2)
        runner = BatchRunner.plan(campaign, accuracy, seed, local, samples)
        # The runner has compiled and planned: what follows is the rate that a longer campaign sees.
        preparation = time.perf_counter() - started
        kept = {**record(campaign, accuracy, runs), **(notes or {}), "seed": seed}
        kept |= {"preparation_seconds": preparation, "digest": runner.planned.digest}
        kept |= {"chunk": runner.chunk(chunk), "samples": samples}
        if writer is not None:
            return _stored(writer, runner, using, kept, progress)
        chunks = dict(_flown(runner, using, _extents(runs, kept["chunk"]), runs, progress))
        # Dicts come back from a tree transformation sorted by name.
        every = jax.tree.map(
            lambda *x: np.concatenate(x, axis=-1), *(chunks[k][0] for k in sorted(chunks))
        )
        seconds = time.perf_counter() - started
        kept["cpu_seconds"] = sum(cpu for _, cpu in chunks.values())
        results = _ordered(every, campaign)
        return Dispersion(*results[:4], dict(campaign.units), seed, seconds, kept)


def _extents(runs: int, chunk: int) -> list[Extent]:
    firsts = range(0, runs, chunk)
    return [Extent(k, first, min(chunk, runs - first)) for k, first in enumerate(firsts)]


def _flown(
    runner: BatchRunner,
    engine: AbstractEngine,
    extents: list[Extent],
    total: int,
    progress: Callable[[int, int], None] | None,
) -> Iterator[tuple[int, tuple[RunResults, float]]]:
    """The results of these chunks with the processor time of each."""
    done = total - sum(extent.runs for extent in extents)
    own = {extent.chunk: extent.runs for extent in extents}
    for found in engine.compute(runner, extents):
        # What is yielded has been stored when the loop goes on, and only then is it reported:
        # what a user has seen done survives an interruption.
        yield found.chunk, (_ordered(found.results, runner.planned.campaign), found.cpu)
        done += own[found.chunk]
        if progress is not None:
            progress(done, total)


def _stored(
    writer: StoreWriter,
    runner: BatchRunner,
    engine: AbstractEngine,
    attributes: dict[str, Any],
    progress: Callable[[int, int], None] | None,
) -> Dispersion:
    """The chunks that the store lacks, written to it."""
    planned = runner.planned
    assert runner.example is not None
    example = _ordered(runner.example, planned.campaign)
    columns = columns_of(example, planned.campaign.units)
    if engine.leads:
        writer.prepare(columns, attributes)
    engine.sync("prepared")
    store = writer.store if engine.leads else writer.join(columns, attributes)
    missing, damages = writer.missing()
    # None writes before all have looked.
    engine.sync("counted")
    for damage in damages:
        warnings.warn(f"{store.path}: {damage} It is computed again.", DamagedStore, stacklevel=4)
    extents = engine.share([Extent(chunk, *store.extent(chunk)) for chunk in missing])
    last = time.perf_counter()
    storing = 0.0
    for chunk, (results, cpu) in _flown(runner, engine, extents, store.runs, progress):
        before = time.perf_counter()
        writer.commit(chunk, results, before - last, cpu)
        last = time.perf_counter()
        storing += last - before
    engine.sync("finished")
    if engine.leads:
        writer.note(storing_seconds=storing + store.attributes.get("storing_seconds", 0.0))
    return as_dispersion(store, store.finished())


def _ordered(results: RunResults, campaign: Campaign) -> RunResults:
    """The results with their names in the order of the campaign."""
    place = {name: number for number, name in enumerate(campaign.units)}
    outputs = sorted(results.outputs, key=lambda name: (place.get(name, len(place)), name))
    inputs = {name: results.inputs[name] for name in campaign.inputs}
    return results._replace(
        inputs=inputs, outputs={name: results.outputs[name] for name in outputs}
    )


def _resolved(accuracy: Accuracy) -> Accuracy:
    """The accuracy with its tolerance filled in.

    Raises `InputError` for one that the precision in use cannot reach."""
    dtype = jnp.result_type(float)
    rtol = DEFAULT_RTOL[dtype.name] if accuracy.rtol is None else accuracy.rtol
    check_tolerance(float(rtol), dtype)
    return dataclasses.replace(accuracy, rtol=rtol)


def _devices(chosen: int | Sequence[jax.Device] | None) -> list[jax.Device]:
    """The devices to use. Raises `InputError` for more than there are."""
    local = jax.local_devices()
    if chosen is None:
        return local
    if isinstance(chosen, int):
        if not 1 <= chosen <= len(local):
            raise InputError(f"devices is {chosen}: it must be from 1 to {len(local)}.")
        return local[:chosen]
    return list(chosen)

"""The verb of campaigns: many runs, stored chunk by chunk."""

import dataclasses
import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..core import InputError, Scalar, check_positive
from ..integration._accuracy import DEFAULT_RTOL, Accuracy, as_accuracy
from ..integration._config import check_tolerance
from ._batch_runner import BatchRunner, RunResults
from ._campaign import Campaign
from ._statistics import Dispersion
from ._store import Store, versions


def disperse(
    campaign: Campaign,
    runs: int,
    *,
    seed: int = 0,
    chunk: int = 2048,
    accuracy: Accuracy | Scalar | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    devices: int | Sequence[Any] | None = None,
) -> Dispersion:
    """Run a campaign many times.

    - `runs`: how many; `seed`: what the inputs are drawn from. Run number i is the same whatever
      `runs`, `chunk`, `devices`.
    - `chunk`: after how many runs results are fetched and stored, rounded up to 512 for every
      device.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`.
    - `store`: the path of a Zarr store to which every chunk is appended as soon as it is finished;
      an old one is replaced.
    - `progress(done, total)`: called after every chunk.
    - `devices`: how many of the local devices to use, or which; all of them by default.

    Returns a `Dispersion`. A run that fails marks its own row. Raises `InputError` for numbers that
    are not positive and for a tolerance beyond the precision; `SimulationError` when the nominal
    run itself cannot be flown."""
    check_positive("runs", runs)
    check_positive("chunk", chunk)
    started = time.perf_counter()
    accuracy = _resolved(as_accuracy(accuracy))
    runner = BatchRunner(campaign, accuracy, jax.random.key(seed), _devices(devices), chunk)
    file, parts = None if store is None else Store(store), []
    prepared = time.perf_counter()
    attributes = {**_record(campaign, accuracy, runs), "preparation_seconds": prepared - started}
    for first in range(0, runs, runner.chunk):
        rows = _ordered(runner.run(first, min(runner.chunk, runs - first)), campaign)
        seconds = time.perf_counter() - started
        part = Dispersion(
            *rows, units=dict(campaign.units), seed=seed, seconds=seconds, attributes=attributes
        )
        parts.append(rows)
        if file is not None:
            file.append(part)
        if progress is not None:
            progress(first + part.runs, runs)
    rows = _ordered(jax.tree.map(lambda *pieces: np.concatenate(pieces), *parts), campaign)
    return Dispersion(
        *rows,
        units=dict(campaign.units),
        seed=seed,
        seconds=time.perf_counter() - started,
        attributes=attributes,
    )


def _ordered(rows: RunResults, campaign: Campaign) -> RunResults:
    """The rows with their names in the order of the campaign: transformations have sorted them by
    the alphabet."""
    place = {name: number for number, name in enumerate(campaign.units)}
    outputs = sorted(rows.outputs, key=lambda name: (place.get(name, len(place)), name))
    inputs = {name: rows.inputs[name] for name in campaign.inputs}
    return rows._replace(inputs=inputs, outputs={name: rows.outputs[name] for name in outputs})


def _resolved(accuracy: Accuracy) -> Accuracy:
    """The accuracy with its tolerance filled in.

    Raises `InputError` for one that the precision in use cannot reach."""
    dtype = jnp.result_type(float)
    rtol = DEFAULT_RTOL[dtype.name] if accuracy.rtol is None else accuracy.rtol
    check_tolerance(float(rtol), dtype)
    return dataclasses.replace(accuracy, rtol=rtol)


def _devices(chosen: int | Sequence[Any] | None) -> list[Any]:
    local = jax.local_devices()
    if chosen is None:
        return local
    if isinstance(chosen, int):
        if not 1 <= chosen <= len(local):
            raise InputError(f"devices is {chosen}: it must be from 1 to {len(local)}.")
        return local[:chosen]
    return list(chosen)


def _record(campaign: Campaign, accuracy: Accuracy, runs: int) -> dict[str, Any]:
    return {
        "description": campaign.description,
        "inputs": campaign.text(),
        "planned_runs": runs,
        "rtol": float(accuracy.rtol),
        "atol": float(1e-3 * accuracy.rtol if accuracy.atol is None else accuracy.atol),
        "method": accuracy.method
        if isinstance(accuracy.method, str)
        else type(accuracy.method).__name__,
        "versions": versions(),
    }

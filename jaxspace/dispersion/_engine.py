"""The verb of campaigns: many runs, stored chunk by chunk."""

import dataclasses
import os
import time
from collections.abc import Callable, Sequence

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
    devices: int | Sequence[jax.Device] | None = None,
) -> Dispersion:
    """Run a campaign many times.

    **Arguments**

    - `campaign`: what runs, with which random inputs and outputs.
    - `runs`: how many.
    - `seed`: of the random inputs. Run number i draws the same inputs, bit for bit, whatever
      `runs`, `chunk` and `devices`; its outputs are the same to rounding, because another number of
      devices is another compiled program.
    - `chunk`: after how many runs results are fetched and stored, rounded up to 512 for every
      device.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`.
    - `store`: the path of a Zarr store to which every chunk is appended as soon as it is finished;
      an old one is replaced.
    - `progress`: called as `progress(done, total)` after every chunk.
    - `devices`: how many of the local devices to use, or which; all of them by default.

    **Returns** a `Dispersion`. A run that fails marks its own row.

    **Raises** `InputError` for numbers that are not positive and for a tolerance that the precision
    cannot reach; `SimulationError` when the nominal run fails."""
    check_positive("runs", runs)
    check_positive("chunk", chunk)
    started = time.perf_counter()
    accuracy = _resolved(as_accuracy(accuracy))
    runner = BatchRunner(campaign, accuracy, jax.random.key(seed), _devices(devices), chunk)
    file = None if store is None else Store(store)
    # The runner has compiled and planned: what follows is the rate that a longer campaign sees.
    preparation = time.perf_counter() - started
    attributes = {**_record(campaign, accuracy, runs), "preparation_seconds": preparation}

    def dispersion(results: RunResults) -> Dispersion:
        seconds = time.perf_counter() - started
        units = dict(campaign.units)
        return Dispersion(*results, units=units, seed=seed, seconds=seconds, attributes=attributes)

    chunks: list[RunResults] = []
    for first in range(0, runs, runner.chunk):
        count = min(runner.chunk, runs - first)
        chunks.append(_ordered(runner.run(first, count), campaign))
        # Before the progress is reported: what a user has seen done survives an interruption.
        if file is not None:
            file.append(dispersion(chunks[-1]))
        if progress is not None:
            progress(first + count, runs)
    # Dicts come back from a tree transformation sorted by name.
    every = jax.tree.map(lambda *parts: np.concatenate(parts), *chunks)
    return dispersion(_ordered(every, campaign))


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


def _record(campaign: Campaign, accuracy: Accuracy, runs: int) -> dict[str, object]:
    """What a store says of how its runs came about."""
    # Resolved values, not those given: defaults may change between versions of the library.
    method = accuracy.method
    rtol = float(np.asarray(accuracy.rtol))
    return {
        "description": campaign.description,
        "inputs": campaign.text(),
        "requirements": dict(campaign.requirements),
        "planned_runs": runs,
        "rtol": rtol,
        "atol": 1e-3 * rtol if accuracy.atol is None else float(np.asarray(accuracy.atol)),
        "method": method if isinstance(method, str) else type(method).__name__,
        "versions": versions(),
    }

"""The verb for campaigns: many runs, computed with any engine and stored in chunks."""

import contextlib
import dataclasses
import os
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..core import InputError, Scalar
from ..core.record import Record
from ..engines import AbstractEngine, MultiHost, Part
from ..engines.chunks import in_memory, stored
from ..engines.ending import check_rule
from ..engines.named import as_engine
from ..integration.accuracy import Accuracy
from ..integration.config import check_tolerance
from ..sampling import LatinHypercube
from ..simulation.legs import legs_of
from ..statistics import Dispersion
from ..statistics.spread import StopRule
from ..stores import DamagedStore
from ..stores.columns import check_array_name
from ..stores.part_writer import PartWriter
from ..stores.results import RunResults
from ..stores.store import ENOUGH, Store
from ..stores.writer import StoreWriter
from ._batch_runner import BatchRunner
from ._by_purpose import errors_at, recorded, tolerance_by_purpose
from ._campaign import RUNS, Campaign, ordered
from ._chosen_times import choose_times
from ._record import record
from ._saved_states import StatesToStore
from ._whole import check_whole
from .automatic import choose_method
from .covariance import AUTO, MONTE_CARLO, Moments, moments
from .purpose import ByPurpose, CampaignAccuracy, as_campaign_accuracy, with_tolerance

if TYPE_CHECKING:
    from distributed import Client

CHUNK = 8192
"""Runs in a chunk: large enough that storing takes one percent of the computing time."""
MEASURED = 10_000
"""Minimum number of runs for which the numerical errors at a given tolerance are measured: 512 runs
at two tolerances take a tenth of a second to two seconds of processor time."""
TIMES_KEPT = "In the phase that covers them; NaN where a run is in another phase at a time."
"""Description of `times` in the attributes of a store."""


@overload
def disperse(
    campaign: Campaign,
    runs: int = RUNS,
    *,
    method: Literal["monte_carlo"] = "monte_carlo",
    seed: int = 0,
    chunk: int = CHUNK,
    accuracy: CampaignAccuracy = None,
    store: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    samples: int = 0,
    times: Sequence[float] | None = None,
    engine: "str | AbstractEngine | Client" = "local",
    until: StopRule | None = None,
    notes: Mapping[str, object] | None = None,
    progress: Callable[[int, int], None] | None = None,
    devices: int | Sequence[jax.Device] | None = None,
) -> Dispersion:
    """All runs of a campaign."""
    ...


@overload
def disperse(
    campaign: Campaign,
    *,
    method: Literal["lincov", "second_order", "unscented"],
    accuracy: CampaignAccuracy = None,
) -> Moments:
    """Mean and covariance, from a method without runs."""
    ...


@overload
def disperse(
    campaign: Campaign,
    runs: int = RUNS,
    *,
    method: Literal["auto"],
    seed: int = 0,
    chunk: int = CHUNK,
    accuracy: CampaignAccuracy = None,
    store: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    samples: int = 0,
    times: Sequence[float] | None = None,
    engine: "str | AbstractEngine | Client" = "local",
    until: StopRule | None = None,
    notes: Mapping[str, object] | None = None,
    progress: Callable[[int, int], None] | None = None,
    devices: int | Sequence[jax.Device] | None = None,
) -> Dispersion | Moments:
    """The cheapest method that is as accurate as so many runs."""
    ...


def disperse(
    campaign: Campaign,
    runs: int = RUNS,
    *,
    method: str = MONTE_CARLO,
    seed: int = 0,
    chunk: int = CHUNK,
    accuracy: CampaignAccuracy = None,
    store: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    samples: int = 0,
    times: Sequence[float] | None = None,
    engine: "str | AbstractEngine | Client" = "local",
    until: StopRule | None = None,
    notes: Mapping[str, object] | None = None,
    progress: Callable[[int, int], None] | None = None,
    devices: int | Sequence[jax.Device] | None = None,
) -> Dispersion | Moments:
    """Run a campaign: by default many runs with random inputs.

    **Arguments**

    - `campaign`: the mission, its random inputs and its outputs.
    - `runs`: number of runs; of a campaign with a sweep (`Campaign.at`), of each row.
    - `method`: "monte_carlo"; or "lincov", "second_order" or "unscented", which compute a mean and
      a covariance without random runs (`moments`). Of the options below, these support `accuracy`
      only. Or "auto": the cheapest of "lincov", "unscented" and "monte_carlo" that is as accurate
      as `runs` runs (`choose_method`), whose reason is `Moments.reason` or the attribute
      `method_choice` of the result; the other options apply where it chooses runs.
    - `seed`: seed of the random inputs. On the same kind of processor and with the same versions,
      run number i has bit-identical inputs and outputs for any `chunk`, `engine` and `devices`, and
      also after a restart. It depends on `runs` only with a Latin hypercube, with the accuracy
      "by purpose", and through the choice between two programs, of which the slower one compiles
      faster (`rolls_stages`).
    - `chunk`: number of runs after which results are fetched and stored, rounded up to whole calls
      of 512 runs (2^14 on an accelerator). It bounds the memory.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`; by default that of the
      campaign, or 1e-9. Or "by purpose" (`ByPurpose`): the loosest tolerance for which the
      numerical error of each output is below a twentieth of its sampling error.
    - `store`: the path of a Zarr store, to which every chunk is written as soon as it is finished.
      The columns of the result are then read from it on demand.
    - `overwrite`: whether an existing store may be replaced; otherwise it is an error.
    - `resume`: whether to complete an existing store: only chunks that are missing or damaged are
      computed. With more `runs` than the store was planned for, the store is extended: its runs are
      unchanged, and the others are those of a campaign planned for `runs`. Sobol points remain
      balanced if both numbers are powers of two; a Latin hypercube cannot be extended. A store of
      another campaign is rejected, with the difference in the message.
    - `samples`: number of states that the store saves for every phase of every run, from its start
      to its end, besides the outputs; none by default, else at least 2.
    - `times`: times of the mission, s, at which the store saves the states of every run, instead of
      `samples`. The steps of the integration end at them.

      Each state belongs to the phase that covers its time; at the border of two phases, to the
      earlier one, before its jump. Once a phase ends at an event or after a random duration, the
      following phases start and end at different times in each run. That phase and all later ones
      then have a row for every one of the later times, and a run is NaN in the rows at which it is
      in another phase or has ended. A time not reached by any run of the first call causes a
      warning.

      If a controller samples a phase, times must not be in it or later, nor in or after an earlier
      phase whose end is unknown in advance.
    - `engine`: "local" (this process, with all of its cores or accelerators), "processes", "dask",
      the address of a Dask scheduler, or a `distributed.Client`, "hosts" (the processes of
      `jax.distributed`), or an engine object, such as `Part(3, 40)` for the third of 40 tasks that
      share a store.
    - `until`: rule by which the campaign stops before `runs`, after a whole chunk (`StopRule`). It
      stops after the same run with every engine, resumed or not.
    - `notes`: further attributes of the store, by name.
    - `progress`: called as `progress(done, total)` after every chunk.
    - `devices`: number of local devices to use, or a list of them; by default all.

    **Returns** a `Dispersion`, where a failed run is marked in its row; with a method other
    than "monte_carlo", the `Moments`.

    **Raises** `InputError` for numbers that are not positive integers, for an option that the
    method does not support, and for a tolerance that the precision cannot reach; `StoreError` for a
    store that exists or cannot be written, before anything is computed where possible;
    `SimulationError` if the nominal run fails."""
    if method == AUTO:
        if resume:
            raise InputError(
                "resume is True, and a store has the runs of monte_carlo: omit method, or resume."
            )
        choice = choose_method(campaign, runs, accuracy=_given(accuracy))
        if choice.moments is not None:
            return choice.moments._replace(reason=choice.reason)
        notes = {**(notes or {}), "method_choice": choice.reason}
        method = MONTE_CARLO
    if method != MONTE_CARLO:
        about_runs = (
            *(("runs", runs, RUNS), ("seed", seed, 0), ("chunk", chunk, CHUNK)),
            *(("store", store, None), ("overwrite", overwrite, False), ("resume", resume, False)),
            *(("samples", samples, 0), ("times", times, None), ("engine", engine, "local")),
            *(("until", until, None), ("notes", notes, None), ("progress", progress, None)),
            ("devices", devices, None),
        )
        _refuse(about_runs, method)
        return moments(campaign, method, accuracy=accuracy)
    check_whole("runs", runs, 1)
    check_whole("chunk", chunk, 1)
    check_whole("seed", seed)
    check_whole("samples", samples)
    started = time.perf_counter()
    runs = campaign.total_runs(runs)
    if until is not None and campaign.sweep is not None:
        raise InputError("until is given, and a sweep has no common quantile of its rows: omit it.")
    asked = as_campaign_accuracy(campaign.accuracy if accuracy is None else accuracy)
    accuracy = _resolved(campaign.accuracy_for(asked))
    kept_states = _states_to_store(campaign, samples, times, store)
    if store is not None:
        _check_stored_names(campaign, kept_states)
    using = as_engine(engine)
    local = _devices(devices)
    if isinstance(using, MultiHost | Part) and store is None:
        raise InputError("store is missing: several processes share their results through it.")
    if isinstance(using, Part):
        _check_part(until, overwrite, resume)
        chunk = using.chunk(runs, chunk)
    with contextlib.ExitStack() as stack:
        writer = None
        # Locked before the runner compiles, so that an error is raised early.
        if store is not None:
            writer = (
                PartWriter(store, using.part, using.parts)
                if isinstance(using, Part)
                else StoreWriter(store, overwrite=overwrite, resume=resume)
            )
            _enter(writer, using, stack)

        def prepare(rtol: float) -> BatchRunner:
            tolerance = dataclasses.replace(accuracy, rtol=rtol)
            return BatchRunner.prepare(campaign, tolerance, seed, local, kept_states, runs, rolled)

        there = rolled = None
        if writer is not None and resume:
            # Only the process that holds the lock has read the store by now.
            there = writer.store.attributes or Store(writer.store.path).read().attributes
            _check_extension(campaign, int(there.get("planned_runs", runs)), runs)
            rolled = bool(there.get("rolled_stages", False))
        runner, found = _prepared(prepare, asked, accuracy, runs, there)
        # After compiling and the first call: the time that follows grows with the number of runs.
        preparation = time.perf_counter() - started
        attributes = _attributes_of(runner, runs, chunk, times, until, notes or {})
        attributes |= {**found, "samples": samples, "preparation_seconds": preparation}
        if writer is not None:
            return stored(writer, runner, using, attributes, progress, until)
        return _held(runner, using, attributes, runs, progress, until, started)


def _given(accuracy: CampaignAccuracy) -> Accuracy | Scalar | None:
    """The accuracy for a method without runs, for which there is none by purpose."""
    asked = None if accuracy is None else as_campaign_accuracy(accuracy)
    return asked.accuracy if isinstance(asked, ByPurpose) else asked


def _check_part(until: StopRule | None, overwrite: bool, resume: bool) -> None:
    """Raise `InputError` for options that concern the whole of a campaign."""
    if until is not None:
        raise InputError(
            "until is given, and the campaign is computed in parts, each of which knows its own "
            "runs only: omit it."
        )
    for name, given in (("overwrite", overwrite), ("resume", resume)):
        if given:
            raise InputError(
                f"{name} is True, and the campaign is computed in parts: omit it. A part creates "
                "the store or joins the existing one of the same campaign."
            )


def _check_extension(campaign: Campaign, planned: int, runs: int) -> None:
    """Raise `InputError` for an extension that the design of the campaign does not allow."""
    if runs > planned and isinstance(campaign.design, LatinHypercube):
        raise InputError(
            f"runs is {runs}, and the store has a Latin hypercube of {planned} runs, whose layers "
            "depend on their number: start a new campaign, or use independent runs or Sobol points."
        )


def _refuse(options: Sequence[tuple[str, object, object]], method: str) -> None:
    """Raise `InputError` for one of the options about runs, (name, given, default), that is given
    with a method without runs."""
    # Rejected instead of ignored: a caller who requests a store or more runs expects them.
    for name, given, default in options:
        if given is not default and (default is None or given != default):
            raise InputError(
                f"{name} is {given!r}: omit it, because the method {method!r} computes no runs."
            )


def _enter(writer: StoreWriter, engine: AbstractEngine, stack: contextlib.ExitStack) -> None:
    """Lock the store for the lifetime of the `stack`, and warn the caller of `disperse` about a
    stale lock."""
    # If several processes share the campaign, one holds the lock for all.
    if engine.leads:
        stack.enter_context(writer)
    if writer.lock.stale:
        warnings.warn(writer.lock.stale, DamagedStore, stacklevel=3)


def _attributes_of(
    runner: BatchRunner,
    runs: int,
    chunk: int,
    times: Sequence[float] | None,
    until: StopRule | None,
    notes: Mapping[str, object],
) -> Record:
    """The record of a prepared campaign in a result; `notes` are the user's. Raises `InputError`
    for a rule about an output that the campaign does not have."""
    prepared = runner.prepared
    attributes: Record = {**record(prepared.campaign, prepared.accuracy, runs), **notes}
    attributes |= {"digest": prepared.digest, "chunk": runner.chunk(chunk), "seed": prepared.seed}
    if prepared.rolled:
        attributes["rolled_stages"] = True
    if runner.nominal is not None:
        attributes["nominal"] = runner.nominal
    if times is not None:
        attributes["times"] = [float(t) for t in times]
        attributes["times_kept"] = TIMES_KEPT
    if until is not None:
        check_rule(until, runner.example.outputs)
        attributes["until"] = dataclasses.asdict(until)
    return attributes


def _held(
    runner: BatchRunner,
    engine: AbstractEngine,
    attributes: Record,
    runs: int,
    progress: Callable[[int, int], None] | None,
    until: StopRule | None,
    started: float,
) -> Dispersion:
    """The runs of a prepared campaign in memory, without a store. `started`: when, s, by the clock
    `time.perf_counter`."""
    chunks = in_memory(runner, engine, attributes["chunk"], runs, progress, until)
    # A tree transformation sorts dicts by name.
    every = jax.tree.map(
        lambda *x: np.concatenate(x, axis=-1), *(chunks[k][0] for k in sorted(chunks))
    )
    # Fewer than planned: the rule has ended the campaign.
    if len(every.status) < runs:
        attributes[ENOUGH] = len(every.status)
    seconds = time.perf_counter() - started
    attributes["cpu_seconds"] = sum(cpu for _, cpu in chunks.values())
    campaign, seed = runner.prepared.campaign, runner.prepared.seed
    results = ordered(every, campaign)
    return Dispersion(*results[:4], dict(campaign.units), seed, seconds, attributes)


def _prepared(
    prepare: Callable[[float], BatchRunner],
    asked: Accuracy | ByPurpose,
    accuracy: Accuracy,
    runs: int,
    there: Record | None,
) -> tuple[BatchRunner, Record]:
    """The prepared campaign, with the tolerance for its purpose if requested; and the record of its
    numerical errors.

    **Arguments**

    - `prepare`: the campaign with a tolerance; `accuracy`: the one that is given, or the default.
    - `there`: the attributes of a store that is resumed, whose tolerance stays."""

    def simulated(rtol: float) -> RunResults:
        # The warnings are those of the campaign itself.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            runner = prepare(rtol)
            return runner.run(0, runner.call)

    given = float(np.asarray(accuracy.rtol))
    # A resumed store retains its tolerance, on which the digits of its runs depend.
    if there is not None:
        by_purpose = isinstance(asked, ByPurpose) and "by_purpose" in there
        return prepare(there.get("rtol", given) if by_purpose else given), {}
    if isinstance(asked, ByPurpose):
        found = tolerance_by_purpose(simulated, runs)
        return prepare(found.purpose.tolerance), found.record
    runner = prepare(given)
    if runs < MEASURED:
        return runner, {}
    return runner, recorded(errors_at(given, runner.run(0, runner.call), simulated))


def _states_to_store(
    campaign: Campaign,
    samples: int,
    times: Sequence[float] | None,
    store: str | os.PathLike[str] | None,
) -> StatesToStore:
    """The states that the store saves. Raises `InputError` without a store, or for both options."""
    if samples and (samples < 2 or store is None):
        raise InputError(f"samples is {samples}: it must be 0, or at least 2 with a store.")
    if times is None:
        return samples
    if samples or store is None:
        raise InputError("times must be given with a store, and without samples.")
    return choose_times(campaign, times)


def _check_stored_names(campaign: Campaign, kept: StatesToStore) -> None:
    """Raise `StoreError`, before anything is compiled, for an input, or a phase with saved states,
    whose name is not allowed for an array of a store."""
    names = list(campaign.inputs)
    if kept:
        # Only the names of the phases are needed, and nothing is computed.
        mission = eqx.filter_eval_shape(lambda c: c.mission(c.nominal())[0], campaign)
        names += [f"{leg.name}.time" for leg in legs_of(mission)[0]]
    for name in names:
        check_array_name(name)


def _resolved(accuracy: Accuracy) -> Accuracy:
    """The accuracy with its tolerance filled in.

    Raises `InputError` for one that the precision in use cannot reach."""
    accuracy = with_tolerance(accuracy)
    check_tolerance(float(np.asarray(accuracy.rtol)), jnp.result_type(float))
    return accuracy


def _devices(chosen: int | Sequence[jax.Device] | None) -> list[jax.Device]:
    """The devices to use. Raises `InputError` for more than there are."""
    # Only the devices of this process, because those of other hosts cannot be used from here.
    local = jax.local_devices()
    if chosen is None:
        return local
    if isinstance(chosen, int):
        if not 1 <= chosen <= len(local):
            raise InputError(f"devices is {chosen}: it must be from 1 to {len(local)}.")
        return local[:chosen]
    return list(chosen)

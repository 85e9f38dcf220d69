"""Plan, run, check, refine: many runs at fixed steps, each of them accounted for.

Pilot runs, the nominal one among them, find with adaptive steps a plan of steps for every phase,
and the errors of a trial block tell how much finer it has to be for runs that are no pilots. All
runs follow that plan in blocks side by side; the embedded error estimate tells for every run
whether it was fine enough. The runs that missed the tolerance are repeated on finer plans; those
that still miss it say so in their status.

One compiled program serves every block and every plan, whatever the number of runs: the plans are
padded to one length. A block is always the same runs, so that the numbers do not depend on how the
campaign was cut into chunks."""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Integer

from ..core import InputError, Scalar, check_positive
from ..simulation import (
    Accuracy,
    Event,
    SimulationError,
    Status,
    by_blocks,
    jit_wide_vectors,
    lanes_on,
    mesh_of,
    refined,
    run_mission,
)
from ._campaign import BatchResult, Campaign, check_names
from ._statistics import Dispersion
from ._store import Store, versions

PILOTS = 15  # besides the nominal run
CALL = 512  # runs in one call on every device at least: enough to pay for the call
TRIAL = 1.2  # how much finer than the pilots' plan the trial block runs
MARGIN = 1.5  # how far below the tolerance the trial block's errors shall come to lie
# a cautious order of the local error: errors shrink with that power of the number of steps at least
ORDER = 6.0
FINENESS = (1.0, 2.0, 4.0)  # of the plan itself, and for the runs that missed the tolerance
FINEST = 8.0  # how much finer than the pilots' plan a plan may be: what the padded length holds
# plans are padded to a multiple of this, so that another campaign of the same make finds its
# program compiled
PADDING = 1024

Plans = tuple[Array | None, ...]


class Rows(NamedTuple):
    """Runs with the runs on the first axis."""

    inputs: dict[str, Any]
    outputs: dict[str, Any]
    status: Any
    evaluations: Any


def disperse(
    campaign: Campaign,
    runs: int,
    *,
    seed: int = 0,
    chunk: int = 2048,
    accuracy: Accuracy | Scalar = 1e-9,
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
    accuracy = _reachable(accuracy if isinstance(accuracy, Accuracy) else Accuracy(rtol=accuracy))
    squad = _Squad(campaign, accuracy, jax.random.key(seed), _devices(devices), chunk)
    file, parts = None if store is None else Store(store), []
    prepared = time.perf_counter()
    attributes = {**_record(campaign, accuracy, runs), "preparation_seconds": prepared - started}
    for first in range(0, runs, squad.chunk):
        rows = _ordered(squad.run(first, min(squad.chunk, runs - first)), campaign)
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


def _ordered(rows: Rows, campaign: Campaign) -> Rows:
    """The rows with their names in the order of the campaign: transformations have sorted them by
    the alphabet."""
    place = {name: number for number, name in enumerate(campaign.units)}
    outputs = sorted(rows.outputs, key=lambda name: (place.get(name, len(place)), name))
    inputs = {name: rows.inputs[name] for name in campaign.inputs}
    return rows._replace(inputs=inputs, outputs={name: rows.outputs[name] for name in outputs})


def _reachable(accuracy: Accuracy) -> Accuracy:
    """The accuracy. Raises `InputError` where the precision in use cannot reach it."""
    precision = jnp.result_type(float)
    least = 16.0 * float(jnp.finfo(precision).eps)
    if float(accuracy.rtol) < least:
        raise InputError(
            f"accuracy is {float(accuracy.rtol):.3g}: for {precision} it must be at least {least:.2g}."
        )
    return accuracy


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


class _Squad:
    """The devices with their plans: runs numbers, a block of them on each device at a time."""

    def __init__(
        self, campaign: Campaign, accuracy: Accuracy, key: Any, devices: list[Any], chunk: int
    ):
        self.lanes = lanes_on(devices, max(chunk, CALL * len(devices)))
        self.call = max(CALL, self.lanes) * len(devices)
        self.chunk = self.call * -(-chunk // self.call)
        self.mesh = mesh_of(devices)
        self.given = (campaign, accuracy, key)
        pilots, self.coupled = _pilot_plans(*self.given)
        trial = self._call(
            np.arange(self.call, dtype=np.uint32), _padded(pilots, [TRIAL] * len(pilots))
        )[1]
        factors = [_factor(account) for account in np.asarray(trial)[:CALL].T]
        self.plans = [_padded(pilots, [level * factor for factor in factors]) for level in FINENESS]

    def run(self, first: int, count: int) -> Rows:
        """`count` runs from the number `first` on, checked and refined."""
        rows = self._rows(np.arange(first, first + self.call * -(-count // self.call)), 0)
        rows = jax.tree.map(lambda x: x[:count].copy(), rows)
        for level in range(1, len(self.plans)):
            missed = np.flatnonzero(rows.status == Status.TOLERANCE_MISSED)
            if missed.size == 0:
                break
            again = self._again(first + missed, level)
            spent = rows.evaluations[missed]
            for old, new in zip(jax.tree.leaves(rows), jax.tree.leaves(again), strict=True):
                old[missed] = new
            rows.evaluations[missed] += spent
        return rows

    def _again(self, numbers: np.ndarray, level: int) -> Rows:
        """The runs of these `numbers` on a finer plan; in their own blocks where the runs of a
        block share adaptive steps."""
        if not self.coupled:
            filled = np.concatenate([numbers, np.full(-numbers.size % self.call, numbers[-1])])
            return jax.tree.map(lambda x: x[: numbers.size], self._rows(filled, level))
        blocks = np.unique(numbers // self.lanes)
        blocks = np.concatenate(
            [blocks, np.full(-blocks.size % (self.call // self.lanes), blocks[-1])]
        )
        rows = self._rows((blocks[:, None] * self.lanes + np.arange(self.lanes)).reshape(-1), level)
        where = (
            np.searchsorted(np.unique(blocks), numbers // self.lanes) * self.lanes
            + numbers % self.lanes
        )
        return jax.tree.map(lambda x: x[where], rows)

    def _rows(self, numbers: np.ndarray, level: int) -> Rows:
        """Whole calls, all of them handed out before the first result is fetched."""
        pieces = numbers.astype(np.uint32).reshape(-1, self.call)
        rows = [self._call(piece, self.plans[level])[0] for piece in pieces]
        return jax.tree.map(lambda *x: np.concatenate([np.asarray(part) for part in x]), *rows)

    def _call(self, numbers: np.ndarray, plans: Plans) -> tuple[Rows, Array]:
        return _call(*self.given, jnp.asarray(numbers), plans, self.lanes, self.mesh)


@jit_wide_vectors
def _call(
    campaign: Campaign,
    accuracy: Accuracy,
    key: Any,
    numbers: Array,
    plans: Plans,
    lanes: int,
    mesh: Any,
) -> tuple[Rows, Array]:
    """The runs of these numbers, and the largest local error of each run in each phase in units of
    the tolerance."""

    def block(numbers: Array, given: tuple[Campaign, Accuracy, Any, Plans]) -> tuple[Rows, Array]:
        return _block(*given, numbers)

    return by_blocks(block, numbers, (campaign, accuracy, key, plans), lanes, mesh)


def _block(
    campaign: Campaign, accuracy: Accuracy, key: Any, plans: Plans, numbers: Integer[Array, " runs"]
) -> tuple[Rows, Array]:
    samples = campaign.samples(key, numbers)
    mission, y0 = campaign.build(samples)
    spans, final, end, status = run_mission(mission, y0, campaign.start, 2, accuracy, 1, plans)
    outputs = campaign.outputs(BatchResult(spans, final, end, status), samples)
    check_names("The outputs of the campaign", outputs)
    for name in set(outputs) & set(samples):
        raise InputError(
            f"The output {name!r} has the name of an input: it must have one of its own."
        )
    evaluations = sum((span.stats["evaluations"] for span in spans), jnp.array(0))
    whole = jax.tree.map(
        lambda x: jnp.broadcast_to(x, numbers.shape), (outputs, status, evaluations)
    )
    accounts = [
        jnp.broadcast_to(span.stats.get("largest_local_error", 0.0), numbers.shape)
        for span in spans
    ]
    return Rows(samples, *whole), jnp.stack(accounts, axis=1)


@eqx.filter_jit
def _pilots(campaign: Campaign, accuracy: Accuracy, key: Any) -> tuple[list[Any], Array, bool]:
    """The steps that the pilots took in every phase (none for a closed form), how they ended, the
    nominal run first, and whether a phase ends by an event: the runs of a block then share the
    adaptive steps of the search for it."""
    drawn = campaign.samples(key, jnp.arange(PILOTS, dtype=jnp.uint32))
    samples = {name: jnp.concatenate([x, drawn[name]]) for name, x in campaign.nominal().items()}
    mission, y0 = campaign.build(samples)
    spans, _, _, status = run_mission(mission, y0, campaign.start, 2, accuracy, 1, record=True)
    return (
        [span.steps for span in spans],
        status,
        any(isinstance(phase.until, Event) for phase in mission.phases),
    )


def _pilot_plans(
    campaign: Campaign, accuracy: Accuracy, key: Any
) -> tuple[list[np.ndarray | None], bool]:
    """The nodes on which the pilots landed, phase by phase, and whether the runs of a block depend
    on one another.

    Raises `SimulationError` when the nominal run cannot be flown."""
    taken, status, coupled = _pilots(campaign, accuracy, key)
    nominal = Status(int(status[0]))
    if nominal in (Status.NOT_FINITE, Status.MAX_STEPS):
        raise SimulationError(f"The nominal run cannot be flown. {nominal.sentence}")
    landed = [None if steps is None else np.asarray(steps) for steps in taken]
    return [
        None if x is None else np.concatenate([np.zeros(1, x.dtype), x[np.isfinite(x)]])
        for x in landed
    ], coupled


def _factor(account: np.ndarray) -> float:
    """How much finer than the pilots' plan the plan of a phase has to be, from the errors of the
    trial block."""
    finite = account[np.isfinite(account)]
    worst = float(np.quantile(finite, 0.99)) if finite.size else 1.0
    return float(np.clip(TRIAL * (MARGIN * worst) ** (1.0 / ORDER), 1.0, FINEST / FINENESS[-1]))


def _padded(pilots: list[np.ndarray | None], factors: list[float]) -> Plans:
    """The plans refined by `factors`, each brought to a length that holds the finest by nodes
    beyond its end, which are never reached."""
    plans: list[Array | None] = []
    for pilot, factor in zip(pilots, factors, strict=True):
        if pilot is None:
            plans.append(None)
            continue
        plan = refined(pilot, factor)
        length = PADDING * -(-len(refined(pilot, FINEST)) // PADDING)
        filled = np.concatenate([plan, plan[-1] + 1.0 + np.arange(length - len(plan))])
        plans.append(jnp.asarray(filled, pilot.dtype))
    return tuple(plans)

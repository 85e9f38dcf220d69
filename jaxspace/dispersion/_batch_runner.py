"""Plan, run, check, refine: many runs at fixed steps, each of them accounted for.

Pilot runs, the nominal one among them, find with adaptive steps a plan of steps for every phase,
and the errors of a trial call show how much finer it has to be for runs that are no pilots. All
runs follow that plan in blocks; the embedded error estimate shows for every run whether it was fine
enough. The runs that missed the tolerance are repeated on finer plans; those that still miss it say
so in their status.

One compiled program serves every call and every plan, whatever the number of runs, of chunks, of
cores and of processes: the plans are padded to one length, a call is always so many runs in blocks
of always the same runs, and cores share calls, never a call. The numbers of run i therefore depend
on the campaign, the seed and i alone, to the last bit (on one kind of processor).
"""

import functools
import hashlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Integer, PyTree

from ..core import InputError
from ..integration import Accuracy, Event, SimulationError, Status
from ..simulation._blocks import WIDE_VECTORS, Blocks
from ..simulation._failures import nan_where_failed
from ..simulation._mission_runs import MissionResult, run_mission
from ..simulation._simulate import resolve_phases
from ._along import saved_states, thinned
from ._campaign import Campaign, check_names
from ._isolation import isolate
from ._plans import FINENESS, TRIAL, Plans, nodes_of, padded, placeholders, refinement

# Besides the nominal run.
PILOTS = 15
# Runs in one call: enough to pay for the call, on a core and on an accelerator.
CALL, ACCELERATOR_CALL = 512, 2**14
# Pilots run once, and compiling takes far longer than they do: half of it is saved so.
QUICK: dict[str, Any] = {"compiler_options": {"xla_backend_optimization_level": 0}}


class RunResults(NamedTuple):
    """Inputs, outputs, status and evaluations of runs, each (runs,); and by "phase.part" the states
    of their trajectories, each (..., times, runs), where these were asked for."""

    inputs: dict[str, Any]
    outputs: dict[str, Any]
    status: Any
    evaluations: Any
    trajectories: dict[str, Any]


class PlannedCampaign(NamedTuple):
    """All that the numbers of a run depend on; it can be sent to another process.

    - `plans`: for every level of fineness.
    - `coupled`: whether the runs of a block share adaptive steps.
    - `samples`: how many states of each phase are kept; 0 for none.
    - `digest`: of the results of the trial, which tells two campaigns, versions or kinds of
      processor apart by what they compute."""

    campaign: Campaign
    accuracy: Accuracy
    seed: int
    plans: tuple[Plans, ...]
    coupled: bool
    samples: int
    digest: str


class BatchRunner:
    """Runs numbers of a planned campaign.

    **Arguments**

    - `devices`: accelerators share the calls; of CPUs the first one is used, with all its cores.
    - `in_flight`: how many calls are under way at a time; all of a chunk by default."""

    def __init__(
        self,
        planned: PlannedCampaign,
        devices: Sequence[jax.Device],
        in_flight: int | None = None,
    ):
        self.planned = planned
        self.call = call_size(devices)
        self.blocks = Blocks.on(devices[:1], self.call)
        # A second CPU device would compile the program once more, and add no core.
        self.devices = devices[:1] if devices[0].platform == "cpu" else devices
        self.in_flight = in_flight
        # A run of the trial, for names and shapes.
        self.example: RunResults | None = None
        key = jax.random.key(planned.seed)
        self.arguments = (planned.campaign, planned.accuracy, key, planned.samples)

    @classmethod
    def plan(
        cls,
        campaign: Campaign,
        accuracy: Accuracy,
        seed: int,
        devices: Sequence[jax.Device],
        samples: int = 0,
    ) -> "BatchRunner":
        """Plan a campaign by its pilots and a trial, and compile the program of all its runs.

        **Raises** `SimulationError` when the nominal run fails."""
        expected = placeholders(_expected_steps(campaign, accuracy, jax.random.key(seed)))
        planned = PlannedCampaign(campaign, accuracy, seed, (expected,), False, samples, "")
        # The program of all runs needs of the plans their lengths alone: it is compiled while the
        # pilots are.
        ahead = ThreadPoolExecutor(1)
        ahead.submit(cls(planned, devices).compile)
        try:
            pilots, coupled = _pilot_plans(campaign, accuracy, jax.random.key(seed))
            trial = padded(pilots, [TRIAL] * len(pilots))
            planned = planned._replace(plans=(trial,), coupled=coupled)
            runner = cls(planned, devices)
        finally:
            # What goes wrong there goes wrong again where it is called.
            ahead.shutdown(wait=True)
        # A whole call: all further ones reuse its program.
        results, errors = runner._call(np.arange(runner.call, dtype=np.uint32), 0)
        factors = [refinement(own) for own in np.asarray(errors)[:, :CALL]]
        plans = tuple(padded(pilots, [level * f for f in factors]) for level in FINENESS)
        runner.planned = planned._replace(plans=plans, digest=_digest(results))
        runner.example = jax.tree.map(lambda x: x[..., :1].copy(), results)
        return runner

    def chunk(self, wished: int) -> int:
        """Runs between two stores: `wished`, rounded up to whole calls."""
        return self.call * -(-wished // self.call)

    def run(self, first: int, count: int) -> RunResults:
        """`count` runs from the number `first` on, checked and refined."""
        whole = self.call * -(-count // self.call)
        results = self._results(np.arange(first, first + whole), 0)
        # A copy, because refined runs are written into it and arrays of jax are read-only.
        results = jax.tree.map(lambda x: x[..., :count].copy(), results)
        for level in range(1, len(self.planned.plans)):
            missed = np.flatnonzero(results.status == Status.TOLERANCE_MISSED)
            if missed.size == 0:
                break
            again = self._again(first + missed, level)
            spent = results.evaluations[missed]
            for old, new in zip(jax.tree.leaves(results), jax.tree.leaves(again), strict=True):
                old[..., missed] = new
            # A repeated run has cost both attempts.
            results.evaluations[missed] += spent
        return results

    def _again(self, numbers: np.ndarray, level: int) -> RunResults:
        """The runs of these `numbers` on a finer plan.

        In their own blocks where the runs of a block share adaptive steps."""
        size = self.blocks.size
        if not self.planned.coupled:
            filled = np.concatenate([numbers, np.full(-numbers.size % self.call, numbers[-1])])
            return jax.tree.map(lambda x: x[..., : numbers.size], self._results(filled, level))
        own = np.unique(numbers // size)
        filled = np.concatenate([own, np.full(-own.size % (self.call // size), own[-1])])
        results = self._results((filled[:, None] * size + np.arange(size)).reshape(-1), level)
        where = np.searchsorted(own, numbers // size) * size + numbers % size
        return jax.tree.map(lambda x: x[..., where], results)

    def _results(self, numbers: np.ndarray, level: int) -> RunResults:
        """The runs of these `numbers`, which fill whole calls."""
        calls = list(numbers.astype(np.uint32).reshape(-1, self.call))
        every = max(cores(), 2 * len(self.devices))
        width = min(len(calls), every if self.in_flight is None else self.in_flight)
        # A CPU computes the calls of one thread in turn, however many have been started.
        with ThreadPoolExecutor(width) as pool:
            results = list(pool.map(lambda k: self._call(calls[k], level, k)[0], range(len(calls))))
        return jax.tree.map(lambda *x: np.concatenate(x, axis=-1), *results)

    def compile(self) -> None:
        """Compile the program of all runs, which a call then finds compiled."""
        given = self._given(np.arange(self.call, dtype=np.uint32), 0, np.ones(self.call, bool), 0)
        self._program.lower(*given).compile()

    @property
    def _program(self) -> Callable[..., Any]:
        return _program(self.devices[0].platform)

    def _given(self, numbers: np.ndarray, level: int, flown: np.ndarray, k: int) -> tuple[Any, ...]:
        """What the program takes for call number `k`."""
        device = self.devices[k % len(self.devices)]
        numbers_k, flown_k = jax.device_put((jnp.asarray(numbers), jnp.asarray(flown)), device)
        campaign, accuracy, key, samples = self.arguments
        plans = self.planned.plans[level]
        return campaign, accuracy, key, numbers_k, flown_k, plans, self.blocks, samples

    def _call(self, numbers: np.ndarray, level: int, k: int = 0) -> tuple[RunResults, np.ndarray]:
        """The results of call number `k`; of a run that raises, its own row says so."""

        def call(flown: np.ndarray) -> PyTree:
            return jax.tree.map(np.asarray, self._program(*self._given(numbers, level, flown, k)))

        return isolate(call, self.call)


def cores() -> int:
    """How many cores this process may use."""
    # Containers and clusters often give a process fewer cores than the machine has.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def call_size(devices: Sequence[jax.Device]) -> int:
    """How many runs one call has on these devices."""
    return CALL if devices[0].platform == "cpu" else ACCELERATOR_CALL


def _digest(results: RunResults) -> str:
    hashed = hashlib.sha256()
    for name, x in (*sorted(results.inputs.items()), *sorted(results.outputs.items())):
        hashed.update(name.encode() + np.ascontiguousarray(x[:CALL]).tobytes())
    hashed.update(np.ascontiguousarray(results.status[:CALL]).tobytes())
    return hashed.hexdigest()


@functools.cache
def _program(platform: str) -> Any:
    """`_call`, compiled for the widest vectors of a CPU."""
    return eqx.filter_jit(_call, **(WIDE_VECTORS if platform == "cpu" else {}))


def _call(
    campaign: Campaign,
    accuracy: Accuracy,
    key: Array,
    numbers: Integer[Array, " runs"],
    flown: Bool[Array, " runs"],
    plans: Plans,
    blocks: Blocks,
    samples: int,
) -> tuple[RunResults, Float[Array, "phases runs"]]:
    """The runs of these numbers, and the largest local error of each phase of each run."""

    def block(
        batched: tuple[Array, Array], arguments: tuple[Campaign, Accuracy, Array, Plans]
    ) -> tuple[RunResults, Array]:
        return _block(*arguments, *batched, samples)

    return blocks.map(block, (numbers, flown), (campaign, accuracy, key, plans))


def _block(
    campaign: Campaign,
    accuracy: Accuracy,
    key: Array,
    plans: Plans,
    numbers: Integer[Array, " runs"],
    flown: Bool[Array, " runs"],
    samples: int,
) -> tuple[RunResults, Float[Array, "phases runs"]]:
    drawn = campaign.samples(key, numbers)
    allowed = campaign.allowed(drawn)
    # A refused run takes the nominal inputs: whatever it drew harms no other run of its block.
    nominal = campaign.nominal()
    inputs = {name: jnp.where(allowed & flown, x, nominal[name]) for name, x in drawn.items()}
    mission, y0 = campaign.build(inputs)
    configs = resolve_phases(mission, y0, accuracy, 1)
    saved, every_nth = saved_states(campaign.along, samples)
    result = run_mission(mission, y0, campaign.start, saved, configs, 1, plans)
    outputs = campaign.outputs(result, inputs)
    check_names("The outputs of the campaign", outputs)
    for name in set(outputs) & set(drawn):
        raise InputError(
            f"The output {name!r} has the name of an input: it must have one of its own."
        )
    status = jnp.where(flown, result.status, Status.RAISED)
    status = jnp.where(allowed, status, Status.REFUSED)
    evaluations = sum((run.stats["evaluations"] for run in result.phases), jnp.array(0))

    def every(x: Array) -> Array:
        return jnp.broadcast_to(x, numbers.shape)

    kept = trajectories(mission.phases, result, numbers.shape, every_nth) if samples else {}
    outputs, kept = nan_where_failed((jax.tree.map(every, outputs), kept), status)
    errors = [every(run.stats.get("largest_local_error", jnp.zeros(()))) for run in result.phases]
    results = RunResults(drawn, outputs, every(status), every(evaluations), kept)
    return results, jnp.stack(errors)


def trajectories(
    phases: Sequence[Any], result: MissionResult, runs: tuple[int, ...], every_nth: int = 1
) -> dict[str, Array]:
    """The times and the parts of each n-th state along every phase, by "phase.part"."""
    kept = {}
    for phase, run in zip(phases, thinned(result, every_nth).phases, strict=True):
        times = run.ts.shape[0]
        kept[f"{phase.name}.time"] = jnp.broadcast_to(run.ts, (times, *runs))
        for path, x in jax.tree_util.tree_flatten_with_path(run.states)[0]:
            part = jax.tree_util.keystr(path, simple=True, separator=".") or "state"
            kept[f"{phase.name}.{part}"] = jnp.broadcast_to(x, (*x.shape[:-1], *runs))
    return kept


# Traced once, both for the shapes of what it returns and for the run.
@eqx.filter_jit
def _traced_pilots(
    campaign: Campaign, accuracy: Accuracy, key: Array, flown: Bool[Array, " pilots"]
) -> tuple[list[Array | None], Array, bool]:
    """Adaptive runs of the pilots, the nominal one first.

    **Returns** the ends of the steps of every phase (`None` for a closed form), the status of every
    pilot, and whether a phase ends by an event."""
    drawn = campaign.samples(key, jnp.arange(PILOTS, dtype=jnp.uint32))
    nominal = campaign.nominal()
    samples = {
        name: jnp.concatenate([x, jnp.where(flown, drawn[name], x)]) for name, x in nominal.items()
    }
    mission, y0 = campaign.build(samples)
    configs = resolve_phases(mission, y0, accuracy, 1)
    result = run_mission(mission, y0, campaign.start, 2, configs, 1, record_steps=True)
    # The runs of a block share the adaptive steps of the search for an event.
    coupled = any(isinstance(phase.until, Event) for phase in mission.phases)
    return [run.step_ends for run in result.phases], result.status, coupled


@eqx.filter_jit(**QUICK)
def _pilots(
    campaign: Campaign, accuracy: Accuracy, key: Array, flown: Bool[Array, " pilots"]
) -> tuple[list[Array | None], Array, bool]:
    return _traced_pilots(campaign, accuracy, key, flown)


def _expected_steps(campaign: Campaign, accuracy: Accuracy, key: Array) -> list[Any]:
    """Of every phase the shape of what the pilots record; `None` for a closed form."""
    return eqx.filter_eval_shape(_traced_pilots, campaign, accuracy, key, jnp.ones(PILOTS, bool))[0]


def _pilot_plans(
    campaign: Campaign, accuracy: Accuracy, key: Array
) -> tuple[list[np.ndarray | None], bool]:
    """The nodes at which the steps of the pilots ended, phase by phase, and whether the runs of a
    block depend on one another.

    **Raises** `SimulationError` when the nominal run fails."""

    def fly(flown: np.ndarray) -> PyTree:
        found = _pilots(campaign, accuracy, key, jnp.asarray(flown))
        return jax.tree.map(lambda x: np.asarray(x) if eqx.is_array(x) else x, found)

    taken, status, coupled = isolate(fly, PILOTS)
    nominal = Status(int(status[0]))
    # A missed tolerance is no failure here: the runs are checked on finer plans anyhow.
    if nominal in (Status.NOT_FINITE, Status.MAX_STEPS):
        raise SimulationError(f"The nominal run cannot be run. {nominal.sentence}")
    return [None if ends is None else nodes_of(np.asarray(ends)) for ends in taken], coupled

"""Plan, run, check, refine: many runs at fixed steps, each of them accounted for.

Pilot runs, the nominal one among them, find with adaptive steps a plan of steps for every phase,
and the errors of a trial block show how much finer it has to be for runs that are no pilots. All
runs follow that plan in blocks; the embedded error estimate shows for every run whether it was fine
enough. The runs that missed the tolerance are repeated on finer plans; those that still miss it say
so in their status.

One compiled program serves every block and every plan, whatever the number of runs: the plans are
padded to one length. A block is always the same runs, so that the numbers do not depend on how the
campaign was cut into chunks.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Integer

from ..core import InputError
from ..integration import Accuracy, Event, SimulationError, Status
from ..simulation._blocks import Blocks, jit_wide_vectors
from ..simulation._failures import nan_where_failed
from ..simulation._mission_runs import run_mission
from ..simulation._simulate import resolve_phases
from ._campaign import Campaign, check_names
from ._plans import FINENESS, TRIAL, Plans, nodes_of, padded, refinement

# Besides the nominal run.
PILOTS = 15
# Runs in one call on every device at least: enough to pay for the call.
CALL = 512


class RunResults(NamedTuple):
    """Inputs, outputs, status and evaluations of runs; every array is (runs,)."""

    inputs: dict[str, Any]
    outputs: dict[str, Any]
    status: Any
    evaluations: Any


class BatchRunner:
    """A campaign with its plans: runs numbers, a block of them on each device at a time.

    **Arguments**

    - `campaign`, `accuracy`, `key`: what runs, how accurately, and the key of the draws.
    - `devices`: which share the blocks.
    - `chunk`: runs between two stores, rounded up to whole calls."""

    def __init__(
        self,
        campaign: Campaign,
        accuracy: Accuracy,
        key: Array,
        devices: Sequence[jax.Device],
        chunk: int,
    ):
        self.blocks = Blocks.on(devices, max(chunk, CALL * len(devices)))
        self.call = max(CALL, self.blocks.size) * len(devices)
        self.chunk = self.call * -(-chunk // self.call)
        self.arguments = (campaign, accuracy, key)
        pilots, self.coupled = _pilot_plans(campaign, accuracy, key)
        # The trial is a whole call, so that it compiles the program that all further calls reuse.
        first = np.arange(self.call, dtype=np.uint32)
        errors = self._call(first, padded(pilots, [TRIAL] * len(pilots)))[1]
        factors = [refinement(own) for own in np.asarray(errors)[:, :CALL]]
        self.plans = [padded(pilots, [level * f for f in factors]) for level in FINENESS]

    def run(self, first: int, count: int) -> RunResults:
        """`count` runs from the number `first` on, checked and refined."""
        whole = self.call * -(-count // self.call)
        results = self._results(np.arange(first, first + whole), 0)
        # A copy, because refined runs are written into it and arrays of jax are read-only.
        results = jax.tree.map(lambda x: x[:count].copy(), results)
        for level in range(1, len(self.plans)):
            missed = np.flatnonzero(results.status == Status.TOLERANCE_MISSED)
            if missed.size == 0:
                break
            again = self._again(first + missed, level)
            spent = results.evaluations[missed]
            for old, new in zip(jax.tree.leaves(results), jax.tree.leaves(again), strict=True):
                old[missed] = new
            # A repeated run has cost both attempts.
            results.evaluations[missed] += spent
        return results

    def _again(self, numbers: np.ndarray, level: int) -> RunResults:
        """The runs of these `numbers` on a finer plan.

        In their own blocks where the runs of a block share adaptive steps."""
        size = self.blocks.size
        if not self.coupled:
            filled = np.concatenate([numbers, np.full(-numbers.size % self.call, numbers[-1])])
            return jax.tree.map(lambda x: x[: numbers.size], self._results(filled, level))
        own = np.unique(numbers // size)
        filled = np.concatenate([own, np.full(-own.size % (self.call // size), own[-1])])
        results = self._results((filled[:, None] * size + np.arange(size)).reshape(-1), level)
        where = np.searchsorted(own, numbers // size) * size + numbers % size
        return jax.tree.map(lambda x: x[where], results)

    def _results(self, numbers: np.ndarray, level: int) -> RunResults:
        """The runs of these `numbers`, which fill whole calls."""
        calls = numbers.astype(np.uint32).reshape(-1, self.call)
        # All of them are started before the first result is fetched, so that no device waits.
        results = [self._call(own, self.plans[level])[0] for own in calls]
        return jax.tree.map(lambda *x: np.concatenate([np.asarray(part) for part in x]), *results)

    def _call(self, numbers: np.ndarray, plans: Plans) -> tuple[RunResults, Array]:
        return _call(*self.arguments, jnp.asarray(numbers), plans, self.blocks)


@jit_wide_vectors
def _call(
    campaign: Campaign,
    accuracy: Accuracy,
    key: Array,
    numbers: Integer[Array, " runs"],
    plans: Plans,
    blocks: Blocks,
) -> tuple[RunResults, Float[Array, "phases runs"]]:
    """The runs of these numbers, and the largest local error of each phase of each run."""

    def block(
        numbers: Array, arguments: tuple[Campaign, Accuracy, Array, Plans]
    ) -> tuple[RunResults, Array]:
        return _block(*arguments, numbers)

    return blocks.map(block, numbers, (campaign, accuracy, key, plans))


def _block(
    campaign: Campaign,
    accuracy: Accuracy,
    key: Array,
    plans: Plans,
    numbers: Integer[Array, " runs"],
) -> tuple[RunResults, Float[Array, "phases runs"]]:
    samples = campaign.samples(key, numbers)
    allowed = campaign.allowed(samples)
    # A refused run takes the nominal inputs: whatever it drew harms no other run of its block.
    nominal = campaign.nominal()
    inputs = {name: jnp.where(allowed, x, nominal[name]) for name, x in samples.items()}
    mission, y0 = campaign.build(inputs)
    configs = resolve_phases(mission, y0, accuracy, 1)
    result = run_mission(mission, y0, campaign.start, 2, configs, 1, plans)
    outputs = campaign.outputs(result, inputs)
    check_names("The outputs of the campaign", outputs)
    for name in set(outputs) & set(samples):
        raise InputError(
            f"The output {name!r} has the name of an input: it must have one of its own."
        )
    status = jnp.where(allowed, result.status, Status.REFUSED)
    evaluations = sum((run.stats["evaluations"] for run in result.phases), jnp.array(0))

    def every(x: Array) -> Array:
        return jnp.broadcast_to(x, numbers.shape)

    outputs = nan_where_failed(jax.tree.map(every, outputs), status)
    errors = [every(run.stats.get("largest_local_error", jnp.zeros(()))) for run in result.phases]
    return RunResults(samples, outputs, every(status), every(evaluations)), jnp.stack(errors)


@eqx.filter_jit
def _pilots(
    campaign: Campaign, accuracy: Accuracy, key: Array
) -> tuple[list[Array | None], Array, bool]:
    """Adaptive runs of the pilots, the nominal one first.

    **Returns** the ends of the steps of every phase (`None` for a closed form), the status of every
    pilot, and whether a phase ends by an event."""
    drawn = campaign.samples(key, jnp.arange(PILOTS, dtype=jnp.uint32))
    samples = {name: jnp.concatenate([x, drawn[name]]) for name, x in campaign.nominal().items()}
    mission, y0 = campaign.build(samples)
    configs = resolve_phases(mission, y0, accuracy, 1)
    result = run_mission(mission, y0, campaign.start, 2, configs, 1, record_steps=True)
    # The runs of a block share the adaptive steps of the search for an event.
    coupled = any(isinstance(phase.until, Event) for phase in mission.phases)
    return [run.step_ends for run in result.phases], result.status, coupled


def _pilot_plans(
    campaign: Campaign, accuracy: Accuracy, key: Array
) -> tuple[list[np.ndarray | None], bool]:
    """The nodes at which the steps of the pilots ended, phase by phase, and whether the runs of a
    block depend on one another.

    **Raises** `SimulationError` when the nominal run fails."""
    taken, status, coupled = _pilots(campaign, accuracy, key)
    nominal = Status(int(status[0]))
    # A missed tolerance is no failure here: the runs are checked on finer plans anyhow.
    if nominal in (Status.NOT_FINITE, Status.MAX_STEPS):
        raise SimulationError(f"The nominal run cannot be run. {nominal.sentence}")
    return [None if ends is None else nodes_of(np.asarray(ends)) for ends in taken], coupled

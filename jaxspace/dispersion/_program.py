"""The two programs of a campaign: one draws the inputs of a call, one runs its missions.

The campaign is an argument of both, so that campaigns of the same functions share the compiled
programs, whatever their numbers. Draws are a separate program because the check of the outputs
uses it, too: otherwise they would be compiled twice.
"""

import functools
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Integer

from ..core.barrier import barrier
from ..core.jit import jit_quickly, quick_jit
from ..core.status import Status
from ..integration.accuracy import Accuracy
from ..integration.programs import Runs, rolls_stages
from ..simulation.blocks import WIDE_VECTORS, Blocks
from ..simulation.failures import nan_where_failed
from ..simulation.phases import resolve_and_count
from ..simulation.trajectory import Trajectory
from ..stores.results import RunResults
from ._interface import AbstractCampaign, jit_of_campaign
from ._outputs import outputs_of
from ._runs import nominal_unless, run_inputs
from ._saved_states import StatesToStore, for_outputs, for_store, saved_of

# Runs in one call: enough to outweigh its overhead, on a core and on an accelerator.
CALL = 512
ACCELERATOR_CALL = 2**14


class Drawn(NamedTuple):
    """The inputs of some runs, each (runs,).

    - `inputs`: as drawn.
    - `used`: those of the run; the nominal ones for a run that is rejected or raises an error.
    - `status`: why a run has the nominal inputs; `COMPLETED` where it has individual ones."""

    inputs: dict[str, Array]
    used: dict[str, Array]
    status: Integer[Array, " runs"]


def drawn_by(
    campaign: AbstractCampaign,
    key: Array,
    numbers: Integer[Array, " runs"],
    used: Bool[Array, " runs"],
) -> Drawn:
    """The inputs of the runs with these `numbers`, of which those `used` raise no error."""
    inputs = campaign.samples(key, numbers)
    allowed = campaign.allowed(inputs)
    # Behind a barrier, because the compiler would compare all of them again for each input.
    taken = nominal_unless(barrier(allowed & used), campaign, inputs)
    status = jnp.where(used, jnp.int32(Status.COMPLETED), jnp.int32(Status.RAISED))
    drawn = Drawn(inputs, taken, jnp.where(allowed, status, jnp.int32(Status.REFUSED)))
    # Not weakly typed, as the arrays of these shapes are not.
    return jax.tree.map(lambda x: x.astype(x.dtype), drawn)


draw_inputs = jit_quickly(drawn_by)
"""`drawn_by`, compiled."""


def call_size(devices: Sequence[jax.Device]) -> int:
    """Number of runs in one call on these devices."""
    return CALL if devices[0].platform == "cpu" else ACCELERATOR_CALL


def runs_with_rolled_stages(
    campaign: AbstractCampaign, accuracy: Accuracy, block: int, runs: int
) -> bool:
    """Whether the stages of this many planned `runs` are rolled.

    `block`: runs in a block, whose program then finds its vector fields traced."""
    operations, noted = _operations(campaign, accuracy, block)
    for message, category in noted:
        warnings.warn(message, category, stacklevel=5)
    return rolls_stages(Runs.CAMPAIGN, operations, runs)


# A program without operations, which a later process loads instead of tracing the mission.
@functools.partial(jit_of_campaign, jit=jit_quickly)
def _operations(
    campaign: AbstractCampaign, accuracy: Accuracy, block: int
) -> tuple[int, tuple[tuple[str, type[Warning]], ...]]:
    """The number of operations of the vector fields of all phases, and the warnings about the
    mission, which are issued where the program is loaded as well."""
    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always")
        mission, y0 = campaign.mission(campaign.nominal(block))
        _, operations = resolve_and_count(mission, y0, accuracy, 1)
    return operations, tuple((str(one.message), one.category) for one in noted)


@functools.cache
def program(platform: str) -> Any:
    """`_run`, compiled for the widest vectors of a CPU."""
    return quick_jit(_run, **(WIDE_VECTORS if platform == "cpu" else {}))


def _run(
    campaign: AbstractCampaign,
    accuracy: Accuracy,
    drawn: Drawn,
    blocks: Blocks,
    samples: StatesToStore,
    rolled: bool,
) -> RunResults:
    """The runs with these inputs."""

    def block(
        batched: tuple[dict[str, Array], Array],
        arguments: tuple[AbstractCampaign, Accuracy, StatesToStore],
    ) -> RunResults:
        return _block(*arguments, *batched, rolled)

    batched = (drawn.used, drawn.status)
    results = blocks.map(block, batched, (campaign, accuracy, samples))
    return results._replace(inputs=drawn.inputs)


def _block(
    campaign: AbstractCampaign,
    accuracy: Accuracy,
    samples: StatesToStore,
    inputs: dict[str, Float[Array, " runs"]],
    not_run: Integer[Array, " runs"],
    rolled: bool,
) -> RunResults:
    saved = saved_of(campaign.num_saved, samples)
    result, _ = run_inputs(campaign, accuracy, inputs, saved, rolled=rolled, shared_program=True)
    outputs = outputs_of(campaign.outputs, for_outputs(result, samples), inputs)
    # A rejected run has been computed with the others: its status marks it.
    status = jnp.where(not_run == Status.COMPLETED, result.status, not_run)
    evaluations = sum((run.stats["evaluations"] for run in result.phases), jnp.array(0))

    def every(x: Array) -> Array:
        return jnp.broadcast_to(x, not_run.shape)

    stored = for_store(result, campaign.num_saved, samples)
    kept = trajectories(result.names, stored, not_run.shape)
    outputs, kept = nan_where_failed((outputs, kept), status)
    return RunResults({}, outputs, every(status), every(evaluations), kept)


def trajectories(
    names: Sequence[str], stored: Sequence[Trajectory | None], runs: tuple[int, ...]
) -> dict[str, Array]:
    """The stored times and parts of the states of every phase, by "phase.part"."""
    columns = {}
    # `stored` is empty if no states are saved at all.
    for name, run in zip(names, stored, strict=bool(stored)):
        if run is None:
            continue
        times = run.ts.shape[0]
        columns[f"{name}.time"] = jnp.broadcast_to(run.ts, (times, *runs))
        for path, x in jax.tree_util.tree_flatten_with_path(run.states)[0]:
            part = jax.tree_util.keystr(path, simple=True, separator=".") or "state"
            columns[f"{name}.{part}"] = jnp.broadcast_to(x, (*x.shape[:-1], *runs))
    return columns

"""The program of a campaign, which computes one call: drawn inputs, flown missions, their outputs.

The campaign is an argument of it, so that campaigns of the same functions share what has been
compiled, whatever their numbers.
"""

import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Integer

from ..core import InputError
from ..integration import Accuracy, Status
from ..simulation._blocks import WIDE_VECTORS, Blocks
from ..simulation._failures import nan_where_failed
from ..simulation._mission_runs import MissionResult, run_mission
from ..simulation._simulate import resolve_phases
from ._along import saved_states, thinned
from ._campaign import Campaign, check_names
from ._plans import Plans
from ._run_results import RunResults


@functools.cache
def program(platform: str) -> Any:
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

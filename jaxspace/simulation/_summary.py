"""What happened in a run, in five lines."""

import math

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import AbstractSystem, State
from ..integration._config import IntegrationConfig
from ..integration._status import Status


def summary_of(
    ts: Float[Array, "times *#runs"],
    states: State,
    status: Int[Array, "*runs"],
    stats: dict[str, Array],
    system: AbstractSystem,
    config: IntegrationConfig,
    run_axes: int,
) -> str:
    """What to print of a `Trajectory`, from its fields."""
    runs = 1 if run_axes == 0 else math.prod(status.shape)
    # Of the first run: others may have times of their own.
    first, last = (float(np.ravel(ts[k])[0]) for k in (0, -1))
    evaluations = int(np.max(np.asarray(stats.get("evaluations", 0))))
    steps = int(np.max(np.asarray(stats.get("steps", 0))))
    how = "closed form" if isinstance(config.method, str) else type(config.method).__name__
    if config.decoupled:
        how += " beside a closed form"
    blocks = ", ".join(
        f"{jax.tree_util.keystr(path).strip('.')} {leaf.shape}"
        for path, leaf in jax.tree_util.tree_flatten_with_path(states)[0]
    )
    lines = (
        f"Trajectory of {type(system).__name__}" + (f", {runs} runs" if runs > 1 else ""),
        f"  times   {first:g} s to {last:g} s, {ts.shape[0]} saved",
        f"  states  {blocks}",
        f"  method  {how}, rtol {float(config.rtol):.0e}; {steps} steps, {evaluations} evaluations",
        f"  status  {_ended(status)}",
    )
    return "\n".join(lines)


def _ended(status: Int[Array, "*runs"]) -> str:
    """How the run ended; of many, how many ended well, and the first that did not."""
    statuses = np.asarray(status).reshape(-1)
    failed = np.flatnonzero(statuses > Status.EVENT)
    sentence = Status(int(statuses[failed[0] if failed.size else 0])).sentence
    if statuses.size == 1:
        return sentence
    well = f"{statuses.size - failed.size} of {statuses.size} runs ended well."
    return well + (f" Run {failed[0]}: {sentence}" if failed.size else "")

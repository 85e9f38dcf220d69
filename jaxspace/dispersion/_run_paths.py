"""Some runs of a campaign in full, for pictures: where the body was, from start to end."""

import warnings
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jaxtyping import Array, Float

from ..core import Scalar
from ..core.jit import jit_quickly
from ..core.printing import printed
from ..core.safe import safe_divide
from ..core.status import Status
from ..integration.accuracy import Accuracy
from ..simulation.legs import legs_of
from ._campaign import Campaign
from ._runs import nominal_unless, run_inputs

MOST_SAVED = 2560
"""Positions of a phase: more make a page slow to load."""
VISIBLE = 0.01
"""Visible error of a line, relative to the extent of a run."""


@printed(times="s", positions="m")
class RunPaths(NamedTuple):
    """Positions along some runs; the first one is the nominal run, with the number -1.

    - `numbers`: of the runs, (runs,).
    - `times`: s, (times, runs); `positions`: m, (3, times, runs), NaN for a run that failed. Each
      branch of a mission is preceded by one time at which both are NaN, in every run."""

    numbers: np.ndarray
    times: np.ndarray
    positions: np.ndarray


def run_paths(
    campaign: Campaign,
    numbers: npt.ArrayLike,
    *,
    seed: int = 0,
    num_saved: int = 40,
    accuracy: Accuracy | Scalar | None = None,
) -> RunPaths | None:
    """The nominal run and the runs with these `numbers`, at positions for lines between them.

    `None` where the states have no position. The inputs are those of `disperse` with the same
    `seed`.

    **Arguments**

    - `campaign`: of missions.
    - `numbers`: of the runs, as in the store.
    - `seed`, `accuracy`: as of `disperse`.
    - `num_saved`: positions of each phase, at least: four times as many, and again, up to 2,560,
      while the error of the lines between them exceeds a hundredth of the extent of a run. Warns
      where that is not enough."""
    chosen = np.asarray(numbers, np.uint32)
    while True:
        result = _run(
            campaign, campaign.accuracy_for(accuracy), jax.random.key(seed), chosen, num_saved
        )
        if result is None:
            return None
        times, positions, status, off = (np.asarray(x) for x in result)
        good = np.nanmax(np.where(status <= Status.EVENT, off, np.nan), initial=0.0) <= VISIBLE
        if good or num_saved >= MOST_SAVED:
            break
        num_saved = min(4 * num_saved, MOST_SAVED)
    if not good:
        warnings.warn(
            f"The {num_saved} saved positions of a phase do not resolve the trajectories: "
            "increase num_saved, or shorten the mission.",
            stacklevel=2,
        )
    positions = np.where(status <= Status.EVENT, positions, np.nan)
    return RunPaths(np.concatenate([[-1], chosen.astype(int)]), times, positions)


# A few runs for a picture: the program takes far longer to compile than to run.
@jit_quickly
def _run(
    campaign: Campaign, accuracy: Accuracy, key: Array, numbers: Array | np.ndarray, num_saved: int
) -> tuple[Float[Array, "times runs"], Float[Array, "3 times runs"], Array, Array] | None:
    drawn = campaign.samples(key, jnp.asarray(numbers))
    nominal = campaign.nominal()
    # The nominal run is the first of the batch, so that one program is sufficient.
    samples = {name: jnp.concatenate([x, drawn[name]]) for name, x in nominal.items()}
    allowed = campaign.allowed(samples)
    samples = nominal_unless(allowed, campaign, samples)
    result, _ = run_inputs(campaign, accuracy, samples, num_saved, rolled=True)
    found = [getattr(phase.states, "position", None) for phase in result.phases]
    parts = [x for x in found if x is not None and x.shape[0] == 3]
    if len(parts) < len(found):
        return None
    # Phases of a closed form may share one time among all runs.
    runs = allowed.shape[0]
    ts = [jnp.broadcast_to(phase.ts, (phase.ts.shape[0], runs)) for phase in result.phases]
    # A branch is a line of its own: nothing is drawn from the end of the one before to its start.
    mission, _ = campaign.mission(samples)
    starts = [leg.parted for leg in legs_of(mission)[0]]
    times = jnp.concatenate(_apart(ts, starts, axis=0))
    positions = jnp.concatenate(_apart(parts, starts, axis=1), axis=1)
    status = jnp.where(allowed, result.status, Status.REFUSED)
    rates = [getattr(phase.states, "velocity", None) for phase in result.phases]
    return times, positions, status, _error_of_lines(ts, parts, rates)


def _error_of_lines(
    ts: list[Array], positions: list[Array], velocities: list[Array | None]
) -> Float[Array, " runs"]:
    """The error of lines between the positions, relative to the extent of each run: from their
    curvature, and from the velocity, which reveals a motion that returns between two times."""
    every = jnp.concatenate(positions, axis=1)
    span = jnp.max(jnp.max(every, axis=1) - jnp.min(every, axis=1), axis=0)
    error = jnp.zeros(span.shape, span.dtype)
    for t, r, v in zip(ts, positions, velocities, strict=True):
        h = jnp.diff(t, axis=0)
        bend = [jnp.abs(jnp.diff(r, 2, axis=1)) / 8.0]
        if r.shape[1] == 2:
            # Two positions show no curvature; a phase without a duration has none.
            bend = [jnp.where(h == 0.0, 0.0, jnp.inf)[None]]
        if v is not None:
            bend.append(jnp.abs(jnp.diff(r, axis=1) - 0.5 * h * (v[:, 1:] + v[:, :-1])))
        error = jnp.maximum(error, jnp.max(jnp.stack([jnp.max(x, (0, 1)) for x in bend]), axis=0))
    return safe_divide(error, span)


def _apart(parts: list[Array], starts: list[bool], axis: int) -> list[Array]:
    """The parts with a time of NaN before each that `starts` a line."""
    result = []
    for part, begins in zip(parts, starts, strict=True):
        if begins:
            result.append(jnp.full_like(jnp.take(part, jnp.array([0]), axis), jnp.nan))
        result.append(part)
    return result

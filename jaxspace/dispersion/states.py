"""Some runs of a campaign with their states, for comparisons with measurements."""

__all__ = ["run_states"]

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jaxtyping import Array

from ..core import Scalar
from ..core.jit import jit_quickly
from ..core.status import Status
from ..integration.accuracy import Accuracy
from ..simulation.mission_result import MissionTrajectory, numbers_of
from ._campaign import Campaign
from ._runs import Inputs, nominal_unless, run_inputs


def run_states(
    campaign: Campaign,
    numbers: npt.ArrayLike,
    *,
    seed: int = 0,
    num_saved: int = 200,
    accuracy: Accuracy | Scalar | None = None,
) -> tuple[MissionTrajectory, dict[str, Array]]:
    """The runs with these `numbers` as one batch, and their inputs by name, each (runs,).

    The inputs are those of `disperse` with the same `seed`. A run whose inputs are rejected has the
    status REFUSED, and the states of the nominal run.

    **Arguments**

    - `campaign`: of missions.
    - `numbers`: of the runs, as in the store.
    - `seed`, `accuracy`: as of `disperse`.
    - `num_saved`: states of each phase, evenly from its start to its end."""
    chosen = jnp.asarray(np.asarray(numbers, np.uint32))
    return _run(campaign, campaign.accuracy_for(accuracy), jax.random.key(seed), chosen, num_saved)


# A few runs: the program takes far longer to compile than to run.
@jit_quickly
def _run(
    campaign: Campaign, accuracy: Accuracy, key: Array, numbers: Array, num_saved: int
) -> tuple[MissionTrajectory, Inputs]:
    drawn = campaign.samples(key, numbers)
    allowed = campaign.allowed(drawn)
    inputs = nominal_unless(allowed, campaign, drawn)
    result, _ = run_inputs(campaign, accuracy, inputs, num_saved, rolled=True)
    status = jnp.where(allowed, result.status, Status.REFUSED)
    # Phases of a closed form may share their times among all runs.
    phases = [
        dataclasses.replace(x, ts=jnp.broadcast_to(x.ts, (x.ts.shape[0], *status.shape)))
        for x in result.phases
    ]
    return numbers_of(result.with_phases(phases, status)), inputs

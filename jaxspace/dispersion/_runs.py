"""Runs of a campaign with given inputs: the part that all programs of a campaign share."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..simulation.mission_result import MissionTrajectory
from ..simulation.mission_runs import run_mission
from ..simulation.phase_runs import SaveTimes
from ..simulation.phases import resolve_phases
from ._interface import AbstractCampaign

Inputs = dict[str, Float[Array, " runs"]]


def run_inputs(
    campaign: AbstractCampaign,
    accuracy: Accuracy,
    inputs: Inputs,
    num_saved: int | Sequence[SaveTimes],
    *,
    rolled: bool | None = None,
    shared_program: bool = False,
) -> tuple[MissionTrajectory, tuple[IntegrationConfig, ...]]:
    """The runs with these inputs, and the configuration of each phase.

    **Arguments**

    - `num_saved`, `shared_program`: as in `run_mission`; `rolled`: as in `resolve_phases`."""
    mission, y0 = campaign.mission(inputs)
    configs = resolve_phases(mission, y0, accuracy, 1, rolled=rolled)
    result = run_mission(
        mission, y0, campaign.start, num_saved, configs, 1, shared_program=shared_program
    )
    return result, configs


def nominal_unless(
    accepted: Bool[Array, " runs"], campaign: AbstractCampaign, inputs: Inputs
) -> Inputs:
    """The inputs of the runs that are `accepted`, and the nominal ones for the others, whose own
    inputs may take steps without end or raise an error."""
    nominal = campaign.nominal()
    return {name: jnp.where(accepted, x, nominal[name]) for name, x in inputs.items()}

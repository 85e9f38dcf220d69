"""The results of runs, and everything on which they depend."""

from typing import Any, NamedTuple

from ..integration.accuracy import Accuracy
from ._along import Kept
from ._campaign import Campaign
from ._plans import Plans


class RunResults(NamedTuple):
    """Inputs, outputs, status and evaluations of runs, each (runs,); and by "phase.part" the states
    of their trajectories, each (..., times, runs), if requested."""

    inputs: dict[str, Any]
    outputs: dict[str, Any]
    status: Any
    evaluations: Any
    trajectories: dict[str, Any]


class PlannedCampaign(NamedTuple):
    """Everything on which the numbers of a run depend; it can be sent to another process.

    - `plans`: one for every factor of refinement.
    - `small`: whether the steps are a small program (`is_small`).
    - `samples`: number of saved states of each phase, 0 for none; or their times.
    - `digest`: of the results of the trial, which differs between campaigns, versions or processors
      with different results."""

    campaign: Campaign
    accuracy: Accuracy
    seed: int
    plans: tuple[Plans, ...]
    small: bool
    samples: Kept
    digest: str

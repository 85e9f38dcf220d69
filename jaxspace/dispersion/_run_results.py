"""The results of runs, and all that they depend on."""

from typing import Any, NamedTuple

from ..integration.accuracy import Accuracy
from ._along import Kept
from ._campaign import Campaign
from ._plans import Plans


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
    - `samples`: how many states of each phase are kept, 0 for none; or at which times.
    - `digest`: of the results of the trial, which tells two campaigns, versions or kinds of
      processor apart by what they compute."""

    campaign: Campaign
    accuracy: Accuracy
    seed: int
    plans: tuple[Plans, ...]
    coupled: bool
    samples: Kept
    digest: str

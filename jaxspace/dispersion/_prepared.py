"""Everything on which the numbers of a run depend."""

from typing import NamedTuple

from ..integration.accuracy import Accuracy
from ._campaign import Campaign
from ._saved_states import StatesToStore


class PreparedCampaign(NamedTuple):
    """Everything on which the numbers of a run depend; it can be sent to another process.

    - `small`: whether the steps are a small program (`is_small`).
    - `samples`: number of saved states of each phase, 0 for none; or their times.
    - `digest`: of the results of the first call, which differs between campaigns, versions or
      processors with different results."""

    campaign: Campaign
    accuracy: Accuracy
    seed: int
    small: bool
    samples: StatesToStore
    digest: str

"""The call of a run, as stored in its result."""

from typing import NamedTuple

from ..core import AbstractSystem
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig


class RunCall(NamedTuple):
    """The call of a run: the system and the accuracy given by the caller, and the resulting method
    and tolerances."""

    system: AbstractSystem
    accuracy: Accuracy
    config: IntegrationConfig

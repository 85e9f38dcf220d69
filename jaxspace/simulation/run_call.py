"""What was run, as the result of a run holds it."""

from typing import NamedTuple

from ..core import AbstractSystem
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig


class RunCall(NamedTuple):
    """What was run: the system and the accuracy, as the caller gave them, and the method and the
    tolerances that follow from the accuracy."""

    system: AbstractSystem
    accuracy: Accuracy
    config: IntegrationConfig

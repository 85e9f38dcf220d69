"""Studies of a run: cost of accuracy, influence of effects, small motions, and sensitivities to its
inputs."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._accuracy_cost import accuracy_cost as accuracy_cost
from ._effect_budget import effect_budget as effect_budget
from ._mission_covariance import MissionCovariance as MissionCovariance
from ._modes import Modes as Modes
from ._modes import equilibrium as equilibrium
from ._modes import modes as modes
from ._propagate import propagate_covariance as propagate_covariance
from ._sensitivity import MissionSensitivity as MissionSensitivity
from ._sensitivity import Sensitivity as Sensitivity
from ._sensitivity import sensitivity as sensitivity
from .budget_table import EffectBudget as EffectBudget
from .cost_table import AccuracyCost as AccuracyCost

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import budget_table as budget_table
    from . import cost_table as cost_table
    from . import covariance as covariance
else:
    __getattr__, __dir__ = _modules_of(__name__)

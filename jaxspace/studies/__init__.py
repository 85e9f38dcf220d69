"""Questions about a run: what its accuracy costs, which effects matter, its small motions, and how
it changes with its inputs."""

from ._accuracy_cost import accuracy_cost as accuracy_cost
from ._budget_table import EffectBudget as EffectBudget
from ._budget_table import Influence as Influence
from ._cost_table import AccuracyCost as AccuracyCost
from ._cost_table import Cost as Cost
from ._effect_budget import effect_budget as effect_budget
from ._mission_covariance import MissionCovariance as MissionCovariance
from ._modes import Modes as Modes
from ._modes import equilibrium as equilibrium
from ._modes import modes as modes
from ._propagate import propagate_covariance as propagate_covariance
from ._sensitivity import MissionSensitivity as MissionSensitivity
from ._sensitivity import Sensitivity as Sensitivity
from ._sensitivity import initial_state as initial_state
from ._sensitivity import sensitivity as sensitivity
from .covariance import MeanCovariance as MeanCovariance
from .covariance import Uncertain as Uncertain

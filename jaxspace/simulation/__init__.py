"""Simulate one run or many, a system or a mission of phases, to a stated accuracy. No physics."""

from ..core.status import SimulationError as SimulationError
from ..core.status import Status as Status
from ..integration.accuracy import Accuracy as Accuracy
from ..integration.events import Event as Event
from ._batch import simulate_batch as simulate_batch
from ._compact import CompactRun as CompactRun
from ._compact import simulate_compact as simulate_compact
from ._crossings import crossings as crossings
from ._final_error import FinalError as FinalError
from ._gradient_error import CheckedGradient as CheckedGradient
from ._gradient_error import gradient_error as gradient_error
from ._mission import Mission as Mission
from ._mission import Phase as Phase
from ._mission_batch import simulate_mission_batch as simulate_mission_batch
from ._simulate import simulate as simulate
from ._simulate_mission import simulate_mission as simulate_mission
from .mission_result import MissionTrajectory as MissionTrajectory
from .trajectory import Trajectory as Trajectory

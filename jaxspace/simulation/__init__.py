"""The runner: simulate one run or many, a system or a mission of phases, to a stated accuracy. No physics."""

from ._accuracy import Accuracy as Accuracy
from ._accuracy import least_tolerance as least_tolerance
from ._batch import simulate_batch as simulate_batch
from ._blocks import BLOCK as BLOCK
from ._blocks import by_blocks as by_blocks
from ._blocks import compiled as compiled
from ._blocks import lanes_on as lanes_on
from ._blocks import mesh_of as mesh_of
from ._choice import chosen_method as chosen_method
from ._events import Event as Event
from ._lanes import refined as refined
from ._lanes import run_mission as run_mission
from ._mission import Mission as Mission
from ._mission import Phase as Phase
from ._simulate import check_start as check_start
from ._simulate import check_times as check_times
from ._simulate import simulate as simulate
from ._status import SimulationError as SimulationError
from ._status import Status as Status
from ._steps import steps_for as steps_for
from ._trajectory import MissionTrajectory as MissionTrajectory
from ._trajectory import Trajectory as Trajectory

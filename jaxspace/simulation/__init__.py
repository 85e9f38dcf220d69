"""The runner: simulate one run or many, a system or a mission of phases, to a stated accuracy. No
physics."""

from ..integration._accuracy import Accuracy as Accuracy
from ..integration._accuracy import least_tolerance as least_tolerance
from ..integration._events import Event as Event
from ..integration._selection import chosen_method as chosen_method
from ..integration._status import SimulationError as SimulationError
from ..integration._status import Status as Status
from ._batch import simulate_batch as simulate_batch
from ._blocks import BLOCK as BLOCK
from ._blocks import by_blocks as by_blocks
from ._blocks import jit_wide_vectors as jit_wide_vectors
from ._blocks import lanes_on as lanes_on
from ._blocks import mesh_of as mesh_of
from ._mission import Mission as Mission
from ._mission import Phase as Phase
from ._runs import refined as refined
from ._runs import run_mission as run_mission
from ._simulate import check_start as check_start
from ._simulate import check_times as check_times
from ._simulate import simulate as simulate
from ._trajectory import MissionTrajectory as MissionTrajectory
from ._trajectory import Trajectory as Trajectory

"""Closed loops: controllers that act at samples, sensors, actuators, single steps, environments."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._actuators import CommandedAcceleration as CommandedAcceleration
from ._actuators import CommandedEngine as CommandedEngine
from ._actuators import CommandedMotor as CommandedMotor
from ._actuators import CommandedTorque as CommandedTorque
from ._closed_loop import ClosedLoop as ClosedLoop
from ._controller import AbstractController as AbstractController
from ._controller import Feedback as Feedback
from ._loop_run import LoopRun as LoopRun
from ._sensors import AbstractSensor as AbstractSensor
from ._sensors import Sensor as Sensor
from ._sensors import StarTracker as StarTracker
from ._slew_task import SlewTask as SlewTask
from ._step import StepPlan as StepPlan
from ._step import plan_step as plan_step
from ._step import step as step
from .environment import AbstractEnvironment as AbstractEnvironment
from .point_tasks import LandingTask as LandingTask
from .point_tasks import RendezvousTask as RendezvousTask
from .vehicle_laws import ApogeeControl as ApogeeControl
from .vehicle_laws import FinControl as FinControl
from .vehicle_laws import LandingControl as LandingControl

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import attitude_laws as attitude_laws
    from . import commands as commands
    from . import environment as environment
    from . import point_laws as point_laws
    from . import point_tasks as point_tasks
    from . import vehicle_laws as vehicle_laws
else:
    __getattr__, __dir__ = _modules_of(__name__)

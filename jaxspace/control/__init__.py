"""Closed loops: controllers that act at samples, sensors, actuators, single steps, environments."""

from ._actuators import CommandedAcceleration as CommandedAcceleration
from ._actuators import CommandedEngine as CommandedEngine
from ._actuators import CommandedMotor as CommandedMotor
from ._actuators import CommandedTorque as CommandedTorque
from ._closed_loop import ClosedLoop as ClosedLoop
from ._commands import with_command as with_command
from ._controller import AbstractController as AbstractController
from ._controller import Feedback as Feedback
from ._fly import LoopRun as LoopRun
from ._sensors import AbstractSensor as AbstractSensor
from ._sensors import Sensor as Sensor
from ._sensors import StarTracker as StarTracker

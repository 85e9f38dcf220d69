"""Closed loops: controllers that act at samples, sensors, actuators, single steps, environments."""

from ._actuators import CommandedAcceleration as CommandedAcceleration
from ._actuators import CommandedEngine as CommandedEngine
from ._actuators import CommandedMotor as CommandedMotor
from ._actuators import CommandedTorque as CommandedTorque
from ._attitude_laws import MomentumDumping as MomentumDumping
from ._attitude_laws import NutationControl as NutationControl
from ._attitude_laws import QuaternionFeedback as QuaternionFeedback
from ._attitude_laws import SpinRateControl as SpinRateControl
from ._attitude_laws import error_vector as error_vector
from ._closed_loop import ClosedLoop as ClosedLoop
from ._commands import with_command as with_command
from ._controller import AbstractController as AbstractController
from ._controller import Feedback as Feedback
from ._fly import LoopRun as LoopRun
from ._point_laws import PID as PID
from ._point_laws import LeastEffortGuidance as LeastEffortGuidance
from ._point_laws import LinearController as LinearController
from ._point_laws import Together as Together
from ._sensors import AbstractSensor as AbstractSensor
from ._sensors import Sensor as Sensor
from ._sensors import StarTracker as StarTracker

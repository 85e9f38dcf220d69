"""Bodies whose mass changes: thrust and how it is steered, jet damping, the rocket equation, the
gravity turn."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._attitude_control import AttitudeControl as AttitudeControl
from ._back_pressure import BackPressure as BackPressure
from ._cold_gas import ColdGasThrusters as ColdGasThrusters
from ._gimballed_thrust import Gimbal as Gimbal
from ._gimballed_thrust import GimballedThrust as GimballedThrust
from ._motor import Motor as Motor
from ._motor import read_motor as read_motor
from ._pitch_kick import PitchKick as PitchKick
from ._propellant_depletion import PropellantDepletion as PropellantDepletion
from ._spinning_rocket import SpinningRocket as SpinningRocket
from ._steered_thrust import Separation as Separation
from ._steered_thrust import SteeredThrust as SteeredThrust
from ._throttle_table import ThrottleTable as ThrottleTable
from ._throttled_engine import ThrottledEngine as ThrottledEngine
from ._thrust import Thrust as Thrust
from ._thrust_profile import ThrustProfile as ThrustProfile
from .gravity_turn import GravityTurn as GravityTurn
from .gravity_turn import GravityTurnState as GravityTurnState
from .jet_damping import JetDamping as JetDamping
from .jet_damping import spin_angle as spin_angle
from .variable_mass import MassStream as MassStream

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import angle_of_attack as angle_of_attack
    from . import gravity_turn as gravity_turn
    from . import jet_damping as jet_damping
    from . import rocket_equation as rocket_equation
    from . import servo as servo
    from . import sprinkler as sprinkler
    from . import steering as steering
    from . import variable_mass as variable_mass
else:
    __getattr__, __dir__ = _modules_of(__name__)

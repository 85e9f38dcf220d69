"""Bodies whose mass changes: thrust, jet damping, the rocket equation, the gravity turn."""

from ._angle_of_attack import angle_of_attack as angle_of_attack
from ._angle_of_attack import complex_angle_of_attack as complex_angle_of_attack
from ._gravity_turn import GravityTurn as GravityTurn
from ._gravity_turn import GravityTurnState as GravityTurnState
from ._gravity_turn import gravity_turn as gravity_turn
from ._gravity_turn import gravity_turn_after as gravity_turn_after
from ._jet_damping import JetDamping as JetDamping
from ._jet_damping import jet_damping_ratio as jet_damping_ratio
from ._jet_damping import spin_angle as spin_angle
from ._jet_damping import spin_ratio as spin_ratio
from ._rocket_equation import coast_height as coast_height
from ._rocket_equation import mass_ratio_for as mass_ratio_for
from ._rocket_equation import rocket_equation as rocket_equation
from ._rocket_equation import vertical_burnout_height as vertical_burnout_height
from ._rocket_equation import vertical_burnout_velocity as vertical_burnout_velocity
from ._spinning_rocket import SpinningRocket as SpinningRocket
from ._sprinkler import sprinkler_moment as sprinkler_moment
from ._sprinkler import sprinkler_speed as sprinkler_speed
from ._thrust import Thrust as Thrust
from ._thrust_profile import ThrustProfile as ThrustProfile
from ._variable_mass import MassStream as MassStream
from ._variable_mass import jet_engine_thrust as jet_engine_thrust
from ._variable_mass import swept_motion as swept_motion
from ._variable_mass import variable_mass_acceleration as variable_mass_acceleration

"""Bodies that lose mass: thrust, jet damping, the rocket equation."""

from ._jet_damping import JetDamping as JetDamping
from ._jet_damping import jet_damping_ratio as jet_damping_ratio
from ._jet_damping import spin_angle as spin_angle
from ._jet_damping import spin_ratio as spin_ratio
from ._rocket_equation import coast_height as coast_height
from ._rocket_equation import mass_ratio_for as mass_ratio_for
from ._rocket_equation import rocket_equation as rocket_equation
from ._rocket_equation import vertical_burnout_height as vertical_burnout_height
from ._rocket_equation import vertical_burnout_velocity as vertical_burnout_velocity
from ._thrust import Thrust as Thrust
from ._thrust_profile import ThrustProfile as ThrustProfile

"""Rotation of a body of constant mass: free bodies, heavy top, rolling disk, gravity gradient,
applied torques, precession of the Earth, despin, drift, moving parts."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._control_moment_gyros import ControlMomentGyros as ControlMomentGyros
from ._rolling_disk import RollingDisk as RollingDisk
from ._shaft_pendulum import ShaftPendulum as ShaftPendulum
from ._shaft_pendulum import TiltState as TiltState
from ._spherical_pendulum import PendulumState as PendulumState
from ._spherical_pendulum import SphericalPendulum as SphericalPendulum
from ._top import Top as Top
from .applied_torques import BodyTorque as BodyTorque
from .applied_torques import DipoleField as DipoleField
from .applied_torques import MagneticDipole as MagneticDipole
from .applied_torques import SpaceTorque as SpaceTorque
from .applied_torques import SpringTorque as SpringTorque
from .applied_torques import ViscousTorque as ViscousTorque
from .despin import YoYo as YoYo
from .drift import AttitudeDrift as AttitudeDrift
from .drift import DriftState as DriftState
from .energy_sink import EnergySink as EnergySink
from .gravity_gradient import GravityGradient as GravityGradient
from .moving_masses import MovingMasses as MovingMasses
from .nutation_damper import NutationDamper as NutationDamper
from .spinning_missile import SpinningMissile as SpinningMissile
from .torque_free import TorqueFreeBody as TorqueFreeBody
from .wheels import ReactionWheels as ReactionWheels

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import applied_torques as applied_torques
    from . import despin as despin
    from . import disk_tilt as disk_tilt
    from . import drift as drift
    from . import energy_sink as energy_sink
    from . import forced_rotation as forced_rotation
    from . import gravity_gradient as gravity_gradient
    from . import initial as initial
    from . import libration as libration
    from . import motors as motors
    from . import moving_masses as moving_masses
    from . import nutation as nutation
    from . import nutation_damper as nutation_damper
    from . import outputs as outputs
    from . import pitch_libration as pitch_libration
    from . import polhode as polhode
    from . import precession_of_earth as precession_of_earth
    from . import principal_spins as principal_spins
    from . import spinning_missile as spinning_missile
    from . import swinging as swinging
    from . import top_motion as top_motion
    from . import top_relatives as top_relatives
    from . import torque_free as torque_free
    from . import unwinding as unwinding
    from . import wheels as wheels
else:
    __getattr__, __dir__ = _modules_of(__name__)

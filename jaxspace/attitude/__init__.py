"""Rotation of a body of constant mass: free bodies, heavy top, gravity gradient, despin."""

from ._despin import YoYo as YoYo
from ._despin import cord_length as cord_length
from ._despin import zero_spin_cord_length as zero_spin_cord_length
from ._gravity_gradient import GravityGradient as GravityGradient
from ._gravity_gradient import gravity_gradient_energy as gravity_gradient_energy
from ._gravity_gradient import gravity_gradient_torque as gravity_gradient_torque
from ._gravity_gradient import pitch_libration_period as pitch_libration_period
from ._initial import attitude_along as attitude_along
from ._initial import attitude_from_angles as attitude_from_angles
from ._nutation import Nutation as Nutation
from ._outputs import cone_angle as cone_angle
from ._outputs import continuous_precession as continuous_precession
from ._outputs import pointing as pointing
from ._outputs import spin_rate as spin_rate
from ._polhode import Polhode as Polhode
from ._spherical_pendulum import PendulumState as PendulumState
from ._spherical_pendulum import SphericalPendulum as SphericalPendulum
from ._top import Top as Top
from ._torque_free import TorqueFreeBody as TorqueFreeBody
from ._torque_free import body_precession_rate as body_precession_rate
from ._torque_free import cone_angles as cone_angles
from ._torque_free import coning_omega as coning_omega
from ._torque_free import precession_rate as precession_rate
from ._torque_free import symmetric_flow as symmetric_flow

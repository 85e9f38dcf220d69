"""Orientation: quaternion, Euler angles, matrix, rotation vector, their rates, interpolation and
mean; motion seen from moving frames. No mass, no force."""

from ._direction_cosines import cosine_conditions as cosine_conditions
from ._direction_cosines import cosine_rates as cosine_rates
from ._direction_cosines import omega_from_cosine_rates as omega_from_cosine_rates
from ._euler_angles import SEQUENCES as SEQUENCES
from ._euler_angles import euler_rates_from_omega as euler_rates_from_omega
from ._euler_angles import from_euler_angles as from_euler_angles
from ._euler_angles import omega_from_euler_rates as omega_from_euler_rates
from ._euler_angles import to_euler_angles as to_euler_angles
from ._interpolation import interpolate_attitude as interpolate_attitude
from ._interpolation import slerp as slerp
from ._mean import mean_attitude as mean_attitude
from ._moving_frame import MovingFrame as MovingFrame
from ._moving_frame import instantaneous_centre as instantaneous_centre
from ._moving_frame import path_components as path_components
from ._moving_frame import polar_components as polar_components
from ._plane_motion import centrodes as centrodes
from ._quaternion import Quaternion as Quaternion
from ._rotation_vector import omega_from_rotation_vector_rate as omega_from_rotation_vector_rate
from ._rotation_vector import rotation_vector_rate as rotation_vector_rate

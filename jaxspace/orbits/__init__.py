"""A point under gravity: attraction by a point and by an oblate body, orbital elements, two-body
motion in closed form, transfers from place to place."""

from ._elements import ClassicalElements as ClassicalElements
from ._elements import angular_momentum as angular_momentum
from ._elements import apoapsis_radius as apoapsis_radius
from ._elements import eccentricity_vector as eccentricity_vector
from ._elements import elements_from_state as elements_from_state
from ._elements import inclination as inclination
from ._elements import periapsis_radius as periapsis_radius
from ._elements import semi_latus_rectum as semi_latus_rectum
from ._elements import semi_major_axis as semi_major_axis
from ._elements import specific_energy as specific_energy
from ._elements import state_from_elements as state_from_elements
from ._initial import orbit_from_altitude as orbit_from_altitude
from ._initial import orbit_from_radius as orbit_from_radius
from ._kepler import kepler_flow as kepler_flow
from ._lambert import lambert as lambert
from ._lambert import least_duration as least_duration
from ._oblateness import Oblateness as Oblateness
from ._oblateness import apsidal_rate as apsidal_rate
from ._oblateness import node_regression_rate as node_regression_rate
from ._oblateness import oblateness as oblateness
from ._oblateness import oblateness_potential as oblateness_potential
from ._outputs import apoapsis as apoapsis
from ._outputs import apoapsis_altitude as apoapsis_altitude
from ._outputs import ascending_node as ascending_node
from ._outputs import descending_node as descending_node
from ._outputs import periapsis as periapsis
from ._outputs import periapsis_altitude as periapsis_altitude
from ._outputs import speed as speed
from ._outputs import speed_error as speed_error
from ._outputs import velocity_error as velocity_error
from ._point_gravity import PointGravity as PointGravity
from ._point_gravity import point_gravity as point_gravity
from ._point_gravity import point_gravity_potential as point_gravity_potential
from ._two_body import TwoBody as TwoBody

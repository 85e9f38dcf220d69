"""Motion of a point under gravity and other central forces: attraction by a point, a sphere and an
oblate body, orbital elements, two-body motion in closed form, radial motion by quadrature,
transfers."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._at_altitude import AtAltitude as AtAltitude
from ._equinoctial import EquinoctialElements as EquinoctialElements
from ._modified_equinoctial import ModifiedEquinoctialElements as ModifiedEquinoctialElements
from ._planet_rotation import PlanetRotation as PlanetRotation
from ._q_law import AtTargetOrbit as AtTargetOrbit
from ._q_law import QLaw as QLaw
from ._rotating_frame import RotatingFrame as RotatingFrame
from ._two_body import TwoBody as TwoBody
from ._velocity_to_be_gained import VelocityToBeGained as VelocityToBeGained
from .central_force import CentralPotential as CentralPotential
from .central_force import PowerLawForce as PowerLawForce
from .central_force import SphereGravity as SphereGravity
from .clohessy_wiltshire import ClohessyWiltshire as ClohessyWiltshire
from .drag import Drag as Drag
from .elements import ClassicalElements as ClassicalElements
from .impulses import Impulse as Impulse
from .interception import Interception as Interception
from .low_thrust import LowThrust as LowThrust
from .oblateness import Oblateness as Oblateness
from .paths import CircularPath as CircularPath
from .paths import KeplerPath as KeplerPath
from .paths import TabulatedPath as TabulatedPath
from .point_gravity import PointGravity as PointGravity
from .solar_pressure import SolarPressure as SolarPressure
from .spherical_harmonics import SphericalHarmonics as SphericalHarmonics
from .station import Station as Station
from .third_body import ThirdBody as ThirdBody
from .uniform_gravity import UniformGravity as UniformGravity
from .zonals import Zonals as Zonals

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import ballistic as ballistic
    from . import bielliptic as bielliptic
    from . import burnout as burnout
    from . import central_force as central_force
    from . import clohessy_wiltshire as clohessy_wiltshire
    from . import conic as conic
    from . import deviation_outputs as deviation_outputs
    from . import drag as drag
    from . import elements as elements
    from . import gravity_file as gravity_file
    from . import ground_track as ground_track
    from . import impulses as impulses
    from . import initial as initial
    from . import interception as interception
    from . import kepler as kepler
    from . import lambert as lambert
    from . import low_thrust as low_thrust
    from . import oblateness as oblateness
    from . import orbit_force as orbit_force
    from . import outputs as outputs
    from . import paths as paths
    from . import phasing as phasing
    from . import planets as planets
    from . import point_gravity as point_gravity
    from . import projectile as projectile
    from . import radial_motion as radial_motion
    from . import rotating_earth as rotating_earth
    from . import secular_rates as secular_rates
    from . import shadow as shadow
    from . import small_impulse as small_impulse
    from . import solar_pressure as solar_pressure
    from . import spherical_harmonics as spherical_harmonics
    from . import station as station
    from . import steps as steps
    from . import third_body as third_body
    from . import time_of_flight as time_of_flight
    from . import transfers as transfers
    from . import two_masses as two_masses
    from . import uniform_gravity as uniform_gravity
    from . import zonals as zonals
else:
    __getattr__, __dir__ = _modules_of(__name__)

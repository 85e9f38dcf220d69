"""Rockets in air: one vehicle, flown as a point or as a body, from its rail or its pad."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._aerodynamics import Aerodynamics as Aerodynamics
from ._air_brake import AirBrake as AirBrake
from ._dryden_gusts import DrydenGusts as DrydenGusts
from ._flexible_stage import FlexibleStage as FlexibleStage
from ._launch_site import LaunchSite as LaunchSite
from ._measured_air import MeasuredAtmosphere as MeasuredAtmosphere
from ._measured_air import MeasuredWind as MeasuredWind
from ._movable_fins import MovableFins as MovableFins
from ._rail import Rail as Rail
from ._tabulated_aerodynamics import TabulatedAerodynamics as TabulatedAerodynamics
from ._uncertain_wind import UncertainWind as UncertainWind
from ._vehicle import Vehicle as Vehicle
from .air_drag import AirDrag as AirDrag
from .air_drag import Parachute as Parachute
from .airframe import FinSet as FinSet
from .airframe import NoseCone as NoseCone
from .airframe import RadiusChange as RadiusChange
from .flights import Recovery as Recovery
from .flights import sounding_flight as sounding_flight
from .local_air import Wind as Wind

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import aerodynamic_table as aerodynamic_table
    from . import air_drag as air_drag
    from . import airframe as airframe
    from . import along_air as along_air
    from . import coefficient as coefficient
    from . import flights as flights
    from . import ground_gravity as ground_gravity
    from . import landings as landings
    from . import local_air as local_air
    from . import sounding as sounding
else:
    __getattr__, __dir__ = _modules_of(__name__)

"""Rockets in air: one vehicle, flown as a point or as a body, from its rail or its pad."""

from ._aerodynamic_table import AerodynamicTable as AerodynamicTable
from ._aerodynamic_table import read_aerodynamics as read_aerodynamics
from ._aerodynamics import Aerodynamics as Aerodynamics
from ._air_drag import AirDrag as AirDrag
from ._air_drag import Parachute as Parachute
from ._air_drag import descent_rate as descent_rate
from ._air_drag import drag_force as drag_force
from ._airframe import FinSet as FinSet
from ._airframe import NoseCone as NoseCone
from ._airframe import RadiusChange as RadiusChange
from ._airframe import prandtl_factor as prandtl_factor
from ._along_air import AlongAir as AlongAir
from ._coefficient import MachTable as MachTable
from ._flexible_stage import FlexibleStage as FlexibleStage
from ._ground_gravity import GroundGravity as GroundGravity
from ._ground_gravity import normal_gravity as normal_gravity
from ._local_air import LocalAir as LocalAir
from ._local_air import Wind as Wind
from ._rail import Rail as Rail
from ._sounding_flight import LaunchSite as LaunchSite
from ._sounding_flight import Recovery as Recovery
from ._sounding_flight import sounding_flight as sounding_flight
from ._tabulated_aerodynamics import TabulatedAerodynamics as TabulatedAerodynamics
from ._vehicle import Vehicle as Vehicle

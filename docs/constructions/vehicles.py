"""One construction of each class of `jaxspace.vehicles`, as the reference shows them."""

import numpy as np

from jaxspace.bodies import BurningBody, StandardAtmosphere
from jaxspace.mechanics import FlexibleMissile
from jaxspace.mechanics.missile_loop import MissileLoop
from jaxspace.rockets import Thrust
from jaxspace.vehicles import (
    Aerodynamics,
    AirBrake,
    AirDrag,
    DrydenGusts,
    FinSet,
    FlexibleStage,
    LaunchSite,
    MeasuredAtmosphere,
    MeasuredWind,
    MovableFins,
    NoseCone,
    Parachute,
    RadiusChange,
    Rail,
    Recovery,
    TabulatedAerodynamics,
    UncertainWind,
    Vehicle,
    Wind,
)
from jaxspace.vehicles.aerodynamic_table import AerodynamicTable
from jaxspace.vehicles.along_air import AlongAir
from jaxspace.vehicles.coefficient import MachTable
from jaxspace.vehicles.ground_gravity import GroundGravity
from jaxspace.vehicles.local_air import LocalAir

# Complete flights.
body = BurningBody(
    dry_mass=16.2,
    dry_inertia=[6.4, 6.4, 0.036],
    gyration_radii=[0.2, 0.2, 0.02],
    propellant_mass=3.0,
)
motor = Thrust.of_motor(6000.0, burn_time=3.9, propellant_mass=3.0)
Vehicle(body=body, motor=motor, area=0.0127, drag=0.45)
LaunchSite(
    rail_length=5.2,
    inclination=1.48,
    latitude=0.575,
    longitude=-1.864,
    elevation=1400.0,
)
Recovery(drag_area=1.0, lag=1.5)
Rail(direction=[0.0, 0.28, 0.96], length=5.2)
GroundGravity(gravity=9.8)

# Atmosphere and wind.
wind = Wind(heights=[0.0, 8000.0], east=[4.0, 15.0], north=[0.0, 0.0])
air = LocalAir(atmosphere=StandardAtmosphere(), wind=wind)
AlongAir(air=air)
MeasuredWind(heights=[0.0, 4000.0], east=[5.0, 9.0], north=[0.0, 0.0])
MeasuredAtmosphere(
    heights=[0.0, 1500.0, 4000.0],
    pressure=[101325.0, 84556.0, 61640.0],
    temperature=[288.15, 278.4, 262.15],
)
UncertainWind.of_seed(
    heights=[0.0, 1000.0, 3000.0],
    east=[4.0, 9.0, 15.0],
    north=[0.0, -3.0, -10.0],
    deviation=[1.0, 2.0, 3.0],
    correlation_length=1500.0,
    seed=0,
)
DrydenGusts(seed=8.0, wind_20_feet=7.0, rms_aloft=[1.0] * 12)

# Aerodynamics.
AirDrag(area=0.0127, coefficient=0.45)
drag = MachTable(mach=[0.0, 1.0, 2.0], values=[0.4, 0.6, 0.5])
nose = NoseCone.of_shape(0.0635, 1.16, 0.558, "von_karman")
fins = FinSet(
    count=4,
    span=0.1,
    root_chord=0.12,
    tip_chord=0.04,
    sweep_length=0.08,
    radius=0.0635,
    leading_edge=-1.168,
)
tail = RadiusChange(
    fore_radius=0.0635, aft_radius=0.0435, length=0.06, fore_end=-1.313
)
Aerodynamics(area=0.0127, coefficient=drag, nose=nose, fins=fins, tail=tail)
columns = {"mach": np.array([0.0, 1.0]), "axial": np.array([0.4, 0.6])}
table = AerodynamicTable.of_columns(
    columns, area=0.0127, length=0.127, station=0.0
)
TabulatedAerodynamics(table=table)
Parachute(drag_area=2.0, opening=25.0, inflation_time=3.0)

# Control surfaces.
AirBrake(area=0.01, coefficient=1.2)
MovableFins(fins=fins, azimuths=[0.0, 1.5708, 3.1416, 4.7124])

# Flexible bodies.
missile = FlexibleMissile(
    mass=2e4,
    length=20.0,
    bending_stiffness=2e8,
    engine_length=1.5,
    hinge_stiffness=0.0,
    thrust=4e5,
    actuator_stiffness=3e6,
    actuator_damping=4e4,
    modes=2,
)
loop = MissileLoop(
    missile=missile, pitch_gain=1.0, rate_gain=0.1, gyro_place=2.0
)
FlexibleStage(loop=loop, target=[0.05, 0.1, 1.0])

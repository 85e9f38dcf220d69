"""Samples of the systems and effects beside the registry of `systems.py`, which the fuzz tests
search too. Their laws have tests of their own."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from systems import MU, RADIUS, Sample, orbit, turned

from jaxspace import Scene
from jaxspace.attitude import ControlMomentGyros, GravityGradient, MovingMasses, ReactionWheels
from jaxspace.attitude.motors import PointingControl
from jaxspace.attitude.swinging import SwingingCords, SwingOutArms
from jaxspace.attitude.unwinding import StretchingCords
from jaxspace.bodies import BodyState, BurningBody, ExponentialAtmosphere, RigidBody
from jaxspace.control import CommandedAcceleration, CommandedEngine, CommandedTorque
from jaxspace.control.point_tasks import PushedRelativeMotion
from jaxspace.mechanics import (
    ArmState,
    CanonicalState,
    ElasticPendulum,
    FlexibleMissile,
    GeneralisedState,
    Hamiltonian,
)
from jaxspace.optimization import SteeredFlight, SteeringProfile
from jaxspace.optimization.ascent import ConstantMassFlow, FlightState
from jaxspace.orbits import (
    CircularPath,
    ClohessyWiltshire,
    LowThrust,
    PointGravity,
    QLaw,
    RotatingFrame,
    SolarPressure,
    ThirdBody,
    UniformGravity,
    Zonals,
)
from jaxspace.rockets import (
    AttitudeControl,
    BackPressure,
    ColdGasThrusters,
    Gimbal,
    GimballedThrust,
    MassStream,
    SteeredThrust,
    ThrottledEngine,
)
from jaxspace.rockets.steering import AlongVelocity, FixedDirection
from jaxspace.scene import Scaled
from jaxspace.scene.random_loads import RandomAcceleration, RandomTorque
from jaxspace.vehicles import (
    Aerodynamics,
    AirBrake,
    AirDrag,
    DrydenGusts,
    FinSet,
    MeasuredAtmosphere,
    MovableFins,
    NoseCone,
    Parachute,
    RadiusChange,
    Rail,
    TabulatedAerodynamics,
    UncertainWind,
    Wind,
)
from jaxspace.vehicles.aerodynamic_table import AerodynamicTable
from jaxspace.vehicles.coefficient import MachTable
from jaxspace.vehicles.ground_gravity import GroundGravity
from jaxspace.vehicles.local_air import LocalAir

MOON = CircularPath(3.844e8, 2.6617e-6, phase=0.4, inclination=0.4, node=1.1)
SUN = CircularPath(1.495978707e11, 1.991e-7, inclination=0.4091)
AIR = LocalAir(
    ExponentialAtmosphere(1.2, 0.0, 7000.0), wind=Wind([0.0, 1e4], [3.0, 8.0], [-2.0, 1.0])
)
AIRFRAME = (
    NoseCone.of_shape(0.0635, 1.160, 0.55829, "von_karman"),
    FinSet(4, 0.100, 0.120, 0.040, 0.080, 0.0635, -1.168, cant=0.01),
    RadiusChange(0.0635, 0.0435, 0.060, -1.313),
)
ROCKET = BodyState(
    jnp.array([10.0, -20.0, 800.0]),
    jnp.array([20.0, -15.0, 180.0]),
    turned(),
    jnp.array([0.3, -0.2, 0.7]),
)
# By the Mach number and the angle, in air of a sounding, with a wind of a seed and gusts.
GRID = [x.ravel() for x in np.meshgrid([0.0, 0.4, 0.9, 1.2], [0.0, 0.1, 0.4, 1.0], indexing="ij")]
COEFFICIENTS = AerodynamicTable.of_columns(
    {
        "mach": GRID[0],
        "angle": GRID[1],
        "axial": 0.4 + 0.2 * GRID[0] + 0.1 * GRID[1] ** 2,
        "axial_burning": 0.3 + 0.2 * GRID[0] + 0.1 * GRID[1] ** 2,
        "normal": (9.0 + GRID[0]) * np.sin(GRID[1]) + 4.0 * np.sin(GRID[1]) ** 2,
        "centre": 2.0 - 0.1 * GRID[0] - 0.2 * GRID[1],
        "pitch_damping": -300.0 - 10.0 * GRID[0],
    },
    **{"area": 0.0127, "length": 0.127, "station": 1.16},
)
LEVELS = np.array([0.0, 500.0, 1500.0, 4000.0])
MEASURED = LocalAir(
    MeasuredAtmosphere(LEVELS, 1e5 * np.exp(-LEVELS / 8400.0), 290.0 - 0.006 * LEVELS),
    wind=UncertainWind.of_seed(LEVELS, [3.0, 5.0, 6.0, 9.0], np.zeros(4), np.ones(4), 900.0, 7.0),
    gusts=DrydenGusts.of_severity("moderate", 3.0, top=2e3),
)
# On the rail, at rest in its direction.
RAIL = np.array([0.0, 0.28, 0.96])


def path(t):
    """Of two masses in a body."""
    first = jnp.stack([0.5 * jnp.sin(t), 0.2 * jnp.cos(t), 0.1 + 0.0 * t])
    return jnp.stack([first, jnp.stack([0.1 * t, -0.3 + 0.0 * t, jnp.cos(t)])], axis=1)


def moving_parts() -> tuple[Scene, BodyState]:
    """A satellite with wheels near their limits, gyros and moving masses, and a state of it."""
    wheels = ReactionWheels(
        [[1.0, 0.0, 0.6], [0.0, 1.0, 0.6], [0.0, 0.2, 0.5]],
        *([0.4, 0.5, 0.3], [20.0, -30.0, 48.0]),
        friction=0.01,
        torque_limit=0.5,
        speed_limit=49.0,
        motor=PointingControl([0.6, -0.3, 0.7, 0.2], 2.0, 30.0),
    )
    gyros = ControlMomentGyros(
        [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]],
        [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
        *([3.0, 2.0], [0.3, -0.4], [0.02, 0.03]),
    )
    scene = Scene(
        (wheels, gyros, MovingMasses(path, [3.0, 5.0])), RigidBody(200.0, [40.0, 50.0, 60.0])
    )
    return scene, scene.start(BodyState(attitude=turned(), omega=jnp.array([0.2, -0.1, 0.5])))


CORDS = StretchingCords(0.264, 0.127, 0.01134, 40.0)
ARM = ArmState(jnp.array([0.1, -0.2]), jnp.array([0.3, 0.2]))
ELASTIC = ElasticPendulum(1.0, 100.0, 0.8, 9.8)
MISSILE = FlexibleMissile(
    *(2e4, 20.0, 2e8, 1.5, 0.0), thrust=4e5, actuator_stiffness=3e6, actuator_damping=2e4, modes=2
)
FLIGHT = FlightState(*jnp.array([100.0, 2000.0, 300.0, 200.0]))
CARRIER = GeneralisedState(jnp.array([0.1, 0.2, 0.5, 0.7]), jnp.array([0.3, -0.1, 0.4, 0.2]))

# Surfaces and an engine on their way to a command.
SURFACES = Scene(
    (
        GroundGravity(9.79, RADIUS),
        MovableFins(
            FinSet(4, 0.05, 0.06, 0.03, 0.02, 0.0635, 0.9),
            [0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi],
            air=AIR,
            command=[0.02, -0.03, 0.05],
        ),
        AirBrake(0.01, 1.2, air=AIR, command=0.4),
    ),
    RigidBody(16.0, [8.0, 8.0, 0.04]),
)
STAGE = Scene(
    (
        ThrottledEngine(2e4, 2800.0, 1200.0, -2.5, command=[0.6, 0.02, -0.03]),
        ColdGasThrusters(40.0, 0.6, 600.0, 1200.0, command=[5.0, -8.0, 12.0]),
        UniformGravity([0.0, 0.0, -9.8]),
    ),
    BurningBody(1100.0, [520.0, 560.0, 340.0], [0.42, 0.42, 0.4], -0.6),
)
HEAVY = dataclasses.replace(ROCKET, mass=jnp.array(1700.0))

MORE = [
    Sample(
        "perturbed_orbit",
        Scene(
            (
                *(PointGravity(MU), Zonals(MU, jnp.array([1.08e-3, -2.5e-6, -1.6e-6]), RADIUS)),
                *(ThirdBody(4.9e12, MOON), LowThrust(2e-4)),
                SolarPressure(0.02, SUN, RADIUS, 6.96e8),
            )
        ),
        orbit(),
        2000.0,
    ),
    Sample(
        "steered_spiral",
        Scene((PointGravity(MU), QLaw(50.0, 9e6, MU, 0.1, 0.2, 3e4, 6.6e6)), RigidBody(1000.0)),
        orbit(mass=jnp.array(1000.0)),
        2000.0,
    ),
    Sample(
        "turning_axes",
        Scene((PointGravity(MU), RotatingFrame(jnp.array([1e-6, 2e-6, 7.29e-5])))),
        orbit(),
        2000.0,
    ),
    Sample(
        "gravity_gradient",
        Scene((PointGravity(MU), GravityGradient(MU)), RigidBody(inertia=[500.0, 600.0, 900.0])),
        orbit(attitude=turned(), omega=jnp.array([1e-4, -1e-3, 2e-4])),
        500.0,
    ),
    Sample("moving_parts", *moving_parts(), 5.0),
    Sample("stretching_cords", CORDS, CORDS.state(41.0, 1.5), 0.02),
    Sample(
        "swinging_cords",
        SwingingCords(0.264, 0.127, 0.01134, 0.9),
        SwingingCords.state(10.0, 40.0),
        0.05,
    ),
    Sample("swing_out_arms", SwingOutArms(2.0, 0.2, 0.5, 0.8), SwingOutArms.state(5.0), 0.3),
    Sample(
        "canonical_pendulum",
        Hamiltonian.of(ELASTIC),
        CanonicalState(jnp.array([0.9, 0.4]), jnp.array([0.1, 0.5])),
        2.0,
    ),
    Sample(
        "steered_stage",
        Scene(
            (
                UniformGravity([0.0, 0.0, -9.8]),
                SteeredThrust(
                    AlongVelocity(7e-5),
                    *(2.5e4, 2850.0, 60.0),
                    back_pressure=BackPressure(0.05, RADIUS),
                ),
                MassStream(-0.5, [10.0, 0.0, 5.0]),
            )
        ),
        BodyState(
            jnp.array([2e3, 1e3, RADIUS + 5e3]),
            jnp.array([80.0, 10.0, 200.0]),
            mass=jnp.array(1700.0),
        ),
        10.0,
    ),
    Sample(
        "gimballed_stage",
        Scene(
            (
                UniformGravity([0.0, 0.0, -9.8]),
                GimballedThrust(
                    Gimbal(FixedDirection([0.1, 0.2, 1.0]), 2.0, 1.5), *(2.5e4, 2850.0, 60.0, -2.0)
                ),
            ),
            BurningBody(1100.0, [520.0, 560.0, 340.0], [0.42, 0.42, 0.4], -0.6),
        ),
        orbit(attitude=turned(), omega=jnp.array([0.02, -0.1, 0.2]), mass=jnp.array(1700.0)),
        2.0,
    ),
    Sample(
        "turning_rocket",
        Scene(
            (
                GroundGravity(9.79, RADIUS),
                Aerodynamics(0.0127, MachTable([0.0, 1.0], [0.4, 0.6]), *AIRFRAME, AIR),
                AttitudeControl(FixedDirection([1.0, 0.2, 0.3]), 50.0, 4.0),
            ),
            RigidBody(16.0, [8.0, 8.0, 0.04]),
        ),
        ROCKET,
        1.0,
    ),
    Sample(
        "tabulated_rocket",
        Scene(
            (
                GroundGravity(9.79, RADIUS),
                TabulatedAerodynamics(COEFFICIENTS, MEASURED, 0.4, fins=AIRFRAME[1]),
            ),
            RigidBody(16.0, [8.0, 8.0, 0.04]),
        ),
        ROCKET,
        1.0,
    ),
    Sample(
        "random_loads",
        Scene(
            (
                GroundGravity(9.81),
                RandomAcceleration.coloured(0.1 * jnp.ones(3), 2.0, 3.0, 10.0, 0.5),
                RandomTorque.white(0.1 * jnp.ones(3), 4.0, 10.0, 0.5),
            ),
            RigidBody(16.0, [8.0, 8.0, 0.04]),
        ),
        ROCKET,
        1.0,
    ),
    Sample(
        "parachute",
        Scene(
            (GroundGravity(9.81), Parachute(2.0, -1.0, 3.0, air=AIR), AirDrag(0.02, 0.5, air=AIR)),
            RigidBody(16.0),
        ),
        BodyState(jnp.array([0.0, 0.0, 1000.0]), jnp.array([5.0, 1.0, -20.0])),
        2.0,
    ),
    Sample(
        "on_the_rail",
        Scene((GroundGravity(9.81), LowThrust(60.0), Rail(RAIL, 5.0))),
        BodyState(jnp.asarray(1.0 * RAIL), jnp.asarray(8.0 * RAIL)),
        0.2,
    ),
    Sample(
        "commanded_stage",
        Scene(
            (
                *(CommandedTorque([0.1, -0.2, 0.3]), CommandedAcceleration([0.1, 0.2, -0.1])),
                CommandedEngine(6500.0, 3050.0, 1300.0, command=[10.0, 20.0, 4000.0]),
                Scaled(UniformGravity([0.0, 0.0, -9.8]), 0.5),
            ),
            BurningBody(1100.0, [520.0, 560.0, 340.0], [0.42, 0.42, 0.4], -0.6),
        ),
        orbit(attitude=turned(), omega=jnp.array([0.02, -0.1, 0.2]), mass=jnp.array(1700.0)),
        5.0,
    ),
    Sample(
        "movable_surfaces",
        SURFACES,
        SURFACES.start(ROCKET),
        0.5,
    ),
    Sample("throttled_stage", STAGE, STAGE.start(HEAVY), 0.5),
    Sample(
        "pushed_relative_motion",
        PushedRelativeMotion(ClohessyWiltshire(1.13e-3), [1e-3, -2e-3, 5e-4]),
        BodyState(jnp.array([300.0, -2000.0, 150.0]), jnp.array([0.4, -0.2, 0.3])),
        5400.0,
    ),
    Sample(
        "steered_flight",
        SteeredFlight(
            ConstantMassFlow(3000.0, 200.0),
            SteeringProfile([0.0, 50.0, 120.0], [0.9, 0.6, 0.1]),
            9.8,
        ),
        FLIGHT,
        60.0,
    ),
]

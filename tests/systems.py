"""The registry: every system with a sample state. `test_laws.py` runs its laws over all of them; a
new system is a new line."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxspace import Scene
from jaxspace.attitude import (
    AttitudeDrift,
    BodyTorque,
    DipoleField,
    DriftState,
    EnergySink,
    MagneticDipole,
    NutationDamper,
    ReactionWheels,
    RollingDisk,
    ShaftPendulum,
    SpaceTorque,
    SphericalPendulum,
    SpringTorque,
    Top,
    TorqueFreeBody,
    ViscousTorque,
)
from jaxspace.attitude.pitch_libration import EllipticLibration, LibrationState
from jaxspace.attitude.unwinding import CordState, UnwindingCords
from jaxspace.bodies import BodyState, BurningBody, ExponentialAtmosphere, RigidBody
from jaxspace.core import AbstractSystem
from jaxspace.core.types import as_float
from jaxspace.gyros import (
    Gyrocompass,
    Gyropendulum,
    GyropendulumState,
    InertialNavigator,
    PlatformAxis,
    RateGyro,
    RateGyroState,
    StablePlatform,
    TwoGimbalGyro,
)
from jaxspace.gyros.bearing import BearingFriction, RotorMotor
from jaxspace.gyros.duffing import DuffingOscillator, DuffingState
from jaxspace.gyros.navigation_errors import NavigationErrors
from jaxspace.mechanics import (
    ArmPendulum,
    ArmState,
    BarOnSpring,
    BarOnString,
    CentrifugalPendulum,
    DoublePendulum,
    ElasticPendulum,
    FlexibleMissile,
    FramedPendulum,
    GeneralisedState,
    InclineDisk,
    LandingLegs,
    RotatingHoop,
    SimplePendulum,
    SliderCarrier,
    Trailer,
    TrailerState,
)
from jaxspace.mechanics.missile_loop import MissileLoop
from jaxspace.orbits import (
    CentralPotential,
    ClohessyWiltshire,
    Drag,
    Oblateness,
    PointGravity,
    PowerLawForce,
    SphereGravity,
    TwoBody,
    UniformGravity,
)
from jaxspace.rockets import (
    GravityTurn,
    GravityTurnState,
    JetDamping,
    Thrust,
    ThrustProfile,
)
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.vehicles import FlexibleStage

MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3


class Integrated(AbstractSystem):
    """A `system` without its closed form, so that it is integrated."""

    system: AbstractSystem

    def vector_field(self, t, y):
        return self.system.vector_field(t, y)

    def invariants(self, t, y):
        return self.system.invariants(t, y)

    def split(self):
        return self.system.split()

    def regularised(self):
        return self.system.regularised()

    def breaks(self):
        return self.system.breaks()


class Screened(eqx.Module):
    """The potential of Yukawa: a point's attraction that fades beyond `range`, m."""

    mu: Array = eqx.field(converter=as_float)
    range: Array = eqx.field(converter=as_float)

    def __call__(self, r):
        return -self.mu / r * jnp.exp(-r / self.range)


class Sample(NamedTuple):
    """A system, a state of it, and a span, s, in which it does something worth seeing; `sweep` of
    one that compiles for long."""

    name: str
    system: object
    state: object
    span: float
    sweep: bool = False


def orbit(**more) -> BodyState:
    """A low, inclined, slightly eccentric orbit."""
    return BodyState(
        position=jnp.array([6.6e6, 4.0e5, -3.0e5]),
        velocity=jnp.array([-300.0, 6900.0, 3600.0]),
        **more,
    )


def turned() -> Quaternion:
    """An attitude with no axis in a special place."""
    return from_euler_angles(jnp.array([0.3, 1.1, -0.7]))


def motor() -> Thrust:
    """A motor with every field in use."""
    profile, burn_time, mean = ThrustProfile.tabulated(
        [0.0, 1.0, 6.0, 9.0, 10.0], [0.5, 1.1, 1.2, 0.9, 0.0]
    )
    return Thrust(
        6.0e4 * mean,
        2850.0,
        burn_time,
        profile,
        point=[0.002, -0.001, -1.2],
        misalignment=[1e-3, -2e-3],
    )


def rocket_scene() -> Scene:
    """A spinning stage under gravity, oblateness, thrust and jet damping."""
    thrust = motor()
    body = BurningBody(1100.0, [520.0, 560.0, 340.0], [0.42, 0.42, 0.4], -0.6)
    gravity = (PointGravity(MU), Oblateness(MU, J2, RADIUS))
    return Scene((*gravity, thrust, JetDamping(thrust.mass_rate, -1.3, 0.1)), body)


def rocket_state() -> BodyState:
    """The stage at ignition."""
    return orbit(attitude=turned(), omega=jnp.array([0.02, -0.01, 6.0]), mass=jnp.array(1700.0))


def dual_spin() -> tuple[Scene, BodyState]:
    """A satellite with a rotor and a nutation damper, and a state of it."""
    rotor = ReactionWheels.rotor([0.1, 0.0, 1.0], 8.0, 20.0, friction=0.01)
    damper = NutationDamper(
        4.0, [0.8, 0.2, -0.1], [0.1, 0.2, 1.0], 24.5, 2.0, displacement=0.02, rate=-0.05
    )
    scene = Scene((rotor, damper), RigidBody(200.0, [40.0, 50.0, 60.0]))
    return scene, scene.start(BodyState(attitude=turned(), omega=jnp.array([0.2, -0.1, 0.5])))


def flexible_stage() -> tuple[Scene, BodyState]:
    """A flexible stage in flight, its engine swivelled."""
    stage = FlexibleStage(LOOP, [0.05, 0.1, 1.0], engine=[0.02, -0.01])
    scene = Scene((stage, PointGravity(MU)), stage.body(5e3))
    y = scene.start(orbit(attitude=turned(), omega=jnp.array([0.02, -0.01, 0.3])))
    # All parts in motion, so that each has a size to measure errors by.
    return scene, eqx.tree_at(lambda y: y.parts, y, jax.tree.map(lambda x: x + 0.05, y.parts))


SPIN = BodyState(attitude=turned(), omega=jnp.array([0.4, 0.1, 2.0]))
GYRO = TwoGimbalGyro(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)
TOP = Top(0.002, 0.0008, 0.3)
CORDS = UnwindingCords(0.264, 0.127, 0.01134)
PENDULUM = SphericalPendulum(1.2, 9.8)
AIR = Drag(50.0, ExponentialAtmosphere(1e-11, 4.0e5, 6.0e4), RADIUS, 7.29e-5)
SHAFT = ShaftPendulum(0.1, 0.02, 2.94, 7.0)
DISK = RollingDisk.uniform(1.0, 0.3, 9.8)
TENSOR = np.array([[3.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 1.5]])

RUBBING = TwoGimbalGyro(
    *(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015),
    inner_bearing=BearingFriction(0.01, 0.02, creep=0.5),
    outer_bearing=BearingFriction(0.02, 0.03, creep=0.5),
    motor=RotorMotor(1e-3, 450.0),
)
MISSILE = FlexibleMissile(2e4, 20.0, 2e8, 1.5, 3e6, 2e5, modes=2)
AXIS = PlatformAxis(0.4, 2e-4, 0.05, 0.01, gain=1.0, gyro_damping=0.01)
HOOP = RotatingHoop(1.0, 0.5, 6.0, 9.8)
PLANE = SimplePendulum(1.1, 9.8)
FRAMED = FramedPendulum(0.3, 1.0, 0.8, 9.8)
ELASTIC = ElasticPendulum(1.0, 100.0, 0.8, 9.8)
STRING = BarOnString(2.0, 0.7, 1.2, 9.8)
SPRING = BarOnSpring(2.0, 300.0, 0.5, 1.2, 9.8)
CENTRIFUGAL = CentrifugalPendulum(0.5, 0.2, 0.3, 0.1)
SLIDER = SliderCarrier(10.0, 4.0, 1.0, 30.0, 0.6)
DOUBLE = DoublePendulum(2.0, 1.0, 1.0, 0.8, 9.8)
LEGS = LandingLegs(900.0, 12.0, 2.0, 0.6, 4e3, 1.62)
INCLINE = InclineDisk(1.0, 0.3, 0.4, 9.8)
COMPASS = Gyrocompass(30.0, 0.2, 0.2, 8.5, 0.8, damping_moment=0.17, speed=8.0, course=0.3)
PLATFORM = StablePlatform(
    *([0.3, 0.4, 0.5], 0.02, 2e-3, 0.05, 4.0, 0.2),
    gyro_damping=0.05,
    sway=[0.3, 0.1, 0.05],
    outer_gain=3.0,
    fourth=True,
)
NAVIGATOR = InertialNavigator(
    *(0.8, 0.3, 1e4, 200.0, -50.0),
    heading=0.4,
    roll_amplitude=0.1,
    roll_frequency=0.05,
    altitude_rate_gain=0.02,
    altitude_gain=1e-4,
)
ERRORS = NavigationErrors(6.4e6, 9.8, [0.0, 5e-5, 5e-5], [0.0, 0.1, 9.8], altitude_rate_gain=0.01)
LOOP = MissileLoop(
    FlexibleMissile(2e4, 20.0, 2e8, 1.5, 0.0, 4e5, actuator_stiffness=3e6, modes=2),
    *(1.0, 0.1, 2.0, 1500.0, 2.5, 0.01, 4.0),
)

SAMPLES = [
    Sample("two_body", TwoBody(MU), orbit(), 5400.0),
    Sample("torque_free_principal", TorqueFreeBody([3.0, 2.0, 1.0]), SPIN, 10.0),
    Sample("torque_free_tensor", TorqueFreeBody(TENSOR), SPIN, 10.0),
    Sample("top", TOP, Top.state(jnp.array([0.2, 0.7, 0.1]), jnp.array([1.0, 0.3, 149.0])), 0.3),
    Sample("two_gimbal_gyro", GYRO, GYRO.state(1.05, 0.1, 2.0, 0.0), 0.2),
    Sample("oblate_orbit", Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS))), orbit(), 5400.0),
    Sample("spherical_pendulum", PENDULUM, PENDULUM.state(0.7, 0.2, 0.3, 1.1), 5.0),
    Sample("shaft_pendulum", SHAFT, SHAFT.state(0.4, 0.3), 5.0),
    Sample(
        "rolling_disk",
        DISK,
        DISK.state(jnp.array([0.1, 1.3, 0.2]), jnp.array([0.5, 0.2, -11.0])),
        0.5,
    ),
    Sample(
        "torqued_satellite",
        Scene(
            (
                PointGravity(MU),
                BodyTorque([0.1, -0.2, 0.3]),
                SpaceTorque([0.2, 0.1, -0.1]),
                ViscousTorque([0.3, 0.2, 0.1]),
                EnergySink(0.4),
                SpringTorque([3.0, 2.0, 1.0]),
                MagneticDipole(DipoleField([0.0, 0.0, -7.8e15]), [2e3, 1e3, -1e3]),
            ),
            RigidBody(900.0, [520.0, 560.0, 340.0]),
        ),
        orbit(attitude=turned(), omega=jnp.array([0.02, -0.1, 0.2])),
        20.0,
    ),
    Sample("dragged_orbit", Scene((PointGravity(MU), AIR)), orbit(), 5400.0),
    Sample(
        "central_forces",
        Scene(
            (
                PowerLawForce(6e17, 2.5, 6.6e6),
                SphereGravity(MU, 7.0e6),
                CentralPotential(Screened(0.1 * MU, 3.0e7)),
            )
        ),
        orbit(),
        2000.0,
    ),
    Sample(
        "free_stage",
        Scene((PointGravity(MU),), RigidBody(900.0, [520.0, 560.0, 340.0]), ("attitude",)),
        orbit(attitude=turned(), omega=jnp.array([0.02, -0.1, 2.0])),
        20.0,
    ),
    Sample(
        "clohessy_wiltshire",
        ClohessyWiltshire(1.13e-3),
        BodyState(jnp.array([300.0, -2000.0, 150.0]), jnp.array([0.4, -0.2, 0.3])),
        5400.0,
    ),
    Sample(
        "gravity_turn",
        GravityTurn(1.4, 9.8, 1.0 / 180.0, RADIUS, 8000.0),
        GravityTurnState(*(jnp.array(x) for x in (60.0, 0.1, 20.0, 300.0))),
        60.0,
    ),
    Sample("burning_stage", rocket_scene(), rocket_state(), 9.0),
    Sample("dual_spin", *dual_spin(), 8.0),
    Sample("uniform_gravity", Scene([UniformGravity([0.0, 1.0, -9.8])]), orbit(), 5.0),
    Sample("unwinding_cords", CORDS, CordState(*jnp.array([30.0, 3.0, 41.0])), 0.15),
    Sample(
        "elliptic_libration",
        EllipticLibration(1.1e-3, 0.1, 0.5),
        LibrationState(*(jnp.array(x) for x in (0.2, 1e-4, 0.3))),
        5400.0,
    ),
    Sample("double_pendulum", DOUBLE, DOUBLE.state(0.6, 0.5, 0.1, -0.3), 2.0),
    Sample("incline_disk", INCLINE, INCLINE.state(0.3, 1.1, 2.0), 2.0, sweep=True),
    Sample(
        *("rubbing_gyro", RUBBING, RUBBING.state(1.05, 0.1, 2.0, 0.3), 0.02),
        sweep=True,
    ),
    Sample(
        "duffing_oscillator",
        DuffingOscillator(1.0, 4.0, 0.1, 1.0, 1.0, 0.05),
        DuffingState(*jnp.array([0.3, -0.2])),
        5.0,
        sweep=True,
    ),
    Sample(
        "gyropendulum",
        Gyropendulum(1.0, 0.01, 0.5, 0.01, 0.2, 0.1),
        GyropendulumState(*jnp.array([0.05, -0.02, 0.1, 0.3])),
        0.5,
        sweep=True,
    ),
    Sample(
        "rate_gyro_motion",
        RateGyro(1e-4, 0.004, 0.05, spring=0.2, input_rate=0.1),
        RateGyroState(*jnp.array([0.02, 0.3])),
        0.1,
        sweep=True,
    ),
    Sample("platform_axis", AXIS, AXIS.at_rest, 0.1, sweep=True),
    Sample("simple_pendulum", PLANE, PLANE.state(1.2, 0.4), 3.0, sweep=True),
    Sample("elastic_pendulum", ELASTIC, ELASTIC.state(0.95, 0.3), 2.0, sweep=True),
    Sample("bar_on_string", STRING, STRING.state(0.3, -0.4, 0.5), 2.0, sweep=True),
    Sample("bar_on_spring", SPRING, SPRING.state(0.6, 0.3, -0.4), 2.0, sweep=True),
    Sample("centrifugal_pendulum", CENTRIFUGAL, CENTRIFUGAL.state(40.0, 0.3), 0.5, sweep=True),
    Sample("framed_pendulum", FRAMED, FRAMED.state(0.4, 0.1, 0.0, 2.0), 2.0, sweep=True),
    Sample("rotating_hoop", HOOP, HOOP.state(0.3, 0.2), 2.0, sweep=True),
    Sample(
        "slider_carrier",
        SLIDER,
        GeneralisedState(jnp.array([0.1, 0.2, 0.3, 0.7]), jnp.array([0.3, -0.1, 1.2, 0.2])),
        2.0,
        sweep=True,
    ),
    Sample(
        "arm_pendulum",
        ArmPendulum(3.0, 0.05, 2.0, 0.4),
        ArmState(*jnp.array([[0.1, -0.2], [0.3, 0.1]])),
        2.0,
        sweep=True,
    ),
    Sample("flexible_missile", MISSILE, MISSILE.state(0.03, 0.1), 0.3, sweep=True),
    Sample("landing_legs", LEGS, LEGS.touchdown(2.0), 0.7, sweep=True),
    Sample("gyrocompass", COMPASS, COMPASS.state(0.02, 0.3, 0.01, 0.02), 1.0, sweep=True),
    Sample("stable_platform", PLATFORM, PLATFORM.state(0.3, -0.2, 0.5, 0.1), 0.1, sweep=True),
    Sample(
        "inertial_navigator",
        NAVIGATOR,
        NAVIGATOR.state(*jnp.array([[100.0, 200.0, 30.0], [0.1, 0.2, 0.3], [1e-4, 2e-4, 3e-4]])),
        600.0,
        sweep=True,
    ),
    Sample(
        "navigation_errors",
        ERRORS,
        ERRORS.errors(*jnp.array([[100.0, 20.0, 3.0], [0.1, 0.2, 0.3], [1e-4, 2e-4, 3e-4]])),
        600.0,
    ),
    Sample(
        "trailer",
        Trailer(800.0, 1.0, 2.5, 0.6, 2e4, 20.0),
        TrailerState(*jnp.array([0.1, 0.05, 0.2])),
        0.5,
    ),
    Sample("missile_loop", LOOP, LOOP.state(0.02, 0.1), 0.3, sweep=True),
    Sample("flexible_stage", *flexible_stage(), 0.1, sweep=True),
    Sample("attitude_drift", AttitudeDrift(6.6e-4, 1.2, 0.05), DriftState(jnp.array(0.3)), 900.0),
]

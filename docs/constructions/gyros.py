"""One construction of each class of `jaxspace.gyros`, as the reference shows them."""

from jaxspace.gyros import (
    GimbalState,
    Gyrocompass,
    GyrocompassState,
    Gyropendulum,
    GyropendulumState,
    InertialNavigator,
    NavigatorState,
    PlatformAxis,
    PlatformState,
    RateGyro,
    RateGyroState,
    StablePlatform,
    StablePlatformState,
    TwoGimbalGyro,
)
from jaxspace.gyros.bearing import BearingFriction, RotorMotor
from jaxspace.gyros.duffing import DuffingOscillator, DuffingState
from jaxspace.gyros.navigation_errors import (
    NavigationErrors,
    NavigationErrorState,
)
from jaxspace.rotations import Quaternion

# The gyro in two gimbals.
TwoGimbalGyro(
    transverse_inertia=1e-4,
    axial_inertia=1.8e-4,
    spin_rate=2500.0,
    inner_xi=6e-5,
    inner_eta=5e-5,
    inner_zeta=6e-5,
    outer=1.2e-4,
)
GimbalState(theta=1.2, psi=0.0, theta_rate=0.5, angular_momentum=0.0)
BearingFriction(dry=0.002)
RotorMotor(gain=0.001, speed=450.0)

# Instruments.
Gyrocompass(
    spin_momentum=339.0,
    tilt_inertia=0.2,
    azimuth_inertia=0.2,
    pendulous_moment=8.5,
    latitude=0.785,
    damping_moment=0.17,
)
GyrocompassState(tilt=0.0, azimuth=0.1, tilt_rate=0.0, azimuth_rate=0.0)
Gyropendulum(
    spin_momentum=1.0,
    transverse_inertia=0.01,
    weight_moment=0.5,
    erection_rate=0.01,
)
GyropendulumState(theta=0.05, phi=-0.02, theta_rate=0.0, phi_rate=0.0)
RateGyro(
    transverse_inertia=1e-4,
    damping=0.004,
    spin_momentum=0.05,
    spring=0.2,
    input_rate=0.1,
)
RateGyroState(angle=0.02, angle_rate=0.0)
PlatformAxis(
    platform_inertia=0.4,
    gyro_inertia=2e-4,
    spin_momentum=0.05,
    gain=2.0,
    gyro_damping=0.01,
)
PlatformState(
    gyro_angle=0.0,
    platform_angle=0.01,
    gyro_rate=0.0,
    platform_rate=0.0,
    integral=0.0,
)
StablePlatform(
    platform_inertia=[0.3, 0.4, 0.5],
    gimbal_inertia=0.02,
    gyro_inertia=0.002,
    spin_momentum=0.05,
    gain=4.0,
    rate_gain=0.2,
    gyro_damping=0.05,
)
StablePlatformState(
    angles=[0.0, 0.0, 0.1],
    angle_rates=[0.0, 0.0, 0.0],
    gyro_angles=[0.0, 0.0, 0.0],
    gyro_rates=[0.0, 0.0, 0.0],
    integrals=[0.0, 0.0, 0.0],
    attitude=Quaternion.identity(),
)
DuffingOscillator(
    mass=1.0,
    stiffness=4.0,
    softening=0.1,
    force=1.0,
    frequency=1.0,
    damping=0.05,
)
DuffingState(position=0.3, velocity=-0.2)

# Inertial navigation.
InertialNavigator(
    latitude=0.8, east_speed=200.0, height=1e4, gyro_drift=[5e-8, 0.0, 5e-8]
)
NavigatorState(
    latitude=0.8,
    longitude=0.0,
    height=1e4,
    velocity=[200.0, 0.0, 0.0],
    attitude=Quaternion.identity(),
)
NavigationErrors(
    radius=6.4e6,
    gravity=9.8,
    rate=[0.0, 5e-5, 5e-5],
    specific_force=[0.0, 0.1, 9.8],
)
NavigationErrorState(
    position=[0.0, 0.0, 0.0], velocity=[0.1, 0.0, 0.0], tilt=[0.0, 0.0, 1e-3]
)

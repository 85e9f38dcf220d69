"""One construction of each class of `jaxspace.rockets`, as the reference shows them."""

from jaxspace.rockets import (
    AttitudeControl,
    BackPressure,
    ColdGasThrusters,
    Gimbal,
    GimballedThrust,
    GravityTurn,
    GravityTurnState,
    JetDamping,
    MassStream,
    PitchKick,
    PropellantDepletion,
    Separation,
    SpinningRocket,
    SteeredThrust,
    ThrottledEngine,
    ThrottleTable,
    Thrust,
    ThrustProfile,
)
from jaxspace.rockets.steering import (
    AlongVelocity,
    FixedDirection,
    FlightPlane,
    PitchPolynomial,
    PitchTable,
    TangentSteering,
    UserSteering,
)

# Motors and engines.
thrust = Thrust(mean_thrust=1800.0, exhaust_velocity=2340.0, burn_time=3.9)
ThrustProfile.of_table([0.0, 1.0, 4.0], [1.0, 2.0, 0.0])
ThrottleTable(times=[0.0, 40.0, 60.0], throttles=[1.0, 0.7, 1.0])
BackPressure(
    exit_area=0.5,
    radius=6378137.0,
    surface_pressure=101325.0,
    scale_height=7000.0,
)
ThrottledEngine(
    full_thrust=2e4,
    exhaust_velocity=2800.0,
    burnout_mass=1200.0,
    station=-2.5,
)
ColdGasThrusters(
    torque_limit=40.0, lever=0.6, exhaust_velocity=600.0, empty_mass=1200.0
)
JetDamping(mass_rate=thrust.mass_rate, exit_station=-1.0, exit_radius=0.1)
MassStream(rate=-0.5, stream_velocity=[10.0, 0.0, 5.0])
PropellantDepletion(propellant_left=thrust.propellant_left)
Separation(dropped=100.0)

# Steering.
FixedDirection(along=[0.1, 0.2, 1.0])
AlongVelocity(air_rate=7.292e-5)
plane = FlightPlane(normal=[0.0, 0.0, 1.0])
PitchPolynomial(coefficients=[1.57, -0.012], plane=plane)
pitch = PitchTable(times=[0.0, 10.0, 60.0], angles=[1.57, 1.5, 0.8])
TangentSteering(tangent=0.6, tangent_rate=-0.002)
UserSteering(lambda t, y: y.velocity)
SteeredThrust(
    steering=pitch, mean_thrust=3e4, exhaust_velocity=3000.0, burn_time=100.0
)
gimbal = Gimbal(steering=pitch, gain=2.0, damping=1.5)
GimballedThrust(
    gimbal=gimbal,
    mean_thrust=2.5e4,
    exhaust_velocity=2850.0,
    burn_time=60.0,
    station=-2.0,
)
AttitudeControl(steering=pitch, stiffness=50.0, damping=4.0)
PitchKick(angle=0.1)

# Reduced models.
GravityTurn(thrust_ratio=2.0, gravity=9.81)
GravityTurnState(speed=50.0, angle=0.1, range=0.0, height=0.0)
SpinningRocket(spin=10.0, burn_fraction_rate=0.008, lever_over_gyration=2.0)

"""One construction of each class of `jaxspace.control`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.bodies import RigidBody
from jaxspace.control import (
    ApogeeControl,
    ClosedLoop,
    CommandedAcceleration,
    CommandedEngine,
    CommandedMotor,
    CommandedTorque,
    Feedback,
    FinControl,
    LandingControl,
    LandingTask,
    RendezvousTask,
    Sensor,
    SlewTask,
    StarTracker,
)
from jaxspace.control.attitude_laws import (
    MomentumDumping,
    NutationControl,
    QuaternionFeedback,
    SpinRateControl,
)
from jaxspace.control.point_laws import (
    PID,
    LeastEffortGuidance,
    LinearController,
    Together,
)
from jaxspace.control.point_tasks import PushedRelativeMotion
from jaxspace.orbits import ClohessyWiltshire
from jaxspace.scene import Scene

# A closed loop.
scene = Scene(
    effects=[CommandedTorque()], body=RigidBody(inertia=[1.0, 1.0, 2.0])
)
law = SpinRateControl(gain=2.0, rate=0.1)
ClosedLoop(scene, law, period=0.1)

# Commands.
CommandedTorque(command=[0.0, 0.0, 0.2])
CommandedAcceleration(command=[0.1, 0.2, -0.1])
CommandedMotor(command=[0.0, 0.0, 0.01])
CommandedEngine(
    max_thrust=6500.0, exhaust_velocity=3050.0, burnout_mass=1300.0
)

# Control laws.
SpinRateControl(gain=2.0, rate=0.1)
QuaternionFeedback(stiffness=0.2, damping=0.6, target=[0.5, 0.5, 0.5, 0.5])
NutationControl(gain=0.6)
MomentumDumping(gain=0.05, axes=jnp.eye(3))
PID(proportional=2.0, derivative=0.5, integral=0.1)
LinearController(d=[[-2.0, 0.0, 0.0, -0.5, 0.0, 0.0]])
LeastEffortGuidance(arrival=40.0, gravity=[0.0, 0.0, -1.62], least_time=0.5)
Together(
    [
        SpinRateControl(gain=2.0, rate=0.1),
        MomentumDumping(gain=0.05, axes=jnp.eye(3)),
    ]
)
Feedback(lambda t, y: -0.5 * y.omega)
ApogeeControl(target=3000.0, drag=4e-4, gain=0.05, share=0.3)
FinControl(gain=[0.0, 0.0, 0.5], damping=[0.0, 0.0, 0.1], full_speed=90.0)
LandingControl(
    arrival=20.0,
    gravity=[0.0, 0.0, -9.8],
    full_thrust=1e5,
    gain=1.0,
    damping=1.0,
    least_thrust=4e4,
)

# Sensors.
Sensor(reads="omega", noise=1e-4, walk=1e-6, quantum=1e-5)
StarTracker(noise=1e-4, period=2.0)

# Environments.
SlewTask(period=0.5, horizon=60.0)
LandingTask(mass=1500.0)
RendezvousTask(thrust=0.02)
PushedRelativeMotion(motion=ClohessyWiltshire(mean_motion=1.13e-3))

"""One construction of each class of `jaxspace.attitude`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.attitude import (
    AttitudeDrift,
    BodyTorque,
    ControlMomentGyros,
    DipoleField,
    DriftState,
    EnergySink,
    GravityGradient,
    MagneticDipole,
    MovingMasses,
    NutationDamper,
    PendulumState,
    ReactionWheels,
    RollingDisk,
    ShaftPendulum,
    SpaceTorque,
    SphericalPendulum,
    SpinningMissile,
    SpringTorque,
    TiltState,
    Top,
    TorqueFreeBody,
    ViscousTorque,
    YoYo,
)
from jaxspace.attitude.motors import ConstantTorque, PointingControl
from jaxspace.attitude.pitch_libration import (
    EllipticLibration,
    LibrationState,
)
from jaxspace.attitude.polhode import Polhode
from jaxspace.attitude.swinging import SwingingCords, SwingOutArms, SwingState
from jaxspace.attitude.unwinding import (
    CordState,
    StretchingCords,
    UnwindingCords,
)

# Single bodies.
TorqueFreeBody(inertia=[0.3, 0.2, 0.1])
Top(transverse_inertia=0.001, axial_inertia=0.0006, weight_moment=0.08)
SphericalPendulum(length=1.0, gravity=9.81)
PendulumState(direction=[0.0, 0.0, -1.0], direction_rate=[0.5, 0.0, 0.0])
ShaftPendulum(
    transverse_inertia=0.1,
    axial_inertia=0.02,
    weight_moment=2.94,
    shaft_rate=7.0,
)
TiltState(tilt=0.3, tilt_rate=0.0)
RollingDisk(
    mass=0.0113,
    radius=0.0153,
    transverse_inertia=6.6e-7,
    axial_inertia=1.3e-6,
    gravity=9.81,
    contour_damping=4e-9,
)
SpinningMissile(
    transverse_inertia=4000.0, axial_inertia=400.0, spin_rate=6.28
)
AttitudeDrift(drift_constant=6.559e-4)
DriftState(angle=0.3)
EllipticLibration(mean_motion=1.1e-3, eccentricity=0.1, inertia_ratio=0.5)
LibrationState(pitch=0.1, pitch_rate=0.0, true_anomaly=0.0)
Polhode.of(jnp.array([1.0, 2.0, 3.0]), jnp.array([0.01, 1.0, 0.0]))

# Despin.
YoYo(axial_inertia=100.0, radius=0.5, mass=1.2, cord_length=10.0)
UnwindingCords(axial_inertia=0.264, radius=0.127, mass=0.01134)
StretchingCords(
    axial_inertia=0.264, radius=0.127, mass=0.01134, stiffness=40.0
)
CordState(spin=30.0, angle=0.0, angle_rate=30.0)
SwingOutArms(axial_inertia=2.0, mass=0.2, hinge_radius=0.5, arm_length=0.8)
SwingingCords(
    axial_inertia=0.264, radius=0.127, mass=0.01134, cord_length=0.9
)
SwingState(spin=30.0, angle=0.0, angle_rate=30.0)

# Torques.
BodyTorque(torque=[0.1, -0.2, 0.3])
SpaceTorque(torque=[0.2, 0.1, -0.1])
SpringTorque(stiffness=[3.0, 2.0, 1.0])
ViscousTorque(damping=[0.3, 0.2, 0.1])
EnergySink(damping=0.4)
GravityGradient(mu=3.986004418e14)
field = DipoleField(strength=[0.0, 0.0, -7.8e15])
MagneticDipole(field=field, moment=[2000.0, 1000.0, -1000.0])

# Moving parts.
NutationDamper(
    mass=4.0,
    position=[0.9, 0.0, 0.0],
    direction=[0.0, 0.0, 1.0],
    stiffness=20.0,
    damping=2.0,
)
ReactionWheels(
    axes=jnp.eye(3), inertia=[0.01, 0.01, 0.01], speed=[0.0, 0.0, 0.0]
)
ConstantTorque(drive=0.1, until=30.0)
PointingControl(target=[1.0, 0.0, 0.0, 0.0], stiffness=2.0, damping=30.0)
ControlMomentGyros(
    gimbal_axes=[[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]],
    spin_axes=[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
    momentum=[3.0, 2.0],
    gimbal_angle=[0.3, -0.4],
    gimbal_rate=[0.02, 0.03],
)


def path(t):
    """Two masses that move along the first axis of the body."""
    x = 1.0 + 0.1 * jnp.sin(t)
    return jnp.array([[x, -x], [0.0, 0.0], [0.0, 0.0]])


MovingMasses(path=path, mass=[3.0, 5.0])

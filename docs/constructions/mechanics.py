"""One construction of each class of `jaxspace.mechanics`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.mechanics import (
    ArmPendulum,
    ArmState,
    BarOnSpring,
    BarOnString,
    CanonicalState,
    CentrifugalPendulum,
    DoublePendulum,
    ElasticPendulum,
    FlexibleMissile,
    FramedPendulum,
    GeneralisedState,
    Hamiltonian,
    InclineDisk,
    Lagrangian,
    LandingLegs,
    MissileState,
    RotatingHoop,
    SimplePendulum,
    SliderCarrier,
    Trailer,
    TrailerState,
)
from jaxspace.mechanics.missile_loop import MissileLoop, MissileLoopState


# Systems from a function.
def lagrangian(t, q, rates, parameters):
    """Kinetic minus potential energy, J, of a mass on a spring."""
    mass, stiffness = parameters
    return 0.5 * mass * rates[0] ** 2 - 0.5 * stiffness * q[0] ** 2


Lagrangian(lagrangian, names=("x",), parameters=(2.0, 50.0))
GeneralisedState(coordinates=[0.1], rates=[0.0])


def hamiltonian(t, q, p, parameters):
    """Energy, J, of a mass on a spring."""
    mass, stiffness = parameters
    return 0.5 * p[0] ** 2 / mass + 0.5 * stiffness * q[0] ** 2


Hamiltonian(hamiltonian, parameters=(2.0, 50.0))
CanonicalState(coordinates=[0.1], momenta=[0.0])

# Pendulums.
SimplePendulum(length=1.1, gravity=9.81)
DoublePendulum(
    mass_1=2.0, mass_2=1.0, length_1=1.0, length_2=0.8, gravity=9.81
)
ElasticPendulum(mass=1.0, stiffness=100.0, free_length=0.8, gravity=9.81)
CentrifugalPendulum(inertia=0.5, mass=0.2, arm=0.3, length=0.1)
FramedPendulum(inertia=0.3, mass=1.0, length=0.8, gravity=9.81)
RotatingHoop(mass=0.2, radius=0.5, rate=6.0, gravity=9.81)
ArmPendulum(frequency=3.0, damping_ratio=0.05, rate=2.0, arm=0.4)
ArmState(position=[0.1, -0.2], velocity=[0.3, 0.1])

# Mechanisms.
BarOnString(mass=1.0, string_length=0.5, bar_length=0.8, gravity=9.81)
BarOnSpring(
    mass=2.0, stiffness=300.0, free_length=0.5, bar_length=1.2, gravity=9.81
)
SliderCarrier(
    carrier_mass=10.0,
    inertia=4.0,
    slider_mass=1.0,
    stiffness=30.0,
    rest_length=0.6,
)
InclineDisk(mass=1.0, radius=0.3, slope=0.1, gravity=9.81)
Trailer(
    mass=800.0,
    gyration_radius=1.0,
    hitch_to_centre=2.5,
    centre_to_wheel=0.5,
    stiffness=2e4,
    speed=20.0,
)
TrailerState(hitch=0.05, angle=0.0, angle_rate=0.0)
LandingLegs(
    body_mass=900.0,
    leg_mass=12.0,
    leg_length=2.0,
    rest_angle=0.6,
    stiffness=4000.0,
    gravity=1.62,
)

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
bent = MissileState(
    engine=0.0,
    bending=jnp.array([0.02, 0.0]),
    pitch=0.0,
    engine_rate=0.0,
    bending_rate=jnp.array([0.0, 0.0]),
    pitch_rate=0.0,
)
MissileLoop(missile=missile, pitch_gain=1.0, rate_gain=0.1, gyro_place=2.0)
MissileLoopState(missile=bent, slosh=0.1, slosh_rate=0.0)

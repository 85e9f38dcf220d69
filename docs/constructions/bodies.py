"""One construction of each class of `jaxspace.bodies`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.bodies import (
    BodyState,
    BurningBody,
    Detached,
    ExponentialAtmosphere,
    InertiaTensor,
    Load,
    MassProperties,
    PadAtmosphere,
    PrincipalInertia,
    RigidBody,
    StandardAtmosphere,
)
from jaxspace.bodies.random_signals import Fluctuation, RandomSignal

BodyState(position=[7.0e6, 0.0, 0.0], velocity=[0.0, 7500.0, 0.0])
RigidBody(mass=17.0, inertia=[1.2, 1.1, 0.4])
BurningBody(
    dry_mass=16.2,
    dry_inertia=[6.4, 6.4, 0.036],
    gyration_radii=[0.2, 0.2, 0.02],
)
PrincipalInertia(moments=[1.0, 2.0, 3.0])
InertiaTensor(tensor=[[3.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 1.5]])
MassProperties(
    mass=jnp.array(2.0), centre=jnp.array([1.0, 0.0, 0.5]), tensor=jnp.eye(3)
)
Detached(mass=10.0, offset=[0.0, 0.0, -1.5], kick=[0.0, 0.0, -0.3])
Load(torque_B=jnp.array([0.0, 0.0, 0.2]))
StandardAtmosphere(density_factor=1.1)
ExponentialAtmosphere(
    density=1.225, reference_height=0.0, scale_height=8500.0
)
PadAtmosphere(elevation=1400.0, temperature=308.15, pressure=86500.0)
RandomSignal(
    seed=3.0, duration=60.0, step=0.5, correlation_time=4.0, components=3
)
Fluctuation.coloured(
    deviation=0.1, correlation_time=4.0, seed=3.0, duration=60.0, step=0.5
)

"""One construction of each class of `jaxspace.minimisation` and `jaxspace.optimization`, as the
reference shows them."""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxspace.minimisation import Criterion
from jaxspace.optimization import (
    Insertion,
    InsertionState,
    SteeredFlight,
    SteeringProfile,
)
from jaxspace.optimization.ascent import (
    Ascent,
    ConstantMassFlow,
    ConstantThrustAcceleration,
    FlightState,
)
from jaxspace.optimization.laws import SteeringNetwork, TangentLaw
from jaxspace.optimization.staged_flight import StageDesign

Criterion(objective=jnp.array(2.0), non_negative=jnp.array([0.5, -0.1]))

# Ascent steering.
constant = ConstantThrustAcceleration(acceleration=29.4)
Ascent(
    thrust=constant,
    burn_time=160.0,
    release_speed=914.4,
    release_height=0.0,
    apex_height=182880.0,
    gravity=9.81,
)
profile = SteeringProfile(times=[0.0, 50.0, 120.0], angles=[0.9, 0.6, 0.1])
flow = ConstantMassFlow(exhaust_velocity=3363.7, depletion_time=333.0)
SteeredFlight(thrust=flow, steering=profile, gravity=9.81)
FlightState(x=100.0, y=2000.0, u=300.0, w=200.0)
TangentLaw(tangent=0.5, rate=-0.4)
network = eqx.nn.MLP(
    "scalar", "scalar", width_size=8, depth=1, key=jax.random.key(0)
)
SteeringNetwork(network)

# Orbit insertion.
start = InsertionState(radius=6478137.0, radial=900.0, across=3000.0)
Insertion(thrust=flow, start=start, mu=3.986004418e14, radius=6563137.0)

# Staging.
StageDesign(
    exhaust_velocity=[2800.0, 3300.0],
    structural_factor=[0.07, 0.09],
    thrust=[1.9e5, 2.6e4],
    fixed_mass=[100.0, 50.0],
)

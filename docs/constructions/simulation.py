"""One construction of each class of `jaxspace.scene`, `jaxspace.simulation`, `jaxspace.solvers` and
`jaxspace.studies`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.bodies import Load, RigidBody
from jaxspace.orbits import TwoBody, UniformGravity
from jaxspace.scene import Custom, Scaled, Scene
from jaxspace.simulation import Accuracy, Event, FinalError, Mission, Phase
from jaxspace.solvers import (
    DOP853,
    RKN1210,
    AdaptiveRegularised,
    ExponentialRosenbrock,
    FixedSteps,
    MuntheKaas,
    Regularised,
    Splitting,
    Stormer,
    Tsit5,
)
from jaxspace.studies.covariance import Uncertain, UncertainRoot

# Scenes.
gravity = UniformGravity(acceleration=[0.0, 0.0, -9.81])
scene = Scene(effects=[gravity], body=RigidBody(mass=17.0))
Scaled(effect=gravity, factor=0.5)


def push(t, y, body):
    """A constant force along the first axis."""
    return Load(force_N=jnp.array([2.0, 0.0, 0.0]))


Custom(push)

# Runs.
orbit = TwoBody(mu=3.986004418e14)
Accuracy(rtol=1e-9)
FinalError(position=1.0)


def height(t, y):
    """Height above the ground, m, which is zero at the event."""
    return y.position[2]


Event(height, direction=-1)
coast = Phase(system=orbit, until=3600.0, name="coast")
Mission(phases=[coast])

# Methods.
DOP853()
Tsit5()
RKN1210()
FixedSteps(Tsit5(), steps=100)
Splitting(steps=64)
Stormer(steps=64)
Regularised(steps=64)
AdaptiveRegularised()
ExponentialRosenbrock()
MuntheKaas()

# Covariance.
uncertain = Uncertain(orbit)
UncertainRoot(orbit)

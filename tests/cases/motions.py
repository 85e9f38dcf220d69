"""Short motions that several rows share: one effect of a few lines each, so one program each."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxspace import Scene, simulate
from jaxspace.bodies import BodyState, Load, RigidBody
from jaxspace.core.vectors import axis, cross, unit
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom

from .case import vec

ACCURACY = 1e-13
# One program for all rows: only the numbers differ.
kepler = jax.jit(kepler_flow)


class Field(eqx.Module):
    """Near the ground: gravity along -z, Coriolis' acceleration, a linear pull to the origin, and
    a thrust along the velocity, thrust / (1 - rate t)."""

    gravity: Array
    spin: Float[Array, "3"]
    pull: Array
    thrust: Array
    rate: Array

    def __call__(self, t, y, body):
        down = -self.gravity * axis(2, y.position[2])
        push = self.thrust / (1.0 - self.rate * t) * unit(y.velocity)
        turn = -2.0 * cross(self.spin, y.velocity)
        return Load(acceleration_N=down + push + turn - self.pull * y.position)


def near_ground(gravity=0.0, spin=(0.0, 0.0, 0.0), pull=0.0, thrust=0.0, rate=0.0) -> Custom:
    """A `Field`; gravity and thrust, m/s^2, turning frame, rad/s, pull, 1/s^2, rate, 1/s."""
    numbers = (jnp.asarray(x, float) for x in (gravity, spin, pull, thrust, rate))
    return Custom(Field(*numbers))


def fly(effect, position, velocity, duration, accuracy=ACCURACY):
    """Position and velocity of a point under one effect, (2, 3): halfway and at the end."""
    y0 = BodyState(position=vec(*position), velocity=vec(*velocity))
    run = simulate(Scene((effect,)), y0, duration * vec(0.0, 0.5, 1.0), accuracy=accuracy)
    return run.states.position[:, 1:].T, run.states.velocity[:, 1:].T


class Moment(eqx.Module):
    """A body-fixed moment: constant, in half a sine, of a damper, of a rotor that is spun up."""

    steady: Float[Array, "3"]
    pulse: Float[Array, "3"]
    frequency: Array
    damping: Array
    rotor: Float[Array, "3"]

    def __call__(self, t, y, body):
        wheel = self.rotor * t
        torque = self.steady + jnp.sin(self.frequency * t) * self.pulse - self.damping * y.omega
        return Load(torque_B=torque - self.rotor - cross(y.omega, wheel))


def turn(inertia, omega, ts, steady=(0, 0, 0), pulse=(0, 0, 0), frequency=0, damping=0, rotor=None):
    """The run of a body with a `Moment`, from the inertial axes."""
    moment = Moment(
        *(jnp.asarray(x, float) for x in (steady, pulse, frequency, damping, rotor or (0, 0, 0)))
    )
    scene = Scene((Custom(moment),), RigidBody(inertia=jnp.asarray(inertia, float)))
    y0 = BodyState(attitude=Quaternion.identity(), omega=vec(*omega))
    return simulate(scene, y0, jnp.asarray(ts, float), accuracy=ACCURACY)


def angle_of_attack(attitude: Quaternion):
    """theta e^(i psi) of the body's z axis, real and imaginary part (Thomson 7.3)."""
    s = attitude.rotate(vec(0, 0, 1))
    across = jnp.hypot(s[0], s[1])
    ratio = jnp.where(across > 0, jnp.arctan2(across, s[2]) / jnp.where(across > 0, across, 1), 1)
    return -ratio * s[1], ratio * s[0]

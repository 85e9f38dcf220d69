"""Functions of the edge cases of runs: events, phases, burnouts, failures; and of dispersions.

Each maps the inputs of a case, (inputs,), to its outputs, (outputs,)."""

import math

import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import BodyState, BurningBody
from ..bodies.inertia import as_inertia
from ..orbits import TwoBody
from ..orbits.outputs import apoapsis
from ..rockets import Thrust
from ..rotations import Quaternion
from ..sampling import Normal, TruncatedNormal, Uniform
from ..scene import Scene
from ..simulation import Accuracy, Event, Status, simulate, simulate_batch
from ..solvers import DOP853


def tight() -> Accuracy:
    """Built when a case runs: the import of this file touches no device."""
    # Few steps, because reverse mode stores each of them.
    return Accuracy(rtol=1e-12, method=DOP853(), max_steps=256)


def usual(max_steps: int = 256) -> Accuracy:
    """The tolerance of the precision of the state."""
    return Accuracy(method=DOP853(), max_steps=max_steps)


def on_circle(speed: Array) -> BodyState:
    """Velocity at the distance 1, perpendicular to the radius."""
    # From the speed, so that precision and runs are those of the case.
    zero = 0.0 * speed
    return BodyState(
        position=jnp.stack([zero + 1.0, zero, zero]), velocity=jnp.stack([zero, speed, zero])
    )


def stepped(x: Array) -> Array:
    """Position and velocity by steps, from position, velocity, duration and mu."""
    ts = jnp.stack([0.0 * x[6], x[6]])
    start = BodyState(position=x[:3], velocity=x[3:6])
    end = simulate(TwoBody(x[7]), start, ts, accuracy=tight(), throw=False).final
    return jnp.concatenate([end.position, end.velocity])


def time_of_apoapsis(x: Array) -> Array:
    """The time of the next apoapsis from the speed at periapsis, where the condition is zero, and
    the greatest time, of either sign."""
    # Few samples, because the program of the search is compiled for this case alone.
    stop = Event(apoapsis, samples=16)
    ts = jnp.stack([0.0 * x[1], x[1]])
    run = simulate(
        TwoBody(jnp.ones_like(x[0])),
        on_circle(x[0]),
        ts,
        accuracy=tight(),
        events=(stop,),
        throw=False,
    )
    return run.ts[-1:]


def burnt(x: Array) -> Array:
    """The speed after burnout, 1000 at ignition, from thrust, exhaust velocity, burn time, mass."""
    zero = jnp.zeros(3, x.dtype)
    ones = jnp.ones(3, x.dtype)
    # Any moments, because nothing turns.
    body = BurningBody(ones[0], as_inertia(ones), 0.3 * ones, 0.0 * ones[0])
    scene = Scene((Thrust(x[0], x[1], x[2]),), body)
    attitude = Quaternion(jnp.asarray([1.0, 0.0, 0.0, 0.0], x.dtype))
    moving = 1e3 * jnp.asarray([0.0, 0.0, 1.0], x.dtype)
    start = BodyState(
        position=1e3 * moving, velocity=moving, attitude=attitude, omega=zero, mass=x[3]
    )
    # Twice as long as it burns, so that the burnout is within the run.
    ts = jnp.stack([zero[0], 2.0 * x[2]])
    return simulate(scene, start, ts, accuracy=tight(), throw=False).final.velocity[2:]


def fall_into_the_centre(x: Array) -> Array:
    """Whether the run from rest fails, and whether its end is not a number."""
    # From rest the path is a line, which the steps follow into the singularity.
    start = BodyState(position=x[:3], velocity=jnp.zeros_like(x[:3]))
    run = simulate(
        TwoBody(jnp.ones_like(x[0])), start, jnp.asarray([0.0, 3.0]), accuracy=usual(), throw=False
    )
    return jnp.stack([run.status > Status.EVENT, jnp.all(jnp.isnan(run.final.position))])


def out_of_steps(x: Array) -> Array:
    """The status of a run with too few steps, and whether its end is not a number."""
    run = simulate(
        TwoBody(jnp.ones_like(x[0])),
        on_circle(x[0]),
        jnp.asarray([0.0, 100.0]),
        accuracy=usual(4),
        throw=False,
    )
    return jnp.stack(
        [run.status.astype(x.dtype), jnp.all(jnp.isnan(run.final.position)).astype(x.dtype)]
    )


def beside_a_failure(x: Array) -> Array:
    """Failure flags of three runs, one of which falls into the centre."""
    starts = on_circle(x)
    run = simulate_batch(
        TwoBody(jnp.ones_like(x[0])), starts, jnp.asarray([0.0, 3.0]), accuracy=usual()
    )
    return (run.status > Status.EVENT).astype(x.dtype)


def tails(x: Array) -> Array:
    """The shares of three distributions beyond the limit."""
    zero = 0.0 * x[0]
    one = jnp.ones_like(x[0])
    # Far out, where one less a distribution function would have no digit left.
    limit = x[0]
    laws = (
        Normal(zero, one),
        TruncatedNormal(zero, one, -12.0 * one, 12.0 * one),
        Uniform(zero, 2.0 * limit),
    )
    return jnp.asarray([law.outside(-math.inf, float(limit)) for law in laws])

"""The error of a derivative, estimated and asked for, against the derivative of the closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import Integrated
from test_simulation_final_error import kicked, mission, truth
from test_simulation_final_error import start as others
from unchecked import unchecked

from jaxspace import Accuracy, BodyState, Event, simulate, simulate_batch, simulate_mission
from jaxspace.core import InputError
from jaxspace.orbits import TwoBody
from jaxspace.simulation import SimulationError, gradient_error, gradient_within
from jaxspace.solvers import DOP853, Stormer

ORBIT = Integrated(TwoBody(1.0))
METHOD = Accuracy(method=DOP853())
# Five revolutions, after which the derivative is a hundred times as large as the position.
TS = jnp.array([0.0, 40.0])
SPEED = 1.1


def start(speed):
    zero = 0.0 * speed
    return BodyState(jnp.stack([1.0 + zero, zero, zero]), jnp.stack([zero, speed, 0.2 + zero]))


def place(speed, accuracy):
    return simulate(ORBIT, start(speed), TS, accuracy=accuracy).final.position


def flown(speed):
    return TwoBody(1.0).closed_form().flow(TS[1], start(speed)).position


@functools.cache
def exact():
    return jax.jit(jax.jacfwd(flown))(SPEED)


@functools.cache
def rounding():
    """What the roundings of a run can do to the derivative: each of some 300 steps rounds the
    state, and so the speed, which changes the derivative by the second one."""
    second = jax.jit(jax.jacfwd(jax.jacfwd(flown)))(SPEED)
    return 300 * np.finfo(float).eps * SPEED * float(np.linalg.norm(second))


@pytest.mark.parametrize("forward", [True, False])
def test_the_estimate_is_the_error_of_the_derivative(forward):
    accuracy = Accuracy(1e-7, method=DOP853())
    found = gradient_error(place, SPEED, accuracy, forward=forward)
    errors = np.abs(np.asarray(found.gradient) - exact())
    # The other derivative has about a hundredth of the error; a tenth leaves room for errors that
    # fall by a power of the tolerance below one.
    np.testing.assert_allclose(found.error, errors, rtol=0.1, atol=0.1 * np.max(errors))
    assert found.tolerance == 1e-7 and found.runs == 2


@pytest.mark.parametrize("within", [1e-2, 1e-5, 1e-8])
def test_the_error_is_below_what_is_asked(within):
    found = gradient_within(place, SPEED, within, accuracy=METHOD, forward=True)
    error = float(np.linalg.norm(np.asarray(found.gradient) - exact()))
    assert error <= within and float(found.error) <= within
    # The estimate may be too small by what few runs tell of how fast errors fall, and where the two
    # derivatives that it compares are rounded alike.
    assert error <= 3.0 * float(found.error) + rounding()


def test_the_time_of_an_event():
    """That at which the orbit is back at its apsis, a period of 2 pi a^(3/2), 1 / a = 2 - v^2."""

    def period(speed, accuracy):
        back = Event(lambda t, y: y.position[1], direction=1)
        return simulate(ORBIT, start(speed), TS, accuracy=accuracy, events=[back]).ts[-1]

    slope = 6.0 * np.pi * SPEED * (2.0 - SPEED**2 - 0.2**2) ** -2.5
    found = gradient_within(period, SPEED, 1e-6, accuracy=METHOD, forward=True)
    assert abs(float(found.gradient) - slope) <= 1e-6 and float(found.error) <= 1e-6


def after_a_kick(speed, accuracy):
    return simulate_mission(mission(), start(speed), accuracy=accuracy).final.position


def of_two(speeds, accuracy):
    return simulate_batch(ORBIT, others(speeds), TS, accuracy=accuracy).final.position


@pytest.mark.parametrize(
    ("function", "closed_form", "x"),
    [
        (after_a_kick, lambda speed: kicked(speed).position, 0.9),
        (of_two, lambda speeds: truth(speeds).position, np.array([0.9, 1.1])),
    ],
    ids=["mission", "batch"],
)
def test_missions_and_batches(function, closed_form, x):
    """Through the jump between two phases; and of two runs, neither by the speed of the other."""
    # Kept from its first call on, which must not be within a trace.
    mission()
    exact = jax.jit(jax.jacfwd(closed_form))(x)
    found = gradient_within(function, x, 1e-4, accuracy=METHOD, forward=True)
    assert float(jnp.linalg.norm(found.gradient - exact)) <= 1e-4
    assert float(found.error) <= 1e-4 and found.runs <= 4
    # By the program of the search.
    looser = gradient_error(function, x, Accuracy(1e-7, method=DOP853()), forward=True)
    errors = np.abs(np.asarray(looser.gradient) - exact)
    np.testing.assert_allclose(looser.error, errors, rtol=0.1, atol=0.1 * np.max(errors))


def test_single_precision_says_what_it_resolves():
    """A derivative of some ten is rounded by some millionths of it, and more along the way."""
    orbit = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), ORBIT)

    def low(speed, accuracy):
        ts = jnp.array([0.0, 8.0], jnp.float32)
        return simulate(orbit, start(speed), ts, accuracy=accuracy).final.position

    speed = jnp.float32(SPEED)
    flow = TwoBody(1.0).closed_form().flow
    exact = jax.jacfwd(lambda v: flow(8.0, start(v)).position)(SPEED)
    found = gradient_within(low, speed, 0.1, accuracy=METHOD, forward=True)
    assert found.gradient.dtype == jnp.float32
    assert float(np.linalg.norm(np.asarray(found.gradient) - exact)) <= 0.1
    with pytest.raises(SimulationError, match="That of the derivative is .* times what is asked"):
        gradient_within(low, speed, 1e-7, accuracy=METHOD, forward=True)


def test_what_cannot_be_met_is_said():
    with pytest.raises(SimulationError, match="That of the derivative is .* times what is asked"):
        gradient_within(place, SPEED, 1e-16, accuracy=METHOD, forward=True)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: gradient_within(place, SPEED, 0.0), "within is 0: it must be positive"),
        (lambda: gradient_within(place, SPEED, 1.0, accuracy=Accuracy(1e-9)), "has a tolerance"),
        (
            lambda: jax.jit(lambda v: gradient_error(place, v).error)(SPEED),
            "outside of jit, vmap and grad",
        ),
        (
            lambda: gradient_error(place, SPEED, Accuracy(method=Stormer(8, steps=64))),
            "Stormer, whose steps follow no tolerance",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(made, said):
    with unchecked(), pytest.raises(InputError, match=said):
        made()

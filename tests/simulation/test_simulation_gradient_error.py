"""The estimated error of a derivative, against the derivative of the closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import Integrated
from test_simulation_final_error import kicked, mission, truth
from test_simulation_final_error import start as others
from unchecked import unchecked

from jaxspace import Accuracy, BodyState, Event, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.bodies import Load
from jaxspace.core import InputError
from jaxspace.orbits import TwoBody
from jaxspace.scene import Custom
from jaxspace.simulation import gradient_error
from jaxspace.solvers import DOP853, Stormer

ORBIT = Integrated(TwoBody(1.0))
METHOD = Accuracy(1e-7, method=DOP853())
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


def check(found, exact):
    """The estimate is the error, component by component."""
    errors = np.abs(np.asarray(found.gradient) - exact)
    # The other derivative has about a hundredth of the error; a tenth leaves room for errors that
    # fall by a power of the tolerance below one.
    np.testing.assert_allclose(found.error, errors, rtol=0.1, atol=0.1 * np.max(errors))
    assert found.tolerance == 1e-7


@pytest.mark.parametrize("forward", [True, False])
def test_the_estimate_is_the_error_of_the_derivative(forward):
    check(gradient_error(place, SPEED, METHOD, forward=forward), exact())


def test_steps_chosen_from_a_motion_at_rest():
    """x'' = e sin(20 t) at e = 0: one step at every tolerance, by which the derivative is wrong."""

    def pushed(e, accuracy):
        push = Custom(lambda t, y, body: Load(acceleration_N=e * jnp.sin(20.0 * t) + jnp.zeros(3)))
        ts, rest = jnp.array([0.0, 10.0]), BodyState(jnp.zeros(3), jnp.zeros(3))
        return simulate(Scene([push]), rest, ts, accuracy=accuracy).final.position[0]

    alone = Accuracy(1e-7, method=DOP853(), derivative_control=False)
    found = gradient_error(pushed, 0.0, alone)
    exact = 10.0 / 20.0 - np.sin(200.0) / 400.0
    error = abs(float(found.gradient) - exact)
    assert error > 1.0
    np.testing.assert_allclose(found.error, error, rtol=1e-6)


def test_the_time_of_an_event():
    """That at which the orbit is back at its apsis, a period of 2 pi a^(3/2), 1 / a = 2 - v^2."""

    def period(speed, accuracy):
        back = Event(lambda t, y: y.position[1], direction=1)
        return simulate(ORBIT, start(speed), TS, accuracy=accuracy, events=[back]).ts[-1]

    slope = 6.0 * np.pi * SPEED * (2.0 - SPEED**2 - 0.2**2) ** -2.5
    check(gradient_error(period, SPEED, METHOD, forward=True), slope)


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
    check(gradient_error(function, x, METHOD, forward=True), exact)


def test_at_the_limit_of_the_precision_the_other_tolerance_is_looser():
    """The derivative of x times the tolerance is the tolerance, which shows both of them."""

    def scaled(x, accuracy):
        return x * accuracy.rtol

    double = gradient_error(scaled, 2.0, 1e-7)
    np.testing.assert_allclose(double.error, 0.99e-7, rtol=1e-12)
    single = gradient_error(scaled, jnp.float32(2.0), 1e-6)
    assert single.gradient.dtype == jnp.float32
    # A finer tolerance would differ by less than the derivative itself.
    assert float(single.error) > 10.0 * float(single.gradient)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (
            lambda: jax.jit(lambda v: gradient_error(place, v).error)(SPEED),
            "outside of jit, vmap and grad",
        ),
        (
            lambda: gradient_error(place, SPEED, Accuracy(method=Stormer(8, steps=64))),
            "Stormer, which does not adapt its steps",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(made, said):
    with unchecked(), pytest.raises(InputError, match=said):
        made()

"""The error of a derivative, estimated and asked for, against the derivative of the closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import Integrated
from unchecked import unchecked

from jaxspace import Accuracy, BodyState, Event, simulate
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
    return BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.stack([0.0 * speed, speed, 0.2 + 0.0 * speed]))


def place(speed, accuracy):
    return simulate(ORBIT, start(speed), TS, accuracy=accuracy).final.position


@functools.cache
def exact():
    flow = TwoBody(1.0).closed_form().flow
    return jax.jit(jax.jacfwd(lambda speed: flow(TS[1], start(speed)).position))(SPEED)


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
    # The estimate may be too small by what few runs tell of how fast errors fall.
    assert error <= within and error <= 3.0 * float(found.error) <= 3.0 * within


def test_the_time_of_an_event():
    """That at which the orbit is back at its apsis, a period of 2 pi a^(3/2), 1 / a = 2 - v^2."""

    def period(speed, accuracy):
        back = Event(lambda t, y: y.position[1], direction=1)
        return simulate(ORBIT, start(speed), TS, accuracy=accuracy, events=[back]).ts[-1]

    slope = 6.0 * np.pi * SPEED * (2.0 - SPEED**2 - 0.2**2) ** -2.5
    found = gradient_within(period, SPEED, 1e-6, accuracy=METHOD, forward=True)
    assert abs(float(found.gradient) - slope) <= 1e-6 and float(found.error) <= 1e-6


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

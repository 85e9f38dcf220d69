"""Derivatives by every method, of jaxspace, of diffrax and of a user, in both modes.

In the sweep that of x(T) by v_x of a low orbit about an oblate earth, against differences over
twenty revolutions. The differences are of runs by SciPy, in NumPy."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.integrate import solve_ivp

from jaxspace import Scene
from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem, InputError
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.simulation import Accuracy, simulate
from jaxspace.solvers import (
    DOP853,
    RKN1210,
    ExponentialRosenbrock,
    FixedSteps,
    MuntheKaas,
    Regularised,
    Splitting,
    Stormer,
    Tsit5,
)

MU, J2, RADIUS = 3.986e14, 1.0826e-3, 6.378e6
# Twenty revolutions, s.
DURATION = 116_600.0
SPEED = 10.0
SCENE = Scene([PointGravity(MU), Oblateness(MU, J2, RADIUS)])

# Steps enough for 1e-5 of the derivative. Where a method takes thousands of them, its tolerance is
# looser.
SOLVERS = {
    "DOP853": (DOP853(), 1e-10, 2048),
    "DOP853 in a loop": (DOP853(rolled=True), 1e-10, 2048),
    "Tsit5": (Tsit5(), 1e-9, 8192),
    "RKN1210": (RKN1210(), 1e-10, 2048),
    "MuntheKaas": (MuntheKaas(DOP853(rolled=True)), 1e-10, 2048),
    "ExponentialRosenbrock": (ExponentialRosenbrock(), 1e-9, 8192),
    "Regularised": (Regularised(steps=800), 1e-6, 2048),
    "Splitting": (Splitting((8, 6, 4), steps=1600), 1e-6, 2048),
    "Stormer": (Stormer(steps=2400), 1e-6, 4096),
    "FixedSteps": (FixedSteps(DOP853(rolled=True), steps=1600), 1e-6, 4096),
    "Dopri8": (diffrax.Dopri8(), 1e-10, 2048),
}
# diffrax's own methods hold a `custom_vjp`, which has no forward mode.
REVERSE_ALONE = {"Dopri8"}


@functools.cache
def exact():
    """d x(T) / d v_x, s, by runs of SciPy that start 0.1 m/s beside."""

    def field(t, y):
        x, y_, z, *v = y
        r2 = x * x + y_ * y_ + z * z
        k = 1.5 * J2 * RADIUS**2 / r2
        flat = np.array([1.0, 1.0, 3.0]) - 5.0 * z * z / r2
        return [*v, *(-MU / r2**1.5 * y[:3] * (1.0 + k * flat))]

    def end(speed):
        y0 = [7e6, 0.0, 0.0, speed, 5e3, 5.6e3]
        return solve_ivp(field, (0, DURATION), y0, "DOP853", rtol=1e-13, atol=1e-6).y[0, -1]

    return (end(SPEED + 0.1) - end(SPEED - 0.1)) / 0.2


# 1e-4: tolerances and numbers of steps are chosen for 1e-5, and the differences hold 1e-6.
@pytest.mark.sweep
@pytest.mark.parametrize("solver", SOLVERS)
def test_every_method_in_both_modes(solver):
    method, rtol, max_steps = SOLVERS[solver]
    accuracy = Accuracy(rtol=rtol, method=method, max_steps=max_steps)

    def end(speed):
        y0 = BodyState(jnp.array([7e6, 0.0, 0.0]), jnp.stack([speed, 5e3, 5.6e3]))
        run = simulate(SCENE, y0, jnp.array([0.0, DURATION]), accuracy=accuracy, throw=False)
        return run.final.position[0]

    for mode in (jax.grad,) if solver in REVERSE_ALONE else (jax.grad, jax.jacfwd):
        np.testing.assert_allclose(jax.jit(mode(end))(SPEED), exact(), rtol=1e-4)


class Heun(diffrax.AbstractSolver):
    """Heun's method, as a user writes it: no Runge-Kutta method of diffrax."""

    term_structure = diffrax.AbstractTerm
    interpolation_cls = diffrax.LocalLinearInterpolation

    def order(self, terms):
        return 2

    def init(self, terms, t0, t1, y0, args):
        return None

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        h = t1 - t0
        k1 = terms.vf(t0, y0, args)
        euler = y0 + h * k1
        y1 = y0 + 0.5 * h * (k1 + terms.vf(t1, euler, args))
        return y1, y1 - euler, {"y0": y0, "y1": y1}, None, diffrax.RESULTS.successful


class Decay(AbstractSystem):
    """y' = -k y."""

    rate: Array

    def vector_field(self, t, y):
        return -self.rate * y

    def invariants(self, t, y):
        return {}


def decayed(rate, method):
    """What is left of one after 2 s."""
    accuracy = Accuracy(1e-6, method=method, max_steps=4096)
    return simulate(Decay(rate), jnp.ones(1), jnp.array([0.0, 2.0]), accuracy=accuracy).final[0]


def test_a_solver_of_the_user_in_both_modes():
    rate = jnp.asarray(0.7)
    for mode in (jax.grad, jax.jacfwd):
        found = jax.jit(mode(lambda k: decayed(k, Heun())))(rate)
        # The steps follow the error of Euler's method: far below 1e-5.
        np.testing.assert_allclose(found, -2.0 * np.exp(-2.0 * 0.7), rtol=1e-5)


def test_a_solver_whose_steps_depend_on_those_before_is_refused():
    for method in (diffrax.LeapfrogMidpoint(), diffrax.HalfSolver(diffrax.ReversibleHeun())):
        with pytest.raises(InputError, match=f"{type(method).__name__}, whose steps depend on"):
            decayed(jnp.asarray(0.7), method)

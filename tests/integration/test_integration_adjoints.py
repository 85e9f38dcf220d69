"""Every method with every adjoint that is offered: twenty revolutions against differences.

The derivative of x(T) by v_x of a low orbit about an oblate earth. In the sample a pendulum stands
for it, by the one method whose steps an adjoint did not follow. The differences are of runs by
SciPy, in NumPy."""

import functools
import math

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxspace import Scene
from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem, InputError
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.simulation import Accuracy, Status, simulate
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

MU, J2, RADIUS = 3.986e14, 1.0826e-3, 6.378e6
# Twenty revolutions, s.
DURATION = 116_600.0
SPEED = 10.0
SCENE = Scene([PointGravity(MU), Oblateness(MU, J2, RADIUS)])

# Steps enough for 1e-5 of the derivative. Where a method takes thousands of them, its tolerance is
# looser.
SOLVERS = {
    "DOP853": (DOP853(), 1e-10, 2048),
    "DOP853 in a loop": (DOP853(in_loop=True), 1e-10, 2048),
    "Tsit5": (Tsit5(), 1e-9, 8192),
    "RKN1210": (RKN1210(), 1e-10, 2048),
    "MuntheKaas": (MuntheKaas(DOP853(in_loop=True)), 1e-10, 2048),
    "ExponentialRosenbrock": (ExponentialRosenbrock(), 1e-9, 8192),
    "Regularised": (Regularised(steps=800), 1e-6, 2048),
    "Splitting": (Splitting((8, 6, 4), steps=1600), 1e-6, 2048),
    "Stormer": (Stormer(steps=2400), 1e-6, 4096),
    "FixedSteps": (FixedSteps(DOP853(in_loop=True), steps=1600), 1e-6, 4096),
    "Dopri8": (diffrax.Dopri8(), 1e-10, 2048),
}
ADJOINTS = {
    "none": (None, ("grad", "jacfwd")),
    "checkpoints": (diffrax.RecursiveCheckpointAdjoint(), ("grad",)),
    "direct": (diffrax.DirectAdjoint(), ("grad", "jacfwd")),
    "forward": (diffrax.ForwardMode(), ("jacfwd",)),
}


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


def derivative(method, adjoint, mode):
    solver, rtol, max_steps = method
    accuracy = Accuracy(rtol=rtol, method=solver, adjoint=adjoint, max_steps=max_steps)

    def end(speed):
        y0 = BodyState(jnp.array([7e6, 0.0, 0.0]), jnp.array([speed, 5e3, 5.6e3]))
        run = simulate(SCENE, y0, jnp.array([0.0, DURATION]), accuracy=accuracy, throw=False)
        return run.final.position[0]

    return jax.jit(getattr(jax, mode)(end))(SPEED)


# diffrax's own methods hold a `custom_vjp`, which has no forward mode.
REVERSE_ALONE = {"Dopri8"}


# 1e-4: tolerances and numbers of steps are chosen for 1e-5, and the differences hold 1e-6. An
# adjoint that integrates again with other steps was off by a factor.
@pytest.mark.sweep
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("adjoint", ADJOINTS)
def test_every_method_with_every_adjoint(solver, adjoint):
    by, modes = ADJOINTS[adjoint]
    for mode in modes:
        if mode == "jacfwd" and solver in REVERSE_ALONE and adjoint == "none":
            continue
        np.testing.assert_allclose(derivative(SOLVERS[solver], by, mode), exact(), rtol=1e-4)


class Swing(AbstractSystem):
    """A pendulum: angle and rate."""

    def vector_field(self, t, y):
        return jnp.stack([y[1], -jnp.sin(y[0])])

    def invariants(self, t, y):
        return {}


def swing(rate, adjoint, max_steps):
    """Four swings from the bottom, or as far as the steps reach."""
    y0 = jnp.stack([0.0 * rate, rate])
    accuracy = Accuracy(1e-10, method=DOP853(), adjoint=adjoint, max_steps=max_steps)
    return simulate(Swing(), y0, jnp.array([0.0, 30.0]), accuracy=accuracy, throw=False)


def test_an_adjoint_follows_the_steps_of_the_run():
    """The steps are chosen by error estimates, which round otherwise in the program backwards."""
    checkpoints = diffrax.RecursiveCheckpointAdjoint()

    def end(rate):
        run = swing(rate, checkpoints, 512)
        return run.final[0], run.status

    slope, status = jax.jit(jax.grad(end, has_aux=True))(1.7)
    assert int(status) == Status.COMPLETED

    def after(rate):
        def field(t, y):
            return [y[1], -math.sin(y[0])]

        how = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
        return solve_ivp(field, (0.0, 30.0), [0.0, rate], **how).y[0, -1]

    # 1e-5: the tolerance of the steps leaves 1e-6, and so do the differences. Other steps backwards
    # were off by a factor.
    expected = (after(1.7 + 1e-5) - after(1.7 - 1e-5)) / 2e-5
    np.testing.assert_allclose(slope, expected, rtol=1e-5)


def test_adjoints_go_through_a_method_of_diffrax():
    """Some set its kind of loop, which they look for in the solver around it."""

    def end(rate, adjoint):
        y0 = jnp.stack([0.0 * rate, rate])
        accuracy = Accuracy(1e-4, method=diffrax.Bosh3(), adjoint=adjoint, max_steps=32)
        return simulate(Swing(), y0, jnp.array([0.0, 1.0]), accuracy=accuracy).final[0]

    expected = jax.jit(jax.grad(end), static_argnums=1)(1.7, None)
    found = jax.jit(jax.jacfwd(end), static_argnums=1)(1.7, diffrax.ForwardMode())
    # 1e-12: along the same steps.
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    # It failed where it was traced.
    jax.eval_shape(lambda rate: jax.grad(end)(rate, diffrax.DirectAdjoint()), 1.7)


def test_an_adjoint_keeps_status_and_statistics_of_the_run():
    """Steps that run out are reported, and what is counted is that of the run without it."""
    own, by_diffrax = (
        swing(jnp.array(1.7), adjoint, 8) for adjoint in (None, diffrax.DirectAdjoint())
    )
    assert int(by_diffrax.status) == int(own.status) == Status.MAX_STEPS
    assert np.all(np.isnan(by_diffrax.final))
    for name in set(own.stats) - {"largest_local_error"}:
        assert int(by_diffrax.stats[name]) == int(own.stats[name]) > 0


@pytest.mark.parametrize("adjoint", [diffrax.BacksolveAdjoint(), diffrax.ImplicitAdjoint()])
def test_an_adjoint_that_does_not_follow_the_steps_is_refused(adjoint):
    with pytest.raises(InputError, match="omit it, Accuracy"):
        derivative((DOP853(), 1e-10, 64), adjoint, "grad")


@pytest.mark.parametrize("adjoint", [diffrax.DirectAdjoint()])
def test_steps_of_its_own_take_no_adjoint(adjoint):
    with pytest.raises(InputError, match="leave it"):
        derivative((AdaptiveRegularised(), 1e-10, 64), adjoint, "grad")

"""Steps on the group of rotations: their order, the unit length, the free rotation in closed form,
derivatives."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Status, simulate
from jaxspace.solvers import DOP853, MuntheKaas, Tsit5

BODY, BALL = TorqueFreeBody([3.0, 2.0, 1.0]), TorqueFreeBody([2.0, 2.0, 2.0])


def start(omega):
    return BodyState(
        attitude=Quaternion(jnp.array([0.5, -0.5, 0.1, 0.7])).normalised(), omega=omega
    )


OMEGA = jnp.array([0.4, 0.9, 0.3])


@jax.jit
def exact(t):
    """The attitude of the closed form."""
    return BODY.closed_form().flow(t, start(OMEGA)).attitude.wxyz


def by(rtol=1e-9, **more):
    return Accuracy(rtol=rtol, method=MuntheKaas(), **more)


def test_the_rate_of_the_coordinates_is_that_of_the_turn():
    """The derivative of q (1, x/2) along the coordinate rate is the rate of q, for small and large
    x, at zero, too; x is the axis times twice the tangent of half the angle."""
    q = start(OMEGA).attitude

    @jax.jit
    def both(x):
        there = q.moved(x)
        along = there.coordinate_rate(x, there.rate(OMEGA))
        return jax.jvp(lambda x: q.moved(x).wxyz, (x,), (along,))[1], there.rate(OMEGA).wxyz

    turn = Quaternion.from_axis_angle(jnp.array([0.6, -0.48, 0.64]), jnp.array(1.3))
    half = jnp.array([0.6, -0.48, 0.64]) * np.tan(0.65)
    np.testing.assert_allclose(q.moved(2.0 * half).wxyz, q.then(turn).wxyz, atol=1e-15)
    for size in (0.0, 1e-9, 0.3, 0.33, 3.0, 5.0):
        np.testing.assert_allclose(*both(size * jnp.array([0.6, -0.48, 0.64])), atol=1e-14)


@pytest.mark.parametrize(("inner", "order"), [(Tsit5(), 5), (DOP853(), 8)])
def test_its_order_is_that_of_the_inner_method(inner, order):
    end = exact(2.0)

    @jax.jit
    def error(steps):
        h, method = 2.0 / steps, MuntheKaas(inner)
        term = diffrax.ODETerm(lambda t, y, args: BODY.vector_field(t, y))

        def go(n, y):
            return method.step(term, n * h, (n + 1) * h, y, None, None, jnp.array(False))[0]

        return jnp.max(
            jnp.abs(jax.lax.fori_loop(0, steps.astype(int), go, start(OMEGA)).attitude.wxyz - end)
        )

    assert np.log2(error(jnp.array(4.0)) / error(jnp.array(8.0))) > order - 0.7


def test_free_rotation_and_unit_length_over_a_long_run():
    """Over a thousand revolutions of the body, and states between the steps."""
    ts = jnp.linspace(0.0, 6e3, 3)
    run = simulate(BODY, start(OMEGA), ts, accuracy=by(1e-10, max_steps=65536))
    expected = np.stack([exact(float(t)) for t in ts], axis=-1)
    # 1e-10 in each of some thousands of steps, and an error of the rate grows with the time.
    np.testing.assert_allclose(run.states.attitude.wxyz, expected, atol=1e-5)
    norms = jnp.sqrt(jnp.sum(run.states.attitude.wxyz**2, axis=0))
    np.testing.assert_allclose(norms, 1.0, atol=4e-16)
    assert run.stats["steps"] > 3000
    assert run.status == Status.COMPLETED


def one_step(omega):
    method, term = MuntheKaas(Tsit5()), diffrax.ODETerm(lambda t, y, args: BALL.vector_field(t, y))
    return method.step(
        term, jnp.zeros(()), jnp.array(0.05), start(omega), None, None, jnp.array(False)
    )[0].attitude


def whole_run(omega):
    accuracy = Accuracy(rtol=1e-9, method=MuntheKaas(Tsit5()))
    return simulate(BALL, start(omega), jnp.array([0.0, 0.05]), accuracy=accuracy).final.attitude


@pytest.mark.sweep
@pytest.mark.parametrize("mode", [jax.jacrev, jax.jacfwd])
@pytest.mark.parametrize("way", [one_step, whole_run])
def test_derivatives_forwards_and_reverse(way, mode):
    """Of a ball, whose turn is q exp(omega t / 2)."""

    def turned(omega):
        return start(omega).attitude.then(Quaternion.from_rotation_vector(0.05 * omega)).wxyz

    found = jax.jit(mode(lambda omega: way(omega).wxyz))(OMEGA)
    np.testing.assert_allclose(found, jax.jit(jax.jacfwd(turned))(OMEGA), atol=1e-9)

"""Steps on the group of rotations: their order, the unit length, the free rotation in closed form, derivatives."""

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

BODY = TorqueFreeBody([3.0, 2.0, 1.0])


def start(omega):
    return BodyState(attitude=Quaternion(jnp.array([0.5, -0.5, 0.1, 0.7])).normalised(), omega=omega)


OMEGA = jnp.array([0.4, 0.9, 0.3])


def by(rtol=1e-9, **more):
    return Accuracy(rtol=rtol, method=MuntheKaas(), **more)


def test_the_rate_of_the_coordinates_is_that_of_the_turn():
    """The derivative of q exp(x/2) along the coordinate rate is the rate of q, for small and large x, at zero, too."""
    q = start(OMEGA).attitude

    @jax.jit
    def both(x):
        there = q.moved(x)
        along = q.coordinate_rate(x, there.rate(OMEGA))
        return jax.jvp(lambda x: q.moved(x).wxyz, (x,), (along,))[1], there.rate(OMEGA).wxyz

    for size in (0.0, 1e-9, 0.3, 0.33, 3.0, 5.0):
        np.testing.assert_allclose(*both(size * jnp.array([0.6, -0.48, 0.64])), atol=1e-14)


@pytest.mark.parametrize(("inner", "order"), [(Tsit5(), 5), (DOP853(), 8)])
def test_its_order_is_that_of_the_inner_method(inner, order):
    exact = BODY.flow(2.0, start(OMEGA)).attitude.wxyz

    @jax.jit
    def error(steps):
        h, method = 2.0 / steps, MuntheKaas(inner)
        term = diffrax.ODETerm(lambda t, y, args: BODY.vector_field(t, y))
        go = lambda n, y: method.step(term, n * h, (n + 1) * h, y, None, None, jnp.array(False))[0]  # noqa: E731
        return jnp.max(jnp.abs(jax.lax.fori_loop(0, steps.astype(int), go, start(OMEGA)).attitude.wxyz - exact))

    assert np.log2(error(jnp.array(4.0)) / error(jnp.array(8.0))) > order - 0.7


def test_free_rotation_and_unit_length_over_a_long_run():
    """Over a thousand revolutions of the body, and states between the steps."""
    ts = jnp.linspace(0.0, 6e3, 3)
    run = simulate(BODY, start(OMEGA), ts, accuracy=by(1e-10))
    exact = jnp.stack([BODY.flow(t, start(OMEGA)).attitude.wxyz for t in ts])
    np.testing.assert_allclose(run.states.attitude.wxyz, exact, atol=1e-5)  # 1e-10 of each step, over a time that stretches
    norms = jnp.sqrt(jnp.sum(run.states.attitude.wxyz**2, axis=-1))
    np.testing.assert_allclose(norms, 1.0, atol=4e-16)
    assert run.stats["steps"] > 3000
    assert run.status == Status.COMPLETED


def test_derivatives_forwards_and_reverse():
    """Of a ball, whose turn is q exp(omega t / 2)."""

    def end(omega, **more):
        accuracy = Accuracy(rtol=1e-8, method=MuntheKaas(Tsit5()), **more)
        run = simulate(TorqueFreeBody([2.0, 2.0, 2.0]), start(omega), jnp.array([0.0, 5.0]), accuracy=accuracy)
        return jnp.sum(run.final.attitude.wxyz**3)

    turned = lambda omega: start(omega).attitude.then(Quaternion.from_rotation_vector(5.0 * omega))  # noqa: E731
    exact = jax.jacfwd(lambda omega: jnp.sum(turned(omega).wxyz ** 3))(OMEGA)
    np.testing.assert_allclose(jax.grad(end)(OMEGA), exact, atol=1e-7)
    forward = jax.jvp(lambda omega: end(omega, adjoint=diffrax.ForwardMode()), (OMEGA,), (OMEGA,))[1]
    np.testing.assert_allclose(forward, exact @ OMEGA, atol=1e-7)

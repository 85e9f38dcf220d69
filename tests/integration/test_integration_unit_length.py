"""Quaternions of a run have unit length to rounding, whatever the method, and so have their
derivatives: against the closed form of the free rotation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Status, simulate
from jaxspace.solvers import DOP853, Tsit5

BODY = TorqueFreeBody([3.0, 2.0, 1.0])
OMEGA = jnp.array([0.4, 0.9, 0.3])
Q0 = jnp.array([0.5, -0.5, 0.1, 0.7])


def start(wxyz, omega=OMEGA):
    return BodyState(attitude=Quaternion(wxyz), omega=omega)


def off_unit(wxyz):
    return np.max(np.abs(np.sum(np.asarray(wxyz, np.longdouble) ** 2, axis=0) - 1.0))


@pytest.fixture(scope="module")
def run():
    """Runs by DOP853: one program for every duration, tolerance and longest step."""

    @jax.jit
    def integrate(duration, rtol, max_step):
        accuracy = Accuracy(rtol=rtol, method=DOP853(), max_step=max_step, max_steps=2**18)
        ts = duration * jnp.array([0.0, 0.377, 1.0])
        return simulate(BODY, start(Q0), ts, accuracy=accuracy, throw=False)

    return integrate


@pytest.mark.parametrize(
    ("duration", "rtol", "max_step", "error"),
    [
        # Rounding alone, by a hundred thousand steps: 3e-14 off without a projection.
        (4e3, 1e-9, 0.04, 1e-9),
        # The error of each step, which the phase adds up: 1.5e-6 off without a projection.
        (4e3, 1e-7, 1e9, 2e-2),
    ],
)
def test_unit_length_over_many_steps(run, duration, rtol, max_step, error):
    result = run(duration, rtol, max_step)
    assert result.status == Status.COMPLETED
    assert result.stats["steps"] > (99_000 if max_step < 1.0 else 500)
    # Three roundings of a square and of the root.
    assert off_unit(result.states.attitude.wxyz) < 1e-15
    flow = jax.jit(lambda t: BODY.closed_form().flow(t, start(Q0)).attitude.normalised())
    for k, t in enumerate(result.ts):
        expected = flow(t).wxyz
        np.testing.assert_allclose(result.states.attitude.wxyz[:, k], expected, atol=error)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("method", "rtol", "error"), [(Tsit5(), 1e-9, 1e-7), (DOP853(), 1e-11, 1e-9)]
)
def test_derivatives_are_those_of_the_turn(method, rtol, error):
    """By the components of the initial quaternion, of length 1, and by the angular velocity, in
    both modes, along effectively random directions.

    The flow is linear in the quaternion, q_1 = q_0 turn(t). A change of its length turns nothing:
    it changes no state of a run but the given one."""
    q0 = Q0 / jnp.sqrt(jnp.sum(Q0**2))
    ts = jnp.array([0.0, 2.0, 5.0])
    d_q, d_omega = jnp.array([0.3, -0.8, 0.5, 0.9]), jnp.array([-0.2, 0.7, 0.4])
    weights = jnp.array([[0.4, -0.1], [0.8, 0.2], [-0.6, 0.9], [0.1, -0.7]])

    def integrated(q, omega):
        accuracy = Accuracy(rtol=rtol, method=method)
        return simulate(BODY, start(q, omega), ts, accuracy=accuracy).states.attitude.wxyz[:, 1:]

    def exact(q, omega):
        flow = BODY.closed_form().flow
        states = [flow(t, start(q, omega)).attitude.wxyz for t in ts[1:]]
        return jnp.stack(states, axis=-1)

    across = jnp.eye(4) - jnp.outer(q0, q0)
    exact_by_q, exact_by_omega = jax.jit(jax.jacfwd(exact, argnums=(0, 1)))(q0, OMEGA)
    exact_by_q = exact_by_q @ across
    _, forward = jax.jit(lambda *d: jax.jvp(integrated, (q0, OMEGA), d))(d_q, d_omega)
    np.testing.assert_allclose(forward, exact_by_q @ d_q + exact_by_omega @ d_omega, atol=error)
    by_q, by_omega = jax.jit(lambda w: jax.vjp(integrated, q0, OMEGA)[1](w))(weights)
    np.testing.assert_allclose(by_q, jnp.tensordot(weights, exact_by_q, 2), atol=error)
    np.testing.assert_allclose(by_omega, jnp.tensordot(weights, exact_by_omega, 2), atol=error)

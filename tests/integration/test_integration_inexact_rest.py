"""Derivatives at equilibria that are not exact in floating-point numbers, where the motion is the
growth of a rounding error: by the matrix exponential of the linear motion about them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from restricted import EARTH_MOON, Place, RestrictedBody, lagrange_points, linearised
from scipy.linalg import expm

from jaxspace import (
    Accuracy,
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.attitude import Top
from jaxspace.bodies import Load
from jaxspace.mechanics import SimplePendulum
from jaxspace.scene import Custom
from jaxspace.solvers import DOP853, Tsit5

POINTS = lagrange_points(EARTH_MOON)
# Of unstable points about one time in which a change grows by e^6, of stable ones two periods.
SPANS = np.array([2.5, 3.0, 6.0, 15.0, 15.0])
BODY = RestrictedBody(jnp.asarray(EARTH_MOON))
# A step may leave thirty tolerances before the run is repeated, and a few more of its neighbours
# that are longer. These runs take up to a hundred steps, of which the last few count.
STEPS = 1e3


def truth(point: int, span: float) -> np.ndarray:
    return expm(linearised(POINTS[:, point], EARTH_MOON) * span)


def batch_slopes(method):
    """The derivatives of all points of a batch by where each starts, (4, 4, runs), in both modes;
    and what the batch gives for the tolerance."""

    @jax.jit
    def slopes(r, spans, rtol):
        def final(z):
            ts = jnp.stack([jnp.zeros_like(spans), spans])
            accuracy = Accuracy(rtol, method=method)
            y = simulate_batch(BODY, Place(z[:2], z[2:]), ts, accuracy=accuracy).final
            return jnp.concatenate([y.r, y.v])

        z = jnp.concatenate([r, jnp.zeros_like(r)])
        _, push = jax.linearize(final, z)
        pull = jax.linear_transpose(push, z)
        rows = jnp.broadcast_to(jnp.eye(4)[..., None], (4, *z.shape))
        return jax.vmap(push)(rows).swapaxes(0, 1), jax.vmap(lambda row: pull(row)[0])(rows)

    return slopes


@pytest.mark.parametrize("method", [DOP853(), Tsit5()], ids=lambda m: type(m).__name__)
def test_lagrange_points_of_earth_and_moon(method):
    """At the points, and next to them by a little more or less than the tolerance."""
    slopes = batch_slopes(method)
    right = np.stack([truth(k, SPANS[k]) for k in range(5)], axis=-1)
    for rtol in (1e-4, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12):
        for apart in (0.0, 1e-11):
            found = slopes(jnp.asarray(POINTS + apart), jnp.asarray(SPANS), rtol)
            size = np.max(np.abs(right), axis=(0, 1))
            for x in found:
                errors = np.max(np.abs(x - right), axis=(0, 1)) / size
                # The place itself is off by some roundings, or by this distance, and what it
                # becomes in the end by e^6 times as much, with the third derivative of U of 200.
                bound = STEPS * rtol + 200.0 * np.exp(6.0) * (apart + 1e-15)
                assert np.all(errors <= bound), (rtol, apart, errors)


def test_a_long_run_at_a_stable_point():
    """Of fifteen periods, in which a change stays as large as it is."""
    span = 100.0

    def final(z):
        y = Place(z[:2], z[2:])
        y = simulate(BODY, y, jnp.array([0.0, span]), accuracy=1e-9).final
        return jnp.concatenate([y.r, y.v])

    slopes = jax.jit(jax.jacfwd(final))(jnp.asarray([*POINTS[:, 3], 0.0, 0.0]))
    right = truth(3, span)
    np.testing.assert_allclose(slopes, right, atol=STEPS * 1e-9 * np.max(np.abs(right)))


def test_a_pendulum_on_its_head():
    """The sine of the number next to pi is 1e-16. A change grows as cosh(t)."""
    pendulum, span = SimplePendulum(1.0, 1.0), 8.0

    def angle(theta, rtol):
        ts = jnp.array([0.0, span])
        run = simulate(pendulum, pendulum.state(theta), ts, accuracy=Accuracy(rtol))
        return run.final.coordinates[0]

    slope_at = jax.jit(jax.grad(angle))
    for rtol in (1e-6, 1e-8, 1e-9, 1e-10, 1e-12):
        slope = slope_at(jnp.asarray(np.pi), rtol)
        np.testing.assert_allclose(slope, np.cosh(span), rtol=STEPS * rtol)


def test_a_sleeping_top():
    """Upright but for the roundings of its attitude: a tilt turns with the frequencies of the
    linear motion, A q'' - i C n q' - W q = 0 with q the tilt of the axis."""
    inertia, axial, weight, spin, span = 0.5, 0.3, 4.0, 12.0, 5.0
    top = Top(inertia, axial, weight)

    def tilt(small):
        y0 = Top.state(jnp.stack([0.0 * small, small, 0.0 * small]), jnp.array([0.0, 0.0, spin]))
        run = simulate(top, y0, jnp.array([0.0, span]), accuracy=1e-9)
        q0, q1, q2, q3 = run.final.attitude.wxyz
        return 2.0 * jnp.stack([q1 * q3 + q0 * q2, q2 * q3 - q0 * q1])

    slope = jax.jit(jax.jacfwd(tilt))(jnp.asarray(0.0))
    roots = np.roots([inertia, -1j * axial * spin, -weight])
    # From rest of the axis: the start has no rate across it.
    a = np.linalg.solve([[1.0, 1.0], roots], [1.0, 0.0])
    size = abs(np.sum(a * np.exp(roots * span)))
    np.testing.assert_allclose(np.hypot(*slope), size, rtol=STEPS * 1e-9)


def spring(rate):
    """A scene of a body that a spring holds at a place which is no number."""
    pull = lambda t, y, body: Load(acceleration_N=-(rate**2) * (y.position - 0.1) + 1e-17)  # noqa: E731
    return Scene([Custom(pull)])


def test_phases_and_events_at_an_inexact_rest():
    """A mission of two phases, and a run that ends at an event soon after its start, within the
    first step: of a body at rest at the end of a spring, by where it starts."""
    rate, span = 3.0, 4.0
    rest = jnp.full(3, 0.1) + 1e-17

    def final(x):
        y0 = BodyState(rest + x, jnp.zeros(3))
        mission = Mission([Phase(spring(rate), span, name="a"), Phase(spring(rate), span)])
        return simulate_mission(mission, y0, accuracy=1e-9).final.position[0]

    slope = jax.jit(jax.grad(final))(jnp.zeros(3))
    np.testing.assert_allclose(slope[0], np.cos(2.0 * rate * span), rtol=0.0, atol=STEPS * 1e-9)

    clock = Event(lambda t, y: t - 0.02 * span)

    def soon(x):
        y0 = BodyState(rest + x, jnp.zeros(3))
        ts = jnp.array([0.0, 100.0 * span])
        return simulate(spring(100.0 * rate), y0, ts, events=[clock], accuracy=1e-9).final.position

    slope = jax.jit(jax.jacfwd(soon))(jnp.zeros(3))
    right = np.cos(100.0 * rate * 0.02 * span)
    np.testing.assert_allclose(np.diag(slope), right, rtol=0.0, atol=STEPS * 1e-9)

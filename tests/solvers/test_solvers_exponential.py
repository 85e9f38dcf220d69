"""The exponential method: exact for linear motion, of order 5, right in slow motion beside a fast
one, and honest about it."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace.core import AbstractSystem
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.simulation import Accuracy, Status, simulate, simulate_batch
from jaxspace.solvers import ExponentialRosenbrock

METHOD = ExponentialRosenbrock()
EARTH_RATE = 7.2921e-5


class Swing(eqx.Module):
    """A deflection and its rate; of one or of several modes."""

    x: Array
    v: Array


class Modes(AbstractSystem):
    """Flexible modes of the frequencies w under a load that rises with time: x'' = -w^2 x - c x' +
    a t."""

    w: Array
    c: float
    a: float

    def vector_field(self, t, y):
        return Swing(y.v, -self.w * self.w * y.x - self.c * y.v + self.a * t)

    def invariants(self, t, y):
        return {}


class Pendulum(AbstractSystem):
    """x'' = -k sin(x) + 0.3 cos(1.7 t)."""

    k: Array

    def vector_field(self, t, y):
        return Swing(y.v, -self.k * jnp.sin(y.x) + 0.3 * jnp.cos(1.7 * t))

    def invariants(self, t, y):
        return {}


class Damped(AbstractSystem):
    """y' = -r (y^3 - cos(t)^3) - sin(t), whose solution from 1 is cos(t)."""

    r: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        return -self.r * (y**3 - jnp.cos(t) ** 3) - jnp.sin(t)

    def invariants(self, t, y):
        return {}


class CompassState(eqx.Module):
    """Heading and tilt of the rotor's axis, rad, and its inertial rates about the horizontal and
    across, rad/s."""

    psi: Array
    tilt: Array
    u: Array
    v: Array


class Gyrocompass(AbstractSystem):
    """A pendulous rotor of the transverse inertia A and the momentum H at the equator; the axes as
    in a two-gimbal gyro.

    n = H/A, rad/s: the fast rate; k = (weight moment)/H, rad/s. To first order a slow ellipse
    (Thomson 6.5)."""

    n: Float[Array, "*#runs"]
    k: float = 0.02

    def vector_field(self, t, y):
        s, c, north = jnp.sin(y.tilt), jnp.cos(y.tilt), EARTH_RATE * jnp.cos(y.psi)
        fast = self.n - (north + y.v * s) / c
        return CompassState(
            (y.v + north * s) / c,
            y.u - EARTH_RATE * jnp.sin(y.psi),
            fast * y.v - self.k * self.n * s,
            -fast * y.u,
        )

    def invariants(self, t, y):
        return {}

    def slow_rate(self):
        """The lesser root p of p^4 - (n^2 + (a + b) n) p^2 + a b n^2 = 0 with a = Omega, b = k +
        Omega (Thomson 6.5)."""
        a, b, n = EARTH_RATE, self.k + EARTH_RATE, float(self.n)
        middle = n * n + (a + b) * n
        return np.sqrt(
            2.0 * a * b * n * n / (middle + np.sqrt(middle * middle - 4.0 * a * b * n * n))
        )

    @staticmethod
    def start(psi, v=0.0):
        """At rest at the heading psi, but for a fast rate v."""
        return CompassState(*(jnp.asarray(x) for x in (psi, 0.0, EARTH_RATE * np.sin(psi), v)))


def by(rtol=1e-9, **more):
    return Accuracy(rtol=rtol, method=METHOD, **more)


@jax.jit
def one_step(system, y, h):
    term = diffrax.ODETerm(lambda t, y, args: system.vector_field(t, y))
    return METHOD.step(term, jnp.zeros(()), h, y, None, None, jnp.array(False))[:2]


def test_a_linear_system_is_exact_at_any_step():
    w, h = np.array([1e3, 37.0, 0.3]), 1.0
    y, error = one_step(
        Modes(jnp.array(w), 0.0, 2.0),
        Swing(jnp.array([1.0, 0.5, -1.0]), jnp.zeros(3)),
        jnp.array(h),
    )
    exact = np.array([1.0, 0.5, -1.0]) * np.cos(w * h) + 2.0 / w**2 * (h - np.sin(w * h) / w)
    # eps times the phase of 1e3 rad, and as much for the doublings.
    np.testing.assert_allclose(y.x, exact, atol=1e-12)
    assert jnp.max(jnp.abs(error.x)) < 1e-12
    overdamped = one_step(Modes(jnp.array(w), 1e6, 0.0), y, jnp.array(h))[0]
    np.testing.assert_allclose(
        overdamped.x, (y.x + y.v / 1e6) * np.exp(-(w**2) / 1e6 * h), rtol=1e-6
    )
    ts = jnp.array([0.0, 50.0])
    run = simulate(
        Modes(jnp.array(w), 0.0, 2.0),
        Swing(jnp.array([1.0, 0.5, -1.0]), jnp.zeros(3)),
        ts,
        accuracy=by(),
    )
    exact = np.array([1.0, 0.5, -1.0]) * np.cos(w * 50.0) + 2.0 / w**2 * (
        50.0 - np.sin(w * 50.0) / w
    )
    np.testing.assert_allclose(run.final.x, exact, rtol=1e-9)
    assert run.stats["steps"] < 20  # the first ones are short, and grow eightfold


def test_its_order_is_five():
    @jax.jit
    def error(steps):
        term = diffrax.ODETerm(lambda t, y, args: Damped(jnp.array(1.0)).vector_field(t, y))

        def go(n, y):
            return METHOD.step(term, n / steps, (n + 1) / steps, y, None, None, jnp.array(False))[0]

        return jnp.abs(jax.lax.fori_loop(0, steps.astype(int), go, jnp.array(1.0)) - jnp.cos(1.0))

    assert np.log2(error(jnp.array(5.0)) / error(jnp.array(10.0))) > 4.7


@pytest.mark.parametrize("rate", [1e2, 1e8])
def test_a_stiff_damped_system(rate):
    """However stiff it is: the steps are those of the solution."""
    run = simulate(
        Damped(jnp.array(rate)), jnp.array(1.0), jnp.array([0.0, 1.0]), accuracy=by(1e-8)
    )
    assert abs(run.final - np.cos(1.0)) < 3e-8
    assert run.stats["steps"] < 80


def test_a_gyrocompass_swings_slowly_beside_a_fast_rotor():
    """Over a period of some 5000 s, of a thousand to 1e5 rad/s of nutation: the steps do not know
    how fast that is."""
    for n in (1e3, 1e5):
        compass = Gyrocompass(jnp.array(n))
        period = 2.0 * np.pi / compass.slow_rate()
        ts = period * jnp.array([0.0, 0.25, 0.5, 1.0])
        run = simulate(compass, Gyrocompass.start(1e-3), ts, accuracy=by())
        # Not linear in the heading to the second order of 1e-3, and the root not exact to Omega /
        # n.
        np.testing.assert_allclose(
            run.states.psi, 1e-3 * np.array([1.0, 0.0, -1.0, 1.0]), atol=3e-9
        )
        assert run.stats["steps"] < 30
    wide = simulate(compass, Gyrocompass.start(0.3), ts, accuracy=by(1e-6))
    assert wide.stats["steps"] < 60


def test_the_slow_motion_is_that_of_a_run_that_resolves_the_fast_one():
    compass, ts = Gyrocompass(jnp.array(1e3)), jnp.array([0.0, 0.1, 0.2, 0.3])
    resolved = simulate(compass, Gyrocompass.start(0.3, 1e-3), ts, accuracy=1e-12)
    run = simulate(compass, Gyrocompass.start(0.3, 1e-3), ts, accuracy=by())
    assert run.stats["steps"] < 30 < 1000 < resolved.stats["steps"]
    for a, b in zip(jax.tree.leaves(run.final), jax.tree.leaves(resolved.final), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


def test_fast_motion_that_is_not_linear_is_seen():
    """A gimbal walks by the square of its nutation: what is too small to matter is passed over,
    what matters is resolved."""
    gyro = TwoGimbalGyro(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)
    ts = jnp.array([0.0, 40.0 * np.pi / gyro.nutation_frequency(1.05)])
    small, large, wild = (
        simulate(
            gyro,
            gyro.state(1.05, 0.0, rate, 0.0),
            ts,
            accuracy=by(1e-7, max_steps=700),
            throw=False,
        )
        for rate in (1e-5, 1.0, 20.0)
    )
    assert small.stats["steps"] < 50
    assert large.stats["steps"] > 200
    drift = gyro.walk(1.05, 1.0).drift
    assert (
        abs(large.final.psi / ts[-1] / drift - 1.0) < 1e-3
    )  # the nutations are whole only to the second order
    assert wild.status == Status.MAX_STEPS


def test_many_runs_and_times_backwards_are_single_runs():
    ts = jnp.linspace(1.0, 0.0, 3)
    run = simulate_batch(Damped(jnp.array([0.1, 2.0])), jnp.cos(jnp.ones(2)), ts, accuracy=by())
    np.testing.assert_allclose(run.states, jnp.cos(jnp.stack([ts, ts], axis=-1)), atol=1e-7)
    assert jnp.all(run.status == Status.COMPLETED)


@pytest.mark.sweep
def test_derivatives_forwards_and_reverse():
    h, start = jnp.array(0.7), Swing(jnp.array(1.0), jnp.array(0.2))

    def step(k):
        return one_step(Pendulum(k), start, h)[0].x

    difference = (step(jnp.array(4.0 + 1e-5)) - step(jnp.array(4.0 - 1e-5))) / 2e-5
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(mode(step)(jnp.array(4.0)), difference, rtol=1e-8)
    start, ts = Swing(jnp.ones(1), jnp.zeros(1)), jnp.array([0.0, 1.0])

    def end(w):
        return simulate(Modes(w, 0.0, 0.0), start, ts, accuracy=by()).final.x[0]

    np.testing.assert_allclose(jax.grad(end)(jnp.array([1e3])), [-np.sin(1e3)], atol=1e-10)


def test_an_implicit_method_of_diffrax_serves_too():
    run = simulate(
        Damped(jnp.array(1e6)),
        jnp.array(1.0),
        jnp.array([0.0, 1.0]),
        accuracy=Accuracy(rtol=1e-6, method=diffrax.Kvaerno5()),
    )
    assert abs(run.final - np.cos(1.0)) < 1e-5


def test_single_precision_stays_single():
    def one(x):
        return jnp.asarray(x, jnp.float32)

    run = simulate(
        Damped(one(1e4)), one(1.0), jnp.array([0.0, 1.0], jnp.float32), accuracy=by(1e-5)
    )
    assert run.final.dtype == jnp.float32
    assert abs(float(run.final) - np.cos(1.0)) < 3e-5

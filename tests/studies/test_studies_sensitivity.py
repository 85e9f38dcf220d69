"""State-transition matrices against closed forms, 40 digits and differences."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Accuracy, BodyState, Event, Mission, Phase, Scene, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.core import AbstractSystem, InputError
from jaxspace.orbits import PointGravity, TwoBody
from jaxspace.rotations import Quaternion
from jaxspace.solvers import Tsit5
from jaxspace.studies import Sensitivity, propagate_covariance, sensitivity
from jaxspace.studies._factors import Factors, factors_of

START = BodyState(jnp.array([1.0, 0.0, 0.1]), jnp.array([0.05, 1.1, 0.2]))
TS = np.array([0.0, 1.0, 3.0])
FINE = Accuracy(1e-10, method=Tsit5(), max_steps=512)


def kepler(y, mu, t):
    """Position and velocity a time `t` later on an ellipse, by Lagrange's coefficients."""
    r, v = mp.matrix(y[:3]), mp.matrix(y[3:])
    r0 = mp.sqrt(sum(x * x for x in r))
    a = 1 / (2 / r0 - sum(x * x for x in v) / mu)
    n = mp.sqrt(mu / a**3)
    s = sum(p * q for p, q in zip(r, v, strict=True)) / mp.sqrt(mu * a)
    c = 1 - r0 / a

    def equation(E):
        return E - c * mp.sin(E) + s * (1 - mp.cos(E)) - n * t

    E = mp.findroot(equation, n * t)
    f = 1 - a / r0 * (1 - mp.cos(E))
    g = t - (E - mp.sin(E)) / n
    ra = 1 - c * mp.cos(E) + s * mp.sin(E)
    f_dot, g_dot = -n * a / (r0 * ra) * mp.sin(E), 1 - (1 - mp.cos(E)) / ra
    return [*(f * r + g * v), *(f_dot * r + g_dot * v)]


def kepler_derivatives(t):
    """First and second derivatives by (position, velocity, mu), by differences with 60 digits."""
    with mp.workdps(60):
        h = mp.mpf(10) ** -15
        p = [mp.mpf(float(x)) for x in [*START.position, *START.velocity, 1.0]]

        def at(*moves):
            q = list(p)
            for k, step in moves:
                q[k] += step
            return np.array(kepler(q[:6], q[6], mp.mpf(t)))

        first = [(at((k, h)) - at((k, -h))) / (2 * h) for k in range(7)]
        second = np.zeros((6, 7, 7))
        for j in range(7):
            for k in range(j + 1):
                corners = at((j, h), (k, h)) - at((j, h), (k, -h)) - at((j, -h), (k, h))
                second[:, j, k] = (corners + at((j, -h), (k, -h))) / (4 * h * h)
                second[:, k, j] = second[:, j, k]
        return np.array(first, float).T, second


def by_start_and_mu(system, y0):
    return y0, system.mu if isinstance(system, TwoBody) else system.effects[0].mu


@pytest.fixture(scope="module")
def exact():
    return kepler_derivatives(3.0)


def test_transition_matrices_of_kepler(exact):
    """Of the closed form, and of the orbit as it is integrated."""
    first, second = exact
    run, found = sensitivity(TwoBody(1.0), START, TS, wrt=by_start_and_mu, order=2)
    assert found.columns == (*found.rows, "mu")
    assert found.rows[:2] == ("position[0]", "position[1]")
    assert_allclose(found.final, first, atol=1e-12)
    assert_allclose(found.second[..., -1], second, atol=1e-10)
    assert_allclose(found.first[:, :6, 0], np.eye(6), atol=1e-15)
    # What the matrices are for: the third order is left.
    x = 1e-4 * np.array([1.0, -2.0, 0.5, 1.0, -1.0, 0.3, 0.2])
    moved = BodyState(START.position + x[:3], START.velocity + x[3:6])
    there = simulate(TwoBody(1.0 + x[6]), moved, TS)
    change = found.change(x)
    assert_allclose(change[:3], there.states.position - run.states.position, atol=1e-9)


def test_transition_matrix_of_an_integrated_batch(exact):
    factor = jnp.array([1.0, 1.01, 0.99])
    y0s = BodyState(START.position[:, None] * factor, START.velocity[:, None] * factor)
    scene = Scene([PointGravity(1.0)])
    run, found = sensitivity(scene, y0s, TS, wrt=by_start_and_mu, batch=True, accuracy=FINE)
    assert found.first.shape == (6, 7, 3, 3)
    # The tolerance of the run, and the growth of an error over half a revolution.
    assert_allclose(found.final[..., 0], exact[0], atol=1e-8)
    # Symplectic, of every run, at every time.
    phi = np.moveaxis(found.first[:, :6], (0, 1), (-2, -1))
    form = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    assert_allclose(
        np.swapaxes(phi, -1, -2) @ form @ phi, np.broadcast_to(form, phi.shape), atol=1e-7
    )


class Falling(AbstractSystem):
    """A point that falls: z'' = -g."""

    g: jax.Array

    def vector_field(self, t, y):
        return {"z": y["v"], "v": -self.g + 0.0 * y["z"]}

    def invariants(self, t, y):
        return {}


class Bounce(AbstractSystem):
    """The jump v -> -e v."""

    e: jax.Array

    def vector_field(self, t, y):
        raise NotImplementedError

    def invariants(self, t, y):
        return {}

    def __call__(self, t, y):
        return {"z": y["z"], "v": -self.e * y["v"]}


def test_first_and_second_order_through_a_bounce():
    """Fall, landing, jump, flight of a given length: the derivatives of the closed form."""
    landing = Event(lambda t, y: y["z"], direction=-1, within=5.0)

    def mission(p):
        first = Phase(Falling(p["g"]), landing, Bounce(p["e"]), "fall")
        return Mission([first, Phase(Falling(p["g"]), p["t"], name="flight")])

    p = {"e": jnp.array(0.8), "g": jnp.array(1.7), "t": jnp.array(0.6)}
    y0 = {"v": jnp.array(0.3), "z": jnp.array(2.0)}

    def closed(x):
        v, z, e, g, t = x
        impact = jnp.sqrt(v * v + 2.0 * g * z)
        after = e * impact
        end = jnp.stack([after - g * t, after * t - 0.5 * g * t * t])
        return jnp.append(end, (v + impact) / g + t), jnp.append(-impact, (v + impact) / g)

    def wrt(m, y):
        one, two = m.phases
        return y, one.then.e, two.until

    run, found = sensitivity(mission(p), y0, wrt=wrt, order=2, accuracy=FINE)
    x = jnp.array([0.3, 2.0, 0.8, 1.7, 0.6])
    # g stands in two phases, which `wrt` picks apart: it is left out here.
    keep = np.array([0, 1, 2, 4])
    first, second = jax.jit(lambda x: (jax.jacfwd(closed)(x), jax.hessian(closed)(x)))(x)
    first, second = ([np.asarray(part) for part in parts] for parts in (first, second))
    assert_allclose(found.end.final, first[0][:2, keep], atol=1e-9)
    assert_allclose(found.end.times[:, -1], first[0][2, keep], atol=1e-9)
    assert_allclose(found.end.second[..., -1], second[0][:2][:, keep][:, :, keep], atol=1e-7)
    fall = found["fall"]
    assert_allclose(fall.final[0], first[1][0, keep], atol=1e-9)
    # On the ground whatever changes.
    assert_allclose(fall.final[1], 0.0, atol=1e-10)
    assert_allclose(fall.times[:, -1], first[1][1, keep], atol=1e-9)
    assert_allclose(fall.second[0, ..., -1], second[1][0][np.ix_(keep, keep)], atol=1e-7)
    assert run.end.shape == ()


def test_attitude_counts_three_coordinates_on_both_sides():
    omega = jnp.array([0.4, -0.3, 0.5])
    y0 = BodyState(attitude=Quaternion.identity(), omega=omega)
    sphere = TorqueFreeBody(jnp.array([1.0, 1.0, 1.0]))
    run, found = sensitivity(sphere, y0, np.array([0.0, 2.0]))
    assert len(found.rows) == 6 and found.rows[0] == "attitude[0]"
    # A sphere turns uniformly: the error turns back with the body.
    back = run.final.attitude.inverse().matrix()
    assert_allclose(found.final[:3, :3], back, atol=1e-12)
    assert_allclose(found.final[3:], np.eye(6)[3:], atol=1e-12)
    P = np.diag([1e-4, 2e-4, 3e-4, 0.0, 0.0, 0.0])
    assert_allclose(found.covariance(P)[:3, :3, -1], back @ P[:3, :3] @ back.T, atol=1e-14)


def test_covariance_of_brownian_motion_and_of_an_orbit():
    """Against the integral of white noise in the velocity, and against Phi P Phi^T."""
    t, q = 2.0, 3e-4
    P0 = np.diag([1e-3, 2e-3])
    falling = Falling(jnp.array(1.7))
    start = {"v": jnp.array(0.3), "z": jnp.array(2.0)}
    # Of the velocity, then of the height, in the order of the fields.
    _, P = propagate_covariance(falling, start, np.array([0.0, t]), P0, noise=np.diag([q, 0.0]))
    expected = [[1e-3 + q * t, 1e-3 * t + q * t**2 / 2]]
    expected += [[expected[0][1], 2e-3 + 1e-3 * t * t + q * t**3 / 3]]
    assert_allclose(P[..., -1], expected, rtol=1e-9)

    P0 = np.diag([1.0, 2.0, 3.0, 1.0, 1.0, 2.0]) * 1e-6
    _, P = propagate_covariance(TwoBody(1.0), START, TS, P0, accuracy=FINE)
    _, found = sensitivity(TwoBody(1.0), START, TS)
    assert_allclose(P, found.covariance(P0), atol=1e-13)


def test_covariance_of_an_attitude():
    """Noise in the rate of a spinning body: the error turns with its axes."""
    rate, q, t = 0.7, 1e-4, 3.0
    y0 = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.0, 0.0, rate]))
    sphere = TorqueFreeBody(jnp.array([1.0, 1.0, 1.0]))
    P0 = np.diag([1e-3, 2e-3, 3e-3, 0.0, 0.0, 0.0])
    Q = np.diag([q, q, q, 0.0, 0.0, 0.0])
    ts = np.array([0.0, t])
    _, P = propagate_covariance(sphere, y0, ts, P0, noise=Q, accuracy=FINE)
    c, s = np.cos(rate * t), np.sin(rate * t)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    expected = back @ P0[:3, :3] @ back.T + q * t * np.eye(3)
    assert_allclose(P[:3, :3, -1], expected, atol=1e-11)


def test_covariance_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"must be \(6, 6\) for position\[0\]"):
        propagate_covariance(TwoBody(1.0), START, TS, np.eye(5))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"order": 3}, "order is 3"),
        ({"wrt": lambda s, y: ()}, "must return a pytree of arrays"),
        ({"wrt": lambda s, y: 2.0}, "must return a pytree of arrays"),
    ],
)
def test_wrong_calls(change, sentence):
    with pytest.raises(InputError, match=sentence):
        sensitivity(TwoBody(1.0), START, TS, **change)


def test_a_covariance_of_sums_of_squares():
    """Random covariances of full and of less rank are their factors, of which no weight is
    negative; what maps a state that is known exactly has a variance that is not negative."""
    rng = np.random.default_rng(4)
    for rank in (0, 1, 3, 5):
        A = rng.normal(size=(5, rank)) * np.logspace(0.0, 8.0, 5)[:, None]
        P = A @ A.T
        U, D = factors_of(jnp.asarray(P))
        assert np.all(D >= 0.0)
        size = np.sqrt(np.where(np.diag(P) > 0.0, np.diag(P), 1.0))
        scaled = (Factors(U, D).product - P) / np.outer(size, size)
        assert_allclose(scaled, 0.0, atol=1e-13)
    # All of the variance is along x, and none across.
    for x in rng.normal(size=(50, 2)):
        first = jnp.asarray([[x[1], -x[0]], [1.0, 1.0]])[..., None]
        found = Sensitivity(("a", "b"), ("a", "b"), first, None, jnp.zeros((2, 1)))
        P = found.covariance(np.outer(x, x) * 1e12)
        assert P[0, 0, 0] >= 0.0
        assert_allclose(P[1, 1, 0], x.sum() ** 2 * 1e12, rtol=1e-9)
    # Phi^2, also at a variance of zero.
    slope = jax.grad(lambda p: found.covariance(jnp.diag(p))[0, 0, 0])(jnp.zeros(2))
    assert_allclose(slope, found.first[0, :, 0] ** 2, rtol=1e-14)

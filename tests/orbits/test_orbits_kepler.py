"""Kepler's problem in closed form: published states, 60-digit references, conserved quantities,
derivatives."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxspace.bodies import BodyState
from jaxspace.core import InputError
from jaxspace.core.special import stumpff
from jaxspace.orbits import TwoBody
from jaxspace.orbits.elements import eccentricity_vector, specific_energy
from jaxspace.orbits.kepler import kepler_flow

EPS = np.finfo(float).eps
flow = jax.jit(kepler_flow)


def _packed(y):
    """(r, v, t, mu) -> (r', v') as flat arrays."""
    return jnp.concatenate(kepler_flow(y[:3], y[3:6], y[6], y[7]))


packed = jax.jit(_packed)
forward = jax.jit(jax.jacfwd(_packed))
reverse = jax.jit(jax.jacrev(_packed))
gradient = jax.jit(
    jax.grad(lambda y: jnp.sum(_packed(y) * jnp.array([1.0, -2.0, 0.5, 0.3, 1.0, -1.0])))
)
gradient_change = jax.jit(lambda y, direction: jax.jvp(gradient, (y,), (direction,))[1])


# References in 60 digits
# -------------------------------------------------------------------------------------------------


def exact_stumpff(z):
    if abs(z) < mp.mpf(10) ** -6:
        return [mp.fsum((-z) ** k / mp.factorial(2 * k + n) for k in range(9)) for n in range(6)]
    s = mp.sqrt(mp.mpc(z))
    c0, c1 = mp.cos(s).real, (mp.sin(s) / s).real
    c2, c3 = (1 - c0) / z, (1 - c1) / z
    return [c0, c1, c2, c3, (mp.mpf(1) / 2 - c2) / z, (mp.mpf(1) / 6 - c3) / z]


def exact_flow(r, v, t, mu=1.0):
    """What `exact_digits` finds, in doubles."""
    end = exact_digits(*(mp.mpf(float(x)) for x in (*r, *v, t, mu)))
    return np.array(end[:3], float), np.array(end[3:], float)


def exact_jacobian(y):
    """Derivatives of the final state, (6, 8), by central differences in 60 digits: truncation is at
    1e-36."""
    with mp.workdps(60):
        y, columns = [mp.mpf(float(x)) for x in y], []
        for i in range(8):
            step = mp.mpf(10) ** -18 * (abs(y[i]) + mp.mpf("1e-3"))
            up, down = (exact_digits(*y[:i], y[i] + s * step, *y[i + 1 :]) for s in (1, -1))
            columns.append([float((a - b) / (2 * step)) for a, b in zip(up, down, strict=True)])
        return np.array(columns).T


def exact_digits(x, y, z, vx, vy, vz, t, mu):
    """Universal variables in 60 digits: the root bracketed, then Newton held inside the bracket."""
    with mp.workdps(60):
        r, v = [x, y, z], [vx, vy, vz]
        r0 = mp.sqrt(mp.fsum(x * x for x in r))
        alpha = 2 * mu / r0 - mp.fsum(x * x for x in v)
        if alpha > 0:
            period = 2 * mp.pi * mu / alpha ** mp.mpf("1.5")
            t -= period * mp.nint(t / period)
        sign = -1 if t < 0 else 1
        t, v = sign * t, [sign * x for x in v]
        eta = mp.fsum(x * y for x, y in zip(r, v, strict=True))

        def parts(chi):
            c = exact_stumpff(alpha * chi * chi)
            g = [chi**n * c[n] for n in range(4)]
            return g, r0 * g[1] + eta * g[2] + mu * g[3] - t, r0 * g[0] + eta * g[1] + mu * g[2]

        low, high = mp.mpf(0), mp.mpf("1e-3")
        while parts(high)[1] < 0:
            low, high = high, 2 * high
        chi = (low + high) / 2
        for _ in range(200):
            _, late, radius = parts(chi)
            low, high = (low, chi) if late > 0 else (chi, high)
            new = chi - late / radius
            new = new if low <= new <= high else (low + high) / 2
            done = abs(new - chi) <= abs(new) * mp.mpf(10) ** -45
            chi = new
            if done:
                break
        g, _, radius = parts(chi)
        f, gt, fd, gd = (
            1 - mu * g[2] / r0,
            t - mu * g[3],
            -mu * g[1] / (r0 * radius),
            1 - mu * g[2] / radius,
        )
        position = [f * x + gt * y for x, y in zip(r, v, strict=True)]
        return position + [sign * (fd * x + gd * y) for x, y in zip(r, v, strict=True)]


def _scale(y):
    return np.r_[
        np.repeat(np.linalg.norm(y[:3]), 3), np.repeat(np.linalg.norm(y[3:6]), 3), abs(y[6]), y[7]
    ]


def condition(jacobian, y, position):
    """How much relative changes of the input grow into the relative change of the final
    position."""
    return np.linalg.norm(np.asarray(jacobian)[:3] * _scale(y)) / np.linalg.norm(position)


def relative(a, b):
    return np.linalg.norm(np.asarray(a) - np.asarray(b)) / np.linalg.norm(b)


def conics(n, seed):
    """Mixed conics: circular to nearly radial, parabolic to strongly hyperbolic, in any plane, from
    any place on them."""
    g = np.random.default_rng(seed)
    small, kind = 10.0 ** g.uniform(-12, -1, n), g.integers(0, 7, n)
    e = np.choose(
        kind,
        [
            g.uniform(0, 1, n),
            1 - small,
            1 + small,
            g.uniform(1, 10, n),
            small,
            10 ** g.uniform(0, 3, n),
            np.ones(n),
        ],
    )
    p = 10.0 ** g.uniform(-3, 3, n) * (1 + e)
    f = g.uniform(-1, 1, n) * np.where(e < 1, np.pi, 0.98 * np.arccos(-1 / np.maximum(e, 1)))
    r = p / (1 + e * np.cos(f))
    axes = np.linalg.qr(g.normal(size=(n, 3, 3)))[0]
    towards, ahead = axes[:, :, 0].T, axes[:, :, 1].T
    position = r * (np.cos(f) * towards + np.sin(f) * ahead)
    velocity = (-np.sin(f) * towards + (e + np.cos(f)) * ahead) / np.sqrt(p)
    return position, velocity, r * np.sqrt(r) * 10.0 ** g.uniform(-4, 2, n) * g.choice([-1, 1], n)


# Published
# -------------------------------------------------------------------------------------------------

PUBLISHED = {
    "T4.7-prop": (
        1.0,
        [0.07101070107664505, -0.8685945045241555, -0.3128395879460718],
        [0.9466937972916112, -0.44387476077365373, -0.7149505694706483],
        7.0,
        [2.6328567427617666, 0.7190419078867906, -1.3821388029536763],
        [-0.033373111175825726, 0.2912336603265128, 0.1107239993271165],
        1e-9,
    ),
    "T4.7-long": (
        1.0,
        [0.1, 0.0, 0.0],
        [0.0, 4.358898943540674, 0.0],
        630.2034863101126,
        [-1.6735862936835715, 0.2762194902296612, 0.0],
        [-0.3735883949633199, -0.19879315431612016, 0.0],
        1e-6,
    ),
    "KEP-VALLADO-2-4": (
        398600.4418,
        [1131.34, -2282.343, 6672.423],
        [-5.64305, 4.30333, 2.42879],
        2400.0,
        [-4219.752737795692202804038, 4363.029177180831587503165, -3958.766616602979215425503],
        [3.689866025052512784214547, -1.916734777087304878429446, -6.112511100000716179475792],
        1e-12,
    ),
    "KEP-CURTIS-3-5": (
        398600.4418,
        [6678.1366, 0.0, 0.0],
        [0.0, 15.0, 0.0],
        14941.0,
        [-49827.08747503578446870125, 155383.7426021007671929515, 0.0],
        [-3.789107546307230030417666, 9.805784111139828359286207, 0.0],
        1e-12,
    ),
}


@pytest.mark.parametrize("case", PUBLISHED)
def test_published_states(case):
    mu, r, v, t, r1, v1, tolerance = PUBLISHED[case]
    for found, expected in zip(flow(jnp.array(r), jnp.array(v), t, mu), (r1, v1), strict=True):
        size = np.linalg.norm(expected)
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * size)


DETEST = {
    0.1: [0.2198835352008397, 0.9427076846341813, -0.9787659841058176, 0.3287977990962036],
    0.3: [-0.1777027357140412, 0.9467784719905892, -1.030294163192969, 0.1211074890053952],
    0.5: [-0.5780432953035362, 0.8633840009194192, -0.9595083730380727, -0.0650491512671209],
    0.7: [-0.9538990293416394, 0.6907409024219432, -0.8212674270877433, -0.1539574259125825],
    0.9: [-1.295266250987574, 0.4003938963792321, -0.6775390924707566, -0.1270838154278686],
}


@pytest.mark.parametrize("e", DETEST)
def test_detest_d1_to_d5(e):  # ODE-DETEST-D1..D5
    start = BodyState(
        position=jnp.array([1 - e, 0.0, 0.0]),
        velocity=jnp.array([0.0, np.sqrt((1 + e) / (1 - e)), 0.0]),
    )
    end = TwoBody(1.0).closed_form().flow(20.0, start)
    np.testing.assert_allclose(
        np.r_[end.position[:2], end.velocity[:2]], DETEST[e], rtol=0, atol=1e-10
    )


def from_periapsis(e, q, t):
    """The state a time t after the periapsis of radius q, mu = 1, in the plane of the orbit."""
    return flow(jnp.array([q, 0.0, 0.0]), jnp.array([0.0, np.sqrt((1 + e) / q), 0.0]), t, 1.0)


@pytest.mark.parametrize(
    ("e", "mean", "psi"),
    [  # T4.13-21
        (0.1, 1.0, 1.0885977523978936),
        (0.5, 2.5, 2.7094216109276945),
        (0.9, 0.1, 0.6308435275631534),
        (0.99, 0.01, 0.34227031649177514),
        (0.999, 0.001, 0.17085095632357902),
        (0.99999, 1e-6, 0.017072121484618886),
    ],
)
def test_eccentric_anomaly(e, mean, psi):
    position, _ = from_periapsis(e, 1 - e, mean)
    eccentric = np.arctan2(position[1] / np.sqrt(1 - e * e), position[0] + e)
    assert eccentric == pytest.approx(psi, abs=1e-11)


@pytest.mark.parametrize(
    ("e", "q", "time", "theta"),
    [
        (2.5, 1.5, 1.9111308362334984, np.radians(70)),  # T4.13-13
        (0.999999, 1 / 1.999999, 1.7320501147498903, np.radians(120)),  # T4.13-par
        (1.0, 0.5, 1.7320508075688772, np.radians(120)),
        (1.000001, 1 / 2.000001, 1.7320515003905366, np.radians(120)),
    ],
)
def test_true_anomaly_at_time(e, q, time, theta):
    position, _ = from_periapsis(e, q, time)
    assert np.arctan2(position[1], position[0]) == pytest.approx(theta, rel=1e-9)


@pytest.mark.parametrize(
    ("e", "eccentric", "true"),
    [
        (0.05, 10.52321, 11.05994),
        (0.1, 54.67466, 59.4981),
        (0.35, 142.27123, 153.32411),
        (0.61, 161.87359, 171.02189),
    ],
)
def test_anomalies_of_nasa_tr_r_158(e, eccentric, true):  # ANG-NASA-TR-R-158
    psi = np.radians(eccentric)
    position, _ = from_periapsis(e, 1 - e, psi - e * np.sin(psi))
    assert np.degrees(np.arctan2(position[1], position[0])) == pytest.approx(true, rel=1e-6)


# Hostile states against 60 digits
# -------------------------------------------------------------------------------------


def _tangential(e, t):
    return [1, 0, 0, 0, np.sqrt(1 + e), 0, t]


HOSTILE = {
    f"e={e!r} t={t}": _tangential(e, t)
    for e in (0.0, 1 - 1e-12, 1.0, 1 + 1e-12, 100.0)
    for t in (3.0, -3.0, 100.0, 1e-8)
} | {
    "periapsis of 1e-6 a, just past it": [
        2 - 1e-6,
        0,
        0,
        0,
        np.sqrt(1e-6 / (2 - 1e-6)),
        0,
        np.pi + 1e-3,
    ],
    "energy -1e3": [1e-3, 0, 0, 0, 0.3 * np.sqrt(1e3), 0, 0.01],
    "energy 1e3, outwards": [1, 0.1, 0, 44.7, 2, 1, 1.0],
    "energy 1e3, past the centre": [1, 0.1, 0, -44.7, 2, 1, 1.0],
    "radial, hyperbolic": [1, 0, 0, 44.7, 0, 0, 1.0],
    "radial, inwards": [1, 0, 0, -44.7, 0, 0, 0.01],
    "radial, elliptic, over the top": [1, 0, 0, 1, 0, 0, 1.5],
    "radial, parabolic": [1, 0, 0, np.sqrt(2), 0, 0, 1.5],
    "from rest": [1, 0, 0, 0, 0, 0, 0.5],
    "1e4 revolutions": [1, 0, 0, 0, 1.2, 0.1, 1.7e5],
    "1e4 revolutions, e = 0.9": [1, 0, 0, 0, np.sqrt(1.9), 0, 2e6],
    "nearly straight": [-1e3, 1e8, 0, 1, 0, 0, 2e4],
    "from rest, just above the centre": [1, 0, 0, 0, 0, 0, np.pi / np.sqrt(8) - 1e-9],
    "radial, hyperbolic, just above the centre": [1, 0, 0, -44.7, 0, 0, 0.0221],
    "flyby from 1e6 a": [1, 0, 0, -1e3, 0.05, 0.01, 2e-3],
    "flyby from 1e6 a, at periapsis": [1, 0, 0, -1e3, 0.05, 0.01, 1e-3],
    "flyby from 1e4 q": [1, 0, 0, -44.7, 0.1, 0.01, 0.05],
    "ellipse, from afar through periapsis": [1, 0.1, 0, -1.2, 1e-3, 1e-3, 1.2],
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_states(name):
    y = np.array([*HOSTILE[name], 1.0])
    result, jacobian = np.asarray(packed(y)), np.asarray(forward(y))
    r, v = exact_flow(y[:3], y[3:6], y[6])
    # The rounding of the inputs alone moves the result by eps times the condition.
    allowed = 8 * EPS * max(condition(jacobian, y, r), 4.0)
    assert relative(result[:3], r) < allowed
    assert relative(result[3:], v) < 4 * allowed


STRAIGHT = {
    "past the centre": [1, 0.1, 0, -3, 0.2, 1, 1.0],
    "backwards": [1, 0.1, -2, -3, 0.2, 1, -0.7],
    "outwards": [1, 0, 0, 4, 0, 0, 2.0],
    "out to a million times the distance": [1, 1, 0, 100, 50, 0, 1e4],
    "from rest": [1, 0.5, 0, 0, 0, 0, 0.5],
    "slow, in metres": [7e6, 0, 0, 0, 1e-3, 2e-3, 4e3],
    "far, in metres": [7e6, 0, 0, 0, 7e3, 1e3, 4e6],
}


@pytest.mark.parametrize("name", STRAIGHT)
def test_without_attraction_the_motion_is_a_straight_line(name):
    """With its slopes by everything, mu too: beside mu = 0 against differences in 60 digits."""
    y = np.array([*STRAIGHT[name], 0.0])
    expected = np.r_[y[:3] + y[6] * y[3:6], y[3:6]]
    # A few roundings of the terms, which may be larger than their sum.
    allowed = 4 * EPS * np.r_[np.abs(y[:3]) + np.abs(y[6] * y[3:6]), np.abs(y[3:6])]
    # Outside of `jit`, too, where mu is known.
    for found in (packed(y), np.asarray(_packed(jnp.asarray(y)))):
        assert np.all(np.abs(found - expected) <= allowed)
    exact = exact_jacobian(y)
    for found in (forward(y), reverse(y)):
        # Of each column: that by mu has another size than those by the state.
        size = np.linalg.norm(exact, axis=0)
        assert np.all(np.linalg.norm(found - exact, axis=0) <= 1e-12 * size)


def test_a_line_through_the_centre_goes_on_without_attraction():
    y = np.array([1.0, 0.0, 0.0, -2.0, 0.0, 0.0, 1.0, 0.0])
    np.testing.assert_array_equal(packed(y), [-1.0, 0.0, 0.0, -2.0, 0.0, 0.0])
    assert np.isfinite(forward(y)).all() and np.isfinite(reverse(y)).all()


def test_places_and_centres_without_a_motion_are_refused():
    y = jnp.array([1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="position is .* away from the centre"):
        kepler_flow(0.0 * y, y, 1.0, 1.0)
    with pytest.raises(InputError, match="mu is -1: it must be zero or positive"):
        kepler_flow(y, y, 1.0, -1.0)
    # Under `jit`, as the docstring says.
    for bad in ([0, 0, 0, 1, 0, 0, 1, 1.0], [1, 0, 0, 1, 0, 0, 1, -1.0]):
        assert np.isnan(packed(np.array(bad, float))).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", HOSTILE)
def test_derivatives_of_hostile_states(name):
    """Forward and reverse, beside what rounding of the inputs alone does to the derivatives: a
    flyby loses two digits more."""
    y, rough = np.array([*HOSTILE[name], 1.0]), np.array([1, -1, 1, -1, 1, 1, -1, 1]) * EPS
    exact, moved = exact_jacobian(y), exact_jacobian(y + rough * _scale(y))
    for found in (forward(y), reverse(y)):
        for rows in (slice(0, 3), slice(3, 6)):
            scale = np.linalg.norm(exact[rows] * _scale(y))
            spread = np.linalg.norm((moved - exact)[rows] * _scale(y)) / scale
            assert np.linalg.norm((found - exact)[rows] * _scale(y)) / scale < 100 * spread + 1e-14


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_states_in_single_precision(name):
    y = np.array([*HOSTILE[name], 1.0], np.float32)
    result = packed(y)
    assert result.dtype == jnp.float32
    r, _ = exact_flow(y[:3], y[3:6], y[6])
    loss = (
        8
        * np.finfo(np.float32).eps
        * max(condition(forward(y.astype(float)), y.astype(float), r), 4.0)
    )
    assert relative(result[:3], r) < loss or loss > 0.1
    # A nanosecond before the collision is, in this precision, the collision itself to one rounding:
    # there is no derivative there.
    assert np.isfinite(forward(y)).all() or name == "from rest, just above the centre"


def flybys(n, seed):
    """Hyperbolas and ellipses from afar, |r0| = 1: |a| down to 1e-6, q down to 1e-7, to before, at
    and beyond periapsis."""
    g = np.random.default_rng(seed)
    for _ in range(n):
        beta, q = -(10.0 ** g.uniform(-3, 6)), 10.0 ** g.uniform(-7, -2)
        e, p = 1 - q * beta, q * (2 - q * beta)
        f, start = -np.arccos((p - 1) / e), np.arccosh((1 - beta) / e)
        axes = np.linalg.qr(g.normal(size=(3, 3)))[0]
        r = axes @ [np.cos(f), np.sin(f), 0]
        v = axes @ [-np.sin(f), e + np.cos(f), 0] / np.sqrt(p)
        yield np.r_[
            r,
            v,
            (e * np.sinh(start) - start)
            / (-beta) ** 1.5
            * g.choice([0.3, 0.99, 1.0, 1.01, 2.0, 5.0]),
            1.0,
        ]


def test_flybys_lose_no_more_than_rounding_of_the_inputs_does():
    worst = 0.0
    for y in flybys(100, 3):
        r, v = exact_flow(y[:3], y[3:6], y[6])
        found, loss = packed(y), EPS * max(condition(forward(y), y, r), 4.0)
        worst = max(worst, relative(found[:3], r) / loss)
    assert worst < 4.0


def test_random_states_against_60_digits():
    """The worst of 250 mixed conics whose condition is below 100, so that 13 digits can be asked
    for."""
    position, velocity, t = conics(250, 5)
    worst = 0.0
    for i in range(250):
        y = np.r_[position[:, i], velocity[:, i], t[i], 1.0]
        r, _ = exact_flow(y[:3], y[3:6], y[6])
        if condition(forward(y), y, r) < 100.0:
            worst = max(worst, relative(packed(y)[:3], r))
    assert worst < 1e-13


# Sweeps
# -------------------------------------------------------------------------------------------------


def _length(a):
    return np.sqrt(np.sum(np.asarray(a) ** 2, axis=0))


def test_sweep_of_mixed_conics():
    """1e5 states: none fails; energy and angular momentum stay, and the way back leads to the
    start.

    The tolerance is rounding times the largest cancellation, which is that of a flyby: the ratio of
    the distances in play to |a| or to the least distance. The way back adds the condition of the
    way there, bounded by the same and by the revolutions."""
    position, velocity, t = (jnp.asarray(x) for x in conics(100_000, 0))
    r1, v1 = flow(position, velocity, t, 1.0)
    assert np.isfinite(r1).all() and np.isfinite(v1).all()
    ra, rb = _length(position), _length(r1)
    h0, h1 = (
        np.cross(np.asarray(position).T, np.asarray(velocity).T).T,
        np.cross(np.asarray(r1).T, np.asarray(v1).T).T,
    )
    e = _length(eccentricity_vector(position, velocity, 1.0))
    q = _length(h0) ** 2 / (1 + e)
    kinetic = np.maximum(_length(velocity), _length(v1)) ** 2 + 1 / np.minimum(ra, rb)
    energy = np.abs(specific_energy(r1, v1, 1.0) - specific_energy(position, velocity, 1.0))
    assert np.max(energy / kinetic) < 1e-12
    assert np.max(_length(h1 - h0) / (rb * _length(v1) + ra * _length(velocity))) < 1e-12
    r2, v2 = flow(r1, v1, -t, 1.0)
    alpha = np.maximum(2 / ra - _length(velocity) ** 2, 0.0)
    growth = 1 + np.maximum(ra, rb) / q + np.abs(t) * alpha**1.5 * (np.maximum(ra, rb) / q)
    assert np.max(_length(r2 - position) / ra / growth) < 2e-11
    assert np.median(_length(r2 - position) / ra) < 1e-14


finite = st.floats(-2.0, 2.0).map(lambda x: round(x, 6))


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(finite, finite, finite),
    st.tuples(finite, finite, finite),
    st.floats(-3, 3),
    st.floats(-3, 3),
)
def test_two_steps_are_one(r, v, t1, t2):
    r, v = np.array(r) + [3.0, 0, 0], np.array(v) + [0, 0.0, 0.7]
    if np.linalg.norm(np.cross(r, v)) < 0.3:
        return
    middle = flow(r, v, t1, 1.0)
    twice, once = flow(*middle, t2, 1.0), flow(r, v, t1 + t2, 1.0)
    # h >= 0.3 with r up to 15 bounds the condition by about 1e4.
    assert relative(twice[0], once[0]) < 1e-11 and relative(twice[1], once[1]) < 1e-11


def test_no_duration_is_the_identity():
    position, velocity, _ = conics(1000, 3)
    r, v = flow(position, velocity, 0.0, 1.0)
    np.testing.assert_allclose(r, position, rtol=0, atol=1e-15 * _length(position).max())
    assert np.max(_length(v - velocity) / _length(velocity)) < 1e-14


def test_single_precision():
    """Float32 in, float32 out; earth in metres, where r^3 would leave little room."""
    mu, r, v, t, r1, v1, _ = PUBLISHED["KEP-VALLADO-2-4"]
    km = jnp.float32(1e3)
    position, velocity = flow(
        jnp.array(r, jnp.float32) * km,
        jnp.array(v, jnp.float32) * km,
        jnp.float32(t),
        jnp.float32(mu * 1e9),
    )
    assert position.dtype == velocity.dtype == jnp.float32
    assert (
        relative(position / 1e3, r1) < 1e-5 and relative(velocity / 1e3, v1) < 1e-5
    )  # eps = 6e-8, condition about 30
    position, velocity, t = (x.astype(np.float32) for x in conics(20_000, 1))
    r32, v32 = flow(position, velocity, t, 1.0)
    assert r32.dtype == jnp.float32 and np.isfinite(r32).all() and np.isfinite(v32).all()
    r64, _ = flow(position.astype(float), velocity.astype(float), t.astype(float), 1.0)
    assert np.median(_length(np.asarray(r32, float) - r64) / _length(r64)) < 1e-6


def test_a_single_state_meets_many_durations():
    """Three durations must not be taken for the three components."""
    r, v, t = jnp.array([1.0, 0.2, 0.0]), jnp.array([0.0, 1.1, 0.3]), jnp.array([0.5, 1.0, 2.0])
    many, _ = flow(r, v, t, 1.0)
    for i in range(3):
        np.testing.assert_allclose(many[:, i], flow(r, v, t[i], 1.0)[0], rtol=1e-14)


# Derivatives
# -------------------------------------------------------------------------------------------------

SMOOTH = {
    "ellipse": [1.0, 0.2, -0.1, 0.1, 0.9, 0.3, 2.5, 1.3],
    "ellipse, turns": [1.0, 0.2, -0.1, 0.1, 0.9, 0.3, 40.0, 1.3],
    "circle": [1.0, 0, 0, 0, 1.0, 0, 2.0, 1.0],
    "parabola": [1.0, 0, 0, 0.0, np.sqrt(2), 0, 2.0, 1.0],
    "hyperbola": [1.0, 0.2, 0.1, -1.9, 0.7, 0.3, 1.5, 1.0],
    "backwards": [1.0, 0.2, 0.1, 1.9, 0.7, 0.3, -1.5, 1.0],
    "at once": [1.0, 0.2, 0.1, 0.3, 0.7, 0.3, 0.0, 1.0],
    "radial": [1.0, 0, 0, 1.2, 0, 0, 0.7, 1.0],
}


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives(name):
    """Forward equals reverse, and both equal central differences of the reference in 60 digits,
    exact to the step's square."""
    y, step = np.array(SMOOTH[name]), 1e-6
    a, b = np.asarray(forward(y)), np.asarray(reverse(y))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * np.abs(a).max())
    for i in range(8):
        plus, minus = y.copy(), y.copy()
        plus[i], minus[i] = y[i] + step, y[i] - step
        up, down = (np.concatenate(exact_flow(x[:3], x[3:6], x[6], x[7])) for x in (plus, minus))
        # Truncation is the third derivative times 1e-12 / 6; the printed doubles add 1e-16 / 1e-6.
        np.testing.assert_allclose(
            a[:, i], (up - down) / (plus[i] - minus[i]), rtol=0, atol=3e-9 * np.abs(a).max() ** 1.5
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ellipse", "circle", "parabola", "hyperbola", "at once"])
def test_transition_matrix_is_symplectic(name):
    phi = np.asarray(forward(np.array(SMOOTH[name])))[:, :6]
    j = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    np.testing.assert_allclose(phi.T @ j @ phi, j, atol=1e-12 * np.abs(phi).max() ** 2)


@pytest.mark.parametrize("name", ["ellipse", "circle", "parabola", "hyperbola", "at once"])
def test_second_derivatives(name):
    """Forward over reverse against differences of the reverse gradient."""
    y = np.array(SMOOTH[name])
    direction = np.array([0.3, -0.2, 0.5, 0.1, 0.4, -0.3, 0.2, 0.1])
    second = gradient_change(y, direction)
    difference = (gradient(y + 1e-5 * direction) - gradient(y - 1e-5 * direction)) / 2e-5
    np.testing.assert_allclose(second, difference, rtol=0, atol=1e-7 * np.abs(second).max())


# The system
# -------------------------------------------------------------------------------------------------


def test_the_flow_solves_the_vector_field():
    system, y = (
        TwoBody(1.3),
        BodyState(position=jnp.array([1.0, 0.2, -0.1]), velocity=jnp.array([0.1, 0.9, 0.3])),
    )
    state, rate = jax.jvp(lambda t: system.closed_form().flow(t, y), (2.0,), (1.0,))
    field = system.vector_field(0.0, state)
    np.testing.assert_allclose(rate.position, field.position, atol=1e-14)
    np.testing.assert_allclose(rate.velocity, field.velocity, atol=1e-14)


def test_invariants_stay():
    system = TwoBody(1.3)
    position, velocity, _ = conics(50, 8)
    y = BodyState(position=jnp.asarray(position), velocity=jnp.asarray(velocity))
    before, after = (
        system.invariants(0.0, y),
        system.invariants(
            1.0, system.closed_form().flow(jnp.asarray(1e-2 * _length(position) ** 1.5), y)
        ),
    )
    assert set(before) == {"energy", "angular_momentum", "eccentricity_vector"}
    for name in before:
        np.testing.assert_allclose(
            after[name], before[name], rtol=1e-9, atol=1e-11 * np.abs(before[name]).max()
        )


@pytest.mark.parametrize("mu", [0.0, -1.0, np.nan])
def test_mu_must_be_positive(mu):
    with pytest.raises(ValueError, match=r"TwoBody\.mu is .*: it must be positive"):
        TwoBody(mu)


values = jax.jit(stumpff)
slopes = jax.jit(jax.jacfwd(stumpff))
bends = jax.jit(jax.jacfwd(jax.jacrev(stumpff)))

# Stumpff
# -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("z", [0.0, 1e-9, -1e-9, 0.3, -5.0, 9.86, -9.86, -9.88, -1e3, -1e5])
def test_stumpff(z):
    """Values and two derivatives, on both sides of the branch; c_n' = (n c_(n+2) - c_(n+1)) / 2."""
    with mp.workdps(60):
        exact = [float(c) for c in exact_stumpff(mp.mpf(z))[2:]]
        slope = [
            float(mp.diff(lambda x, n=n: exact_stumpff(x)[n], mp.mpf(z))) for n in (2, 3, 4, 5)
        ]
        bend = [
            float(mp.diff(lambda x, n=n: exact_stumpff(x)[n], mp.mpf(z), 2)) for n in (2, 3, 4, 5)
        ]
    # The rounding of z alone moves the functions by eps times half the square root of |z|, or z
    # times the slope.
    loss = 4e-15 * (1 + np.sqrt(abs(z)))
    value, first, second = np.array(values(z)), np.array(slopes(z)), np.array(bends(z))
    for n in range(4):
        assert abs(value[n] - exact[n]) < loss * abs(exact[n])
        assert first[n] == pytest.approx(slope[n], abs=10 * loss * abs(exact[n]))
        assert second[n] == pytest.approx(bend[n], abs=100 * loss * abs(exact[n]))


def test_circles_whose_eccentricity_no_float32_squares():
    """A circle, to one rounding: a quarter of a million of them with e or the inclination from
    1e-38 to 1e-6, whose squares underflow."""
    g = np.random.default_rng(0)
    count = 250_000
    small = 10.0 ** g.uniform(-38.0, -6.0, (2, count)) * g.choice([-1.0, 1.0], (2, count))
    small = small.astype(np.float32)
    one, zero = np.ones(count, np.float32), np.zeros(count, np.float32)
    t = g.uniform(-8.0, 8.0, count).astype(np.float32)
    r, v = flow(np.stack([one, zero, zero]), np.stack([small[0], one, small[1]]), t, one)
    r, v, angle = (np.asarray(x, float) for x in (r, v, t))
    # A rate of 1e-6 outwards moves it by 2e-6 along the orbit, per radian by as much again.
    bound = 12.0 * np.finfo(np.float32).eps + 8.0 * np.abs(small[0]) * (1.0 + np.abs(angle))
    assert (np.abs(r[0] - np.cos(angle)) < bound).all()
    assert (np.abs(r[1] - np.sin(angle)) < bound).all()
    assert (np.abs(v[1] - np.cos(angle)) < bound).all()
    assert np.isfinite(r[2]).all() and np.isfinite(v[2]).all()

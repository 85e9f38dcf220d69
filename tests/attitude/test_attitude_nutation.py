"""The nutation of the heavy top near the separatrix, in a nearly plane swing and for fast tops,
against the roots of its cubic and Carlson's integrals in a hundred digits."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from both_modes import both_modes
from numpy.testing import assert_allclose

from jaxspace.attitude import Top
from jaxspace.attitude.nutation import Nutation
from jaxspace.bodies import BodyState
from jaxspace.rotations import Quaternion

A, C, WL = 0.002, 0.0008, 0.3  # critical spin: 61.24 rad/s
DIGITS = 100


def roots_of_a_cubic(a, b, c):
    """The three real roots of u^3 + a u^2 + b u + c in rising order, by the cosine of a third."""
    p, q = a * a / 9 - b / 3, a * b / 6 - c / 2 - a**3 / 27
    angle = mpmath.acos(min(max(q / mpmath.sqrt(p) ** 3, -1), 1))
    return sorted(
        2 * mpmath.sqrt(p) * mpmath.cos((angle + 2 * k * mpmath.pi) / 3) - a / 3 for k in range(3)
    )


def exact(values):
    """Turning angles, period and precession from A, C, W l, the quaternion and omega, in the digits
    of `values`: psi' = (gamma + N)/(1 + u)/2 + (gamma - N)/(1 - u)/2, each by an integral of the
    third kind in Legendre's form."""
    A, C, Wl, q0, q1, q2, q3, w1, w2, w3 = values
    norm = q0**2 + q1**2 + q2**2 + q3**2
    Z = [2 * (q1 * q3 - q0 * q2) / norm, 2 * (q2 * q3 + q0 * q1) / norm]
    up = (q0**2 + q3**2 - q1**2 - q2**2) / norm
    N, beta = C * w3 / A, 2 * Wl / A
    alpha, gamma = w1**2 + w2**2 + beta * up, w1 * Z[0] + w2 * Z[1] + N * up
    roots = roots_of_a_cubic(
        -(alpha + N * N) / beta, 2 * gamma * N / beta - 1, (alpha - gamma * gamma) / beta
    )
    low, high, third = roots if beta > 0 else (roots[1], roots[2], roots[0])
    start, end = (low, high) if beta > 0 else (high, low)  # u = start + (end - start) sn^2
    top, least = beta * (third - start), beta * (third - end)

    def passage(strength, sign):
        if strength == 0:
            return mpmath.mpf(0)
        base = 1 + sign * start
        n = -sign * (end - start) / base
        third_kind = mpmath.elliprf(0, least / top, 1) + n / 3 * mpmath.elliprj(
            0, least / top, 1, 1 - n
        )
        return 2 * strength / (mpmath.sqrt(top) * base) * third_kind

    return [
        mpmath.acos(high),
        mpmath.acos(low),
        4 * mpmath.elliprf(0, least, top),
        passage(gamma + N, 1) + passage(gamma - N, -1),
    ]


def slopes(values, rows=slice(None), exact=exact):
    """Derivatives of the `rows` of `exact`: differences with a step of 1e-35, right to 1e-30."""
    columns, step = [], mpmath.mpf(10) ** -35
    for i in range(len(values)):
        ends = [
            exact([v + s * step * (i == j) for j, v in enumerate(values)])[rows] for s in (1, -1)
        ]
        columns.append([(a - b) / (2 * step) for a, b in zip(*ends, strict=True)])
    return np.array(columns, dtype=float).T


@jax.jit
def swing(v):
    y = BodyState(attitude=Quaternion(v[3:7]), omega=v[7:])
    nutation = Top(v[0], v[1], v[2]).nutation(y)
    return jnp.stack([*nutation.turning_points, nutation.period, nutation.precession])


SLOPES = both_modes(swing)


def tilted(top, tilt, omega, down=False):
    """A, C, W l, quaternion and omega for a `tilt` from the upward or the downward vertical, which
    the quaternion holds to all digits."""
    c, s = np.cos(0.5 * tilt), np.sin(0.5 * tilt)
    c, s = (s, c) if down else (c, s)
    psi, phi = 0.3, -0.2
    turn, across = 0.5 * (psi + phi), 0.5 * (psi - phi)
    wxyz = [c * np.cos(turn), s * np.cos(across), s * np.sin(across), c * np.sin(turn)]
    return np.array([*top, *wxyz, *omega])


SLOW, PENDULUM, HANGS = (A, C, WL), (1.0, 1e-3, -1.0), (A, C, -WL)
CASES = {}
for size in (1e-3, 1e-6, 1e-9, 1e-12):
    CASES |= {
        f"dropped top {size}": tilted(SLOW, size, [0.0, 0.0, 45.0]),
        f"pushed top {size}": tilted(SLOW, size, [3.0 * size, 40.0 * size, 45.0]),
        f"top pushed back {size}": tilted(SLOW, size, [-30.0 * size, 2.0 * size, 45.0]),
        f"pushed, hanging {size}": tilted(HANGS, size, [-30.0 * size, 2.0 * size, 45.0], True),
        f"dropped pendulum {size}": tilted(PENDULUM, size, [0.0, 0.0, 0.0], True),
        f"thrown pendulum {size}": tilted(PENDULUM, 1e-20, [size, 0.0, 0.0], True),
    }
for size in (1e-2, 1e-3, 3e-3, 1e-5, 1e-7, 1e-10, 1e-15):
    plane = [0.1, 0.2 * size, size]
    CASES[f"nearly plane {size}"] = tilted((1.0, 1.0, 1.0), 1.0, plane)
    CASES[f"nearly plane, hanging {size}"] = tilted((1.0, 1.0, -1.0), 1.0, plane)
CASES |= {
    "general": tilted((1.3, 1.0, 0.7), 0.8, [0.3, 0.2, 2.0]),
    "general, hanging": tilted((1.3, 1.0, -0.7), 0.8, [0.3, 0.2, 2.0]),
    "stable, upright": tilted(SLOW, 1e-6, [1e-5, 2e-5, 150.0]),
    "stable, hanging": tilted(HANGS, 1e-5, [1e-4, 2e-4, 15.0], True),
    "plane": tilted((1.0, 1.0, 1.0), 0.9, [0.0, 0.0, 0.0]),
}
# Where the half turn at a vertical has no sense, the precession has none: it counts as nothing.
PLANE = {name for name in CASES if "pendulum" in name} | {"plane"}


@pytest.mark.parametrize("name", CASES)
def test_nutation_in_a_hundred_digits(name):
    v = CASES[name]
    with mpmath.workdps(DIGITS):
        truth = [mpmath.mpf(float(x)) for x in v]
        if name in PLANE:  # a breath of spin, so that the path passes beside the vertical
            truth[-1] = mpmath.mpf(10) ** -30
        expected = np.array(exact(truth), dtype=float)
    found = swing(v)
    # Rounding of the half-dozen constants, relative to every result: 1e-16 times some tens.
    assert_allclose(found[1:3], expected[1:3], rtol=5e-15)
    assert_allclose(found[0], expected[0], rtol=5e-15, atol=1e-30)
    if name not in PLANE:
        assert_allclose(found[3], expected[3], rtol=5e-15)


@pytest.mark.sweep
@pytest.mark.parametrize("name", [name for name in CASES if name not in PLANE])
def test_derivatives_in_a_hundred_digits(name):
    v = CASES[name]
    with mpmath.workdps(DIGITS):
        expected = slopes([mpmath.mpf(float(x)) for x in v])
    for found in SLOPES(v)[1:]:
        # Relative to the greatest derivative of each result: those along the quaternion's length
        # are zero, by cancellation.
        for row, truth in zip(np.asarray(found), expected, strict=True):
            assert_allclose(row, truth, rtol=1e-11, atol=1e-12 * np.abs(truth).max())


def nearly_steady(size, spin):
    """Steady precession of a top at 0.8 rad, but for a rate of nutation of this size."""
    (a, c, wl), theta, phi = (1.3, 1.0, 0.7), 0.8, -0.2
    p = c * spin + np.sqrt((c * spin) ** 2 - 4.0 * a * wl * np.cos(theta))
    around = 2.0 * wl / p * np.sin(theta)
    omega = [
        around * np.sin(phi) + size * np.cos(phi),
        around * np.cos(phi) - size * np.sin(phi),
        spin,
    ]
    return tilted((a, c, wl), theta, omega)


@pytest.mark.parametrize(("size", "spin"), [(1e-2, 4.0), (1e-5, 400.0), (1e-8, 4.0)])
def test_a_nearly_steady_precession_in_a_hundred_digits(size, spin):
    """The cubic has nearly a double root: from its constants alone the angles would be lost to
    1e-16 over the width of the nutation."""
    v = nearly_steady(size, spin)
    with mpmath.workdps(DIGITS):
        truth = [mpmath.mpf(float(x)) for x in v]
        expected, bends = np.array(exact(truth), dtype=float), slopes(truth)
    found = swing(v)
    assert_allclose(found[:3], expected[:3], rtol=2e-15)
    assert_allclose(found[3], expected[3], rtol=1e-14)
    # The slopes of the width hold the direction of the start seen from steady precession: the
    # inputs hold it to 1e-16 over the size.
    loss = 1e-13 + 1e-14 / size
    for derivative in SLOPES(v)[1:]:
        for row, truth in zip(np.asarray(derivative), bends, strict=True):
            assert_allclose(row, truth, atol=loss * np.abs(truth).max())


@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("kind", ["dropped", "thrown"])
def test_derivatives_of_a_pendulum_near_the_separatrix(kind, size):
    """The period alone: the precession of a path through the vertical has no derivative."""
    v = CASES[f"{kind} pendulum {size}"]
    with mpmath.workdps(DIGITS):
        expected = slopes([mpmath.mpf(float(x)) for x in v], slice(2, 3))[0]
    for found in SLOPES(v)[1:]:
        assert_allclose(found[2], expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("spin", [0.0, 45.0, -45.0])
def test_the_upright_top_below_its_critical_spin_never_returns(spin):
    v = tilted(SLOW, 0.0, [0.0, 0.0, spin])
    theta_1, theta_2, period, psi = swing(v)
    # f(u) = (1 - u)^2 [beta (1 + u) - N^2]: the path from the vertical turns where it vanishes.
    N, beta = C * spin / A, 2.0 * WL / A
    assert_allclose([theta_1, theta_2], [0.0, np.arccos(N**2 / beta - 1.0)], rtol=1e-14)
    assert period == np.inf
    assert psi == (np.sign(spin) * np.inf if spin else 0.0)
    y = BodyState(attitude=Quaternion(v[3:7]), omega=jnp.asarray(v[7:]))
    assert_allclose(Top(*SLOW).nutation(y).mean_precession_rate, 0.5 * N, rtol=1e-15)
    for slope in SLOPES(v)[1:]:
        assert np.isfinite(slope).all()


def test_a_sleeping_top_nods_with_its_small_frequency():
    n = 150.0
    v = tilted(SLOW, 0.0, [0.0, 0.0, n])
    # N^2 - 2 beta/... : the difference of the two frequencies of a sleeping top, in Harrison and
    # Nettleton 4.11 sqrt((C n)^2 - 4 A W l)/A.
    expected = 2.0 * np.pi * A / np.sqrt((C * n) ** 2 - 4.0 * A * WL)
    assert_allclose(swing(v)[2], expected, rtol=1e-14)


# T5.12-P7: 4 sqrt(l/g) K(sin(theta_0/2)), l = 1 m, g = 9.80665 m/s^2. Tolerance of the case: 1e-9.
PERIODS = {
    0.5235987755982989: 2.0413384658583684,
    1.5707963267948966: 2.3682463462860097,
    2.6179938779914944: 3.5357019383114,
    3.12413936106985: 7.827133388800017,
}


@pytest.mark.parametrize("amplitude", PERIODS)
def test_pendulum_period(amplitude):  # T5.12-P7
    """The axis of a hanging top swings past the lowest place twice in a period."""
    top = Top(1.0, 1e-3, -9.80665)
    nutation = top.nutation(top.state([0.0, amplitude, 0.0], [0.0, 0.0, 0.0]))
    assert_allclose(2.0 * nutation.period, PERIODS[amplitude], rtol=1e-9)


def exact_circle_rates(values):
    """psi' at both turning circles from N, alpha, beta and gamma."""
    N, alpha, beta, gamma = values
    low, high, _ = roots_of_a_cubic(
        -(alpha + N * N) / beta, 2 * gamma * N / beta - 1, (alpha - gamma * gamma) / beta
    )
    return [(gamma - N * u) / (1 - u * u) for u in (high, low)]


@jax.jit
def circle_rates(v):
    def rates(v):
        return jnp.stack(Nutation.of(*v).circle_rates)

    return rates(v), jax.jacfwd(rates)(v), jax.jacrev(rates)(v)


# A fast top's momentum gamma - N u is left of terms N times as large; beside a cusp (alpha = beta
# gamma/N) its energy alpha - beta u is what vanishes.
@pytest.mark.parametrize(
    "values",
    [
        (15.0, 1.5, 1.7, 3.0),
        (1e3, 1.5, 1.7, 200.0),
        (1e6, 1.5, 1.7, -4e5),
        (20.0, 0.34 + 1e-9, 1.7, 4.0),
        (2.0, 1.5, 1.7, 0.3),
    ],
)
def test_rates_at_the_turning_circles_in_a_hundred_digits(values):
    found, *modes = (np.asarray(x) for x in circle_rates(jnp.array(values)))
    with mpmath.workdps(DIGITS):
        v = [mpmath.mpf(x) for x in values]
        truth = np.array(exact_circle_rates(v), dtype=float)
        exact_slopes = slopes(v, exact=exact_circle_rates)
    # What roundings of the inputs alone change.
    size = np.abs(truth) + np.abs(exact_slopes) @ np.abs(values)
    assert np.all(np.abs(found - truth) < 10 * 2.0**-52 * size)
    for jacobian in modes:
        scaled = np.abs(jacobian - exact_slopes) * np.abs(values)
        # Derivatives have a condition of their own, which is not formed here: N/psi' at most.
        assert np.all(scaled < 1e-13 * size[:, None] * (1.0 + values[0] / np.abs(truth[:, None])))

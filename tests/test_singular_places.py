"""Derivatives of closed forms at the ends and holes of their ranges: right, or infinite by the rule
of ends (`core/safe.py`), in both modes alike."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace.attitude import Top
from jaxspace.attitude.despin import cord_length
from jaxspace.attitude.gravity_gradient import pitch_libration_period
from jaxspace.attitude.polhode import Polhode
from jaxspace.bodies import InertiaTensor
from jaxspace.bodies.principal_axes import principal_axes, tensor_function
from jaxspace.rockets import spin_angle
from jaxspace.rockets.jet_damping import jet_damping_ratio, spin_ratio

A, C, WL = 0.002, 0.0008, 0.3


# Kept, so that the cases of a parametrised test share their programs.
@lru_cache(maxsize=4)
def _modes(f):
    """`f`, its forward and its reverse derivative, compiled."""
    return jax.jit(f), jax.jit(jax.jacfwd(f)), jax.jit(jax.jacrev(f))


def both(f, x):
    """The slopes of a scalar function of a vector in both modes, which must be the same."""
    forward, reverse = (mode(jnp.asarray(x)) for mode in _modes(f)[1:])
    assert not np.isnan(forward).any()
    assert_allclose(reverse, forward, rtol=1e-13, atol=1e-13)
    return np.asarray(forward)


def test_no_cord_for_no_despin():
    found = both(lambda x: cord_length(*x), [2.0, 2.0, 3.0, 0.5, 0.1])
    assert_allclose(found, [np.inf, -np.inf, 0.0, 0.0, 0.0])


def test_the_spin_angle_without_burning():
    values = [2.0, 3.0, 0.0, 0.5]
    assert spin_angle(*values) == 6.0
    with mpmath.workdps(40):

        def exact(t, n, b, rho):  # n/(b rho^2) (1 - (1 - b t)^(rho^2)), from the integral
            return n / (b * rho**2) * (1 - (1 - b * t) ** (rho**2))

        small = mpmath.mpf(10) ** -12
        slope = (exact(2, 3, small, mpmath.mpf("0.5")) - exact(2, 3, -small, mpmath.mpf("0.5"))) / (
            2 * small
        )
    found = both(lambda x: spin_angle(*x), values)
    assert_allclose(found, [3.0, 2.0, float(slope), 0.0], rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("burn", [1e-3, 1e-8, 1e-13, -1e-5])
def test_the_spin_angle_with_little_burning(burn):
    with mpmath.workdps(40):
        b, rho = mpmath.mpf(burn), mpmath.mpf(0.5)
        exact = float(3 / (b * rho**2) * (1 - (1 - 2 * b) ** (rho**2)))
    assert_allclose(spin_angle(2.0, 3.0, burn, 0.5), exact, rtol=1e-15)


@pytest.mark.parametrize(
    ("ring", "value", "slopes"),
    [  # n/(b q) (1 - (1 - b t)^q) with q = rho^2 at b t = 1; the slope by the time is n xi^(q - 1)
        (0.5, 24.0, [np.inf, 8.0, np.inf, -96.0]),
        (1.0, 6.0, [3.0, 2.0, 0.0, -12.0]),
        (2.0, 1.5, [0.0, 0.5, -3.0, -1.5]),
        (0.0, np.inf, [0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_the_spin_angle_when_all_mass_is_gone(ring, value, slopes):
    values = [2.0, 3.0, 0.5, ring]
    assert spin_angle(*values) == value
    assert_allclose(both(lambda x: spin_angle(*x), values), slopes, atol=1e-15)


@pytest.mark.parametrize("burnt", [0.4999999, 0.5000001, 0.9, 1.0 - 1e-9])
@pytest.mark.parametrize("ring", [1e-9, 0.1, 1.2, 10.0])
def test_the_spin_angle_with_much_burning(burnt, ring):
    with mpmath.workdps(40):
        b, q = mpmath.mpf(0.5 * burnt), mpmath.mpf(ring) ** 2
        exact = float(3 / (b * q) * (1 - (1 - 2 * b) ** q))
    # What is left of the mass has the digits of 1 - burnt, here exact to rounding.
    assert_allclose(spin_angle(2.0, 3.0, 0.5 * burnt, ring), exact, rtol=1e-14)


@pytest.mark.parametrize("form", [jet_damping_ratio, spin_ratio])
@pytest.mark.parametrize(
    ("arm", "value", "slope"),
    [
        (2.0, 0.0, 0.0),
        (np.sqrt(2.0), 0.0, np.nan),  # the exponent rounds to 1 + 4e-16
        (1.2, 0.0, np.inf),
        (1.0, 1.0, 0.0),
        (0.5, np.inf, 0.0),
    ],
)
def test_the_ratio_of_rates_when_all_mass_is_gone(form, arm, value, slope):
    assert form(0.0, arm) == value
    found = both(lambda x: form(x[0], x[1]), [0.0, arm])
    if not np.isnan(slope):
        assert_allclose(found, [slope, 0.0])


def polhode_period(x):
    return Polhode.of(x[:3], x[3:]).period


@pytest.mark.parametrize(
    "x",
    [[2.0, 2.0, 2.0, 0.3, 0.4, 0.5], [3.0, 2.0, 1.0, 0.0, 1.0, 0.0], [3.0, 2.0, 1.0, 0, 0, 0.0]],
)
def test_an_infinite_period_has_no_slope(x):
    x = np.asarray(x, float)
    assert polhode_period(jnp.asarray(x)) == np.inf
    assert_allclose(both(polhode_period, x), 0.0)


@pytest.mark.parametrize(
    "x",
    [
        [2.0, 2.0, 1.0, 0.3, 0.4, 0.5],
        [3.0, 1.5, 1.5, 0.3, 0.4, 0.5],
        [1.2, 2.0, 2.0, 0.3, 0.4, 0.5],
        [3.0, 2.0, 1.0, 1.0, 0.0, 0.0],
        [3.0, 2.0, 1.0, 0.0, 0.0, 1.0],
    ],
)
def test_the_period_of_a_polhode_at_two_equal_moments(x):
    """It is smooth there: against the agm of thirty digits, whose arguments change places where two
    moments do."""

    def exact(values):
        moments, rates = zip(
            *sorted(zip(values[:3], values[3:], strict=True), key=lambda v: -v[0]), strict=True
        )
        (a, b, c), e = moments, [i * w * w for i, w in zip(moments, rates, strict=True)]
        p = (b - c) * ((a - b) * e[1] + (a - c) * e[2])
        q = (a - b) * ((a - c) * e[0] + (b - c) * e[1])
        mean = mpmath.agm(mpmath.sqrt(max(p, q)), mpmath.sqrt(abs(p - q)))
        return 2 * mpmath.pi * mpmath.sqrt(a * b * c) / mean

    with mpmath.workdps(50):
        values = [mpmath.mpf(v) for v in x]
        expected, step = [], mpmath.mpf(10) ** -15
        for i in range(6):
            ends = [exact([v + s * step * (i == j) for j, v in enumerate(values)]) for s in (1, -1)]
            expected.append(float((ends[0] - ends[1]) / (2 * step)))
    assert_allclose(both(polhode_period, x), expected, rtol=1e-12, atol=1e-12)


def test_no_libration_without_a_gradient():
    x = [0.3, 2.0, 3.0, 2.0, 1e-3]
    form = lambda x: pitch_libration_period(x[0], x[1:4], x[4])  # noqa: E731
    assert form(jnp.asarray(x)) == np.inf
    assert_allclose(both(form, x), 0.0)


def top_of(x):
    return Top(x[0], x[1], x[2])


BY_SPIN, BY_MOMENTUM = (
    [lambda x, name=name, k=k: getattr(top_of(x), name)(x[3], x[4])[k] for k in (0, 1)]
    for name in ("steady_precession_rates", "precession_rates_from_momentum")
)


@pytest.mark.parametrize("theta", [0.0, 0.3, 1.2])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_steady_precession_at_the_least_spin(theta, sense):
    """The double root C n / (2 A cos(theta)); its slopes are infinite along all that moves the
    radicand, at theta = 0 all but theta."""
    least = sense * float(Top(A, C, WL).least_spin(theta))
    x = [A, C, WL, theta, least]
    for rate, sign in zip(BY_SPIN, (-sense, sense), strict=True):
        double = C * least / (2.0 * A * np.cos(theta))
        assert_allclose(_modes(rate)[0](jnp.asarray(x)), double, rtol=1e-14)
        tilting = sign * np.inf if theta else 0.0
        expected = sign * np.inf * np.array([-1.0, 1.0, -1.0, 1.0, sense])
        expected[3] = tilting
        assert_allclose(both(rate, x), expected)


@pytest.mark.parametrize("theta", [0.0, 0.3, 1.2])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_steady_precession_at_the_least_momentum(theta, sense):
    """The double root h_Z / (2 A), with infinite slopes along all that moves the radicand."""
    least = sense * 2.0 * np.sqrt(A * WL * np.cos(theta))
    x = [A, C, WL, theta, least]
    for rate, sign in zip(BY_MOMENTUM, (-sense, sense), strict=True):
        assert_allclose(_modes(rate)[0](jnp.asarray(x)), least / (2.0 * A), rtol=1e-14)
        expected = sign * np.inf * np.array([-1.0, 1.0, -1.0, 1.0, sense])
        expected[1], expected[3] = 0.0, expected[3] if theta else 0.0
        assert_allclose(both(rate, x), expected)


def test_nutation_of_the_upright_top_at_the_critical_spin():
    least = float(Top(A, C, WL).least_spin(0.0))
    frequency = lambda x: top_of(x).nutation_frequency(x[3], x[4], x[5])  # noqa: E731
    x = [A, C, WL, 0.0, 1.7, least]
    assert frequency(jnp.asarray(x)) == 0.0
    expected = [-np.inf, np.inf, -np.inf, 0.0, 0.0, np.inf]
    assert_allclose(both(frequency, x), expected)
    # Away from the end the slope is that of the formula.
    x = [A, C, WL, 0.4, 1.7, 1.5 * least]
    with mpmath.workdps(40):

        def exact(*v):
            a, c, w, th, psi, n = v
            moving = (c * n) ** 2 - 4 * a * w * mpmath.cos(th) + (a * psi * mpmath.sin(th)) ** 2
            return mpmath.sqrt(moving) / a

        slopes = [
            float(mpmath.diff(exact, x, tuple(int(i == j) for j in range(6)))) for i in range(6)
        ]
    assert_allclose(both(frequency, x), slopes, rtol=1e-13)


def test_growth_at_the_critical_spin():
    critical = float(Top(A, C, WL).least_spin(0.0))
    growth = lambda x: top_of(x).sleeping_growth_rate(x[3])  # noqa: E731
    assert growth(jnp.asarray([A, C, WL, critical])) == 0.0
    expected = np.inf * np.array([1.0, -1.0, 1.0, -1.0])
    assert_allclose(both(growth, [A, C, WL, critical]), expected)
    assert_allclose(both(growth, [A, C, WL, 1.1 * critical]), 0.0)


TURN = np.linalg.qr(np.array([[1.0, 0.2, 0.3], [0.5, 1.0, -0.4], [-0.3, 0.6, 1.0]]))[0]


def axes_of(x):
    return principal_axes(InertiaTensor(x))


def _tensor_function_of(f, x):
    return tensor_function(f, InertiaTensor(x)).tensor


FORMS = {
    f: [jax.jit(way(partial(_tensor_function_of, f))) for way in (partial, jax.jacfwd, jax.jacrev)]
    for f in (jnp.sqrt, jnp.reciprocal)
}


@pytest.mark.parametrize(
    "moments",
    [
        [2.0, 2.0, 3.0],
        [2.0, 2.0, 2.0],
        [1.0, 1.0 + 1e-15, 3.0],
        [1.0, 1.0 + 1e-9, 3.0],
        [1.0, 1.0 + 1e-4, 1.02],
        [1.0, 1.3, 7.0],
    ],
)
def test_a_function_of_the_tensor_is_smooth(moments):
    """Root and inverse: their derivatives X solve  R X + X R = change  and X = -J^-1 change J^-1,
    in forty digits, however close the moments are."""
    tensor = TURN @ np.diag(moments) @ TURN.T
    tensor = 0.5 * (tensor + tensor.T)
    change = np.array([[0.3, 0.1, 0.2], [0.1, -0.2, 0.5], [0.2, 0.5, 0.4]])
    with mpmath.workdps(40):
        J, E = mpmath.matrix(tensor), mpmath.matrix(change)
        values, V = mpmath.eigsy(J)
        roots, local = [mpmath.sqrt(v) for v in values], V.T * E * V
        solved = mpmath.matrix(
            [[local[i, j] / (roots[i] + roots[j]) for j in range(3)] for i in range(3)]
        )
        exact = {
            jnp.sqrt: (V * mpmath.diag(roots) * V.T, V * solved * V.T),
            jnp.reciprocal: (J**-1, -(J**-1) * E * J**-1),
        }
        exact = {f: [np.array(x.tolist(), float) for x in pair] for f, pair in exact.items()}
    for f, (value, slope) in exact.items():
        form, forward, reverse = FORMS[f]
        assert_allclose(form(tensor), value, rtol=1e-13, atol=1e-14)
        for jacobian in (forward, reverse):
            found = np.einsum("ijkl,kl->ij", jacobian(tensor), change)
            assert_allclose(found, slope, rtol=1e-12, atol=1e-13)


def test_functions_of_a_tensor_in_a_batch_and_of_second_order():
    tensors = jnp.stack([jnp.asarray(TURN @ np.diag(m) @ TURN.T) for m in ([1, 2, 3], [2, 2, 3])])
    batch = jnp.moveaxis(tensors, 0, -1)
    cubes = _tensor_function_of(_cube, batch)
    assert_allclose(cubes, jnp.moveaxis(tensors @ tensors @ tensors, 0, -1), rtol=1e-13)
    # Second derivatives: right where the moments differ, else not finite.
    bend = jax.jit(jax.hessian(lambda x: jnp.sum(jnp.sin(_tensor_function_of(_cube, x)))))
    truth = jax.jit(jax.hessian(lambda x: jnp.sum(jnp.sin(_cubed(x)))))
    assert_allclose(bend(tensors[0]), truth(tensors[0]), rtol=1e-10, atol=1e-10)
    assert not np.isfinite(bend(tensors[1])).all()


def _cube(moment):
    return moment * moment * moment


def _cubed(x):
    x = 0.5 * (x + x.T)
    return x @ x @ x


def test_principal_axes_at_equal_moments():
    tensor = jnp.asarray(TURN @ np.diag([2.0, 2.0, 3.0]) @ TURN.T)
    change = np.array([[0.3, 0.1, 0.2], [0.1, -0.2, 0.5], [0.2, 0.5, 0.4]])
    (_, axes), (dm, dv) = jax.jvp(axes_of, (tensor,), (jnp.asarray(change),))
    # First-order perturbation: a sum of equal moments, the single moment and its axis.
    v = TURN[:, 2]
    assert_allclose(dm[0] + dm[1], np.trace(change) - v @ change @ v, rtol=1e-13)
    assert_allclose(dm[2], v @ change @ v, rtol=1e-13)
    expected = (np.eye(3) - np.outer(v, v)) @ change @ v * np.sign(v @ axes[:, 2])
    assert_allclose(dv[:, 2], expected, rtol=1e-12, atol=1e-13)
    assert not np.isfinite(dv[:, :2]).all()
    reverse = jax.jacrev(lambda x: axes_of(x)[1][:, 2])(tensor)
    assert_allclose(np.einsum("kij,ij->k", reverse, change), expected, rtol=1e-12, atol=1e-13)
    assert not np.isfinite(jax.jacrev(lambda x: axes_of(x)[1][:, 0])(tensor)).all()
    total = jax.grad(lambda x: jnp.sum(axes_of(x)[0] ** 3))(tensor)
    assert_allclose(total, 3.0 * tensor @ tensor, rtol=1e-12, atol=1e-12)


def test_principal_axes_at_different_moments():
    tensor = jnp.asarray(TURN @ np.diag([1.0, 2.0, 3.0]) @ TURN.T)

    def cube(x):
        moments, axes = axes_of(x)
        return (axes * moments**3) @ axes.T

    for mode in (jax.jacfwd, jax.jacrev):
        expected = mode(lambda x: x @ x @ x)(tensor)
        symmetric = 0.5 * (expected + jnp.swapaxes(expected, 2, 3))
        assert_allclose(mode(cube)(tensor), symmetric, atol=1e-12)

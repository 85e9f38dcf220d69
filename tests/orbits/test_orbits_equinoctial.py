"""Equinoctial elements: their definition, the way back, derivatives at the circle and the
equator."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from both_modes import both_modes
from mpmath import mp

from jaxspace.core import InputError
from jaxspace.orbits import ClassicalElements, EquinoctialElements, ModifiedEquinoctialElements
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.kepler import kepler_flow

KINDS = (ModifiedEquinoctialElements, EquinoctialElements)
STATES = {
    "circular": [1, 0, 0, 0, 0.8, 0.6],
    "equatorial": [1, 0, 0, 0.1, 1.2, 0],
    "circular and equatorial": [1, 0, 0, 0, 1, 0],
    "nearly circular and equatorial": [1, 0, 0, 1e-12, 1, 1e-11],
    "inclined": [1, 0.1, 0.2, -0.1, 0.9, 0.6],
    "past the apoapsis": [-1.3, 0.4, 0.2, -0.1, -0.6, 0.2],
    "hyperbolic": [1, 0, 0, 0.5, 1.5, 0.2],
    "hyperbolic, inbound": [5, 0.3, 0.2, -0.8, 1.2, -0.7],
    "parabolic": [2, 0, 0, 0, 0.8, 0.6],
}
ROWS = [
    pytest.param(
        *(kind, name, retrograde),
        id=f"{kind.__name__[:3]}-{name}-{retrograde}",
        # Programs of their own for the other sense of one of the two kinds.
        marks=[pytest.mark.sweep] * (retrograde and kind is EquinoctialElements),
    )
    for kind in KINDS
    for name in STATES
    for retrograde in (False, True)
    if kind is ModifiedEquinoctialElements or name != "parabolic"
]


def leaves(kind, retrograde, y):
    return jnp.stack(jax.tree.leaves(kind.of_state(y[:3], y[3:], 1.0, retrograde=retrograde)))


def back(kind, retrograde, y):
    return jnp.concatenate(kind.of_state(y[:3], y[3:], 1.0, retrograde=retrograde).state(1.0))


FORMS = {
    (kind, retrograde): both_modes(partial(back, kind, retrograde))
    for kind in KINDS
    for retrograde in (False, True)
}


@pytest.mark.parametrize(("kind", "name", "retrograde"), ROWS)
def test_there_and_back_with_derivatives(kind, name, retrograde):
    y = jnp.array(STATES[name], float)
    if retrograde:
        # The same orbit run over backwards, in the other sense of the plane.
        y = y * jnp.array([1.0, 1, 1, -1, -1, -1])
    value, forward, reverse = FORMS[kind, retrograde](y)
    # Some hundred operations; the mean longitude of an inbound hyperbola amplifies them tenfold.
    np.testing.assert_allclose(value, y, rtol=0, atol=5e-15)
    np.testing.assert_allclose(forward, np.eye(6), atol=5e-14)
    np.testing.assert_allclose(reverse, np.eye(6), atol=5e-14)


def test_the_definitions():
    a, e, i, node, omega, f = 1.8, 0.7, 0.6, 1.1, 2.2, -0.9
    state = state_from_elements(ClassicalElements(a * (1 - e * e), e, i, node, omega, f), 1.0)
    E = 2.0 * np.arctan(np.sqrt((1 - e) / (1 + e)) * np.tan(f / 2))
    for sense in (1.0, -1.0):
        x = ModifiedEquinoctialElements.of_state(*state, 1.0, retrograde=sense < 0)
        tilt = np.tan(i / 2) ** sense
        turn = omega + sense * node
        expected = [a * (1 - e * e), e * np.cos(turn), e * np.sin(turn)]
        expected += [tilt * np.cos(node), tilt * np.sin(node)]
        np.testing.assert_allclose(jax.tree.leaves(x)[:5], expected, rtol=1e-13)
        assert np.cos(x.true_longitude - turn - f) == pytest.approx(1.0, abs=1e-14)
        m = EquinoctialElements.of_state(*state, 1.0, retrograde=sense < 0)
        np.testing.assert_allclose(
            jax.tree.leaves(m)[:5], [a, expected[2], expected[1], expected[4], expected[3]], 1e-13
        )
        mean = m.mean_longitude - (turn + E - e * np.sin(E))
        assert mean / (2 * np.pi) == pytest.approx(round(float(mean / (2 * np.pi))), abs=1e-14)


@pytest.mark.parametrize("name", ["inclined", "hyperbolic, inbound", "circular and equatorial"])
def test_the_mean_longitude_grows_evenly(name):
    y = jnp.array(STATES[name], float)
    before = EquinoctialElements.of_state(y[:3], y[3:], 1.0)
    after = EquinoctialElements.of_state(*kepler_flow(y[:3], y[3:], 1.7, 1.0), 1.0)
    rate = np.abs(before.semi_major_axis) ** -1.5
    gain = float(after.mean_longitude - before.mean_longitude - 1.7 * rate)
    assert gain / (2 * np.pi) == pytest.approx(round(gain / (2 * np.pi)), abs=1e-13)
    np.testing.assert_allclose(
        jax.tree.leaves(after)[:5], jax.tree.leaves(before)[:5], rtol=1e-12, atol=1e-14
    )


def test_orbits_near_the_parabola():
    """e = 1 -+ 1e-9: the modified elements notice nothing."""
    for v in (0.8 * (1 - 1e-9), 0.8 * (1 + 1e-9)):
        y = jnp.array([2, 0, 0, 0, v, 0.6])
        value, forward, _ = FORMS[ModifiedEquinoctialElements, False](y)
        np.testing.assert_allclose(value, y, atol=1e-15)
        np.testing.assert_allclose(forward, np.eye(6), atol=1e-14)


def exact_mean_longitude(y):
    """Of an ellipse, with mu = 1: the longitude of the periapsis, E and e sin E in forty digits."""
    with mp.workdps(40):
        x, v = ([mp.mpf(float(c)) for c in part] for part in (y[:3], y[3:]))
        H = [x[1] * v[2] - x[2] * v[1], x[2] * v[0] - x[0] * v[2], x[0] * v[1] - x[1] * v[0]]
        size, r = mp.sqrt(sum(c * c for c in H)), mp.sqrt(sum(c * c for c in x))
        w = [c / size for c in H]
        h, k = -w[1] / (1 + w[2]), w[0] / (1 + w[2])
        F, G = (1 + h * h - k * k, 2 * h * k, -2 * k), (2 * h * k, 1 - h * h + k * k, 2 * h)
        outward = sum(a * b for a, b in zip(x, v, strict=True))
        squared = sum(c * c for c in v)
        e = [(squared - 1 / r) * a - outward * b for a, b in zip(x, v, strict=True)]
        east, north = (sum(a * b for a, b in zip(e, axis, strict=True)) for axis in (F, G))
        alpha = 2 / r - squared
        sine = outward * mp.sqrt(alpha)
        return mp.atan2(north, east) + mp.atan2(sine, 1 - r * alpha) - sine


@pytest.mark.parametrize("across", [0.3, 1e-2, 1e-3, 1e-4])
def test_the_mean_longitude_of_a_narrow_ellipse(across):
    """Nearly a fall, whose root sqrt(1 - e^2) is small. Nearer still its plane is not known."""
    y = np.array([-1.5, 1.4, 0.1, -0.3 - across * 0.4, 0.28 - across * 0.3, 0.02 + across])
    found = float(EquinoctialElements.of_state(*jnp.split(jnp.asarray(y), 2), 1.0).mean_longitude)
    turns = (found - exact_mean_longitude(y)) / (2 * mp.pi)
    # A few roundings of angles of a turn.
    assert abs(float(turns - mp.nint(turns))) < 5e-16


@pytest.mark.parametrize("retrograde", [False, True])
def test_close_to_the_inclination_where_they_are_infinite(retrograde):
    """At d from there h is 1/tan(d/2): no digit is lost, nor in both modes of its derivative by the
    velocity across, -(1 + h^2)/2 cos(d)."""
    # Where also the square of the derivative is a number of the machine.
    d = 10.0 ** np.arange(-70.0, 1.0, 10.0)
    sense = 1.0 if retrograde else -1.0
    r = jnp.stack([jnp.ones(d.size), *jnp.zeros((2, d.size))])
    along = sense * jnp.cos(d)

    def h(across):
        v = jnp.stack([jnp.zeros(d.size), along, across])
        return ModifiedEquinoctialElements.of_state(r, v, 1.0, retrograde=retrograde).h

    expected = 1.0 / np.tan(0.5 * d)
    value, forward, reverse = both_modes(lambda x: jnp.stack([h(x)]))(jnp.sin(d))
    # Some ten operations, each with a rounding.
    np.testing.assert_allclose(value[0], expected, rtol=2e-15)
    for slopes in (forward, reverse):
        slope = -0.5 * (1.0 + expected**2) * np.cos(d)
        np.testing.assert_allclose(np.diagonal(slopes[0]), slope, rtol=1e-14)


def test_single_precision_and_batches():
    y = jnp.asarray(np.random.default_rng(0).normal(size=(6, 50)), jnp.float32)
    for kind in KINDS:
        x = kind.of_state(y[:3], y[3:], 1.0)
        assert all(v.dtype == jnp.float32 and v.shape == (50,) for v in jax.tree.leaves(x))
        again = jnp.concatenate(x.state(1.0))
        error = np.abs(again - y).max(axis=0) / np.abs(y).max(axis=0)
        assert again.dtype == jnp.float32 and np.median(error) < 3e-6


def test_what_does_not_exist_is_told():
    r, v = jnp.array([2.0, 0, 0]), jnp.array([0, 0.8, 0.6])
    with pytest.raises(InputError, match="parabola.*ModifiedEquinoctialElements"):
        EquinoctialElements.of_state(r, v, 1.0)
    with pytest.raises(InputError, match="inclination is 180 deg.*retrograde=True"):
        ModifiedEquinoctialElements.of_state(r, jnp.array([0, -0.8, 0]), 1.0)
    with pytest.raises(InputError, match="inclination is 0 deg.*retrograde=False"):
        EquinoctialElements.of_state(r, jnp.array([0, 0.8, 0]), 1.0, retrograde=True)
    with pytest.raises(InputError, match=r"semi_major_axis is 1: .*ModifiedEquinoctialElements"):
        EquinoctialElements(1.0, 1.2, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(InputError, match=r"true_longitude is 3: .*asymptotes"):
        ModifiedEquinoctialElements(1.0, 1.2, 0.0, 0.0, 0.0, 3.0)

"""Elements and constants of the orbit: published orbits, round trips, derivatives where an angle or
a radius is undefined."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxspace.core import InputError
from jaxspace.orbits import ClassicalElements, EquinoctialElements, ModifiedEquinoctialElements
from jaxspace.orbits.elements import (
    angular_momentum,
    apoapsis_radius,
    eccentricity_vector,
    elements_from_state,
    inclination,
    periapsis_radius,
    semi_latus_rectum,
    semi_major_axis,
    specific_energy,
    state_from_elements,
)
from jaxspace.orbits.kepler import kepler_flow

to_elements = jax.jit(elements_from_state)
to_state = jax.jit(state_from_elements)
ANGLES = ("inclination", "node", "argument_of_periapsis", "true_anomaly")
FOOT, MILE = 0.3048, 1609.344
K, R = 1.407e16 * FOOT**3, 3960.0 * MILE


def _read_outs(y):
    r, v = y[:3], y[3:]
    return jnp.stack(
        [
            periapsis_radius(r, v, 1.0),
            apoapsis_radius(r, v, 1.0),
            semi_major_axis(r, v, 1.0),
            semi_latus_rectum(r, v, 1.0),
            inclination(r, v),
            eccentricity_vector(r, v, 1.0)[0],
            specific_energy(r, v, 1.0),
        ]
    )


read_outs = jax.jit(_read_outs)
read_outs_forward = jax.jit(jax.jacfwd(_read_outs))
elements_forward = jax.jit(
    jax.jacfwd(lambda y: jnp.stack(jax.tree.leaves(elements_from_state(y[:3], y[3:], 1.0))))
)
read_outs_reverse = jax.jit(jax.jacrev(_read_outs))


def at_periapsis(q, e, mu=1.0):
    return jnp.array([q, 0.0, 0.0]), jnp.array([0.0, float(np.sqrt(mu * (1 + e) / q)), 0.0])


def test_elements_of_a_state():  # T4.7-prop
    r = jnp.array([0.07101070107664505, -0.8685945045241555, -0.3128395879460718])
    v = jnp.array([0.9466937972916112, -0.44387476077365373, -0.7149505694706483])
    x = to_elements(r, v, 1.0)
    assert float(semi_major_axis(r, v, 1.0)) == pytest.approx(1.8, rel=1e-9)
    assert float(x.eccentricity) == pytest.approx(0.7, rel=1e-9)
    assert float(x.inclination) == pytest.approx(0.6, rel=1e-9)
    assert float(x.node) == pytest.approx(1.1, rel=1e-9)
    assert float(x.argument_of_periapsis) == pytest.approx(2.2, rel=1e-9)
    assert float(specific_energy(r, v, 1.0)) == pytest.approx(-0.2777777777777778, rel=1e-9)
    assert np.linalg.norm(angular_momentum(r, v)) == pytest.approx(0.9581231653602788, rel=1e-9)


def test_state_of_elements():  # COE-VALLADO-2-5
    angles = np.radians([87.87, 227.89, 53.38, 92.335])
    position, velocity = to_state(
        ClassicalElements(11067.79, 0.83285, *(float(a) for a in angles)), 398600.4418
    )
    np.testing.assert_allclose(position, [6525.344, 6861.535, 6449.125], rtol=0, atol=5e-2)
    np.testing.assert_allclose(velocity, [4.902276, 5.533124, -1.975709], rtol=0, atol=1e-4)


def test_hyperbola():  # T4.8-hyp: a = 2, e = 1.6, theta = 50 deg
    x = ClassicalElements.from_periapsis(1.2, 1.6, true_anomaly=0.8726646259971648)
    assert float(x.semi_latus_rectum) == pytest.approx(3.12, rel=1e-9)
    r, v = to_state(x, 1.0)
    assert np.linalg.norm(r) == pytest.approx(1.5381125238178797, rel=1e-9)
    assert float(periapsis_radius(r, v, 1.0)) == pytest.approx(1.2, rel=1e-9)
    assert float(semi_major_axis(r, v, 1.0)) == pytest.approx(-2.0, rel=1e-9)
    assert float(apoapsis_radius(r, v, 1.0)) == np.inf


def test_explorer_6():  # T4.9-P4
    q, ra = 252667.008 + R, 42486681.6 + R
    e = (ra - q) / (ra + q)
    assert e == pytest.approx(0.7611741160773849, rel=1e-9)
    r, v = to_state(ClassicalElements.from_periapsis(q, e), K)
    assert np.linalg.norm(v) == pytest.approx(10290.957002197918, rel=1e-9)
    assert float(apoapsis_radius(r, v, K)) == pytest.approx(ra, rel=1e-12)
    again, _ = kepler_flow(r, v, 45997.36074189499, K)  # the period, s
    np.testing.assert_allclose(again, r, rtol=0, atol=1e-8 * q)


def test_explorer_7():  # T4.9-P1
    mu, q, ra = 397289654618476.56, 556833.024 + R, 1068604.416 + R
    r, v = at_periapsis(q, 0.03561030235162374, mu)
    assert float(apoapsis_radius(r, v, mu)) == pytest.approx(ra, rel=1e-9)
    assert float(v[1]) == pytest.approx(7705.3142211987515, rel=1e-9)
    _, slow = kepler_flow(r, v, 3036.0, mu)  # half the period of 101.2 min
    assert np.linalg.norm(slow) == pytest.approx(7175.407231073059, rel=1e-9)


# T4.9-P3: after a quarter of the sidereal day the body stands 90 degrees on
def test_stationary_orbit():
    r, v = (
        jnp.array([42158183.368161894, 0.0, 0.0]),
        jnp.array([0.0, 42158183.368161894 * 7.292e-05, 0.0]),
    )
    assert float(semi_major_axis(r, v, K)) == pytest.approx(42158183.368161894, rel=1e-9)
    assert float(jnp.linalg.norm(eccentricity_vector(r, v, K))) < 1e-9


def test_heading_error():  # T4.9-P6: circular speed, heading 1 degree up
    beta = 0.017453292519943295
    r, v = jnp.array([1.1, 0.0, 0.0]), jnp.array([np.sin(beta), np.cos(beta), 0.0]) / np.sqrt(1.1)
    x = to_elements(r, v, 1.0)
    assert float(x.eccentricity) == pytest.approx(0.01745240643728351, rel=1e-9)
    assert float(periapsis_radius(r, v, 1.0)) / 1.1 == pytest.approx(0.9825475935627165, rel=1e-9)
    assert float(x.true_anomaly) == pytest.approx(1.5882496193148399, rel=1e-9)


def test_launches():  # T4.10-P1, T4.10-P2, T4.10-P3
    r, v = at_periapsis(1.1, 0.2)
    assert float(apoapsis_radius(r, v, 1.0)) == pytest.approx(1.65, rel=1e-9)
    r0 = R + 643737.6
    r, v = jnp.array([r0, 0.0, 0.0]), jnp.array([0.0, 8046.72, 0.0])
    assert float(apoapsis_radius(r, v, K)) - R == pytest.approx(2934701.910948394, rel=1e-9)
    again, _ = kepler_flow(r, v, 7340.454979566215, K)
    np.testing.assert_allclose(again, r, rtol=0, atol=1e-8 * r0)
    r = jnp.array([R + 482803.2, 0.0, 0.0])
    escape = specific_energy(r, jnp.array([0.0, 10780.90572712029, 0.0]), K)
    assert abs(float(escape)) < 1e-9 * K / R
    circular = specific_energy(r, jnp.array([0.0, float(np.sqrt(K / r[0])), 0.0]), K)
    assert float(circular) * R / K == pytest.approx(-0.4647887323943662, rel=1e-9)


angle = st.floats(-3.1, 3.1)


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.1, 10),
    st.floats(0.01, 3),
    st.floats(0.05, 3.09),
    angle,
    angle,
    st.floats(-0.95, 0.95),
)
def test_there_and_back(p, e, i, node, omega, part):
    f = part * (np.pi if e < 1 else np.arccos(-1 / e))
    x = ClassicalElements(p, e, i, node, omega, float(f))
    back = to_elements(*to_state(x, 1.0), 1.0)
    # e >= 0.01 and sin(i) >= 0.05 divide the rounding; near an asymptote the radius multiplies it.
    assert float(back.semi_latus_rectum) == pytest.approx(p, rel=1e-10)
    assert float(back.eccentricity) == pytest.approx(e, rel=1e-9)
    for name in ANGLES:
        assert np.cos(getattr(back, name) - getattr(x, name)) > 0.0
        assert np.sin(getattr(back, name) - getattr(x, name)) == pytest.approx(0.0, abs=1e-9)


SINGULAR = {
    "circular": [1, 0, 0, 0, 0.8, 0.6],
    "equatorial": [1, 0, 0, 0.1, 1.2, 0],
    "circular and equatorial": [1, 0, 0, 0, 1, 0],
    "equatorial, retrograde": [1, 0, 0, 0.1, -1.2, 0],
    "parabolic": [2, 0, 0, 0, 0.8, 0.6],
    "hyperbolic": [1, 0, 0, 0.5, 1.5, 0.2],
    "polar": [1, 0, 0, 0, 0, 1.1],
}


@pytest.mark.parametrize("name", SINGULAR)
def test_undefined_angles_are_zero_and_lead_back(name):
    y = jnp.array(SINGULAR[name], dtype=float)
    x = to_elements(y[:3], y[3:], 1.0)
    if "equatorial" in name:
        assert float(x.node) == 0.0
    if "circular" in name:
        assert float(x.argument_of_periapsis) == 0.0
    np.testing.assert_allclose(jnp.concatenate(to_state(x, 1.0)), y, atol=1e-14)


@pytest.mark.parametrize("name", SINGULAR)
def test_derivatives_are_finite_everywhere(name):
    y = jnp.array(SINGULAR[name], dtype=float)
    assert np.isfinite(elements_forward(y)).all()
    forward, reverse = read_outs_forward(y), read_outs_reverse(y)
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(forward, reverse, atol=1e-14 * np.abs(forward).max())


def _differences(y, step=1e-6):
    up, down = (
        np.stack([read_outs(y + sign * d) for d in step * np.eye(6)], axis=1) for sign in (1, -1)
    )
    return (np.where(np.isfinite(up), up, 0.0) - np.where(np.isfinite(down), down, 0.0)) / (
        2 * step
    )


@pytest.mark.parametrize(
    ("name", "kept"),
    [("hyperbolic", (0, 2, 3, 4, 5, 6)), ("polar", range(7)), ("parabolic", (0, 3, 4, 5, 6))],
)
def test_derivatives_of_the_read_outs(name, kept):
    """Against central differences, whose error is 1e-12 in truncation and 1e-10 in rounding."""
    y, kept = jnp.array(SINGULAR[name], dtype=float), list(kept)
    np.testing.assert_allclose(
        np.asarray(read_outs_forward(y))[kept], _differences(y)[kept], atol=2e-8
    )


@pytest.mark.parametrize("e", [1e-3, 1e-6, 1e-9])
def test_apses_of_a_nearly_circular_orbit(e):
    """At periapsis a tangential increment of speed leaves r_p and raises r_a by d(2a)/dv = 4 a^2 v
    / mu; r_p goes with r."""
    r, v = at_periapsis(1.0, e)
    y = jnp.concatenate([r, v])
    d = np.asarray(read_outs_forward(y))
    a, speed = 1 / (1 - e), np.sqrt(1 + e)
    loss = 1e-15 / e  # the direction of the eccentricity vector is known to eps / e
    np.testing.assert_allclose(d[0, 4], 0.0, atol=1e-12 + 10 * loss)
    np.testing.assert_allclose(d[1, 4], 4 * a * a * speed, rtol=1e-12 + 10 * loss)
    np.testing.assert_allclose(d[0, 0], 1.0, rtol=1e-12 + 10 * loss)


def test_single_precision_and_batches():
    y = np.random.default_rng(0).normal(size=(6, 100)).astype(np.float32)
    x = to_elements(y[:3], y[3:], 1.0)
    assert all(leaf.dtype == jnp.float32 and leaf.shape == (100,) for leaf in jax.tree.leaves(x))
    r, v = to_state(x, 1.0)
    assert r.dtype == v.dtype == jnp.float32
    one = to_elements(y[:3, 7], y[3:, 7], 1.0)
    np.testing.assert_allclose(one.eccentricity, x.eccentricity[7], rtol=1e-5)


def test_input_is_checked():
    with pytest.raises(
        ValueError, match=r"ClassicalElements\.semi_latus_rectum is 0: it must be positive"
    ):
        ClassicalElements(0.0, 0.1, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"ClassicalElements\.eccentricity is -0\.1"):
        ClassicalElements(1.0, -0.1, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("size", [5e-17, 1e-16, 1e-15])
def test_an_eccentricity_of_rounding_counts_as_none(size):
    """The split into argument and anomaly would be arbitrary, with derivatives of 1/e."""
    y = jnp.array([1.0, 0.0, 0.0, 0.0, 0.8, 0.6]) + size * jnp.array([1.0, 0, 0, 1.0, 0, 0])
    x = to_elements(y[:3], y[3:], 1.0)
    assert float(x.eccentricity) == 0.0 and float(x.argument_of_periapsis) == 0.0
    assert np.abs(elements_forward(y)).max() < 10.0
    np.testing.assert_allclose(jnp.concatenate(to_state(x, 1.0)), y, atol=2e-15)


def test_the_circles_of_rounding():
    """Circles in any plane, rounded to doubles, have no periapsis; e = 1e-13 has one, to 1e-2."""
    g = np.random.default_rng(5)
    angles = g.uniform(0.1, 3.0, (4, 2000))
    for e in (0.0, 1e-13):
        x = ClassicalElements(1.0 + 0.0 * angles[0], e + 0.0 * angles[0], *angles)
        back = to_elements(*to_state(x, 1.0), 1.0)
        found = np.asarray(back.argument_of_periapsis)
        if e == 0.0:
            assert np.all(found == 0.0)
        else:
            np.testing.assert_allclose(found, angles[2], atol=2e-2)


def test_derivatives_lead_back_only_where_the_angles_have_a_meaning():
    """State to elements and back: the identity away from the circle and the equator, not there."""
    again = jax.jit(
        jax.jacfwd(
            lambda y: jnp.concatenate(
                state_from_elements(elements_from_state(y[:3], y[3:], 1.0), 1.0)
            )
        )
    )
    regular = jnp.array([1.0, 0.1, 0.2, -0.1, 0.9, 0.6])
    np.testing.assert_allclose(again(regular), np.eye(6), atol=1e-13)
    for name in ("circular", "equatorial"):
        slope = again(jnp.array(SINGULAR[name], dtype=float))
        assert np.isfinite(slope).all() and np.abs(slope - np.eye(6)).max() > 0.5


def test_the_constants_of_a_repulsive_centre():
    """A hyperbola about its other focus: r = p / (1 + e cos f) with a negative p, and a least
    distance a (e + 1), from energy and momentum alone."""
    mu = -0.8
    r, v = jnp.array([3.0, 1.0, 0.5]), jnp.array([-1.0, 0.2, 0.1])
    h = np.cross(r, v)
    length, energy = np.linalg.norm(r), 0.5 * np.dot(v, v) - mu / np.linalg.norm(r)
    # At the least distance q the velocity is h/q: h^2 / (2 q^2) - mu / q = E.
    least = np.max(np.roots([energy, mu, -0.5 * np.dot(h, h)]))
    np.testing.assert_allclose(periapsis_radius(r, v, mu), least, rtol=1e-14)
    e = np.asarray(eccentricity_vector(r, v, mu))
    size = np.sqrt(1.0 + 2.0 * energy * np.dot(h, h) / mu**2)
    np.testing.assert_allclose(np.linalg.norm(e), size, rtol=1e-14)
    p = semi_latus_rectum(r, v, mu)
    np.testing.assert_allclose(p, np.dot(h, h) / mu, rtol=1e-14)
    np.testing.assert_allclose(length, p / (1.0 + np.dot(e, r) / length), rtol=1e-13)
    np.testing.assert_allclose(semi_major_axis(r, v, mu), -mu / (2.0 * energy), rtol=1e-14)
    assert apoapsis_radius(r, v, mu) == np.inf
    with pytest.raises(InputError, match="mu is 0: it must be finite and not zero"):
        eccentricity_vector(r, v, 0.0)


@pytest.mark.parametrize("e", [0.0, 0.3, 1.5])
def test_the_sizes_of_elements_are_those_of_their_state(e):
    """Of all three kinds, by the functions of the state, with finite derivatives at the circle."""
    r, v = to_state(ClassicalElements(2.0, e, 0.4, 0.5, 0.6, 0.7), 1.0)
    kinds = [
        ClassicalElements(2.0, e, 0.4, 0.5, 0.6, 0.7),
        EquinoctialElements.of_state(r, v, 1.0),
        ModifiedEquinoctialElements.of_state(r, v, 1.0),
    ]
    expected = [f(r, v, 1.0) for f in (semi_major_axis, periapsis_radius, apoapsis_radius)]
    for elements in kinds:
        found = [elements.semi_major_axis, elements.periapsis_radius, elements.apoapsis_radius]
        # Roundings of the state, which differences of its numbers increase.
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(elements.eccentricity, e, atol=1e-15)


def test_the_sizes_of_a_parabola():
    """The derivative of an infinite size is zero."""
    parabola = ClassicalElements(2.0, [1.0, 0.5], 0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(parabola.semi_major_axis, [np.inf, 8.0 / 3.0])
    np.testing.assert_allclose(parabola.periapsis_radius, [1.0, 4.0 / 3.0])
    np.testing.assert_allclose(parabola.apoapsis_radius, [np.inf, 4.0])

    def size(e):
        elements = ClassicalElements(2.0, e, 0.0, 0.0, 0.0, 0.0)
        return elements.semi_major_axis + elements.apoapsis_radius

    assert jax.grad(size)(1.0) == 0.0
    # d/de of p / (1 - e^2) + p / (1 - e).
    np.testing.assert_allclose(jax.grad(size)(0.5), 2.0 * 0.5 * 2.0 / 0.75**2 + 2.0 / 0.25)

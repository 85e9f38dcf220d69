"""Shadow of a planet: the cylinder, the cones by their own geometry, the area of the disks by
quadrature, and the derivatives where the disks touch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxspace.orbits.shadow import _hidden_part, shadow, shadow_event, sunlight

RADIUS, SUN_RADIUS, AU = 6.378137e6, 6.957e8, 1.495978707e11
SUN = jnp.array([0.3, -0.7, 0.2]) / np.sqrt(0.62) * AU


def beside(depth, distance):
    """Positions at the `depth` behind the planet and the `distance` from the axis of the shadow."""
    axis = np.asarray(SUN) / AU
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    return jnp.asarray(-np.multiply.outer(axis, depth) + np.multiply.outer(side, distance))


@jax.jit
def margins(position):
    return (
        shadow(position, SUN, RADIUS),
        shadow(position, SUN, RADIUS, SUN_RADIUS),
        shadow(position, SUN, RADIUS, SUN_RADIUS, "umbra"),
    )


def test_the_shadow_is_a_cylinder_and_two_cones():
    """Each condition is zero on its surface: at the depth x behind the centre the cylinder has the
    radius R, the cones R_u = R sec g - x tan g with sin g = (R_s -+ R) / AU (Montenbruck 3.4.2)."""
    x = np.array([2.6e6, 7.0e6, 4.2e7, 3.8e8])
    cone = np.arcsin((SUN_RADIUS + RADIUS) / AU), np.arcsin((SUN_RADIUS - RADIUS) / AU)
    wide = RADIUS / np.cos(cone[0]) + x * np.tan(cone[0])
    narrow = RADIUS / np.cos(cone[1]) - x * np.tan(cone[1])
    for k, radius in enumerate((RADIUS + 0.0 * x, wide, narrow)):
        inside = margins(beside(x, radius * (1.0 - 1e-6)))[k]
        outside = margins(beside(x, radius * (1.0 + 1e-6)))[k]
        # Angles of order one, with rounding of 1e-16 and the slope 1 at the distance of the moon.
        np.testing.assert_allclose(margins(beside(x, radius))[k], 0.0, atol=3e-14)
        assert np.all(inside < 0.0) and np.all(outside > 0.0)


def test_no_shadow_on_the_side_of_the_sun():
    front = beside(np.array([-7e6, -7e6, -6.4e6, 0.0]), np.array([0.0, 3e6, 5e6, 7e6]))
    assert all(np.all(m > 0.0) for m in margins(front))
    np.testing.assert_array_equal(sunlight(front, SUN, RADIUS, SUN_RADIUS), np.ones(4))
    np.testing.assert_array_equal(sunlight(front, SUN, RADIUS), np.ones(4))


def overlap(a, b, c):
    """Covered part of a disk by the integral of its chords."""
    if c >= a + b:
        return 0.0

    def chord(x):
        return 2.0 * np.sqrt(max(min(a * a - x * x, b * b - (x - c) ** 2), 0.0))

    # The chords of the two disks are equal at `edge`, and the integrand has a kink.
    low, edge = max(-a, c - b), (c * c + a * a - b * b) / (2.0 * c)
    area = quad(chord, low, a, points=[edge] if low < edge < a else None, epsabs=1e-16, limit=200)
    return area[0] / (np.pi * a * a)


def test_the_light_is_the_area_of_the_disk():
    """From low orbit to beyond the tip of the umbra, where the planet is smaller than the sun."""
    depth = np.array([6.7e6, 6.7e6, 4.2e7, 4.2e7, 3.8e8, 1.6e9, 1.6e9])
    rim = RADIUS * np.array([0.9995, 1.002, 0.99, 1.03, 1.1, 0.5, 0.9])
    # On the circle that the low orbit leaves there.
    r = beside(np.sqrt(depth**2 - np.where(depth < 1e7, rim**2 * 0.9, 0.0)), rim)
    light = np.asarray(sunlight(r, SUN, RADIUS, SUN_RADIUS))
    d = np.asarray(SUN)[:, None] - np.asarray(r)
    far, near = np.linalg.norm(d, axis=0), np.linalg.norm(r, axis=0)
    c = np.arccos(np.sum(-d * np.asarray(r), axis=0) / far / near)
    a, b = np.arcsin(SUN_RADIUS / far), np.arcsin(np.minimum(RADIUS / near, 1.0))
    expected = [1.0 - overlap(*x) for x in zip(a, b, c, strict=True)]
    assert sum(0.0 < x < 1.0 for x in expected) >= 5
    # The angle c carries rounding of 1e-16 over 5e-3, the arccos above some tens of it.
    np.testing.assert_allclose(light, expected, atol=1e-11)


def test_umbra_and_ring():
    """None of the light in the umbra; behind its tip all but the planet's disk."""
    assert float(sunlight(beside(7e6, 1e6), SUN, RADIUS, SUN_RADIUS)) == 0.0
    assert float(sunlight(beside(7e6, 1e6), SUN, RADIUS)) == 0.0
    far = 3e9
    ring = np.arcsin(RADIUS / far) / np.arcsin(SUN_RADIUS / (AU + far))
    light = sunlight(beside(far, 0.0), SUN, RADIUS, SUN_RADIUS)
    assert float(light) == pytest.approx(1.0 - ring**2, rel=1e-12)


def test_derivatives_agree_with_differences_and_are_finite_at_the_ends():
    """Both modes in the penumbra against central differences of fourth order: a step of 1e-4 of its
    width of 6e4 m, rounding 1e-11. Where it begins and ends, on the axis and on the ground they are
    finite, and the light has none."""

    def both(r):
        light = sunlight(r, SUN, RADIUS, SUN_RADIUS)
        return jnp.stack([light, shadow(r, SUN, RADIUS, SUN_RADIUS)])

    r = beside(7.0e6, RADIUS + 3e3)
    h = 100.0 * np.concatenate([np.eye(3), -np.eye(3), 2.0 * np.eye(3), -2.0 * np.eye(3)])
    ends = [beside(7e6, 0.0), beside(-7e6, 0.0), beside(0.0, RADIUS), beside(7e6, 9e6)]
    places = jnp.stack([r, beside(7e6, 1e6), *ends, *(r + h)])
    value, forward, reverse = jax.jit(
        jax.vmap(lambda r: (both(r), jax.jacfwd(both)(r), jax.jacrev(both)(r)))
    )(places)
    assert 0.1 < float(value[0, 0]) < 0.9
    one, other, two, further = value[6:].reshape(4, 3, 2)
    expected = (8.0 * (one - other) - (two - further)) / 1200.0
    np.testing.assert_allclose(forward[0], expected.T, rtol=1e-6, atol=1e-13)
    scale = np.abs(forward[0]).max()
    np.testing.assert_allclose(reverse, forward, rtol=1e-11, atol=1e-11 * scale)
    assert np.all(np.isfinite(forward)) and np.all(np.isfinite(reverse))
    # The sine of half a turn is 1e-16.
    np.testing.assert_allclose(forward[1, 0], 0.0, atol=1e-14 * scale)
    np.testing.assert_array_equal(forward[3, 0], 0.0)
    slopes = jax.jit(jax.vmap(jax.grad(_hidden_part, (0, 1, 2))))
    touching = jnp.array([[1.0, 2.0, 3.0], [1.0, 2.0, 1.0], [2.0, 1.0, 1.0], [1.0, 1.0, 0.0]])
    assert np.all(np.isfinite(jnp.stack(slopes(*touching.T))))


def test_a_condition_of_time_and_state():
    class State:
        position = beside(7e6, 6e6)

    def still(t):
        return SUN

    expected = shadow(State.position, SUN, RADIUS)
    assert float(shadow_event(SUN, RADIUS)(0.0, State)) == float(expected)
    assert float(shadow_event(still, RADIUS)(0.0, State)) == float(expected)


def test_runs_and_single_precision():
    """A batch is its runs; float32 loses 1e-7 of an angle, over the sun's 5e-3."""
    r = beside(np.full(5, 7e6), RADIUS + np.linspace(-2e4, 4e4, 5))
    seen = jax.jit(sunlight)
    light = seen(r, SUN, RADIUS, SUN_RADIUS)
    assert light.shape == (5,)
    alone = [float(seen(r[:, k], SUN, RADIUS, SUN_RADIUS)) for k in range(5)]
    np.testing.assert_allclose(light, alone, atol=1e-13)
    single = seen(r.astype(jnp.float32), SUN.astype(jnp.float32), RADIUS, SUN_RADIUS)
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, light, atol=2e-4)

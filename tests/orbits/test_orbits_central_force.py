"""Central forces: fields against potentials, the radial motion against quadratures in fifty digits
and conics, circles, two masses."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from both_modes import both_modes
from systems import Screened

from jaxspace.bodies import BodyState, RigidBody
from jaxspace.orbits import CentralPotential, PowerLawForce, SphereGravity
from jaxspace.orbits.central_force import (
    power_law_potential,
    shell_gravity,
    shell_potential,
    sphere_gravity,
)
from jaxspace.orbits.elements import apoapsis_radius, periapsis_radius
from jaxspace.orbits.radial_motion import (
    circular_rate,
    effective_potential,
    radial_frequency_squared,
    radial_motion,
    turning_points,
)
from jaxspace.orbits.two_masses import from_relative, reduced_mass, sphere_of_influence, to_relative

BODY = RigidBody()
POINT = BodyState(position=jnp.array([0.7, -0.4, 0.5]), velocity=jnp.zeros(3))


def power(n, zero_at=1.0):
    return lambda r: power_law_potential(r, 1.0, n, zero_at)


def _motion(x):
    """Angle, period, energy, angular momentum between the radii x[0], x[1] under 1 / r^x[2]."""
    return jnp.stack(jax.tree.leaves(radial_motion(power(x[2], x[1]), x[0], x[1])))


motion = jax.jit(_motion)
motion_slopes = both_modes(_motion)


def _turns(y):
    return jnp.stack(turning_points(power(2.0), y[:3], y[3:]))


turns = jax.jit(_turns)
turns_slopes = both_modes(_turns)


def _radii(y):
    """The same by the elements of the conic."""
    return jnp.stack([f(y[:3], y[3:], 1.0) for f in (periapsis_radius, apoapsis_radius)])


radii = jax.jit(_radii)
radii_forward = jax.jit(jax.jacfwd(_radii))


@pytest.mark.parametrize(
    "effect",
    [
        PowerLawForce(1.3, 2.5),
        PowerLawForce(1.3, 1.0, 2.0),
        PowerLawForce(-0.4, -1.0),
        SphereGravity(1.3, 0.5),
        SphereGravity(1.3, 2.0),
        CentralPotential(Screened(1.3, 0.8)),
    ],
    ids=["power", "n = 1", "spring", "outside", "inside", "potential"],
)
def test_acceleration_is_minus_the_gradient_of_the_potential(effect):
    def energy(r):
        return effect.potential(0.0, BodyState(position=r), BODY)

    found = effect.load(0.0, POINT, BODY).acceleration_N
    np.testing.assert_allclose(found, -jax.grad(energy)(POINT.position), rtol=1e-13)


def test_potential_of_a_power_is_smooth_at_the_logarithm():
    r, n = 2.3, 1.0
    value, slope = jax.jvp(lambda n: power_law_potential(r, 1.0, n, 0.7), (n,), (1.0,))
    x = np.log(r / 0.7)
    assert float(value) == pytest.approx(x, rel=1e-15)
    # d/dn of the integral of r^-n, which is -ln(r) / r at n = 1.
    assert float(slope) == pytest.approx(-(np.log(r) ** 2 - np.log(0.7) ** 2) / 2, rel=1e-14)


def test_fields_at_and_near_the_centre_and_the_surface():
    r = jnp.array([[0.0, 0.5, 1.0, 2.0], [0.0] * 4, [0.0] * 4])
    np.testing.assert_array_equal(shell_gravity(r, 3.0, 1.0)[0], [0.0, 0.0, -3.0, -0.75])
    np.testing.assert_allclose(sphere_gravity(r, 3.0, 1.0)[0], [0.0, -1.5, -3.0, -0.75])
    assert float(shell_potential(0.2, 3.0, 1.0)) == -3.0
    gradient = jax.jacrev(lambda r: sphere_gravity(r, 3.0, 1.0))(jnp.zeros(3))
    np.testing.assert_allclose(gradient, -3.0 * np.eye(3))
    assert np.all(jax.jacfwd(lambda r: shell_gravity(r, 3.0, 1.0))(jnp.zeros(3)) == 0.0)
    spring = jax.jacrev(
        lambda r: PowerLawForce(2.0, -1.0).load(0, BodyState(r), BODY).acceleration_N
    )
    np.testing.assert_allclose(spring(jnp.zeros(3)), -2.0 * np.eye(3))


def exact_angle(n, inner, outer):
    """The apsidal angle by quadrature in fifty digits of Thomson 4.5-9."""
    with mp.workdps(50):
        n, a, b = mp.mpf(n), mp.mpf(inner), mp.mpf(outer)

        def u(r):
            return mp.log(r) if n == 1 else r ** (1 - n) / (1 - n)

        h_squared = 2 * (u(b) - u(a)) / (a**-2 - b**-2)
        energy = u(a) + h_squared / (2 * a * a)
        c, d = (mp.log(a) + mp.log(b)) / 2, (mp.log(b) - mp.log(a)) / 2

        # The nodes of Chebyshev leave out the ends, where the integrand is 0 / 0.
        def term(i):
            chi = (i + mp.mpf(1) / 2) * mp.pi / 80
            r = mp.exp(c - d * mp.cos(chi))
            return d * mp.sin(chi) / mp.sqrt(2 * r * r * (energy - u(r)) / h_squared - 1)

        return mp.pi / 80 * mp.fsum(term(i) for i in range(80))


@pytest.mark.parametrize("n", [0.0, 1.0, 2.5, 2.9])
@pytest.mark.parametrize("ratio", [1.0001, 1.3, 1.64, 1.66, 3.0, 100.0, 1e6])
def test_apsidal_angle(n, ratio):
    found = motion(jnp.array([1.0, ratio, n]))[0]
    # Rounding alone; near n = 3 the radicand is a difference of nearly equal terms.
    rtol = 1e-14 if n < 2.9 or ratio < 10.0 else 1e-11
    assert float(found) == pytest.approx(float(exact_angle(n, 1.0, ratio)), rel=rtol)


@pytest.mark.parametrize("n", [-1.0, 0.0, 1.0, 2.0, 2.5])
def test_small_oscillations(n):
    """On the circle itself, where both turning points are one."""
    angle, period, _, h = motion(jnp.array([1.3, 1.3, n]))
    rate = 1.3 ** (-0.5 * (n + 1.0))
    assert float(angle) == pytest.approx(np.pi / np.sqrt(3.0 - n), rel=1e-14)
    assert float(period) == pytest.approx(2.0 * np.pi / (np.sqrt(3.0 - n) * rate), rel=1e-14)
    assert float(h) == pytest.approx(1.69 * rate, rel=1e-14)
    assert float(circular_rate(power(n), 1.3)) == pytest.approx(rate, rel=1e-14)
    square = radial_frequency_squared(power(n), 1.3)
    assert float(square) == pytest.approx((3.0 - n) * rate**2, rel=1e-13)


@pytest.mark.parametrize("n", [3.5, 5.0])
def test_unstable_circles(n):
    assert float(radial_frequency_squared(power(n), 1.3)) < 0.0
    assert np.isnan(motion(jnp.array([1.3, 1.3, n]))[0])
    assert np.isnan(motion(jnp.array([1.0, 1.5, n]))[0])


@pytest.mark.sweep
@pytest.mark.parametrize(("inner", "outer"), [(0.5, 1.5), (1.0, 1.0), (1.0, 1.0 + 1e-9)])
def test_conics_and_their_derivatives(inner, outer):
    x = jnp.array([inner, outer, 2.0])
    a, p = 0.5 * (inner + outer), 2.0 * inner * outer / (inner + outer)
    # The zero of the potential is at the outer radius.
    expected = [np.pi, 2.0 * np.pi * a**1.5, 1.0 / outer - 0.5 / a, np.sqrt(p)]
    np.testing.assert_allclose(motion(x), expected, rtol=1e-14)
    dp = np.array([outer**2, inner**2]) * 2.0 / (inner + outer) ** 2
    da = np.array([0.5, 0.5])
    rows = [
        np.zeros(2),
        3.0 * np.pi * np.sqrt(a) * da,
        np.array([0.0, -1.0 / outer**2]) + 0.5 / a**2 * da,
        0.5 / np.sqrt(p) * dp,
    ]
    for found in motion_slopes(x)[1:]:
        np.testing.assert_allclose(found[:, :2], rows, rtol=1e-12, atol=1e-13)
        assert np.all(np.isfinite(found))


def test_derivative_of_the_apsidal_angle_by_the_exponent():
    found = motion_slopes(jnp.array([1.0, 1.0, 2.0]))[1][0, 2]
    assert float(found) == pytest.approx(0.5 * np.pi, rel=1e-13)  # pi / (2 (3 - n)^1.5)


STATES = {
    "ellipse": [1.0, 0.2, 0.3, 0.1, 0.8, 0.2],
    "hyperbola": [1.0, 0.0, 0.0, 1.3, 1.0, 0.0],
    "fall": [1.0, 0.0, 0.0, 0.3, 0.0, 0.0],
    "periapsis": [1.0, 0.0, 0.0, 0.0, 1.2, 0.0],
    "apoapsis": [1.0, 0.0, 0.0, 0.0, 0.6, 0.0],
    "almost a circle": [1.0, 0.0, 0.0, 1e-9, 1.0, 0.0],
}


@pytest.mark.parametrize("name", STATES)
def test_turning_points_of_conics(name):
    y = jnp.array(STATES[name])
    found, forward, reverse = turns_slopes(y)
    np.testing.assert_allclose(found, radii(y), rtol=1e-14)
    assert np.all(np.isfinite(forward))
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-12)
    if name in ("ellipse", "periapsis", "apoapsis"):
        np.testing.assert_allclose(forward, radii_forward(y), rtol=1e-12, atol=1e-13)


def test_turning_points_of_a_circle_and_of_many_motions():
    circle = jnp.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    found, _, reverse = turns_slopes(circle)
    np.testing.assert_array_equal(found, [1.0, 1.0])
    assert np.all(np.isfinite(reverse))
    many = jnp.stack([jnp.array(x) for x in STATES.values()], axis=1)
    one_by_one = jnp.stack([turns_slopes(y)[0] for y in many.T], axis=1)
    np.testing.assert_allclose(turns(many), one_by_one, rtol=1e-15)
    inner, outer = turns(many)[:, 0]
    h = np.linalg.norm(np.cross(many[:3, 0], many[3:, 0]))
    levels = effective_potential(power(2.0), jnp.array([inner, outer]), h)
    assert float(levels[0]) == pytest.approx(float(levels[1]), rel=1e-13)


def test_two_masses():
    rng = np.random.default_rng(2)
    a, b = jnp.asarray(rng.normal(size=(2, 3, 4)))
    m1, m2 = 5.0, jnp.array([0.0, 1.0, 5.0, 80.0])
    barycentre, separation = to_relative(m1, m2, a, b)
    np.testing.assert_allclose(barycentre, (m1 * a + m2 * b) / (m1 + m2), rtol=1e-13)
    for found, expected in zip(from_relative(m1, m2, barycentre, separation), (a, b), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-15)
    # The kinetic energy in both descriptions.
    square = jnp.sum(barycentre**2, axis=0) * (m1 + m2)
    square = square + reduced_mass(m1, m2) * jnp.sum(separation**2, axis=0)
    np.testing.assert_allclose(square, m1 * jnp.sum(a**2, 0) + m2 * jnp.sum(b**2, 0), rtol=1e-13)


def test_sphere_of_influence_of_the_earth():
    # Bate, Mueller and White, table 7.4-1: about 145 radii of the Earth, 9.25e5 km.
    radius = sphere_of_influence(1.495978707e11, 3.986004418e14, 1.32712440018e20)
    assert float(radius) == pytest.approx(9.25e8, rel=1e-3)


def test_the_inner_radius_of_a_fall_all_but_to_the_centre_keeps_its_digits():
    # (r r')^2 is there 1e-4 of that of the start.
    found = turning_points(lambda r: -1.0 / r, jnp.array([1.0, 0, 0]), jnp.array([0.9, 0.01, 0]))
    with mp.workdps(40):
        h2, two_e = mp.mpf(0.01) ** 2, mp.mpf(0.9) ** 2 + mp.mpf(0.01) ** 2 - 2
        root = mp.sqrt(1 + two_e * h2)
        truth = [float(h2 / (1 + root)), float((1 + root) / -two_e)]
    np.testing.assert_allclose(found, truth, rtol=3e-15)


def test_the_energy_of_a_motion_between_far_radii_keeps_its_digits():
    # At the inner radius both of its terms are a thousand times their sum.
    inner, outer = 0.01, 5.0

    def energy(radii):
        return radial_motion(lambda r: -jnp.exp(-0.1 * r) / r, *radii).energy

    with mp.workdps(40):

        def truth(a, b):
            u_a, u_b = (-mp.exp(-mp.mpf(0.1) * r) / r for r in (a, b))
            return (b * b * u_b - a * a * u_a) / (b * b - a * a)

        a, b = mp.mpf(inner), mp.mpf(outer)
        slopes = [float(mp.diff(truth, (a, b), n)) for n in ((1, 0), (0, 1))]
        value = float(truth(a, b))
    found, by_radii = jax.jit(jax.value_and_grad(energy))(jnp.asarray([inner, outer]))
    np.testing.assert_allclose(found, value, rtol=1e-15)
    np.testing.assert_allclose(by_radii, slopes, rtol=1e-13)

"""Spherical harmonics against 40 digits of mpmath, files of ICGEM, rotating bodies."""

import re

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxspace import Scene, load, simulate
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.core import InputError
from jaxspace.io import SceneError
from jaxspace.orbits import PlanetRotation, PointGravity, RotatingFrame, SphericalHarmonics, Zonals
from jaxspace.orbits.gravity_file import read_gfc
from jaxspace.orbits.spherical_harmonics import (
    spherical_harmonics,
    spherical_harmonics_potential,
)

MU, RADIUS = 1.3, 0.9
BODY = RigidBody()
# On the axis, both ways; at the equator; inside the reference radius; and anywhere.
PLACES = np.array(
    [
        [0.0, 0.0, 1.2],
        [0.0, 0.0, -1.1],
        [1.0, 0.0, 0.0],
        [-0.7, 0.9, 0.0],
        [0.3, -0.5, 0.4],
        [0.0, 0.0, 0.8],
        [0.6, 0.8, -0.5],
        [-1e-9, 2e-9, 1.05],
    ]
).T


def coefficients(degree, order, seed=0):
    """Random ones, that fall with the degree as those of planets."""
    c = np.random.default_rng(seed).normal(size=(2, degree + 1, order + 1))
    n, m = np.ogrid[: degree + 1, : order + 1]
    c = np.where(m <= n, c, 0.0) * 1e-3 / np.maximum(n, 1.0) ** 2
    c[:, 0] = 0.0
    c[1, :, 0] = 0.0
    return c


def by_mpmath(place, c):
    """The acceleration from Legendre's functions by Rodrigues' formula, whose polynomials have
    whole coefficients, each term differentiated by hand, with 40 digits."""
    with mp.workdps(40):
        x, y, z = (mp.mpf(float(v)) / mp.mpf(RADIUS) for v in place)
        r = mp.sqrt(x * x + y * y + z * z)
        u, total = z / r, [mp.mpf(0)] * 3
        for n, m in np.argwhere(np.any(c != 0.0, axis=0)).tolist():
            # d^m/du^m P_n: the derivative of order n + m of (u^2 - 1)^n / (2^n n!).
            size = mp.sqrt(
                (1 if m == 0 else 2) * (2 * n + 1) * mp.factorial(n - m) / mp.factorial(n + m)
            ) / (2**n * mp.factorial(n))
            powers = [(2 * k, (-1) ** (n - k) * mp.binomial(n, k)) for k in range(n + 1)]

            def slope(order, powers=powers):
                return mp.fsum(
                    factor * mp.factorial(p) / mp.factorial(p - order) * u ** (p - order)
                    for p, factor in powers
                    if p >= order
                )

            f, df = size * slope(n + m), size * slope(n + m + 1)
            weight = mp.mpc(mp.mpf(float(c[0, n, m])), -mp.mpf(float(c[1, n, m])))
            wave = mp.mpc(x, y)
            before = mp.re(weight * wave ** (m - 1)) if m else mp.mpf(0)
            across = mp.re(weight * 1j * wave ** (m - 1)) if m else mp.mpf(0)
            value = mp.re(weight * wave**m)
            power = r ** (-n - m - 1)
            # r = |x|: the slopes of the power, of u = z / r and of the wave.
            for i, (part, wave_slope) in enumerate(((x, before), (y, across), (z, mp.mpf(0)))):
                of_u = ((1 if i == 2 else 0) - u * part / r) / r
                total[i] += (
                    -(n + m + 1) * part / r**2 * power * f * value
                    + power * df * of_u * value
                    + power * f * m * wave_slope
                )
        return [float(mp.mpf(MU) / mp.mpf(RADIUS) ** 2 * t) for t in total]


def largest(degree):
    """Only the coefficients of the ends of a field of a high degree."""
    c = np.zeros((2, degree + 1, degree + 1))
    for n, m in ((degree, 0), (degree, 1), (degree, degree // 2), (degree, degree)):
        c[:, n, m] = 1e-3, (2e-3 if m else 0.0)
    return c


@pytest.mark.parametrize(
    "c, rtol",
    [(coefficients(7, 7), 1e-14), (coefficients(9, 4, seed=1), 1e-14), (largest(36), 2e-13)],
    ids=["complete", "fewer_orders", "degree_36"],
)
def test_the_acceleration_has_the_digits_of_mpmath(c, rtol):
    found = np.asarray(spherical_harmonics(jnp.asarray(PLACES), MU, jnp.asarray(c), RADIUS))
    exact = np.array([by_mpmath(place, c) for place in PLACES.T]).T
    size = np.linalg.norm(exact, axis=0)
    # Rounding of the position moves a wave of degree n by n of it.
    assert np.all(np.linalg.norm(found - exact, axis=0) <= rtol * size)


def test_derivatives_forward_and_reverse():
    """The acceleration is minus the gradient of the potential, also on the axis; its slopes are
    symmetric without a trace, equal in both modes, and those of the second derivatives too; those
    by the coefficients are the solid harmonics."""
    c, places = jnp.asarray(coefficients(6, 5)), jnp.asarray(PLACES)

    def energy(r, c=c):
        return spherical_harmonics_potential(r, MU, c, RADIUS)

    def acceleration(r):
        return spherical_harmonics(r, MU, c, RADIUS)

    @jax.jit
    @jax.vmap
    def every(r):
        third = jax.jvp(jax.jacfwd(acceleration), (r,), (jnp.array([0.3, -0.2, 0.5]),))[1]
        step = 1e-4 * jnp.array([0.3, -0.2, 0.5])
        difference = (
            jax.jacfwd(acceleration)(r + step) - jax.jacfwd(acceleration)(r - step)
        ) / 2e-4
        by_number = jax.grad(energy, 1)(r, c)
        return (
            *(jax.grad(energy)(r), acceleration(r), jax.jacfwd(acceleration)(r)),
            *(jax.jacrev(acceleration)(r), third, difference),
            *(energy(r), jnp.sum(by_number * c), jax.jvp(lambda c: energy(r, c), (c,), (c,))[1]),
        )

    slope, a, forward, reverse, third, difference, u, by_c, along_c = every(places.T)
    np.testing.assert_allclose(slope, -a, rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(forward, reverse, rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(forward, jnp.swapaxes(forward, 1, 2), rtol=1e-12, atol=1e-15)
    assert np.abs(np.trace(forward, axis1=1, axis2=2)).max() < 1e-14
    np.testing.assert_allclose(third, difference, rtol=1e-5, atol=1e-8)
    # The potential is linear in its coefficients.
    np.testing.assert_allclose(by_c, u, rtol=1e-13)
    np.testing.assert_allclose(along_c, u, rtol=1e-13)


def test_shapes_batches_and_zonals():
    """A batch is its runs, a field may differ between runs, times precede runs, and the zonal ones
    are those of `Zonals`."""
    c, places = jnp.asarray(coefficients(4, 4)), jnp.asarray(PLACES)
    together = spherical_harmonics(places, MU, c, RADIUS)
    alone = jax.jit(jax.vmap(lambda r: spherical_harmonics(r, MU, c, RADIUS), -1, -1))(places)
    np.testing.assert_allclose(together, alone, rtol=1e-13, atol=1e-17)
    fields = jnp.stack([c, 2.0 * c], -1)
    twice = spherical_harmonics(places[:, :, None], MU, fields, RADIUS)
    np.testing.assert_allclose(twice, together[..., None] * jnp.array([1.0, 2.0]), rtol=1e-13)
    one_place = spherical_harmonics(places[:, 4], MU, fields, RADIUS)
    np.testing.assert_allclose(one_place, twice[:, 4], rtol=1e-13)
    zonal = c.at[:, :, 1:].set(0.0).at[:, 1].set(0.0)
    harmonics = -zonal[0, 2:, 0] * jnp.sqrt(2.0 * jnp.arange(2.0, 5.0) + 1.0)
    y = BodyState(places[:, 6], jnp.zeros(3))
    a = SphericalHarmonics(MU, zonal, RADIUS).load(0.0, y, BODY).acceleration_N
    expected = Zonals(MU, harmonics, RADIUS).load(0.0, y, BODY).acceleration_N
    np.testing.assert_allclose(a, expected, rtol=1e-13)


def test_single_precision_in_metres():
    """No product leaves the range of float32, up to degree 70 and over the pole."""
    c = jnp.asarray(1e-3 * coefficients(70, 70))
    places = jnp.asarray(7.2e6 * PLACES[:, :5] / np.linalg.norm(PLACES[:, :5], axis=0))
    exact = np.asarray(spherical_harmonics(places, 3.986e14, c, 6378137.0))
    narrow = places.astype(jnp.float32), c.astype(jnp.float32)
    found = spherical_harmonics(narrow[0], 3.986e14, narrow[1], 6378137.0)
    assert found.dtype == jnp.float32
    size = np.linalg.norm(exact, axis=0)
    assert np.all(np.linalg.norm(np.asarray(found, float) - exact, axis=0) < 2e-5 * size)
    # The effect follows the state, whatever its coefficients are.
    effect = SphericalHarmonics(3.986e14, c, 6378137.0)
    y = BodyState(narrow[0][:, 2], jnp.zeros(3, jnp.float32))
    assert effect.load(0.0, y, BODY).acceleration_N.dtype == jnp.float32


def test_the_program_does_not_grow_with_the_degree():
    def lines(degree):
        c = jnp.zeros((2, degree + 1, degree + 1))
        traced = jax.make_jaxpr(lambda r: spherical_harmonics(r, MU, c, RADIUS))(jnp.ones(3))
        return len(str(traced).splitlines())

    # Powers of the wave are doubled: some lines for each factor of two.
    assert lines(144) - lines(36) <= 2 * (lines(36) - lines(18))


def test_a_rotation_about_the_axis_and_about_a_pole():
    """Against the rotations of SciPy: the angles of the IAU, of the axes."""
    v, t = np.array([0.3, -1.1, 0.7]), 40.0
    pole = PlanetRotation(0.02, 0.4, 0.7, 1.2, -1e-4, 2e-4)
    turns = [0.5 * np.pi + 0.7 - 1e-4 * t, 0.5 * np.pi - 1.2 - 2e-4 * t, 0.4 + 0.02 * t]
    expected = Rotation.from_euler("ZXZ", turns).inv().apply(v)
    np.testing.assert_allclose(pole.to_body(t, jnp.asarray(v)), expected, rtol=1e-14)
    np.testing.assert_allclose(pole.to_inertial(t, pole.to_body(t, jnp.asarray(v))), v, rtol=1e-14)
    about_z = PlanetRotation(0.02, 0.4).to_body(t, jnp.asarray(v))
    same = PlanetRotation(0.02, 0.4, -0.5 * np.pi, 0.5 * np.pi).to_body(t, jnp.asarray(v))
    np.testing.assert_allclose(about_z, same, rtol=1e-14)
    with pytest.raises(InputError, match="it must have both or neither"):
        PlanetRotation(0.02, right_ascension=0.1)


def test_an_orbit_about_a_rotating_body_is_that_in_its_axes():
    """Two scenes of one motion: relative to inertial axes, and relative to axes that rotate, where
    the body rests and the integral of Jacobi is kept."""
    c, rate = coefficients(4, 4), 0.3
    c[0, 2, 2] = 2e-3
    point = PointGravity(MU)
    turning = Scene((point, SphericalHarmonics(MU, c, RADIUS, PlanetRotation(rate))))
    resting = Scene((point, SphericalHarmonics(MU, c, RADIUS), RotatingFrame([0.0, 0.0, rate])))
    r, v, w = (jnp.array(x) for x in ([1.6, 0.2, 0.3], [0.0, -0.75, 0.6], [0.0, 0.0, rate]))
    ts = jnp.array([0.0, 9.0])
    inertial = simulate(turning, BodyState(r, v), ts, accuracy=1e-11)
    relative = simulate(resting, BodyState(r, v - jnp.cross(w, r)), ts, accuracy=1e-11)
    back = PlanetRotation(rate).to_inertial(9.0, relative.final.position)
    np.testing.assert_allclose(inertial.final.position, back, rtol=0, atol=1e-8)
    assert "energy" in resting.invariants(0.0, BodyState(r, v))
    assert "energy" not in turning.invariants(0.0, BodyState(r, v))
    assert relative.drift()["energy"].max() < 1e-9


def gfc(degree=3, **changes):
    """A file written for the test: numbers of no model."""
    head = {
        "product_type": "gravity_field",
        "modelname": "TEST",
        "earth_gravity_constant": "0.3986004415D+15",
        "radius": "6378136.3",
        "max_degree": f"{degree}",
        "norm": "fully_normalized",
        "tide_system": "zero_tide",
    }
    head |= changes
    lines = ["A synthetic field.", ""]
    lines += [f"{key} {value}" for key, value in head.items() if value is not None]
    lines += ["", "key L M C S", "end_of_head ===="]
    for n in range(2, degree + 1):
        for m in range(n + 1):
            lines.append(f"gfc {n} {m} {-1e-6 * (n + 0.1 * m)!r} {1e-7 * m!r} 0.0 0.0")
    return "\n".join(lines) + "\n"


def test_a_file_is_read_to_the_degree_and_order(tmp_path):
    path = tmp_path / "test.gfc"
    path.write_text(gfc().replace("-2e-06", "-.2D-05"))
    field = read_gfc(path)
    assert (field.name, field.mu, field.radius) == ("TEST", 3.986004415e14, 6378136.3)
    assert field.tide_system == "zero_tide" and field.coefficients.shape == (2, 4, 4)
    np.testing.assert_array_equal(field.coefficients[:, 2, :3].T[0], [-2e-6, 0.0])
    np.testing.assert_allclose(field.coefficients[:, 3, 2], [-3.2e-6, 2e-7])
    effect = SphericalHarmonics.of_file(path, degree=3, order=1)
    assert effect.coefficients.shape == (2, 4, 2) and effect.tide_system == "zero_tide"
    # That of the point belongs to another effect.
    assert float(effect.coefficients[0, 0, 0]) == 0.0


@pytest.mark.parametrize(
    "text, message",
    [
        ("OEM\n", "is not a gravity field of ICGEM, or is truncated: it must have a line end_of"),
        (gfc(product_type="topography"), "line 3: product_type is 'topography': it must be grav"),
        (gfc(norm="unnormalized"), "line 8: norm is 'unnormalized': it must be fully_normalized"),
        (gfc(tide_system="tidal"), "line 9: tide_system is 'tidal': it must be tide_free or zero"),
        (gfc(radius="-1"), "line 6: radius is '-1': it must be positive and finite"),
        (gfc(radius=None), "has no radius: its head must contain it"),
        (gfc(max_degree=None), "has no max_degree: its head must contain it"),
        (gfc(max_degree="1e3"), "line 7: max_degree is '1e3': it must be a whole number up to"),
        (gfc(max_degree="2"), "degree is 3: it must be from 0 to 2, that of"),
        (gfc().replace("gfc 3 3", "gfc 3 4"), "line 19 has the degree 3 and the order 4"),
        (gfc().replace("gfc 3 3", "gfc 3 2"), "line 19 repeats the degree 3 and the order 2"),
        (gfc().replace("gfc 3 3", "gfct 3 3"), "line 19 begins with gfct: fields that vary"),
        (gfc().replace("gfc 3 3", "gfc 3"), "no coefficients|line 19"),
        (gfc().replace("-2e-06", "nan"), "line 13: C is 'nan': it must be a finite number"),
        (gfc().replace("-2e-06 0.0", "-2e-06 1.0"), "line 13: S is '1.0': it must be zero"),
        (gfc() + "gfc 0 0 2.0 0.0\n", "line 20: C is '2.0': it must be 1 for degree 0"),
        ("\n".join(gfc().splitlines()[:-2]), "no coefficients of degree 3 and order 2 in its 17"),
        (gfc()[:-20], "line 19"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(tmp_path, text, message):
    path = tmp_path / "bad.gfc"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        read_gfc(path, 3)
    assert "bad.gfc" in str(raised.value)


def test_degree_and_order_that_cannot_be(tmp_path):
    path = tmp_path / "test.gfc"
    path.write_text(gfc())
    with pytest.raises(InputError, match="degree is 4: it must be from 0 to 3, that of .*line 7"):
        SphericalHarmonics.of_file(path, 4)
    with pytest.raises(InputError, match="order is 3: it must be from 0 to 2, the degree"):
        SphericalHarmonics.of_file(path, 2, 3)
    with pytest.raises(InputError, match="2 degrees and 3 orders: it must have at most as many"):
        SphericalHarmonics(MU, np.zeros((2, 2, 3)), RADIUS)


SCENE = """
[planet]
mu = "398600.4415 km^3/s^2"
radius = "6378.1363 km"

[effects.point_gravity]

[effects.spherical_harmonics]
file = "test.gfc"
degree = 3
order = 2
rotation = { rate = "360.9856235 deg/day", angle = "100 deg" }

[initial.orbit]
periapsis_altitude = "600 km"

[times]
end = "10 min"
samples = 2
"""


def test_a_scene_file_names_the_field(tmp_path):
    (tmp_path / "test.gfc").write_text(gfc())
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = load(path).system
    effect = scene.effects[1]
    assert effect.coefficients.shape == (2, 4, 3)
    np.testing.assert_allclose(effect.rotation.rate, np.radians(360.9856235) / 86400.0)
    assert re.search("SphericalHarmonics", str(scene.explain()))
    path.write_text(SCENE.replace("degree = 3", "degree = 9"))
    with pytest.raises((SceneError, InputError), match="degree is 9: it must be from 0 to 3"):
        _ = load(path).system

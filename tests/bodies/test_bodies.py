"""What has mass: inertia, composition, principal axes, Euler's equations, mass that burns."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jaxspace import bodies
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion

SLUG = 14.593902937206364  # kg, 1 lbf s^2/ft
FOOT = 0.3048  # m


def tensor(x, y, z, xy=0.0, xz=0.0, yz=0.0):
    """The tensor of moments and products of inertia; a product counts + int xy dm and enters with
    its sign turned."""
    return jnp.array([[x, -xy, -xz], [-xy, y, -yz], [-xz, -yz, z]])


positive = arrays(float, 3, elements=st.floats(0.1, 10.0))
vectors = arrays(float, 3, elements=st.floats(-5.0, 5.0))


def rods(masses, turn):
    """The inertia of three rods along the axes, turned anyhow: every one is that of some body."""
    c = Quaternion.from_rotation_vector(turn).matrix()
    return bodies.InertiaTensor(c @ jnp.diag(jnp.sum(masses) - masses) @ c.T)


def test_momentum_energy_and_axes():  # T5.2
    j = bodies.inertia.as_inertia(tensor(4.0, 5.0, 6.0, 0.5, -0.3, 0.2))
    omega = jnp.array([1.0, 2.0, -3.0])
    xi, eta = jnp.array([1.0, 2.0, 2.0]) / 3.0, jnp.array([2.0, 1.0, -2.0]) / 3.0
    np.testing.assert_allclose(j.times(omega), [2.1, 10.1, -18.1], rtol=1e-9)
    np.testing.assert_allclose(bodies.inertia.kinetic_energy(j, omega), 38.3, rtol=1e-9)
    np.testing.assert_allclose(
        bodies.mass_properties.moment_along(j.matrix(), xi), 5.066666666666666, rtol=1e-9
    )
    np.testing.assert_allclose(-xi @ j.matrix() @ eta, 0.8333333333333334, rtol=1e-9)
    moments, axes = bodies.principal_axes.principal_axes(j)
    np.testing.assert_allclose(
        moments, [3.7742848863950815, 5.109650993639416, 6.116064119965502], rtol=1e-9
    )
    np.testing.assert_allclose(axes.T @ j.matrix() @ axes, np.diag(moments), atol=1e-13)


def test_dyadic():  # TB-9
    j = bodies.inertia.as_inertia(tensor(10.0, 14.0, 6.0, 1.0, -0.8, 0.5))
    omega = jnp.array([0.3, -0.2, 1.1])
    np.testing.assert_allclose(j.times(omega), [4.08, -3.65, 6.94], rtol=1e-13)
    np.testing.assert_allclose(2.0 * bodies.inertia.kinetic_energy(j, omega), 9.588, rtol=1e-13)


def test_six_weights():  # T5.5-P4
    m, (x, y, z) = 10.0 / 32.2, (5.0, 2.0, 6.0)
    places = [[x, 0, 0], [-x, 0, 0], [0, y, 0], [0, -y, 0], [0, 0, z], [0, 0, -z]]
    body = bodies.solids.particles(jnp.full(6, m), jnp.array(places, dtype=float).T)
    np.testing.assert_allclose(
        np.diag(body.tensor), [24.84472049689441, 37.88819875776397, 18.012422360248447], rtol=1e-9
    )
    direction = jnp.array([1.0, 2.0, 2.0])
    np.testing.assert_allclose(
        body.moment_about(direction, jnp.zeros(3)), 27.605244996549345, rtol=1e-9
    )
    np.testing.assert_allclose(np.diag(body.tensor) * 32.2, [800.0, 1220.0, 580.0], rtol=1e-9)
    # The longest semi-axis, along z, first.
    semi_axes, axes = bodies.mass_properties.inertia_ellipsoid(body.inertia)
    longest = [0.23562096973595187, 0.2006240264773888, 0.16246058790657758]
    np.testing.assert_allclose(semi_axes, longest, rtol=1e-9)
    np.testing.assert_allclose(np.abs(axes), np.eye(3)[[1, 2, 0]], atol=1e-15)
    # The same in metres and kilograms: the formulas hold in every consistent set of units.
    np.testing.assert_allclose(SLUG * FOOT**2 * body.tensor[0, 0], 33.68491797096647, rtol=1e-9)


def test_skewed_disk():  # T5.5-P6
    m, radius, alpha = 2.0, 0.3, 0.13962634015954636
    disk = bodies.solids.cylinder(m, radius, 0.0).turned(Quaternion.about(1, jnp.array(alpha)))
    j = disk.tensor
    np.testing.assert_allclose(j[2, 2], 0.08912838815861217, rtol=1e-9)
    np.testing.assert_allclose(j[0, 0], 0.04587161184138783, rtol=1e-9)
    np.testing.assert_allclose(j[1, 1], 0.045, rtol=1e-9)
    np.testing.assert_allclose(abs(j[0, 2]), 0.006201840505882482, rtol=1e-9)
    moments, _ = bodies.principal_axes.principal_axes(disk.inertia)
    np.testing.assert_allclose(moments, m * radius**2 * np.array([0.25, 0.25, 0.5]), rtol=1e-13)


def test_cube():  # T5.5-P7
    m, c = 3.0, 0.4
    cube = bodies.solids.box(m, c * jnp.ones(3))
    diagonal, corner = jnp.ones(3), c / 2.0 * jnp.ones(3)
    np.testing.assert_allclose(cube.moment_about(diagonal, jnp.zeros(3)), 0.08, rtol=1e-9)
    about_corner = bodies.inertia.parallel_axes(cube.inertia, m, corner)
    moments, _ = bodies.principal_axes.principal_axes(about_corner)
    np.testing.assert_allclose(moments, [0.08, 0.44, 0.44], rtol=1e-9)
    np.testing.assert_allclose(cube.moment_about(diagonal, corner), 0.08, rtol=1e-9)


def test_three_masses():  # T5.5-P14
    angles = jnp.radians(jnp.array([0.0, 120.0, 240.0]))
    places = 0.5 * jnp.stack([jnp.cos(angles), jnp.sin(angles), 0.0 * angles])
    j = bodies.solids.particles(jnp.full(3, 2.0), places).tensor
    np.testing.assert_allclose(np.diag(j), [0.75, 0.75, 1.5], rtol=1e-9)
    np.testing.assert_allclose(j[0, 1], 0.0, atol=1e-15)


def test_angular_acceleration():  # T5.7
    omega, torque = jnp.array([2.0, -1.0, 0.5]), jnp.array([1.0, 2.0, -3.0])
    want = [0.6666666666666666, 1.2, 0.14285714285714285]
    for j in (jnp.array([3.0, 5.0, 7.0]), jnp.diag(jnp.array([3.0, 5.0, 7.0]))):
        np.testing.assert_allclose(
            bodies.newton_euler.angular_acceleration(bodies.inertia.as_inertia(j), omega, torque),
            want,
            rtol=1e-9,
        )


@jax.jit
def rates_of_invariants(masses, turn, omega):
    j = rods(masses, turn)
    rate = bodies.newton_euler.angular_acceleration(j, omega, None)
    energy_rate = jax.jvp(lambda w: bodies.inertia.kinetic_energy(j, w), (omega,), (rate,))[1]
    momentum_rate = jax.jvp(lambda w: jnp.sum(j.times(w) ** 2), (omega,), (rate,))[1]
    return energy_rate, momentum_rate


@given(positive, vectors, vectors)
def test_free_rotation_keeps_energy_and_momentum(masses, turn, omega):
    """The rate of omega is such that neither the energy nor the length of h changes: both rates
    vanish to rounding."""
    energy_rate, momentum_rate = rates_of_invariants(masses, turn, omega)
    # Terms up to J^2 omega^3 = 4e5 cancel in the first and J^3 omega^3 in the second.
    assert abs(energy_rate) < 1e-9 and abs(momentum_rate) < 1e-8


@jax.jit
def there_and_back(masses, turn, omega):
    j = rods(masses, turn)
    return j.solve(j.times(omega))


@given(positive, vectors, vectors)
def test_solve_undoes_times(masses, turn, omega):
    # Condition number below 200; Cramer's rule loses its square at worst.
    np.testing.assert_allclose(there_and_back(masses, turn, omega), omega, atol=1e-11)


@jax.jit
def growth_by_shift(masses, turn, mass, offset):
    j = rods(masses, turn)
    return bodies.inertia.parallel_axes(j, mass, offset).matrix() - j.matrix()


@given(positive, vectors, st.floats(0.1, 10.0), vectors)
def test_parallel_axes_only_adds(masses, turn, mass, offset):
    """Away from the centre of mass, no moment gets smaller; the mean one grows by 2/3 m d^2."""
    growth = np.asarray(growth_by_shift(masses, turn, mass, offset))
    np.testing.assert_allclose(np.trace(growth), 2.0 * mass * offset @ offset, atol=1e-11)
    assert np.linalg.eigvalsh(growth).min() > -1e-11


def test_runs_trail(key):
    moments = 1.0 + jax.random.uniform(key, (3, 5))
    omega = jax.random.normal(key, (3, 5))
    principal = bodies.PrincipalInertia(moments)
    full = bodies.InertiaTensor(principal.matrix())
    for name in ("times", "solve"):
        np.testing.assert_allclose(
            getattr(principal, name)(omega), getattr(full, name)(omega), rtol=1e-13
        )
    single = [
        bodies.newton_euler.angular_acceleration(
            bodies.PrincipalInertia(moments[:, n]), omega[:, n], None
        )
        for n in range(5)
    ]
    np.testing.assert_allclose(
        bodies.newton_euler.angular_acceleration(principal, omega, None),
        np.stack(single, -1),
        atol=1e-15,
    )
    offset, mass = jax.random.normal(key, (3, 5)), jnp.arange(1.0, 6.0)
    shifted = bodies.inertia.parallel_axes(principal, mass, offset)
    one = bodies.inertia.parallel_axes(
        bodies.PrincipalInertia(moments[:, 2]), mass[2], offset[:, 2]
    )
    np.testing.assert_allclose(shifted.matrix()[..., 2], one.matrix(), rtol=1e-14, atol=1e-14)
    values, axes = bodies.principal_axes.principal_axes(shifted)
    assert values.shape == (3, 5) and axes.shape == (3, 3, 5)


def test_burning_body_is_its_parts():
    """Dry body and propellant put together by the law of parallel axes about the common centre."""
    body = bodies.BurningBody(100.0, [40.0, 45.0, 20.0], [0.3, 0.35, 0.2], propellant_station=0.7)
    mass = jnp.array(160.0)
    z = body.centre_of_mass(mass)
    np.testing.assert_allclose(z, [0.0, 0.0, 60.0 * 0.7 / 160.0], rtol=1e-15)
    dry = bodies.inertia.parallel_axes(body.dry_inertia, 100.0, z)
    grain = bodies.inertia.as_inertia(60.0 * jnp.array([0.3, 0.35, 0.2]) ** 2)
    wet = bodies.inertia.parallel_axes(grain, 60.0, jnp.array([0.0, 0.0, 0.7]) - z)
    np.testing.assert_allclose(body.inertia(mass).matrix(), dry.matrix() + wet.matrix(), rtol=1e-14)
    np.testing.assert_allclose(
        body.inertia(jnp.array(100.0)).matrix(), np.diag([40.0, 45.0, 20.0]), rtol=1e-15
    )
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(lambda m: body.inertia(m).matrix())(mass)
        np.testing.assert_allclose(np.diag(slope), body.inertia_per_mass(mass), rtol=1e-13)


def test_rigid_body_has_what_it_was_given():
    point, top = bodies.RigidBody(), bodies.RigidBody(3.0, [1.0, 1.0, 1.5])
    assert not point.has_inertia() and point.constant_mass() is None
    assert top.has_inertia() and top.constant_mass() == 3.0
    np.testing.assert_array_equal(top.inertia_per_mass(jnp.array(3.0)), np.zeros(3))


def test_linear_acceleration():
    gravity, force = jnp.array([0.0, 0.0, -9.8]), jnp.array([2.0, 0.0, 0.0])
    np.testing.assert_array_equal(
        bodies.newton_euler.linear_acceleration(gravity, None, None), gravity
    )
    np.testing.assert_array_equal(
        bodies.newton_euler.linear_acceleration(None, force, 4.0), force / 4.0
    )
    np.testing.assert_array_equal(
        bodies.newton_euler.linear_acceleration(gravity, force, 4.0), [0.5, 0.0, -9.8]
    )


def test_absent_parts_are_no_leaves():
    state = bodies.BodyState(position=jnp.zeros(3), velocity=jnp.ones(3))
    assert state.present == ("position", "velocity")
    assert len(jax.tree.leaves(state)) == 2


@pytest.mark.parametrize(
    ("bad", "rule"),
    [
        (
            [1.0, 2.0, -1.0],
            "PrincipalInertia.moments is [ 1.  2. -1.]: it must be zero or positive, and finite.",
        ),
        ([1.0, 2.0, 0.0], "such that no moment exceeds the sum of the other two."),
        ([0.0, 0.0, 0.0], "it must be such that at most one moment is zero."),
        (
            [1.0, 1.0, 3.0],
            "PrincipalInertia.moments is [1. 1. 3.]: it must be such that no moment exceeds the "
            "sum of the other two.",
        ),
        (
            [1.0, 2.0],
            "inertia has the shape (2,): it must be (3,), the principal moments, or (3, 3), the "
            "tensor.",
        ),
        ([[1.0, 0.2, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]], "it must be symmetric."),
        ([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "it must be positive definite."),
        (
            [[1e300, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "exceeds the sum of the other two.",
        ),
        (np.diag([np.inf, 1.0, 1.0]).tolist(), "it must be finite."),
    ],
)
def test_impossible_inertia(bad, rule):
    with pytest.raises(InputError) as error:
        bodies.inertia.as_inertia(bad)
    assert rule in str(error.value)


@pytest.mark.parametrize(
    "build",
    [lambda: bodies.RigidBody(-1.0), lambda: bodies.BurningBody(0.0, [1.0, 1.0, 1.0], [0.1] * 3)],
)
def test_impossible_mass(build):
    with pytest.raises(InputError, match="mass is .*: it must be positive and finite"):
        build()


def rod(axis):
    """A slender rod along an axis of the body."""
    return bodies.PrincipalInertia(np.where(np.arange(3) == axis, 0.0, 2.0))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_rod_keeps_the_rate_about_its_axis(axis):
    """A torque changes the other two rates alone, also with masses on the axis of the rod; with
    masses beside it the rod turns as their common tensor. Slopes are finite, by the moments too."""
    across = np.arange(3) != axis
    omega, torque = jnp.array([0.3, -0.2, 1.1]), jnp.array([0.5, 0.7, -0.4])
    # 3 kg, half a metre up the axis.
    added = jnp.asarray(np.diag(0.75 * across))
    for more, moment in ((None, 2.0), (added, 2.75)):
        h = moment * across * omega
        expected = across * (np.asarray(torque) - np.cross(omega, h)) / moment
        found = bodies.newton_euler.angular_acceleration(rod(axis), omega, torque, more)
        # Roundings; the rate about the axis has none.
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)
        assert found[axis] == 0.0

    def rates(moments, omega, torque):
        return bodies.newton_euler.angular_acceleration(
            bodies.PrincipalInertia(moments), omega, torque
        )

    slopes = jax.jacrev(rates, (0, 1, 2))(rod(axis).moments, omega, torque)
    assert all(np.all(np.isfinite(x)) and np.all(np.asarray(x)[axis] == 0.0) for x in slopes)
    np.testing.assert_allclose(slopes[2], np.diag(0.5 * across), rtol=1e-15)
    beside = jnp.asarray(np.diag([0.3, 0.2, 0.4]))
    whole = bodies.InertiaTensor(rod(axis).matrix() + beside)
    np.testing.assert_allclose(
        bodies.newton_euler.angular_acceleration(rod(axis), omega, torque, beside),
        bodies.newton_euler.angular_acceleration(whole, omega, torque),
        rtol=1e-14,
    )


# Rods along x, y and z, and bodies which are all but rods, as six runs.
THIN, ALONG = 1e-6, jnp.concatenate([jnp.eye(3), jnp.eye(3)], axis=1)
SHARES = jnp.repeat(jnp.array([0.0, THIN]), 3)
TURNING = jnp.array([0.3, -0.2, 1.1])[:, None] + jnp.zeros_like(ALONG)


def turned(share, omega):
    """Attitude and angular velocity after 7 s, for the axial moment as a share of the others."""
    moments = 2.0 * jnp.where(ALONG == 1.0, share, 1.0)
    turn, later = bodies.principal_frame.free_turn(
        jnp.full(6, 7.0), bodies.PrincipalInertia(moments), omega + 0.0 * share
    )
    return jnp.concatenate([turn.wxyz, later])


@jax.jit
def turned_and_slope(shares, omega):
    return jax.jvp(lambda s: turned(s, omega), (shares,), (jnp.ones(6),))


def test_the_free_turn_of_a_rod():
    """Its momentum L stays in inertial space, its spin in the body; the limit of thin bodies, with
    its derivatives."""
    small, along, omega = THIN, ALONG, TURNING
    found, slope = (np.asarray(x) for x in turned_and_slope(SHARES, omega))
    turn, later = Quaternion(jnp.asarray(found[:4, :3])), found[4:, :3]
    start, spin = np.asarray(omega * (1.0 - along))[:, :3], np.asarray(along)[:, :3]
    momentum = turn.rotate(jnp.asarray(later * (1.0 - spin)))
    np.testing.assert_allclose(momentum, start, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(np.sum(spin * later, axis=0), [0.3, -0.2, 1.1])
    # The step from the rod to the other formula by the mean of both slopes: rounding over `small`.
    mean = 0.5 * (slope[:, :3] + slope[:, 3:])
    np.testing.assert_allclose((found[:, 3:] - found[:, :3]) / small, mean, atol=1e-7)


@pytest.mark.sweep
def test_reverse_mode_of_the_free_turn_of_a_rod():
    _, slope = (np.asarray(x) for x in turned_and_slope(SHARES, TURNING))
    weights = jnp.arange(1.0, 8.0)[:, None]
    reverse = jax.jit(jax.grad(lambda s, w: jnp.sum(weights * turned(s, w)), (0, 1)))
    by_share, by_omega = (np.asarray(x) for x in reverse(SHARES, TURNING))
    np.testing.assert_allclose(by_share, np.sum(weights * slope, axis=0), rtol=1e-9, atol=1e-9)
    # Of thin bodies they differ by some 7^2 times `small` and the weights.
    np.testing.assert_allclose(by_omega[:, :3], by_omega[:, 3:], atol=2e-3)


def test_the_ellipsoid_of_a_rod_has_no_end():
    def axes(scale):
        return bodies.mass_properties.inertia_ellipsoid(
            bodies.PrincipalInertia(scale * rod(0).moments)
        )[0]

    np.testing.assert_allclose(axes(2.0), [np.inf, 0.5, 0.5], rtol=1e-15)
    np.testing.assert_allclose(jax.jacfwd(axes)(2.0), [0.0, -0.125, -0.125], rtol=1e-14)


SHARED = [[2.0, 3.0, 4.0], [[2.0, 0.1, 0.2], [0.1, 3.0, 0.3], [0.2, 0.3, 4.0]]]


@pytest.mark.parametrize("given", SHARED)
@pytest.mark.parametrize("shape", [(5,), (4, 5), (3,)])  # (3,): as many runs as components
def test_one_body_is_shared_by_many_runs(given, shape):
    j = bodies.inertia.as_inertia(given)
    matrix = np.asarray(j.matrix())
    omega = np.random.default_rng(1).normal(size=(3, *shape))
    h = np.einsum("ij,j...->i...", matrix, omega)
    # A few roundings of double precision; the tensor has a condition number of two.
    np.testing.assert_allclose(j.times(jnp.asarray(omega)), h, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(j.solve(jnp.asarray(h)), omega, rtol=1e-13, atol=1e-13)
    added = 1.0 + omega**2
    # Plus one and a common part, so that every sum is that of a body.
    more = j.plus_diagonal(jnp.asarray(0.1 * added[:1] + np.zeros((3, *shape))))
    expected = matrix.reshape(3, 3, *(1,) * len(shape)) + 0.1 * added[0] * np.eye(3).reshape(
        3, 3, *(1,) * len(shape)
    )
    np.testing.assert_allclose(more.matrix(), expected, rtol=1e-15)


@pytest.mark.parametrize("given", SHARED)
def test_bodies_of_many_runs_meet_runs_at_many_times(given):
    j = jnp.asarray(given)[..., None] * (1.0 + jnp.arange(5.0))
    batch = bodies.PrincipalInertia(j) if j.ndim == 2 else bodies.InertiaTensor(j)
    matrix = np.asarray(batch.matrix())
    rng = np.random.default_rng(2)
    for omega in (rng.normal(size=(3, 4, 5)), rng.normal(size=3)):
        spread = omega if omega.ndim == 3 else omega[:, None]
        h = np.einsum("ijr,j...r->i...r", matrix, np.broadcast_to(spread, (*spread.shape[:-1], 5)))
        # As above: roundings of a well conditioned tensor.
        np.testing.assert_allclose(batch.times(jnp.asarray(omega)), h, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(
            batch.solve(jnp.asarray(h)), np.broadcast_to(spread, h.shape), rtol=1e-13, atol=1e-13
        )
        more = batch.plus_diagonal(jnp.ones_like(jnp.asarray(omega)))
        expected = matrix + np.eye(3)[..., None]
        if omega.ndim == 3:
            expected = expected[:, :, None] + np.zeros((1, 1, 4, 1))
        np.testing.assert_allclose(more.matrix(), expected, rtol=1e-15)


def test_parallel_axes_of_one_body_about_many_points():
    inertia = bodies.inertia.as_inertia([2.0, 3.0, 4.0])
    points = np.random.default_rng(3).normal(size=(3, 5))
    found = bodies.inertia.parallel_axes(inertia, 2.0, jnp.asarray(points)).matrix()
    for k, d in enumerate(points.T):
        expected = np.diag([2.0, 3.0, 4.0]) + 2.0 * (d @ d * np.eye(3) - np.outer(d, d))
        # Differences of squares of order ten: a few roundings of these.
        np.testing.assert_allclose(found[:, :, k], expected, atol=1e-13)


def test_small_elements_of_a_tensor_keep_their_digits():
    # The worst place that the fuzz test has found, by cofactors in exact arithmetic. No body has
    # such a tensor: as one of a batch it is not checked.
    a, b, c, d = 0.9999921297958092, 0.9921837529278942, 1.000000000099643e-06, 0.9969452047205531
    e, f = 1.0006814770828135e-07, -3.110621906344668e-15
    h = [0.9714563355987967, 1.6450213952654131, -2.2504748748798353]
    inertia = bodies.InertiaTensor(jnp.array([[a, d, e], [d, b, f], [e, f, c]])[..., None])
    a, b, c, d, e, f = map(Fraction, (a, b, c, d, e, f))
    adjugate = [
        [b * c - f * f, e * f - d * c, d * f - e * b],
        [e * f - d * c, a * c - e * e, d * e - a * f],
        [d * f - e * b, d * e - a * f, a * b - d * d],
    ]
    whole = a * adjugate[0][0] + d * adjugate[0][1] + e * adjugate[0][2]
    sums = [sum(p * Fraction(q) for p, q in zip(row, h, strict=True)) for row in adjugate]
    # Some roundings, of which the block of a, b and d makes 600 by its condition.
    np.testing.assert_allclose(
        inertia.solve(jnp.array(h)[:, None])[:, 0], [float(x / whole) for x in sums], rtol=5e-14
    )

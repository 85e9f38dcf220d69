"""Mass properties of uniform parts against exact quadrature, their composition, the ellipsoid of
inertia, and a body that is caught at a pivot."""

from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import bodies
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion

# A few roundings of sums of a dozen terms.
ROUNDING = 1e-14
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def revolved(mass, low, high, outer, inner=lambda z: 0.0 * z, sheet=False):
    """Height of the centre, transverse and axial moment of a body of revolution whose squared radii
    are polynomials of z: Gauss's rule is exact, and the mass scales the result."""
    z = 0.5 * (low + high) + 0.5 * (high - low) * NODES
    R, r = outer(z), inner(z)
    if sheet:  # a thin layer: all of it at the outer radius
        m, axial = R**0.5, R**1.5
    else:
        m, axial = R - r, 0.5 * (R**2 - r**2)
    total = np.sum(WEIGHTS * m)
    share = mass / total
    centre = np.sum(WEIGHTS * m * z) / total
    axial = share * np.sum(WEIGHTS * axial)
    return centre, 0.5 * axial + share * np.sum(WEIGHTS * m * (z - centre) ** 2), axial


def line(bottom, top, height):
    return lambda z: (bottom + (top - bottom) * z / height) ** 2


SOLIDS = {
    "cylinder": (
        bodies.solids.cylinder(2.0, 0.7, 1.9),
        revolved(2.0, -0.95, 0.95, lambda z: 0 * z + 0.49),
    ),
    "hollow cylinder": (
        bodies.solids.cylinder(2.0, 0.7, 1.9, 0.6),
        revolved(2.0, -0.95, 0.95, lambda z: 0 * z + 0.49, lambda z: 0 * z + 0.36),
    ),
    "tube": (
        bodies.solids.cylinder(2.0, 0.7, 1.9, 0.7),
        revolved(2.0, -0.95, 0.95, lambda z: 0 * z + 0.49, sheet=True),
    ),
    "cone": (bodies.solids.cone(3.0, 0.8, 1.5), revolved(3.0, 0.0, 1.5, line(0.8, 0.0, 1.5))),
    "frustum": (
        bodies.solids.cone(3.0, 0.8, 1.5, 0.3),
        revolved(3.0, 0.0, 1.5, line(0.8, 0.3, 1.5)),
    ),
    "conical sheet": (
        bodies.solids.conical_shell(3.0, 0.8, 1.5),
        revolved(3.0, 0.0, 1.5, line(0.8, 0.0, 1.5), sheet=True),
    ),
    "frustum of a sheet": (
        bodies.solids.conical_shell(3.0, 0.8, 1.5, 0.3),
        revolved(3.0, 0.0, 1.5, line(0.8, 0.3, 1.5), sheet=True),
    ),
    "sphere": (bodies.solids.sphere(5.0, 1.2), revolved(5.0, -1.2, 1.2, lambda z: 1.44 - z**2)),
    "spheroid": (
        bodies.solids.ellipsoid(5.0, jnp.array([1.2, 1.2, 0.6])),
        revolved(5.0, -0.6, 0.6, lambda z: 1.44 - 4.0 * z**2),
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_of_revolution(name):
    found, (height, across, axial) = SOLIDS[name]
    assert_allclose(found.centre, [0.0, 0.0, height], atol=ROUNDING)
    assert_allclose(found.tensor, np.diag([across, across, axial]), rtol=ROUNDING, atol=ROUNDING)


def test_special_cases():
    """What the handbooks list under names of their own."""
    m, r, l = 2.0, 0.7, 1.9
    listed = {
        "disk": (bodies.solids.cylinder(m, r, 0.0), [r**2 / 4, r**2 / 4, r**2 / 2]),
        "hoop": (bodies.solids.cylinder(m, r, 0.0, r), [r**2 / 2, r**2 / 2, r**2]),
        "rod": (bodies.solids.cylinder(m, 0.0, l), [l**2 / 12, l**2 / 12, 0.0]),
        "thin box": (bodies.solids.box(m, jnp.array([0.0, 0.0, l])), [l**2 / 12, l**2 / 12, 0.0]),
        "plate": (
            bodies.solids.box(m, jnp.array([l, r, 0.0])),
            [r**2 / 12, l**2 / 12, (r**2 + l**2) / 12],
        ),
        "shell": (bodies.solids.sphere(m, r, r), [2 * r**2 / 3] * 3),
        "disk of sheet": (bodies.solids.conical_shell(m, r, 0.0), [r**2 / 4, r**2 / 4, r**2 / 2]),
    }
    for name, (found, over_m) in listed.items():
        assert_allclose(found.tensor, m * np.diag(over_m), atol=ROUNDING, err_msg=name)


def test_a_sphere_with_a_hollow_is_a_difference():
    density = 3.0
    masses = density * 4.0 / 3.0 * np.pi * np.array([1.2, 0.5]) ** 3
    left = bodies.mass_properties.combined(
        bodies.solids.sphere(masses[0], 1.2), bodies.solids.sphere(masses[1], 0.5).hole()
    )
    whole = bodies.solids.sphere(masses[0] - masses[1], 1.2, 0.5)
    jax.tree.map(lambda a, b: assert_allclose(a, b, rtol=1e-14, atol=1e-13), left, whole)


def test_a_box_of_six_tetrahedra():
    """Kuhn's dissection: one tetrahedron for each order of the axes."""
    sides = np.array([0.4, 0.7, 1.1])
    parts = []
    for order in permutations(range(3)):
        steps = np.zeros((4, 3))
        for k, i in enumerate(order):
            steps[k + 1] = steps[k]
            steps[k + 1, i] = sides[i]
        parts.append(bodies.solids.simplex(0.5, jnp.asarray(steps.T)))
    found = bodies.mass_properties.combined(*parts)
    box = bodies.solids.box(3.0, jnp.asarray(sides)).moved(jnp.asarray(sides / 2.0))
    jax.tree.map(lambda a, b: assert_allclose(a, b, rtol=1e-14, atol=ROUNDING), found, box)


def test_simplices_of_every_number_of_points():
    a, b, c = (jnp.array(v) for v in ([0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]))
    point = bodies.solids.simplex(2.0, b[:, None])
    assert_allclose(point.centre, b)
    assert_allclose(point.tensor, np.zeros((3, 3)))
    rod = bodies.solids.simplex(2.0, jnp.stack([a, b], axis=1))
    assert_allclose(rod.about(a), np.diag([0.0, 8.0 / 3.0, 8.0 / 3.0]), atol=ROUNDING)
    # A right-angled triangle about its corner: m c^2/6, m b^2/6 and -m b c/12.
    triangle = bodies.solids.simplex(2.0, jnp.stack([a, b, c], axis=1))
    corner = [[3.0, -1.0, 0.0], [-1.0, 8.0 / 6.0, 0.0], [0.0, 0.0, 13.0 / 3.0]]
    assert_allclose(triangle.about(a), corner, atol=ROUNDING)


def test_parts_may_be_put_together_in_any_order(key):
    """A part of parts, turned and moved, is what its particles are."""
    masses = 0.2 + jax.random.uniform(key, (9,))
    places = jax.random.normal(key, (3, 9))
    turn = Quaternion.from_rotation_vector(jnp.array([0.4, -1.3, 0.8]))
    offset = jnp.array([0.3, 2.0, -0.7])

    @jax.jit
    def both():
        parts = [bodies.solids.particles(masses[i::3], places[:, i::3]) for i in range(3)]
        nested = bodies.mass_properties.combined(
            parts[2], bodies.mass_properties.combined(parts[1], parts[0])
        )
        moved = turn.rotate(places) + offset[:, None]
        return nested.turned(turn).moved(offset), bodies.solids.particles(masses, moved)

    found, direct = both()
    jax.tree.map(lambda a, b: assert_allclose(a, b, rtol=1e-13, atol=1e-13), found, direct)
    # By the definition, without a tensor.
    d = np.asarray(turn.rotate(places) + offset[:, None])
    axis = np.array([1.0, -2.0, 0.5])
    across = np.cross(axis / np.linalg.norm(axis), d.T)
    assert_allclose(
        found.moment_about(jnp.asarray(axis), jnp.zeros(3)),
        np.sum(np.asarray(masses) * np.sum(across**2, axis=1)),
        rtol=1e-13,
    )


def test_runs_trail(key):
    radius = 1.0 + jax.random.uniform(key, (5,))
    offset = jax.random.normal(key, (3, 5))
    shared = bodies.solids.cone(2.0, 0.5, 1.5)

    def build(radius, offset):
        ball = bodies.solids.sphere(3.0, radius, 0.5 * radius).moved(offset)
        pair = bodies.solids.particles(
            jnp.stack([radius, 2.0 * radius]), jnp.stack([offset, -offset], 1)
        )
        return bodies.mass_properties.combined(shared, ball, pair)

    batch = build(radius, offset)
    for i in range(5):
        one = build(radius[i], offset[:, i])
        jax.tree.map(
            lambda a, b, i=i: assert_allclose(a[..., i], b, rtol=1e-13, atol=1e-13), batch, one
        )
    assert batch.mass.shape == (5,) and batch.tensor.shape == (3, 3, 5)


def test_slopes_at_the_ends_of_the_ranges():
    """A shell, a cone and a tube are ends of a family: its slopes are those of the full body."""

    def family(x):
        m, R, r, h = x
        parts = (
            *(
                bodies.solids.sphere(m, R, r),
                bodies.solids.cone(m, R, h, r),
                bodies.solids.conical_shell(m, R, h, r),
            ),
            bodies.solids.cylinder(m, R, h, r),
        )
        return jnp.stack([jnp.stack([p.tensor[0, 0], p.tensor[2, 2], p.centre[2]]) for p in parts])

    value, slopes = (jax.jit(f) for f in (family, jax.jacrev(family)))
    for x in ([2.0, 0.7, 0.7, 1.3], [2.0, 0.7, 0.0, 1.3], [2.0, 0.7, 0.3, 0.0]):
        x = np.array(x)
        found = np.asarray(slopes(x))
        for i in range(4):
            # By Richardson from steps inwards and outwards: the rational functions have both sides.
            d = np.eye(4)[i] * 1e-2
            ends = [(value(x + s * d) - value(x - s * d)) / (2e-2 * s) for s in (1.0, 0.5, 0.25)]
            first = [(4.0 * ends[k + 1] - ends[k]) / 3.0 for k in range(2)]
            assert_allclose(found[..., i], (16.0 * first[1] - first[0]) / 15.0, atol=1e-9)


def test_single_precision_stays_single():
    m, x = jnp.float32(2.0), jnp.array([0.3, 0.4, 0.5], jnp.float32)
    parts = (
        bodies.solids.box(m, x),
        bodies.solids.cone(m, x[0], x[1]),
        bodies.solids.sphere(m, x[0]),
    )
    whole = bodies.mass_properties.combined(*parts, bodies.solids.simplex(m, x[:, None]))
    assert all(leaf.dtype == jnp.float32 for leaf in jax.tree.leaves(whole))


def test_turned_axes_and_the_ellipsoid(key):
    body = bodies.mass_properties.combined(
        bodies.solids.box(2.0, jnp.array([0.5, 1.0, 2.0])),
        bodies.solids.cylinder(1.0, 0.3, 1.0).moved(jnp.array([1.0, 0.4, -0.2])),
    )
    semi_axes, axes = bodies.mass_properties.inertia_ellipsoid(body.inertia)
    for i in range(3):
        radius = 1.0 / jnp.sqrt(bodies.mass_properties.moment_along(body.tensor, axes[:, i]))
        assert_allclose(semi_axes[i], radius, rtol=1e-13)
    # In the axes of the ellipsoid the tensor is diagonal.
    turn = Quaternion.from_matrix(axes * jnp.sign(jnp.linalg.det(axes)))
    local = bodies.mass_properties.turned_tensor(body.tensor, turn.inverse())
    assert_allclose(local, np.diag(np.asarray(semi_axes) ** -2), atol=1e-14)
    # Tensor and vectors turn alike.
    omega = jax.random.normal(key, (3,))
    turned = bodies.mass_properties.turned_tensor(body.tensor, turn)
    assert_allclose(turned @ turn.rotate(omega), turn.rotate(body.tensor @ omega), atol=1e-13)


@pytest.mark.parametrize("arm", [[0.0, 1.2, 0.9], [0.5, -0.3, 0.2], [0.0, 0.0, 0.0]])
def test_impact_keeps_the_momentum_about_the_pivot(arm):
    inertia = bodies.solids.box(50.0, jnp.array([2.0, 3.0, 1.5])).turned(
        Quaternion.from_rotation_vector(jnp.array([0.3, 0.2, -0.5]))
    )
    j, r = inertia.inertia, jnp.array(arm)
    v, w = jnp.array([-4.0, 0.3, -6.0]), jnp.array([0.2, -0.4, 0.7])
    hit = jax.jit(bodies.mass_properties.pivot_impact)(j, 50.0, r, v, w)
    assert_allclose(hit.velocity, np.cross(hit.omega, r), atol=1e-13)
    before = j.matrix() @ w + 50.0 * np.cross(r, v)
    after = j.matrix() @ hit.omega + 50.0 * np.cross(r, hit.velocity)
    assert_allclose(after, before, atol=1e-11)
    assert_allclose(hit.impulse, 50.0 * (hit.velocity - v), atol=1e-11)
    energies = [
        25.0 * np.dot(u, u) + bodies.inertia.kinetic_energy(j, jnp.asarray(n))
        for u, n in ((v, w), (hit.velocity, hit.omega))
    ]
    assert_allclose(hit.energy_loss, energies[0] - energies[1], rtol=1e-12)
    # Who turns about the pivot already feels no second impact.
    again = bodies.mass_properties.pivot_impact(j, 50.0, r, hit.velocity, hit.omega)
    assert_allclose(again.omega, hit.omega, rtol=1e-13)
    assert_allclose(again.energy_loss, 0.0, atol=1e-25)


@pytest.mark.parametrize("jit", [False, True])
def test_a_rod_is_caught_at_a_point_of_its_axis(jit):
    """The tensor about the pivot is singular, the impact is not: no torque acts about the axis.
    Across it m (l^2/12 + r^2) w' = m l^2/12 w + m r x v; at the centre of mass, r = 0, w stays.
    Beside them in one batch a point off the axis, as that of a cylinder of almost no thickness."""
    catch = (
        jax.jit(bodies.mass_properties.pivot_impact) if jit else bodies.mass_properties.pivot_impact
    )
    m, own, r = 3.0, 2.0, 0.7
    rod = bodies.PrincipalInertia(jnp.array([own, own, 0.0]))
    arms = jnp.array([[0.0, 0.0, r], [0.0, 0.0, 0.0], [0.3, 0.0, r]]).T
    v, w = jnp.array([0.1, 0.2, 0.3]), jnp.array([0.1, 0.3, 0.2])
    hit = catch(rod, m, arms, v[:, None], w[:, None])
    about = own + m * r**2
    across = np.array([(own * w[0] - m * r * v[1]), (own * w[1] + m * r * v[0])]) / about
    assert_allclose(hit.omega[:, 0], [*across, w[2]], rtol=1e-14)
    assert_allclose(hit.omega[:, 1], w, rtol=1e-15)
    assert_allclose(hit.velocity[:, 1], 0.0, atol=0.0)
    assert_allclose(hit.impulse[:, 1], -m * v, rtol=1e-15)
    thin = bodies.PrincipalInertia(jnp.array([own, own, 1e-12]))
    # A trillionth of a moment beside m 0.3^2.
    assert_allclose(hit.omega[:, 2], catch(thin, m, arms[:, 2], v, w).omega, rtol=1e-10)
    # An isolated rod, and a slope in the axis: that of the energy by the speed along it, which all
    # of it takes: m v_z.
    alone = catch(rod, m, arms[:, 0], v, w)
    assert_allclose(alone.omega, hit.omega[:, 0], rtol=1e-15)
    slope = jax.grad(lambda x: catch(rod, m, arms[:, 0], v.at[2].set(x), w).energy_loss)(v[2])
    assert_allclose(slope, m * v[2], rtol=1e-14)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: bodies.solids.sphere(-1.0, 1.0), "sphere: mass is -1: it must be positive"),
        (lambda: bodies.solids.cone(1.0, 0.0, 1.0), "cone: radius is 0: it must be positive"),
        (
            lambda: bodies.solids.cylinder(1.0, 1.0, -1.0),
            "cylinder: length is -1: it must be zero or",
        ),
        (
            lambda: bodies.solids.simplex(1.0, jnp.ones((3, 5))),
            "number of vertices is 5: it must be 1, 2",
        ),
        (lambda: bodies.solids.cylinder(1.0, 0.0, 1.0).inertia, "it must be positive definite"),
    ],
)
def test_impossible_parts(build, message):
    with pytest.raises(InputError, match=message):
        build()

"""Steady spins against the linearised equations, the cones of the axes against linear programs, and
the invariable plane."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

from jaxspace.attitude.polhode import Polhode
from jaxspace.attitude.principal_spins import (
    cone_bounds,
    invariable_plane,
    spin_modes,
    spin_stiffness,
)
from jaxspace.attitude.torque_free import space_cone_angle
from jaxspace.bodies import BodyState, PrincipalInertia
from jaxspace.bodies.inertia import as_inertia
from jaxspace.bodies.newton_euler import angular_acceleration
from jaxspace.rotations import Quaternion

BODIES = [[3.0, 2.0, 1.5], [1.0, 3.0, 2.5], [2.0, 2.0, 3.0], [2.0, 2.0, 2.0]]


@jax.jit
def linearised(moments, spin):
    return jax.jacfwd(lambda w: angular_acceleration(PrincipalInertia(moments), w, None))(spin)


@pytest.mark.parametrize("moments", BODIES)
def test_modes_are_the_eigenvalues_of_the_linear_motion(moments):
    moments, rate = np.array(moments), 1.7
    frequency, growth = spin_modes(jnp.asarray(moments), rate)
    assert_allclose(
        spin_stiffness(jnp.asarray(moments), rate), frequency**2 - growth**2, atol=1e-14
    )
    for k in range(3):
        # Equal moments make a double eigenvalue of zero, which rounding splits by its root.
        values = np.linalg.eigvals(linearised(moments, rate * np.eye(3)[k]))
        assert_allclose(values.imag.max(), frequency[k], rtol=1e-13, atol=1e-7)
        assert_allclose(values.real.max(), growth[k], rtol=1e-13, atol=1e-7)


def test_growth_is_the_rate_of_the_separatrix():
    moments = jnp.array([3.0, 2.0, 1.5])
    _, growth = spin_modes(moments, 1.7)
    polhode = Polhode.of(moments, jnp.array([0.0, 1.7, 0.0]))
    assert_allclose(growth[1], polhode.rate, rtol=1e-14)


def test_modes_of_many_bodies_and_their_slopes():
    moments = jnp.array(BODIES).T
    frequency, growth = spin_modes(moments, jnp.array([1.7, 1.0, 2.0, 0.5]))
    assert frequency.shape == growth.shape == (3, 4)
    assert_allclose(frequency[2, 2], 2.0 * 1.0 / 2.0, rtol=1e-15)
    for mode in (jax.jacfwd, jax.jacrev):
        # About the axis of a symmetric body: n (C - A) / A, as a function of C, A and n.
        slopes = jax.jit(mode(lambda x: spin_modes(x[:3], x[3])[0][2]))(
            jnp.array([2.0, 2.0, 3.0, 0.5])
        )
        assert_allclose(slopes, [-0.1875, -0.1875, 0.25, 0.5], rtol=1e-14)


def program(moments, omega):
    """Bounds of the angles: three squares h_i^2 >= 0, and their sums h^2 and 2T."""
    h = moments * omega
    sums = [h @ h, h @ omega]
    found = []
    for i in range(3):
        ends = [
            linprog(sign * np.eye(3)[i], A_eq=[np.ones(3), 1.0 / moments], b_eq=sums).fun * sign
            for sign in (1.0, -1.0)
        ]
        low, high = np.sqrt(np.maximum(ends, 0.0) / sums[0])
        if low > 1e-6:
            cosines = np.sign(h[i]) * np.array([low, high])
        else:
            cosines = np.array([-high, high])
        found.append(np.sort(np.arccos(cosines)))
    return np.transpose(found)


SPINS = [[0.4, 0.3, 2.0], [2.0, -0.3, 0.4], [0.4, 0.3, -2.0], [-2.0, 0.9, 0.1], [0.2, 1.9, 0.6]]


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 2, 0], [2, 1, 0]])
def test_cones_of_the_axes(order):
    moments = np.array([3.0, 2.0, 1.5])[order]
    spins = np.array(SPINS).T[order]
    bounds = jax.jit(cone_bounds)(jnp.asarray(moments), jnp.asarray(spins))
    for i in range(len(SPINS)):
        expected = program(moments, spins[:, i])
        # The arccosine and the simplex method of the reference keep half of the digits.
        assert_allclose([b[:, i] for b in bounds], expected, atol=1e-7)


def test_the_space_cone_of_nearly_equal_moments():
    """All digits of the small angle, for a spin of either sense; no cone about the axis itself."""
    A, C = 2.0, 2.0 * (1.0 + 2.0**-40)
    for n in (3.0, -3.0):
        found = space_cone_angle(jnp.array([0.6, 0.8, n]), A, C)
        # To first order in (C - A) / A, whose square is below rounding.
        assert_allclose(found, 2.0**-40 * 3.0 / 10.0, rtol=1e-11)
    slopes = jax.jacrev(space_cone_angle)(jnp.array([0.0, 0.0, 3.0]), A, C)
    assert_allclose(slopes, 0.0)


def test_cones_of_a_steady_spin():
    least, greatest = cone_bounds(jnp.array([3.0, 2.0, 1.5]), jnp.array([0.0, 0.0, -2.0]))
    assert_allclose(least, [0.5 * np.pi, 0.5 * np.pi, np.pi], rtol=1e-15)
    assert_allclose(greatest, least, rtol=1e-15)


def test_slopes_of_the_cones():
    """Finite in both modes at steady spins and at rest; by central differences elsewhere."""

    @jax.jit
    def angles(x):
        return jnp.stack(cone_bounds(x[:3], x[3:]))

    forward, reverse = (jax.jit(mode(angles)) for mode in (jax.jacfwd, jax.jacrev))
    for omega in ([0.0, 0.0, -2.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.4, 0.3, 1.0]):
        x = jnp.array([3.0, 2.0, 1.5, *omega])
        slopes = np.asarray(forward(x))
        assert np.isfinite(slopes).all()
        assert_allclose(reverse(x), slopes, atol=1e-14)
    ends = [(angles(x + 1e-6 * e) - angles(x - 1e-6 * e)) / 2e-6 for e in np.eye(6)]
    # Rounding over the step of the difference.
    assert_allclose(slopes, np.stack(ends, axis=-1), atol=2e-9)


@jax.jit
def contact(tensor, wxyz, omega):
    inertia = as_inertia(tensor)
    attitude = Quaternion(wxyz)
    return (
        invariable_plane(inertia, BodyState(attitude=attitude, omega=omega)),
        attitude.rotate(inertia.times(omega)),
        attitude.rotate(omega),
    )


def test_the_plane_touches_the_ellipsoid(key):
    """The tip of omega lies in the plane across h, where the gradient of 2T, 2 J omega, is along
    h."""
    tensor = jnp.array([[4.0, -0.5, 0.3], [-0.5, 5.0, -0.2], [0.3, -0.2, 6.0]])
    wxyz = Quaternion(jax.random.normal(key, (4, 5))).normalised().wxyz
    omega = jax.random.normal(key, (3, 5))
    plane, h, omega_N = contact(tensor, wxyz, omega)
    assert_allclose(plane.normal * np.linalg.norm(h, axis=0), h, atol=1e-14)
    assert_allclose(plane.distance * plane.normal + plane.herpolhode, omega_N, atol=1e-14)
    assert_allclose(np.sum(plane.normal * plane.herpolhode, axis=0), 0.0, atol=1e-14)
    still, *_ = contact(tensor, wxyz, 0.0 * omega)
    assert_allclose(still.herpolhode, 0.0)


def test_the_vertices_touch_at_the_herpolhode_radii():
    moments = jnp.array([3.0, 2.0, 1.0])
    polhode = Polhode.of(moments, jnp.array([0.4, 0.0, 2.0]))
    vertices = jnp.stack(polhode.vertices, axis=1)
    plane, *_ = contact(moments, jnp.array([[0.6], [0.0], [0.8], [0.0]]), vertices)
    radii = np.linalg.norm(plane.herpolhode, axis=0)
    assert_allclose(radii, polhode.herpolhode_radii, rtol=1e-13)
    assert_allclose(plane.distance, polhode.plane_distance, rtol=1e-14)


def test_the_herpolhode_of_a_spin_next_to_an_axis_keeps_its_digits():
    # omega_perp = h x (omega x h) / h^2, here in 40 digits: the difference has none of 1e-10.
    moments, omega = [2.0, 3.0, 3.6], [1e-10, -3e-11, 1.1]
    y = BodyState(attitude=Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0])), omega=jnp.array(omega))
    found = invariable_plane(PrincipalInertia(moments), y).herpolhode
    with mpmath.workdps(40):
        w = [mpmath.mpf(c) for c in omega]
        h = [mpmath.mpf(m) * c for m, c in zip(moments, w, strict=True)]
        share = mpmath.fdot(w, h) / mpmath.fdot(h, h)
        truth = [float(a - share * b) for a, b in zip(w, h, strict=True)]
    assert_allclose(found, truth, rtol=1e-14)

"""Librations about the local vertical: the modes against a polynomial solver, the map of stability,
Jacobi's integral, and the pitch that an elliptic orbit forces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from jaxspace import Scene, simulate
from jaxspace.attitude import GravityGradient
from jaxspace.attitude.gravity_gradient import pitch_libration_period
from jaxspace.attitude.libration import (
    forced_pitch,
    inertia_ratios,
    jacobi_integral,
    libration_is_stable,
    libration_modes,
)
from jaxspace.attitude.pitch_libration import EllipticLibration, LibrationState, pitch_libration
from jaxspace.bodies import BodyState, InertiaTensor, RigidBody
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion

modes = jax.jit(libration_modes)


def moments_on_a_grid():
    """Of bodies: no moment exceeds the sum of the others."""
    first, second = np.meshgrid(np.linspace(0.15, 0.95, 25), np.linspace(0.17, 0.93, 24))
    third = np.maximum(0.1, 1.55 - first - second)
    all_three = np.stack([first, second, third]).reshape(3, -1)
    return all_three[:, 2.0 * all_three.max(0) < all_three.sum(0)]


def test_the_modes_are_the_roots_of_their_equations():
    I1, I2, I3 = moments = moments_on_a_grid()
    found = modes(jnp.asarray(moments), 1.0)
    stable = libration_is_stable(*inertia_ratios(jnp.asarray(moments)))
    assert 20 < int(stable.sum()) < stable.size - 20
    for k in range(moments.shape[1]):
        coupling = I1[k] + I3[k] - I2[k]
        roll, yaw = 4.0 * (I2[k] - I3[k]), I2[k] - I1[k]
        s4 = [I1[k] * I3[k], 0.0, I1[k] * yaw + I3[k] * roll + coupling**2, 0.0, roll * yaw]
        roots = [*np.roots(s4), *np.roots([I2[k], 0.0, 3.0 * (I1[k] - I3[k])])]
        by_modes = []
        for frequency, growth in zip(*(np.asarray(x)[:, k] for x in found), strict=True):
            by_modes += [growth + 1j * frequency, -growth - 1j * frequency]
        # Complex roots come as four: both signs of both parts.
        by_modes = sorted({(round(abs(z.real), 7), round(abs(z.imag), 7)) for z in by_modes})
        expected = sorted({(round(abs(z.real), 7), round(abs(z.imag), 7)) for z in roots})
        assert_allclose(by_modes, expected, atol=3e-7)
        assert bool(stable[k]) == (max(z.real for z in roots) < 1e-9)


def test_both_regions_of_the_map():
    """That of Lagrange, that of DeBra and Delp, and what lies between."""
    k1 = jnp.array([0.8, 0.5, -0.75, -0.5, 0.3, -0.2])
    k3 = jnp.array([0.4, 0.6, -0.8, -0.5, -0.3, 0.3])
    assert libration_is_stable(k1, k3).tolist() == [True, False, False, False, False, False]
    # The small region lies along k_1 = 0: 1 + 3 k_1 + k_1 k_3 > 4 sqrt(k_1 k_3).
    assert libration_is_stable(jnp.array([-0.05, -0.02]), jnp.array([-0.5, -0.9])).all()
    assert not libration_is_stable(-0.3, -0.98)


def test_slopes_of_the_modes():
    """Against the derivative of s^2 by hand: pitch n sqrt(3 (I_1 - I_3)/I_2)."""
    moments = jnp.array([1000.0, 1200.0, 400.0])
    slope = jax.jacfwd(lambda m: libration_modes(m, 0.001).frequency)(moments)
    pitch = 0.001 * np.sqrt(1.5)
    assert_allclose(slope[0], pitch * np.array([1 / 1200, -1 / 2400, -1 / 1200]), rtol=1e-12)
    ahead, behind = (modes(moments.at[1].add(h), 0.001).frequency for h in (1e-2, -1e-2))
    assert_allclose(slope[:, 1], (ahead - behind) / 2e-2, rtol=1e-8)


def test_jacobi_integral_has_no_rate():
    """Along the motion of any body on a circle, at any attitude and rate."""
    mu, radius = 3.986e14, 7e6
    n = np.sqrt(mu / radius**3)
    tensor = InertiaTensor(jnp.array([[3.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 1.5]]))
    scene = Scene((PointGravity(mu), GravityGradient(mu)), RigidBody(inertia=tensor))
    y = BodyState(
        jnp.array([0.6 * radius, 0.8 * radius, 0.0]),
        n * radius * jnp.array([-0.8, 0.6, 0.0]),
        Quaternion(jnp.array([0.7, -0.1, 0.5, 0.5])),
        n * jnp.array([0.3, -1.2, 0.7]),
    )

    def both(y):
        value = jacobi_integral(y, tensor, mu)
        rate = scene.vector_field(jnp.zeros(()), y)
        return value, jax.jvp(lambda y: jacobi_integral(y, tensor, mu), (y,), (rate,))[1]

    value, change = jax.jit(both)(y)
    assert abs(float(change)) < 1e-13 * n * abs(float(value))


def test_an_elliptic_orbit_forces_pitch():
    """Beletsky's equation (1 + e cos f) th'' - 2 e sin f (th' + 1) + 3 s sin th cos th = 0 from the
    forced motion: the rest is of second order in e."""
    moments = jnp.array([1000.0, 1200.0, 400.0])
    stiffness = float(3.0 * (moments[0] - moments[2]) / moments[1])

    def error(e):
        def field(f, y):
            restoring = stiffness * np.sin(y[0]) * np.cos(y[0])
            push = 2.0 * e * np.sin(f) * (y[1] + 1.0) - restoring
            return [y[1], push / (1.0 + e * np.cos(f))]

        start = [0.0, float(forced_pitch(e, 0.5 * np.pi, moments))]
        run = solve_ivp(field, (0.0, 6.0), start, rtol=1e-11, atol=1e-13, t_eval=[2.0, 4.0, 6.0])
        return np.abs(run.y[0] - forced_pitch(e, jnp.array([2.0, 4.0, 6.0]), moments)).max()

    assert 5.0 < error(1e-2) / error(2e-3) < 30.0
    assert error(2e-3) < 2e-4


MOMENTS = jnp.array([1000.0, 1200.0, 400.0])


@jax.jit
def pitch_rate_and_bend(ts, amplitude, n):
    """The pitch and its two derivatives by the time."""

    def angle(t):
        return pitch_libration(t, amplitude, MOMENTS, n)

    def with_rate(t):
        return jax.jvp(angle, (t,), (jnp.ones_like(t),))

    (pitch, rate), (_, bend) = jax.jvp(with_rate, (ts,), (jnp.ones_like(ts),))
    return pitch, rate, bend


pitch_slope = jax.jit(jax.grad(lambda a, t, n: pitch_libration(t, a, MOMENTS, n)))


@pytest.mark.parametrize("amplitude", [1e-9, 0.4, 1.5, 0.5 * np.pi])
def test_the_pitch_in_time(amplitude):
    """It obeys its equation from rest at the amplitude, with the period of
    `pitch_libration_period`; from a right angle it never returns. Small librations are a cosine."""
    n, square = 1.1e-3, 3.0 * 1.1e-3**2 * 0.5
    period = pitch_libration_period(amplitude, MOMENTS, n)
    ts = np.linspace(-1e4, 2e4, 31)
    pitch, rate, bend = (np.asarray(x) for x in pitch_rate_and_bend(ts, amplitude, n))
    size = square * amplitude
    assert_allclose(bend, -0.5 * square * np.sin(2.0 * pitch), atol=1e-11 * size)
    energy = rate**2 + square * np.sin(pitch) ** 2
    assert_allclose(energy, square * np.sin(amplitude) ** 2, rtol=1e-11)
    start = pitch_rate_and_bend(0.0 * ts, amplitude, n)[0]
    assert_allclose(start, np.full(31, amplitude), rtol=1e-15)
    if amplitude < 1.5:
        later = pitch_rate_and_bend(ts + float(period), amplitude, n)[0]
        assert_allclose(later, pitch, atol=1e-12 * amplitude)
    if amplitude < 1e-3:
        assert_allclose(pitch, amplitude * np.cos(np.sqrt(square) * ts), atol=1e-12 * amplitude)
    assert np.isfinite(pitch_slope(amplitude, 300.0, n))


@pytest.mark.sweep
def test_libration_on_an_ellipse():
    """Against the scene of point gravity and its gradient over three orbits, on the way and at the
    resonance of the forced motion; and on a circle the closed form."""
    mu, a, e = 3.986e14, 9e6, 0.2
    n = np.sqrt(mu / a**3)
    system = EllipticLibration(n, e, 0.5)
    start = LibrationState(*(jnp.array(x) for x in (0.3, 1e-4, 0.0)))
    ts = jnp.linspace(0.0, 6.0 * np.pi / n, 13)
    run = simulate(system, start, ts, accuracy=1e-11)
    scene = Scene((PointGravity(mu), GravityGradient(mu)), RigidBody(inertia=MOMENTS))
    r = jnp.array([a * (1.0 - e), 0.0, 0.0])
    v = jnp.array([0.0, np.sqrt(mu / a * (1.0 + e) / (1.0 - e)), 0.0])
    f_rate = float(v[1] / r[0])
    turn = Quaternion.from_axis_angle(jnp.array([0.0, 0.0, 1.0]), jnp.array(0.3))
    # Columns: body axes 1, 2, 3 in space: 3 outwards, 2 along the normal, 1 = 2 x 3.
    rest = Quaternion.from_matrix(jnp.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    y0 = BodyState(r, v, turn.then(rest), jnp.array([0.0, f_rate + 1e-4, 0.0]))
    flown = simulate(scene, y0, ts, accuracy=1e-12)
    axis = flown.states.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None] + 0.0 * ts)
    place = flown.states.position
    pitch = jnp.arctan2(
        place[0] * axis[1] - place[1] * axis[0], place[0] * axis[0] + place[1] * axis[1]
    )
    gap = np.asarray(run.states.pitch - pitch)
    assert_allclose(np.exp(1j * gap), 1.0, atol=1e-7)
    circle = EllipticLibration(n, 0.0, 0.5)
    rest = LibrationState(*(jnp.array(x) for x in (0.6, 0.0, 0.0)))
    run = simulate(circle, rest, ts, accuracy=1e-12)
    assert_allclose(run.states.pitch, pitch_libration(ts, 0.6, MOMENTS, n), atol=1e-9)


def test_the_modes_of_a_body_in_each_region_are_those_of_its_motion():
    """At one place of the region of Lagrange and one of that of DeBra and Delp the linear motion of
    the scene itself has the frequencies of the modes, and does not grow; between them it does."""
    mu, radius = 1.0, 1.0

    def moments_at(k1, k3):
        # I_1 = 1: I_2 - I_3 = k_1, I_2 - 1 = k_3 I_3.
        third = (1.0 - k1) / (1.0 - k3)
        return jnp.array([1.0, third + k1, third])

    @jax.jit
    def eigenvalues(moments):
        scene = Scene((PointGravity(mu), GravityGradient(mu)), RigidBody(inertia=moments))
        rest = Quaternion.from_matrix(
            jnp.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        )

        def field(x):
            # Small turns from the axes of the orbit, which turn about axis 2.
            small = Quaternion.from_rotation_vector(x[:3])
            omega = x[3:] + small.rotate_back(jnp.array([0.0, 1.0, 0.0]))
            y = BodyState(
                jnp.array([radius, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]), rest.then(small), omega
            )
            torque = scene.loads(jnp.zeros(()), y).torque_B
            spin = moments * omega
            turning = (torque - jnp.cross(omega, spin)) / moments
            # x' of the turn is its relative rate; of the relative rate, less that of the frame.
            frame = jnp.cross(small.rotate_back(jnp.array([0.0, 1.0, 0.0])), x[3:])
            return jnp.concatenate([x[3:], turning - frame])

        return jax.jacfwd(field)(jnp.zeros(6))

    for (k1, k3), stable in (((0.8, 0.4), True), ((-0.05, -0.5), True), ((0.3, -0.3), False)):
        moments = moments_at(k1, k3)
        assert_allclose(inertia_ratios(moments), (k1, k3), rtol=1e-14)
        found = np.linalg.eigvals(eigenvalues(moments))
        assert (max(found.real) < 1e-7) == stable == bool(libration_is_stable(k1, k3))
        frequency, growth = (np.asarray(x) for x in libration_modes(moments, 1.0))
        expected = np.concatenate([growth + 1j * frequency, -growth - 1j * frequency])
        expected = np.concatenate([expected, expected.conj()])
        for value in found:
            assert np.min(np.abs(expected - value)) < 1e-7

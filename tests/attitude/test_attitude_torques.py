"""Applied torques, the relatives of the top, and the precession of the Earth."""

import functools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
from mpmath import mpf
from numpy.testing import assert_allclose

from jaxspace import Accuracy, Scene, simulate
from jaxspace.attitude import (
    BodyTorque,
    DipoleField,
    GravityGradient,
    MagneticDipole,
    ShaftPendulum,
    SpaceTorque,
    SpringTorque,
    Top,
    ViscousTorque,
)
from jaxspace.attitude.gravity_gradient import gravity_gradient_torque
from jaxspace.attitude.nutation import Nutation
from jaxspace.attitude.precession_of_earth import (
    luni_solar_nutation,
    luni_solar_rate,
    luni_solar_rates_at,
)
from jaxspace.attitude.top_relatives import (
    best_crusher_tilt,
    crusher_force,
    gyro_on_a_string,
    sprung_flywheel_frequencies,
)
from jaxspace.bodies import BodyState, PrincipalInertia, RigidBody
from jaxspace.core.vectors import cross
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.solvers import Splitting

BODY = RigidBody(2.0, [3.0, 2.0, 1.0])
Q = from_euler_angles(jnp.array([0.3, 1.1, -0.7]))
Y = BodyState(attitude=Q, omega=jnp.array([0.4, -0.2, 0.5]))


def torque(effect, y=Y):
    return effect.load(jnp.zeros(()), y, BODY).torque_B


def test_constant_torques_and_resistance():
    M = jnp.array([0.1, -0.2, 0.3])
    assert_allclose(torque(BodyTorque(M)), M)
    assert_allclose(Q.rotate(torque(SpaceTorque(M))), M, atol=1e-15)
    assert_allclose(torque(ViscousTorque([1.0, 2.0, 3.0])), [-0.4, 0.4, -1.5], atol=1e-15)
    # A resistance in proportion to the moments lets the rotation fade without turning it.
    fading = Scene((ViscousTorque([0.3, 0.2, 0.1]),), BODY).vector_field(0.0, Y)
    free = Scene((), BODY, ("attitude",)).vector_field(0.0, Y)
    assert_allclose(fading.omega - free.omega, -0.1 * Y.omega, atol=1e-15)


def test_a_spring_pulls_back_to_its_rest():
    turn = jnp.array([0.3, -0.4, 0.2])
    y = BodyState(attitude=Q.then(Quaternion.from_rotation_vector(turn)), omega=Y.omega)
    assert_allclose(
        torque(SpringTorque([2.0, 3.0, 4.0], Q.wxyz), y),
        -turn * jnp.array([2.0, 3.0, 4.0]),
        atol=1e-14,
    )
    rest = torque(SpringTorque([2.0, 3.0, 4.0], Q.wxyz))
    assert_allclose(rest, 0.0, atol=1e-15)

    def about_rest(v):
        y = BodyState(attitude=Quaternion.from_rotation_vector(v), omega=Y.omega)
        return torque(SpringTorque([2.0, 3.0, 4.0]), y)

    slope = jax.jit(jax.jacfwd(about_rest))(jnp.zeros(3))
    assert_allclose(slope, -np.diag([2.0, 3.0, 4.0]), atol=1e-15)


def test_a_dipole_is_turned_along_the_field():
    r = jnp.array([7e6, 1e6, -2e6])
    k = jnp.array([1e14, 0.0, -7.8e15])
    y = BodyState(position=r, attitude=Q, omega=Y.omega)
    m = jnp.array([1.0, 2.0, -1.0])
    B = DipoleField(k)(0.0, y)
    # The field is the gradient of -k . r/r^3.
    gradient = jax.grad(lambda r: -jnp.dot(k, r) / jnp.linalg.norm(r) ** 3)(r)
    assert_allclose(B, gradient, rtol=1e-12)
    found = torque(MagneticDipole(DipoleField(k), m), y)
    assert_allclose(Q.rotate(found), cross(Q.rotate(m), B), rtol=1e-12)


def test_a_pinned_body_stands_out_beyond_the_critical_rate():
    slow = ShaftPendulum(0.1, 0.02, 2.94)
    critical = float(slow.critical_rate)
    for ratio in (0.5, 1.0, 1.5):
        system = ShaftPendulum(0.1, 0.02, 2.94, ratio * critical)
        theta = system.equilibrium
        assert_allclose(jnp.cos(theta), min(1.0, ratio**-2), rtol=1e-12)
        push = lambda x, s=system: s.vector_field(0.0, s.state(x)).tilt_rate  # noqa: E731
        assert_allclose(push(theta), 0.0, atol=1e-12)
        assert_allclose(system.frequency(theta) ** 2, -jax.grad(push)(theta), atol=1e-12)


def test_a_flywheel_on_springs():  # T5.14-P13
    A, H, K1, K2 = 2.0, 3.0, 4.0, 5.0
    system = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-K1 / A, 0, 0, -H / A], [0, -K2 / A, H / A, 0]])
    expected = np.unique(np.round(np.abs(np.linalg.eigvals(system).imag), 12))
    assert_allclose(sprung_flywheel_frequencies(A, H, K1, K2), expected, rtol=1e-11)


def test_the_best_tilt_of_a_crusher_has_the_greatest_force():
    wheel = (4.0, 9.8, 0.4, 0.9, 0.9, 0.1)
    best = best_crusher_tilt(*wheel)
    slope = jax.grad(crusher_force)(best, *wheel)
    assert_allclose(slope, 0.0, atol=1e-12)
    assert crusher_force(best, *wheel) > crusher_force(best + 0.01, *wheel)
    by_rate = jax.grad(best_crusher_tilt)(*wheel)
    ends = [best_crusher_tilt(4.0 + h, *wheel[1:]) for h in (-1e-5, 1e-5)]
    assert_allclose(by_rate, (ends[1] - ends[0]) / 2e-5, rtol=1e-7)


def test_a_gyro_on_a_string_turns_faster_than_its_string_would_swing():
    # Beyond sqrt(g/l1) = 4.43 rad/s, and nearly straight: against 40 digits of one equation.
    def hang(Omega, theta):
        return gyro_on_a_string(theta, Omega, 1.0, 0.1, 0.02, 0.5, 0.3, 9.8)[0]

    def lack(b, w, theta):
        reach = mpf(0.5) * mpmath.sin(b) + mpf(0.3) * mpmath.sin(mpf(theta))
        return mpf(9.8) * mpmath.tan(b) - w * w * reach

    for theta, Omega in ((0.7, 5.0), (2.9, 30.0), (0.7, 1e-4)):
        b, slope = jax.value_and_grad(hang)(Omega, theta)
        with mpmath.workdps(40):
            w = mpf(Omega)
            roots = [
                mpmath.findroot(functools.partial(lack, w=rate, theta=theta), mpf(float(b)))
                for rate in (w, w * (1 + mpf("1e-15")))
            ]
            # The equation has one sign change up to pi/2.
            assert lack(roots[0] / 2, w, theta) < 0 < lack((roots[0] + mpmath.pi / 2) / 2, w, theta)
            change = (roots[1] - roots[0]) / (w * mpf("1e-15"))
        assert_allclose(b, float(roots[0]), rtol=2e-15)
        assert_allclose(slope, float(change), rtol=1e-12)


def test_a_gyro_on_a_string_is_in_balance():  # T5.14-P20
    theta, Omega, m, A, C, l1, l2, g = 1.4, 2.0, 0.3, 1e-3, 2e-4, 0.5, 0.05, 9.8
    b, T, n = gyro_on_a_string(theta, Omega, m, A, C, l1, l2, g)
    assert_allclose(T * jnp.cos(b), m * g, rtol=1e-13)
    reach = l1 * jnp.sin(b) + l2 * np.sin(theta)
    assert_allclose(T * jnp.sin(b), m * Omega**2 * reach, rtol=1e-12)
    s, c = np.sin(theta), np.cos(theta)
    gyroscopic = C * n * Omega * s - A * Omega**2 * s * c
    assert_allclose(gyroscopic, T * l2 * jnp.sin(theta + b), rtol=1e-12)


def test_the_mean_torque_of_the_sun_precesses_the_earth():
    """The secular rate is the mean of the torque itself over an orbit, and the periodic parts are
    its rest."""
    C, ellipticity, obliquity, spin, period = 8.0e37, 0.0032, 0.409, 7.29e-5, 3.156e7
    A = C * (1.0 - ellipticity)
    n = 2.0 * np.pi / period
    r, mu = 1.5e11, n**2 * 1.5e11**3
    attitude = from_euler_angles(jnp.array([0.0, obliquity, 0.0]))
    L = jnp.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    # Seen from the sun, the planet stands opposite.
    position = -r * jnp.stack([jnp.cos(L), jnp.sin(L), 0.0 * L])
    turned = Quaternion(attitude.wxyz[:, None] + 0.0 * L)
    M = gravity_gradient_torque(position, turned, PrincipalInertia([A, A, C]), mu)
    rate = turned.rotate(M) / (C * spin)
    # s = (sin sin psi, -sin cos psi, cos): at psi = 0 psi' moves it along x, theta' along its
    # meridian.
    psi_rate = rate[0] / np.sin(obliquity)
    theta_rate = -rate[1] * np.cos(obliquity) - rate[2] * np.sin(obliquity)
    earth = (1.0, period, ellipticity, obliquity, spin)
    found = luni_solar_rates_at(L, *earth)
    size = float(jnp.max(jnp.abs(psi_rate)))
    assert_allclose(found[0], psi_rate, atol=1e-9 * size)
    assert_allclose(found[1], theta_rate, atol=1e-9 * size)
    assert_allclose(jnp.mean(psi_rate), luni_solar_rate(*earth), rtol=1e-9)
    nutation = luni_solar_nutation(*earth)
    assert_allclose(-2.0 * n * nutation[1] * jnp.sin(2.0 * L), found[1], atol=1e-9 * size)
    assert_allclose(nutation[0] * 2.0 * n, jnp.max(jnp.abs(psi_rate)) / 2.0, rtol=1e-9)


def test_kinds_of_paths():
    top = Top(0.002, 0.0008, 0.3)
    starts = [(0.0, 0.0), (-4.0, -1.0), (1.5, 1.0)]
    for rate, kind in starts:
        spin = 150.0 - rate * np.cos(0.7)
        y = top.state(jnp.array([0.0, 0.7, 0.0]), jnp.array([rate, 0.0, spin]))
        nutation = top.nutation(y)
        assert isinstance(nutation, Nutation)
        upper, lower = nutation.circle_rates
        if kind == 0.0:
            assert_allclose(upper, 0.0, atol=1e-12)
        else:
            assert nutation.loops == kind
        # Of the two circles the start is one.
        assert_allclose(min(abs(upper - rate), abs(lower - rate)), 0.0, atol=1e-9)


def test_a_year_of_the_precession_of_the_earth():
    """The scene of the sun's attraction and its gradient on a spinning Earth for a year of circular
    orbit, against the formula: secular and periodic parts of node and obliquity."""
    C, ellipticity, obliquity, spin, period = 8.0e37, 0.0032, 0.409, 7.29e-5, 3.156e7
    A, n = C * (1.0 - ellipticity), 2.0 * np.pi / 3.156e7
    radius = 1.5e11
    mu = n**2 * radius**3
    scene = Scene((PointGravity(mu), GravityGradient(mu)), RigidBody(6e24, [A, A, C]))
    # From the Earth the sun is seen at the longitude L = n t, and the Earth from it opposite.
    y0 = BodyState(
        jnp.array([-radius, 0.0, 0.0]),
        jnp.array([0.0, -n * radius, 0.0]),
        from_euler_angles(jnp.array([0.0, obliquity, 0.0])),
        jnp.array([0.0, 0.0, spin]),
    )
    ts = jnp.linspace(0.0, period, 9)
    how = Accuracy(1e-9, method=Splitting(4, steps=256, estimate=False))
    axis = simulate(scene, y0, ts, accuracy=how).states.attitude
    s = axis.rotate(jnp.array([0.0, 0.0, 1.0])[:, None] + 0.0 * ts)
    psi, theta = jnp.arctan2(s[0], -s[1]), jnp.arctan2(jnp.hypot(s[0], s[1]), s[2])
    earth = (1.0, period, ellipticity, obliquity, spin)
    swing, nod = luni_solar_nutation(*earth)
    L = n * ts
    expected = luni_solar_rate(*earth) * ts + swing * jnp.sin(2.0 * L)
    # The formula neglects what is of the order of orbit over spin: the nod is greater by 2 n/Omega.
    assert_allclose(psi, expected, atol=4e-3 * float(jnp.max(jnp.abs(expected))))
    assert_allclose(theta - obliquity, nod * (jnp.cos(2.0 * L) - 1.0), atol=0.012 * float(nod))
    assert_allclose(psi[-1], -7.55e-5, rtol=5e-3)  # 15.58 seconds of arc

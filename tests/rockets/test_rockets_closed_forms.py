"""Gravity turns, streams of mass and the spinning rocket in closed form, against flights and
quadrature and the textbook's numbers."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from cases import thomson_8
from scipy.integrate import quad, solve_ivp

from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import AbstractBody, BurningBody, PrincipalInertia
from jaxspace.core import InputError
from jaxspace.rockets import (
    GravityTurn,
    GravityTurnState,
    JetDamping,
    MassStream,
    SpinningRocket,
    SteeredThrust,
)
from jaxspace.rockets.angle_of_attack import angle_of_attack
from jaxspace.rockets.gravity_turn import gravity_turn, gravity_turn_after
from jaxspace.rockets.jet_damping import jet_damping_ratio
from jaxspace.rockets.rocket_equation import rocket_equation
from jaxspace.rockets.steering import FixedDirection
from jaxspace.rockets.variable_mass import (
    jet_engine_thrust,
    swept_motion,
    variable_mass_acceleration,
)
from jaxspace.rotations import Quaternion
from jaxspace.rotations.tilt import complex_tilt

DEG = np.pi / 180.0
TURNS = [c for c in thomson_8.CASES if c.id.startswith("T8.5-n") or "retro" in c.id]

# ---------------------------------------------------------------- gravity turn

after = jax.jit(
    lambda t, n, g, v, psi: jax.tree.leaves(
        gravity_turn_after(t, n, g, GravityTurnState(v, psi, 0.0 * v, 0.0 * v))
    )
)


def numbers(*values):
    return tuple(jnp.asarray(float(x)) for x in values)


@pytest.mark.parametrize("case", TURNS, ids=lambda c: c.id)
def test_gravity_turn_in_closed_form(case):
    """The numbers of the flights, from the time and from the angle."""
    given, (*expected, constant) = case.given, case.expected.values()
    start = numbers(given["t"], given["n"], given["g"], given["v0"], given["psi0"])
    v, psi, x, y = after(*start)
    # The root of the time has the rounding of the time over the rate of change of the logarithm.
    np.testing.assert_allclose([v, psi / DEG, x, y], expected, rtol=1e-11)
    time, end = gravity_turn(expected[1] * DEG, *start[1:])
    np.testing.assert_allclose(time, given["t"], rtol=1e-11)
    np.testing.assert_allclose([end.speed, end.range, end.height], [v, x, y], rtol=1e-11)
    found = GravityTurn(*start[1:3]).invariants(0.0, end)["C"]
    # For n > 1 the system keeps 1/C.
    expected = 1.0 / constant if given["n"] > 1.0 else constant
    np.testing.assert_allclose(found, expected, rtol=1e-11)


def exact_turn(n, g, v0, psi0, psi):
    """Time, range and height by quadrature over z with 30 digits."""
    with mpmath.workdps(30):
        z0, z1 = mpmath.tan(mpmath.mpf(psi0) / 2), mpmath.tan(mpmath.mpf(psi) / 2)
        c = v0 / (z0 ** (n - 1) * (1 + z0**2))
        t = mpmath.quad(lambda z: c / g * z ** (n - 2) * (1 + z * z), [z0, z1])
        x = mpmath.quad(lambda z: 2 * c**2 / g * z ** (2 * n - 2) * (1 + z * z), [z0, z1])
        y = mpmath.quad(lambda z: c**2 / g * z ** (2 * n - 3) * (1 - z**4), [z0, z1])
        return float(t), float(x), float(y)


def test_slopes_by_the_thrust_ratio_through_its_special_values():
    """n = 1 and n = 1/2, where two of the integrals are logarithms: values and derivatives by n,
    against differences of quadratures with thirty digits."""

    def found(n):
        time, end = gravity_turn(*numbers(1.2), n, *numbers(9.8, 100.0, 0.1))
        return jnp.stack([time, end.range, end.height])

    forward = jax.jit(lambda n: jax.jvp(found, (n,), (jnp.ones_like(n),)))
    reverse = jax.jit(jax.jacrev(found))
    h = mpmath.mpf("1e-8")
    for n in (1.0, 0.5, -0.5, -1.0, 1.0 + 1e-9, 0.7):
        value, slope = forward(*numbers(n))
        truth = exact_turn(n, 9.8, 100.0, 0.1, 1.2)
        np.testing.assert_allclose(value, truth, rtol=1e-12)
        ends = [exact_turn(mpmath.mpf(n) + s * h, 9.8, 100.0, 0.1, 1.2) for s in (1, -1)]
        difference = [(a - b) / (2.0 * float(h)) for a, b in zip(*ends, strict=True)]
        # The ends are rounded to doubles: 1e-16/1e-8.
        np.testing.assert_allclose(slope, difference, rtol=1e-6)
        np.testing.assert_allclose(reverse(*numbers(n)), slope, rtol=1e-12)


def test_a_vertical_start_stays_vertical_with_finite_slopes():
    """psi_0 = 0: uniform acceleration, and psi grows with psi_0 as z does: (v/v_0)^(1/(n-1))."""
    n, g, v0, t = 1.5, 9.8, 50.0, 20.0
    v, psi, x, y = after(*numbers(t, n, g, v0, 0.0))
    speed = v0 + (n - 1.0) * g * t
    np.testing.assert_allclose([v, y], [speed, 0.5 * (v0 + speed) * t], rtol=1e-13)
    assert psi == 0.0 and x == 0.0
    assert after(*numbers(0.0, n, g, v0, 0.3))[:2] == [v0, 0.3]
    by_angle = jax.jit(jax.jacfwd(lambda p: after(*numbers(t, n, g, v0), p)[1]))
    np.testing.assert_allclose(by_angle(jnp.zeros(())), (speed / v0) ** 2, rtol=1e-12)
    near = after(*numbers(t, n, g, v0, 1e-9))[1] / 1e-9
    np.testing.assert_allclose(near, (speed / v0) ** 2, rtol=1e-12)
    with pytest.raises(InputError, match="start is 0"):
        gravity_turn(1.0, 1.5, 9.8, 50.0, 0.0)


def test_gravity_turn_of_a_burning_rocket():
    """T8.5-var2 by the system of four numbers: the end, and its slopes by the angle at the start,
    which grow beyond 40."""
    case = next(c for c in thomson_8.CASES if c.id == "T8.5-var2")
    n, rate, g, v0, psi0 = (case.given[k] for k in ("n", "rate", "g", "v0", "psi0"))

    def burnt(psi):
        y0 = GravityTurnState(*numbers(v0), psi, *numbers(0.0, 0.0))
        end = simulate(GravityTurn(n, g, rate), y0, jnp.array([0.0, 110.0]), accuracy=1e-12).final
        state = jnp.stack([end.speed, end.angle, end.range, end.height])
        return state, state

    slopes, state = jax.jacfwd(burnt, has_aux=True)(jnp.asarray(psi0))
    v, _, x, y, psi, by_psi, v_by_psi, y_by_psi = case.expected.values()
    np.testing.assert_allclose(state, [v, psi, x, y], rtol=1e-10)
    np.testing.assert_allclose(slopes[jnp.array([0, 1, 3])], [v_by_psi, by_psi, y_by_psi], 1e-9)


def test_gravity_turn_of_a_burning_rocket_in_air_over_a_round_earth():
    """The full system against an integration in Cartesian axes."""
    n, g, a, R, b, rho0, H = 1.4, 9.8, 1.0 / 180.0, 6.4e6, 8000.0, 1.2, 7000.0
    system = GravityTurn(n, g, a, R, b, rho0, H)
    y0 = GravityTurnState(*numbers(60.0, 0.05, 0.0, 300.0))
    end = simulate(system, y0, jnp.array([0.0, 120.0]), accuracy=1e-11).final

    def rates(t, s):
        r, v = s[:2], s[2:]
        d, speed = np.hypot(*r), np.hypot(*v)
        drag = 0.5 * rho0 * np.exp(-(d - R) / H) * speed**2 / b
        along = (n * g - drag) / (1.0 - a * t) / speed
        return [*v, *(along * v - g * R**2 / d**3 * r)]

    start = [0.0, R + 300.0, 60.0 * np.sin(0.05), 60.0 * np.cos(0.05)]
    x, y, u, w = solve_ivp(rates, (0, 120), start, method="DOP853", rtol=1e-11, atol=1e-9).y[:, -1]
    turn = np.arctan2(x, y)
    found = [end.speed, end.angle, end.range, end.height]
    expected = [np.hypot(u, w), np.arctan2(u, w) - turn, R * turn, np.hypot(x, y) - R]
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    assert system.closed_form() is None and system.invariants(0.0, y0) == {}


# ---------------------------------------------------------------- streams of mass


def test_streams_of_mass():
    """A stream at rest, T7.7-3; a force alone; a stream that leaves at the speed of the body takes
    nothing; and slopes by the rate through zero."""
    found = swept_motion(60.0, 500.0, 2.0, 100.0)
    np.testing.assert_allclose(found, [80.64516129032258, 5377.784490423637], rtol=1e-12)
    found = swept_motion(10.0, 5.0, 0.0, 3.0, force=10.0)
    np.testing.assert_allclose(found, [23.0, 130.0], rtol=1e-14)
    np.testing.assert_allclose(swept_motion(10.0, 50.0, -2.0, 3.0, 3.0), [3.0, 30.0], rtol=1e-14)

    def truth(rate):
        v = (500.0 * 100.0 + 40.0 * 30.0 + rate * 20.0 * 30.0) / (500.0 + rate * 30.0)
        x = quad(
            lambda t: (5e4 + 40.0 * t + rate * 20.0 * t) / (500.0 + rate * t), 0, 30, epsabs=1e-12
        )[0]
        return np.array([v, x])

    def path(rate):
        return jnp.stack(swept_motion(30.0, 500.0, rate, 100.0, 20.0, 40.0))

    slopes = jax.jit(jax.jacfwd(path))
    for rate in (0.0, 1e-9, 3.0, 4.2, -8.0):
        np.testing.assert_allclose(path(rate), truth(rate), rtol=1e-12)
        # Differences of order four.
        h = 1e-2
        ends = [truth(rate + k * h) for k in (2, 1, -1, -2)]
        difference = (8.0 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12.0 * h)
        np.testing.assert_allclose(slopes(jnp.asarray(rate)), difference, rtol=1e-8)


def test_momentum_balance_of_rocket_and_jet_engine():
    """A rocket's exhaust leaves at v - u; an engine's air enters at rest and leaves with the fuel:
    the same force as the thrust formula."""
    v, u = 200.0, 900.0
    velocity = jnp.array([v, 0.0, 0.0])
    still = jnp.zeros(3)
    exhaust = jnp.array([v - u, 0.0, 0.0])
    rates = jnp.array([50.0, -50.0, -1.0])
    streams = jnp.stack([still, exhaust, exhaust], axis=1)
    a = variable_mass_acceleration(1000.0, velocity, still, rates, streams)
    thrust = jet_engine_thrust(50.0, 1.0, u, v)
    np.testing.assert_allclose(a, [thrust / 1000.0, 0.0, 0.0], rtol=1e-14)
    np.testing.assert_allclose(thrust, 51.0 * u - 50.0 * v)
    np.testing.assert_allclose(jet_engine_thrust(0.0, 2.0, u, v, 1e4, 0.1), 2.0 * u + 1e3)


def test_a_stream_in_a_scene():
    y0 = BodyState(jnp.zeros(3), jnp.array([100.0, 0.0, 0.0]), mass=jnp.array(500.0))
    run = simulate(Scene([MassStream(2.0)]), y0, jnp.array([0.0, 60.0]), accuracy=1e-12).final
    expected = swept_motion(60.0, 500.0, 2.0, 100.0)
    np.testing.assert_allclose([run.velocity[0], run.position[0]], expected, rtol=1e-11)


def test_a_mass_ratio_of_a_thousand():
    """Burnout of all but a thousandth: the speed to rounding in closed form, and that speed and
    the way of a flight without gravity, x = u t_b [1 - ln r/(r - 1)]."""
    u, ratio = 3000.0, 1e3
    gain = rocket_equation(u, ratio)
    np.testing.assert_allclose(gain, u * np.log(ratio), rtol=1e-15)
    slope = jax.grad(lambda m: rocket_equation(u, m))(ratio)
    np.testing.assert_allclose(slope, u / ratio, rtol=1e-14)
    # 1000 kg to 1 kg in 100 s
    motor = SteeredThrust(FixedDirection([1.0, 0.0, 0.0]), 9.99 * u, u, 100.0)
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3), mass=jnp.array(1000.0))
    run = simulate(Scene([motor]), y0, jnp.array([0.0, 100.0]), accuracy=1e-12).final
    way = u * 100.0 * (1.0 - np.log(ratio) / (ratio - 1.0))
    # The mass that is left is a small difference of large ones: one rounding of 1000 kg in each of
    # some twenty steps.
    np.testing.assert_allclose(run.mass, 1.0, rtol=2e-12)
    np.testing.assert_allclose(run.velocity[0], gain, rtol=1e-11)
    np.testing.assert_allclose(run.position[0], way, rtol=1e-11)


def test_vertical_burn_under_inverse_square_gravity():
    """Straight up with falling mass: the end against SciPy, and the slope of its height by the
    thrust against differences, forwards and in reverse."""
    gravity, radius, rate, speed, end = 9.81, 6.371e6, 0.005, 50.0, 150.0

    def by_scipy(ratio):
        def field(t, y):
            return [y[1], gravity * (ratio / (1.0 - rate * t) - (radius / (radius + y[0])) ** 2)]

        return solve_ivp(field, (0.0, end), [0.0, speed], "DOP853", rtol=1e-12, atol=1e-9).y[:, -1]

    def burnt(ratio):
        turn = GravityTurn(ratio, gravity, rate, radius)
        y0 = GravityTurnState(*numbers(speed, 0.0, 0.0, 0.0))
        return simulate(turn, y0, jnp.array([0.0, end]), accuracy=1e-12).final

    # The end and its slope from one program.
    forward = jax.jit(lambda n: jax.jvp(burnt, (n,), (jnp.ones_like(n),)))
    reverse = jax.jit(jax.grad(lambda n: burnt(n).height))
    ratio = jnp.array(1.5)
    (found, slope), (height, climb) = forward(ratio), by_scipy(1.5)
    np.testing.assert_allclose([found.height, found.speed], [height, climb], rtol=1e-11)
    assert found.angle == 0.0 and found.range == 0.0
    # The height is nearly linear in the thrust: a large difference has a small error.
    h = 1e-2
    expected = (by_scipy(1.5 + h)[0] - by_scipy(1.5 - h)[0]) / (2.0 * h)
    np.testing.assert_allclose(slope.height, expected, rtol=1e-8)
    np.testing.assert_allclose(reverse(ratio), expected, rtol=1e-8)


# ---------------------------------------------------------------- spinning rocket

rocket_motion = jax.jit(
    lambda rocket, t, w: (
        rocket.transverse_rate(t, w),
        rocket.spin_rate(t),
        rocket.spin_angle(t),
        rocket.complex_tilt(t, w),
        rocket.complex_tilt(t, w, axes="body"),
    )
)
# T7.9-Ex1: ring, time; w_xy, w_z, angle of spin, theta_XY of the small-angle theory.
ROWS = {
    "T7.9-Ex1-a-t20": (0.2, 20.0, (0.02265170051521131, 0.013076051778517317), 6.838199798129711,
                       127.95608478552124, (0.02075393429349861, 0.12066669441685271)),
    "T7.9-Ex1-b-t60": (0.4, 60.0, (0.003148824539818691, -0.01734177712488905), 6.0, 360.0,
                       (0.018601955715328865, 0.03288217926927288)),
    "T7.9-Ex1-c-t20": (0.0, 20.0, (-0.012899386915686812, -0.022799389609519948),
                       7.142857142857143, 130.76504035858332,
                       (0.010514938525722469, 0.12112608109076163)),
    "T7.9-Ex1-c-t60": (0.0, 60.0, (-0.018027022769078953, 0.0006824235862432634),
                       11.538461538461538, 490.444850554998,
                       (-0.0038420159161940675, 0.09132056306827857)),
    "T7.9-Ex1-d-t20": (0.6, 20.0, (0.02578983180583812, 0.001487509218308234), 4.825033777560324,
                       108.1650903805182, (0.07385884566449182, 0.05893635255385767)),
}  # fmt: skip


@pytest.mark.parametrize("row", ROWS)
def test_spinning_rocket_in_closed_form(row):
    ring, t, rate, spin, angle, tip = ROWS[row]
    rocket = SpinningRocket.of_lengths(6.0, 8e-3, 1.5, 0.4, 2.0, ring)
    start = jnp.array([0.03, 0.0])
    found = rocket_motion(rocket, jnp.asarray(t), start)
    for value, expected in zip(found[:4], (rate, spin, angle, tip), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-9)
    inertial, body = (complex(*np.asarray(x)) for x in found[3:])
    np.testing.assert_allclose(body, inertial * np.exp(-1j * angle), rtol=1e-9)


def test_a_slender_spinning_rocket():
    """k_z = 0: the axis moves along a straight line, and every slope is finite (7.10-P8)."""
    rocket = SpinningRocket(10.0, 1.0 / 125.0, 2.0, 1.0, 0.0)
    start = jnp.array([0.02, 0.0])
    found = rocket_motion(rocket, jnp.asarray(40.0), start)[3]
    path = 0.02 * 125.0 / 4.0 * (1.0 - 0.68**4)
    np.testing.assert_allclose(found, [path, 0.0], rtol=1e-13, atol=1e-16)
    slopes = jax.jit(jax.grad(lambda r: jnp.sum(r.complex_tilt(jnp.asarray(40.0), start))))(rocket)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(slopes))


def test_complex_tilt():
    """From Euler's angles, in both axes, near the vertical too; and the plain angle."""
    psi, phi = 0.7, -1.9

    @jax.jit
    def angles(theta):
        q = Quaternion.about(2, psi).then(Quaternion.about(0, theta)).then(Quaternion.about(2, phi))
        plain = angle_of_attack(q, jnp.array([0.0, 0.0, 3.0]))
        return complex_tilt(q), complex_tilt(q, "body"), plain

    for theta in (0.0, 1e-9, 0.02, 0.04, 1.3, 3.0):
        inertial, body, plain = angles(theta)
        expected = theta * np.exp(1j * psi)
        np.testing.assert_allclose(complex(*inertial), expected, rtol=1e-13, atol=1e-16)
        expected = theta * np.exp(-1j * phi)
        np.testing.assert_allclose(complex(*body), expected, rtol=1e-13, atol=1e-16)
        np.testing.assert_allclose(plain, theta, rtol=1e-13, atol=1e-16)
    q = Quaternion.identity()
    rocket = SpinningRocket(10.0, 1.0 / 125.0, 2.0)
    for refused in (
        lambda: complex_tilt(q, "air"),
        lambda: rocket.complex_tilt(jnp.asarray(40.0), jnp.array([0.02, 0.0]), axes="air"),
    ):
        with pytest.raises(InputError, match="axes is 'air': it must be one of inertial, body"):
            refused()

    def of_turn(vector):
        return complex_tilt(Quaternion.from_rotation_vector(vector))

    # The complex angle is the rotation vector itself, to first order.
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(
            jax.jit(mode(of_turn))(jnp.zeros(3)), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], atol=1e-15
        )


# ---------------------------------------------------------------- jet damping


def test_a_cluster_of_nozzles():
    """Three nozzles damp as a ring; two do not damp the turn about their line."""
    body = BurningBody(100.0, [30.0, 30.0, 8.0], [0.5, 0.5, 0.3], -0.4)
    flow = lambda t, m: -2.0 + 0.0 * m  # noqa: E731
    y = BodyState(
        attitude=Quaternion.identity(), omega=jnp.array([0.3, -0.2, 2.0]), mass=jnp.array(150.0)
    )
    corners = 2.0 * np.pi * np.arange(3) / 3.0
    three = 0.25 * np.stack([np.cos(corners), np.sin(corners)])
    ring, cluster, pair = (
        JetDamping(flow, -1.5, **more).load(jnp.zeros(()), y, body).torque_B
        for more in (
            {"exit_radius": 0.25},
            {"nozzles": three},
            {"nozzles": [[0.25, -0.25], [0.0, 0.0]]},
        )
    )
    np.testing.assert_allclose(cluster, ring, rtol=1e-13)
    lever = -1.5 - float(body.centre_of_mass(y.mass)[2])
    carried = np.array([lever**2, lever**2 + 0.0625, 0.0625])
    kept = np.asarray(body.inertia_per_mass(y.mass))
    np.testing.assert_allclose(pair, -2.0 * (carried - kept) * np.asarray(y.omega), rtol=1e-13)


def slender_flight(rate, spin, lever, t):
    """The rod of `test_a_slender_rod_with_jet_damping` after t: angular velocity and attitude.

    For k_z = 0 (7.10) the axis moves along a great circle, and the spin stays (p = 1)."""
    burning = 1.0 / 150.0
    rocket = SpinningRocket(spin, burning, lever / 0.5, 1.0, 0.0)
    w = rocket.transverse_rate(t, jnp.stack([rate, 0.0 * rate]))
    share = jet_damping_ratio(1.0 - burning * t, lever / 0.5)
    np.testing.assert_allclose(jnp.hypot(*w), rate * share, rtol=1e-12)
    power = (lever / 0.5) ** 2
    # The integral of rate (1 - burning t)^(power - 1), about the inertial X.
    swept = rate / burning * -np.expm1(power * np.log1p(-burning * t)) / power
    turn = Quaternion.about(0, jnp.asarray(swept)).then(Quaternion.about(2, spin * t))
    return np.concatenate([w, np.array([rocket.spin_rate(t)]), turn.wxyz])


def test_a_slender_rod_with_jet_damping():
    """k_z = 0: the whole flight and its derivatives, in closed form. A ring of exits has nothing to
    turn about the axis of the rod; across it the lever l^2 becomes l^2 + rho^2/2."""
    body = BurningBody(100.0, [25.0, 25.0, 0.0], [0.5, 0.5, 0.0])
    t, ring, given = 40.0, 0.3, np.array([0.05, 1.5, 0.9])

    def flown(x):
        lever = jnp.sqrt(x[2] ** 2 - 0.5 * ring**2)
        damping = JetDamping(lambda t, m: -1.0 + 0.0 * m, -lever, ring)
        y0 = BodyState(
            jnp.zeros(3),
            jnp.zeros(3),
            Quaternion.identity(),
            jnp.stack([x[0], 0.0 * x[0], x[1]]),
            jnp.asarray(150.0),
        )
        scene = Scene([damping, MassStream(-1.0)], body)
        end = simulate(scene, y0, jnp.array([0.0, t]), accuracy=1e-12).final
        return jnp.concatenate([end.omega, end.attitude.wxyz]), end

    slopes, end = jax.jacfwd(flown, has_aux=True)(given)
    found = np.concatenate([end.omega, end.attitude.wxyz])
    # A hundred times the tolerance: sixty radians of spin.
    np.testing.assert_allclose(found, slender_flight(*given, t), rtol=1e-10, atol=1e-11)
    assert end.omega[2] == given[1]
    np.testing.assert_allclose(end.mass, 110.0, rtol=1e-13)
    assert not np.any(end.position) and not np.any(end.velocity)
    step = 1e-5 * given
    differences = [
        (slender_flight(*(given + dx), t) - slender_flight(*(given - dx), t)) / (2.0 * sum(dx))
        for dx in np.diag(step)
    ]
    # Central differences: the attitude moves by 40 rad per rad/s, its third derivative by 40^3
    # times step^2.
    np.testing.assert_allclose(slopes, np.stack(differences, -1), rtol=1e-6, atol=1e-6)
    reverse = jax.grad(lambda x: jnp.sum(flown(x)[0]))(given)
    np.testing.assert_allclose(reverse, np.sum(slopes, axis=0), rtol=1e-9, atol=1e-10)


class Shrinking(AbstractBody):
    """A body whose transverse radius of gyration changes with its mass: k^2 = 1 + m/m_0."""

    def constant_mass(self):
        return None

    def loaded_mass(self):
        return None

    def has_inertia(self):
        return True

    def inertia(self, mass):
        k2 = 1.0 + mass / 100.0
        return PrincipalInertia(jnp.stack([mass * k2, mass * k2, 0.3 * mass]))

    def inertia_per_mass(self, mass):
        slope = 1.0 + mass / 50.0
        return jnp.stack([slope, slope, 0.3 + 0.0 * mass])

    def centre_of_mass(self, mass):
        return 0.0


def test_jet_damping_with_a_changing_radius_of_gyration():
    """7.8-2 with d(k^2)/dt: d ln(omega)/d ln(m) = (l^2 - k^2 - m dk^2/dm)/k^2, by quadrature."""
    damping = JetDamping(lambda t, m: -1.0 + 0.0 * m, 1.4)
    y0 = BodyState(
        attitude=Quaternion.identity(), omega=jnp.array([0.2, 0.0, 0.0]), mass=jnp.array(100.0)
    )
    flow = MassStream(-1.0)
    scene = Scene([damping, flow], Shrinking())
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3), y0.attitude, y0.omega, y0.mass)
    end = simulate(scene, y0, jnp.array([0.0, 60.0]), accuracy=1e-11).final

    def slope(m):
        k2 = 1.0 + m / 100.0
        return (1.96 - k2 - m / 100.0) / k2 / m

    expected = 0.2 * np.exp(-quad(slope, 40.0, 100.0, epsabs=1e-13)[0])
    np.testing.assert_allclose(end.omega[0], expected, rtol=1e-9)


def test_a_gravity_turn_of_a_short_time_keeps_the_digits_of_its_way():
    # x = v t sin(psi) + ... to first order; no time at all returns the input to the bit, with the
    # rates as derivatives. A flight whose speed has ended stays where it is.
    def turn(t, angle, ratio):
        zero = jnp.zeros(())
        y = gravity_turn_after(
            t, ratio, 9.8, GravityTurnState(jnp.asarray(100.0), angle, zero, zero)
        )
        return jnp.stack([y.range, y.height, y.speed, y.angle])

    turn, change = jax.jit(turn), jax.jit(jax.jacrev(turn))
    psi = jnp.asarray(0.2)
    short = 1e-10 * np.array([np.sin(0.2), np.cos(0.2)])
    np.testing.assert_allclose(turn(1e-10, psi, 1.5)[:2], 100.0 * short, rtol=1e-10)
    assert turn(0.0, psi, 1.5).tolist() == [0.0, 0.0, 100.0, 0.2]
    rates = [100.0 * np.sin(0.2), 100.0 * np.cos(0.2), 9.8 * (1.5 - np.cos(0.2))]
    np.testing.assert_allclose(change(0.0, psi, 1.5)[:3], rates, rtol=1e-14)
    np.testing.assert_allclose(change(1e3, jnp.asarray(0.0), 0.2), 0.0, atol=1e-20)


@pytest.mark.parametrize("ratio", [0.99, 1.0, 1.001])
def test_a_long_vertical_flight_with_hardly_any_acceleration(ratio):
    """v = v_0 + (n - 1) g t and y = v_0 t + (n - 1) g t^2/2, after 900 s of the 1000 s in which the
    first one stops."""
    t, g, v0 = 900.0, 9.8, 98.0
    v, psi, x, y = after(*numbers(t, ratio, g, v0, 0.0))
    gained = (ratio - 1.0) * g * t
    np.testing.assert_allclose([v, y], [v0 + gained, v0 * t + 0.5 * gained * t], rtol=1e-12)
    assert psi == x == 0.0

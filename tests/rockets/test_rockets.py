"""Rockets: thrust, varying mass, jet damping and the vertical flight, against the textbook's closed
forms and case numbers."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Scene, simulate, simulate_batch, simulate_mission
from jaxspace.bodies import BodyState, BurningBody, Load, PrincipalInertia, RigidBody
from jaxspace.core import InputError
from jaxspace.rockets import (
    GravityTurn,
    GravityTurnState,
    JetDamping,
    PropellantDepletion,
    SteeredThrust,
    Thrust,
    ThrustProfile,
    spin_angle,
)
from jaxspace.rockets.jet_damping import jet_damping_ratio
from jaxspace.rockets.rocket_equation import (
    coast_height,
    mass_ratio_for,
    propulsive_efficiency,
    rocket_equation,
    vertical_burnout_height,
    vertical_burnout_velocity,
)
from jaxspace.rockets.steering import FixedDirection
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.simulation import Event, Mission, Phase, Status

FT = 0.3048
MILE = 5280.0


def drifting(mass, omega=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)):
    """A body at the origin whose axes are the inertial ones."""
    return BodyState(
        jnp.zeros(3), jnp.array(velocity), Quaternion.identity(), jnp.array(omega), jnp.array(mass)
    )


# ---------------------------------------------------------------- thrust and mass


def test_rocket_in_free_space():
    """T7.7-4: v = v0 + u ln(m0/m), and the path."""
    thrust = Thrust(2500.0 * 2.0, 2500.0, 60.0)
    scene = Scene((thrust,), BurningBody(100.0, [10.0, 10.0, 5.0], [0.3, 0.3, 0.3]))
    end = simulate(
        scene, drifting(500.0, velocity=(0.0, 0.0, 100.0)), jnp.array([0.0, 60.0]), accuracy=1e-13
    ).final
    np.testing.assert_allclose(end.velocity[2], 786.0921142544009, rtol=1e-12)
    np.testing.assert_allclose(end.position[2], 25642.49829166383, rtol=1e-12)
    np.testing.assert_allclose(end.mass, 380.0, rtol=1e-14)
    np.testing.assert_allclose(
        100.0 + rocket_equation(2500.0, 500.0 / 380.0), 786.0921142544009, rtol=1e-12
    )
    np.testing.assert_allclose(
        mass_ratio_for(2500.0, rocket_equation(2500.0, 3.7)), 3.7, rtol=1e-14
    )


def test_a_flight_from_rest_beyond_burnout():
    """At a tight tolerance no step is rejected, because the first one after the burnout sees no
    thrust; and the flight leaves with the velocity of the rocket equation."""
    motor = Thrust(3000.0, 2000.0, 17.3, ignition=0.1)
    scene = Scene((motor,), BurningBody(1.0, [1.0, 1.0, 1.0], [0.3, 0.3, 0.3]))
    run = simulate(scene, drifting(70.0), jnp.array([0.0, 31.7]), accuracy=1e-12)
    assert run.stats["rejected_steps"] == 0
    expected = rocket_equation(2000.0, 70.0 / (70.0 - 1.5 * 17.3))
    np.testing.assert_allclose(run.final.velocity[2], expected, rtol=1e-12)


def test_body_that_sweeps_up_matter_at_rest():
    """T7.7-3: m v stays; matter at rest enters with a force -m' v against the motion."""

    def load(t, y, b):
        return Load(force_N=-2.0 * y.velocity, mass_rate=2.0 + 0.0 * y.mass)

    sweep = Custom(load)
    y = BodyState(
        position=jnp.zeros(3), velocity=jnp.array([100.0, 0.0, 0.0]), mass=jnp.array(500.0)
    )
    end = simulate(Scene((sweep,)), y, jnp.array([0.0, 60.0]), accuracy=1e-13).final
    np.testing.assert_allclose(end.velocity[0], 80.64516129032258, rtol=1e-12)
    np.testing.assert_allclose(end.position[0], 5377.784490423637, rtol=1e-12)


@pytest.mark.sweep
def test_a_profile_with_kinks_loses_no_digits():
    """The rocket equation depends on the masses alone: a tabulated thrust gives the same speed, in
    few steps, and its slope with respect to the burn time is zero."""
    profile, burn_time, mean = ThrustProfile.tabulated(
        [0.0, 0.3, 7.0, 20.0, 41.0, 60.0], [0.2, 1.0, 1.3, 1.1, 0.8, 0.0]
    )

    def gain(stretch):
        thrust = Thrust(5000.0 / stretch, 2500.0, 60.0 * stretch, profile)
        scene = Scene((thrust,), BurningBody(100.0, [10.0, 10.0, 5.0], [0.3, 0.3, 0.3]))
        return simulate(
            scene, drifting(500.0), jnp.stack([0.0 * stretch, 60.0 * stretch]), accuracy=1e-12
        )

    assert burn_time == 60.0 and 0.0 < mean < 1.3
    run = gain(jnp.array(1.0))
    np.testing.assert_allclose(run.final.velocity[2], 2500.0 * np.log(500.0 / 380.0), rtol=1e-12)
    # Five pieces, each smooth: no step is lost on a kink.
    assert int(run.stats["rejected_steps"]) <= 15 and int(run.stats["steps"]) < 100
    slope = jax.grad(lambda s: gain(s).final.velocity[2])(jnp.array(1.0))
    assert abs(slope) < 1e-8


def test_offset_and_misalignment_make_their_couple():
    """The moment (r_T - r_C) x F with the centre of mass where the propellant left puts it."""
    body = BurningBody(1000.0, [300.0, 300.0, 200.0], [0.4, 0.4, 0.4], propellant_station=-0.9)
    thrust = Thrust(6.0e4, 2800.0, 80.0, point=[0.003, -0.002, -1.5], misalignment=[2e-3, -1e-3])
    y = drifting(1800.0)
    load = thrust.load(jnp.array(10.0), y, body)
    force = 6.0e4 * np.array([2e-3, -1e-3, 1.0]) / np.sqrt(1.0 + 5e-6)
    centre = np.array([0.0, 0.0, -0.9 * 800.0 / 1800.0])
    np.testing.assert_allclose(load.force_N, force, rtol=1e-14)
    np.testing.assert_allclose(
        load.torque_B, np.cross(np.array([0.003, -0.002, -1.5]) - centre, force), rtol=1e-12
    )
    np.testing.assert_allclose(load.mass_rate, -6.0e4 / 2800.0, rtol=1e-14)


def test_inertia_falls_with_the_mass():
    """Two discs of propellant and payload, composed by parallel axes; the slope against
    differences."""
    body = BurningBody(1000.0, [300.0, 310.0, 200.0], [0.5, 0.5, 0.4], propellant_station=-0.9)
    m_p, m_d = 800.0, 1000.0
    apart = m_p * m_d / (m_p + m_d) * 0.81
    expected = np.array(
        [300.0 + m_p * 0.25 + apart, 310.0 + m_p * 0.25 + apart, 200.0 + m_p * 0.16]
    )
    np.testing.assert_allclose(
        body.inertia(jnp.array(1800.0)).matrix(), np.diag(expected), rtol=1e-14
    )

    def moments(m):
        return jnp.diagonal(body.inertia(m).matrix())

    slope = (moments(jnp.array(1800.1)) - moments(jnp.array(1799.9))) / 0.2
    np.testing.assert_allclose(body.inertia_per_mass(jnp.array(1800.0)), slope, rtol=1e-8)


def test_propellant_that_runs_out_ends_the_phase():
    thrust = Thrust(5000.0, 2500.0, 1000.0, burnout_mass=380.0)
    scene = Scene((thrust,), BurningBody(100.0, [10.0, 10.0, 5.0], [0.3, 0.3, 0.3]))
    until = Event(lambda t, y: thrust.propellant_left(y), direction=-1, within=100.0)
    run = simulate_mission(Mission([Phase(scene, until)]), drifting(500.0), accuracy=1e-12)
    assert int(run.status) == Status.EVENT
    # The event lies 4096 units in the last place of the mass, 1e-12 of it, before the thrust's own
    # end. Beyond that the condition is flat: the search may end one step of Newton's method away.
    np.testing.assert_allclose(run.end, 60.0, rtol=1e-10)
    np.testing.assert_allclose(run.final.velocity[2], 2500.0 * np.log(500.0 / 380.0), rtol=1e-11)
    assert float(thrust.thrust(jnp.array(70.0), jnp.array(379.0))) == 0.0


POINT = BodyState(jnp.zeros(3), jnp.zeros(3), mass=jnp.asarray(500.0))
# The thrust and the burnout mass.
BURN = jnp.array([5000.0, 380.0])


def burn_and_drift(x, events):
    """A burn of 60 s to a burnout mass and a drift of 40 s after it."""
    thrust = SteeredThrust(FixedDirection([0.0, 0.0, 1.0]), x[0], 2500.0, 1e3, burnout_mass=x[1])
    scene = Scene((thrust,))
    run = simulate(scene, POINT, jnp.array([0.0, 100.0]), accuracy=1e-10, events=events(scene))
    return jnp.stack([run.final.velocity[2], run.final.position[2], run.final.mass])


def burn_and_drift_exactly(x):
    """u ln(m_0/m_b), and where that leaves the body."""
    u = 2500.0
    burn, ratio = (500.0 - x[1]) * u / x[0], jnp.log(500.0 / x[1])
    height = u * burn * (1.0 - ratio / (500.0 / x[1] - 1.0)) + u * ratio * (100.0 - burn)
    return jnp.stack([u * ratio, height, x[1]])


# The reverse mode through an event is that of every event.
@pytest.mark.parametrize(
    "jacobian", [jax.jacfwd, pytest.param(jax.jacrev, marks=pytest.mark.sweep)]
)
def test_slopes_over_the_end_of_the_propellant_by_an_event(jacobian):
    def goes_on(scene):
        left = PropellantDepletion(scene.effects[0].propellant_left)
        return (Event(left, direction=-1, terminal=False, then=lambda t, y: y),)

    found = jax.jit(jacobian(lambda x: burn_and_drift(x, goes_on)))(BURN)
    # The event lies 1e-12 of the mass before the end of the thrust.
    expected = jax.jit(jax.jacfwd(burn_and_drift_exactly))(BURN)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)


def test_slopes_over_the_end_of_the_propellant_need_an_event():
    """Without an event the slopes are not those, and a warning says so."""
    with pytest.warns(UserWarning, match=r"SteeredThrust\.burnout_mass makes .* PropellantDepl"):
        values = burn_and_drift(BURN, lambda scene: ())
    np.testing.assert_allclose(values, burn_and_drift_exactly(BURN), rtol=1e-8)
    # Each warning as an error, which ends the run before it is compiled. An event that looks at
    # something else does not help.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match=r"burnout_mass"):
            burn_and_drift(BURN, lambda scene: (Event(lambda t, y: y.position[2] - 1e9),))
        body = BurningBody(100.0, [10.0, 10.0, 5.0], [0.3, 0.3, 0.3])
        scene = Scene((Thrust(5000.0, 2500.0, 1e3, burnout_mass=380.0),), body)
        with pytest.raises(UserWarning, match=r"Thrust\.burnout_mass"):
            simulate_mission(Mission([Phase(scene, 100.0)]), drifting(500.0))
        many = jax.tree.map(lambda x: jnp.stack([x, x], -1), drifting(500.0))
        with pytest.raises(UserWarning, match=r"Thrust\.burnout_mass"):
            simulate_batch(scene, many, jnp.array([0.0, 1.0]))


def test_a_vertical_gravity_turn_keeps_its_constant():
    for ratio in (0.5, 1.0, 1.5):
        turn = GravityTurn(ratio, 9.8)
        y0 = GravityTurnState(*map(jnp.asarray, (50.0, 0.0, 0.0, 0.0)))
        run = simulate(turn, y0, jnp.array([0.0, 2.0, 5.0]))
        assert run.drift()["C"].max() < 1e-12

        def constant(angle, turn=turn, y0=y0):
            return turn.invariants(0.0, eqx.tree_at(lambda y: y.angle, y0, angle))["C"]

        assert not np.isnan(jax.grad(constant)(jnp.asarray(0.0)))


@jax.jit  # one program for both cases
def misaligned(omega, ts):
    """The end of a body which turns under a moment that is fixed in it."""
    moment = Custom(lambda t, y, b: Load(torque_B=jnp.array([250.0, 0.0, 0.0])))
    scene = Scene((moment,), RigidBody(inertia=[4000.0, 4000.0, 400.0]))
    y = BodyState(attitude=Quaternion.identity(), omega=omega)
    return simulate(scene, y, ts, accuracy=1e-13).final


@pytest.mark.parametrize(
    ("t", "re", "im"), [(7.5, -0.011052426603603843, -0.011052426603603843), (3.0, None, None)]
)
def test_thrust_misalignment_of_a_spinning_missile(t, re, im):
    """T7.2-P6-t7.5 and T7.2-P6-ic: a constant body-fixed moment."""
    start, expected = (
        ((0.0, 0.0), (re, im))
        if re
        else ((0.03, -0.02), (-0.0007608618475766982, 0.020244221123154344))
    )
    omega = np.array([*start, 2.0 * np.pi])
    end = misaligned(omega, np.array([0.0, t]))
    # 1e-10 of the largest rate in the motion.
    np.testing.assert_allclose(end.omega[:2], expected, rtol=1e-10, atol=2e-12)


# ---------------------------------------------------------------- jet damping


def gyrating(k, kz):
    """A body of almost nothing but propellant, whose radii of gyration stay."""
    return BurningBody(1e-9, PrincipalInertia(1e-9 * np.array([k * k, k * k, kz * kz])), [k, k, kz])


def test_jet_damping_with_a_moment():
    """T7.8-2."""
    push = Custom(lambda t, y, b: Load(torque_B=jnp.array([30.0, 0.0, 0.0])))
    flow = Custom(lambda t, y, b: Load(mass_rate=-8.0 + 0.0 * y.mass))
    scene = Scene((push, flow, JetDamping(lambda t, m: -8.0 + 0.0 * m, 2.4)), gyrating(1.5, 1.5))
    y = BodyState(
        attitude=Quaternion.identity(), omega=jnp.array([0.05, 0.0, 0.0]), mass=jnp.array(1000.0)
    )
    run = simulate(scene, y, jnp.linspace(0.0, 60.0, 601), accuracy=1e-13)
    np.testing.assert_allclose(run.final.omega[0], 0.7012008168850434, rtol=1e-11)
    q = np.asarray(run.states.attitude.wxyz)
    np.testing.assert_allclose(
        2.0 * np.unwrap(np.arctan2(q[1], q[0]))[-1], 23.699979258778196, rtol=1e-10
    )


@pytest.mark.parametrize(
    ("ratio", "lever", "expected"),
    # T7.8-4-lk1.0, T7.8-4-lk3.0, T7.10-P4 over w0 = 0.5.
    [(0.3, 1.0, 1.0), (0.3, 3.0, 6.560999999999998e-05), (0.5, 2.0, 0.125)],
)
def test_jet_damping_without_spin(ratio, lever, expected):
    np.testing.assert_allclose(jet_damping_ratio(ratio, lever), expected, rtol=1e-12)


def test_jet_damping_of_a_larger_radius_of_gyration():
    """T7.10-P5: the moment m' (l^2 - k^2) w is smaller if l stays, larger if l/k stays."""

    def moment(k, l):
        damping = JetDamping(lambda t, m: -8.0 + 0.0 * m, -l)
        y = BodyState(
            attitude=Quaternion.identity(), omega=jnp.array([0.5, 0.0, 0.0]), mass=jnp.array(1e3)
        )
        return -damping.load(jnp.zeros(()), y, gyrating(k, k)).torque_B[0]

    small, same_lever, same_ratio = moment(1.5, 2.0), moment(1.8, 2.0), moment(1.8, 2.4)
    # Closed form, in roundings of its terms.
    np.testing.assert_allclose(small, 8.0 * (2.0**2 - 1.5**2) * 0.5, rtol=1e-14)
    assert same_lever < small < same_ratio


def test_jet_damping_with_a_radius_of_gyration_that_changes():
    """T7.10-P5: k^2 = k_0^2 (1 + s (1 - xi)) with a lever that stays has the integral
    (l/k_0)^2 [ln(xi) - ln(k^2/k_0^2)]/(1 + s) in closed form; s > 0 damps less, s < 0 more. And
    k ~ xi^(1/4) with l/k that stays, a power again."""
    xi, lever = np.array([1.0, 0.6, 0.2, 0.02]), 2.0

    @jax.jit
    def ratio(xi, s, lever):
        def gyration(z):
            return jnp.sqrt(1.0 + s * (1.0 - z))

        return jet_damping_ratio(xi, lambda z: lever / gyration(z), gyration=gyration)

    found = {}
    for s in (0.8, 0.0, -0.5):
        k2 = 1.0 + s * (1.0 - xi)
        expected = (xi / k2) ** (lever**2 / (1.0 + s)) / (xi * k2)
        found[s] = ratio(jnp.asarray(xi), s, lever)
        # The quadrature bends as 1/k^2: to rounding, times the exponent.
        assert_allclose(found[s], expected, rtol=1e-13)
    assert np.all(found[-0.5][1:] < found[0.0][1:]) and np.all(found[0.0][1:] < found[0.8][1:])
    power = jet_damping_ratio(jnp.asarray(xi), 2.0, gyration=lambda z: z**0.25)
    assert_allclose(power, xi ** (4.0 - 1.5), rtol=1e-14)
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(mode(lambda x: ratio(*x)))(jnp.array([0.6, 0.0, lever]))
        # By xi and the lever as of the power 3; by s from the closed form.
        by_s = 0.6**3 * (-4.0 * np.log(0.6) - 4.0 * 0.4 - 0.4)
        assert_allclose(slopes, [3.0 * 0.36, by_s, 4.0 * np.log(0.6) * 0.6**3], rtol=1e-12)
    with pytest.raises(InputError, match="mass_ratio"):
        jet_damping_ratio(0.0, lambda z: z)


def test_jet_damping_of_a_tank_is_that_of_the_effect():
    """The function of xi against the moment of `JetDamping`, for a body whose radius of gyration
    falls: the derivative of the logarithm, J omega' = M + m' (dJ/dm) omega ... of the effect."""
    body = BurningBody(500.0, PrincipalInertia(jnp.array([900.0, 900.0, 50.0])), [1.2, 1.2, 0.3])
    xi, m0, lever, rate = 0.7, 1500.0, 3.0, -8.0

    def gyration(z):
        return jnp.sqrt(900.0 / (z * m0) + 1.44 * (1.0 - 500.0 / (z * m0)))

    def logarithm(z):
        return jnp.log(jet_damping_ratio(z, lambda z: lever / gyration(z), gyration=gyration))

    damping = JetDamping(lambda t, m: rate + 0.0 * m, -lever)
    y = BodyState(
        attitude=Quaternion.identity(), omega=jnp.array([1.0, 0.0, 0.0]), mass=jnp.array(xi * m0)
    )
    moment = damping.load(jnp.zeros(()), y, body).torque_B[0]
    inertia = xi * m0 * gyration(xi) ** 2
    assert_allclose(jax.grad(logarithm)(xi) * rate / m0, moment / inertia, rtol=1e-12)


def test_propulsive_efficiency():
    """8.1: 2 u v/(u^2 + v^2), one at v = u, and the same at v and at u^2/v."""
    v = jnp.array([0.0, 750.0, 3000.0, 12000.0])
    found = propulsive_efficiency(v, 3000.0)
    assert_allclose(found, [0.0, 8.0 / 17.0, 1.0, 8.0 / 17.0], rtol=1e-15)
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = mode(lambda x: propulsive_efficiency(x[0], x[1]))(jnp.array([750.0, 3000.0]))
        # By v / u: 2 (1 - x^2)/(1 + x^2)^2.
        slope = 2.0 * (1.0 - 1.0 / 16.0) / (1.0 + 1.0 / 16.0) ** 2
        assert_allclose(slopes, [slope / 3000.0, -slope * 750.0 / 3000.0**2], rtol=1e-14)
    with pytest.raises(InputError, match="exhaust_velocity"):
        propulsive_efficiency(100.0, 0.0)


def test_spin_angle_has_no_hole_at_a_central_nozzle():
    """T7.10-7's limits: value and slopes through rho = 0, where the quotient becomes a
    logarithm."""
    near, at = spin_angle(60.0, 6.0, 8e-3, 1e-7), spin_angle(60.0, 6.0, 8e-3, 0.0)
    np.testing.assert_allclose(near, at, rtol=1e-12)
    np.testing.assert_allclose(at, -6.0 / 8e-3 * np.log(0.52), rtol=1e-14)
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(mode(lambda x: spin_angle(x[0], x[1], x[2], x[3])))(
            jnp.array([60.0, 6.0, 8e-3, 0.0])
        )
        assert np.all(np.isfinite(slopes)) and abs(slopes[3]) < 1e-12


# ---------------------------------------------------------------- vertical flight


def test_more_thrust_lowers_the_burnout_and_raises_the_top():
    """T8.1-P8: slopes of the heights of burnout and top by the thrust over weight n, in feet, for
    I = 300 s and mu = 5; against 8.1-9 to 8.1-12 differentiated by hand."""
    impulse, mu, g, R, n = 300.0, 5.0, 32.2, 3960.0 * MILE, 2.0

    def flight(n):
        burn_time = impulse / n * (1.0 - 1.0 / mu)
        v = vertical_burnout_velocity(impulse * g, mu, burn_time, g)
        h = vertical_burnout_height(impulse * g, mu, burn_time, g)
        return v, h, h + coast_height(v, h, g, R)

    v, h, _ = map(float, flight(n))
    burnt, r, s = 1.0 - 1.0 / mu, R + h, v * v / (2.0 * g * R * R)
    faster = impulse * g * burnt / n**2
    burnout = impulse**2 * g * burnt * (burnt / n**3 - (1.0 - np.log(mu) / (mu - 1.0)) / n**2)
    # The coast is r^2 s/(1 - r s).
    coast = (r * s * (2.0 - r * s) * burnout + r * r * s * 2.0 * faster / v) / (1.0 - r * s) ** 2
    slopes = jax.jit(jax.jacrev(lambda n: flight(n)[1:]))(n)
    np.testing.assert_allclose(slopes, [burnout, burnout + coast], rtol=1e-12)
    # The case has six digits of the one and five of the other.
    assert [round(float(slopes[0])), round(float(slopes[1]), -1)] == [-114552, 768720]
    np.testing.assert_allclose(jax.jit(jax.jacfwd(flight))(n)[1:], slopes, rtol=1e-12)


def test_no_speed_at_burnout_is_stationary():
    """Erratum 23, to the text after 8.1-14: no I, thrust over weight R and mass ratio mu make dv
    vanish. The slopes of v = I g [ln mu - (1 - 1/mu)/R], by hand: that by mu has the sign of
    R mu - 1, thrust over weight at the burnout, and the others are positive in every flight."""
    I, g = 300.0, 32.2
    R, mu = (x.ravel() for x in np.meshgrid([0.5, 1.0, 1.5, 3.0], [1.2, 2.0, 5.0, 100.0]))

    def speed(x):
        I, R, mu = x
        return vertical_burnout_velocity(I * g, mu, I / R * (1.0 - 1.0 / mu), g)

    slopes = jax.jit(jax.vmap(jax.grad(speed), -1, -1))(np.stack([I + 0.0 * R, R, mu]))
    share = (1.0 - 1.0 / mu) / R
    expected = [g * (np.log(mu) - share), I * g * share / R, I * g / mu * (1.0 - 1.0 / (R * mu))]
    # In roundings of the terms, whose difference vanishes at R mu = 1.
    np.testing.assert_allclose(slopes, expected, rtol=1e-13, atol=1e-12 * I * g)
    assert np.all(slopes[1] > 0.0) and np.all(slopes[0][R >= 1.0] > 0.0)
    falls, rises = R * mu < 1.0, R * mu > 1.0
    assert np.all(slopes[2][falls] < 0.0) and np.all(slopes[2][rises] > 0.0)
    assert falls.any() and not (falls | rises).all()


def test_a_coast_from_the_speed_of_escape_on_has_no_end():
    # The speed of escape from the surface of this earth is 36,694 ft/s.
    assert np.isinf(coast_height(4.0e4, 0.0, 32.2, 3960.0 * MILE))
    np.testing.assert_allclose(coast_height(4.0e4, 0.0, 32.2), 4.0e4**2 / 64.4, rtol=1e-15)


def test_vertical_flight_without_propellant_has_finite_slopes():
    slopes = jax.grad(lambda mu: vertical_burnout_height(2500.0, mu, 10.0, 9.8))(1.0)
    ahead, behind = (vertical_burnout_height(2500.0, 1.0 + h, 10.0, 9.8) for h in (1e-3, -1e-3))
    np.testing.assert_allclose(slopes, (ahead - behind) / 2e-3, rtol=1e-5)


def test_two_stages_flown():
    """T8.2-sim: the stage jump, the burn times and the heights, by simulation of both stages and
    the coast."""
    g, R = 32.2, 3960.0 * MILE
    gravity = Custom(lambda t, y, b: Load(acceleration_N=jnp.array([0.0, 0.0, -g])))
    stages, m0 = [], 1.0
    for u, mu, ratio in ((8500.0, 3.2, 1.5), (11000.0, 3.6, 1.3)):
        thrust = ratio * g * m0
        burn_time = (1.0 - 1.0 / mu) * m0 * u / thrust
        motor = Thrust(thrust, u, burn_time, ignition=sum(s[1] for s in stages))
        stages.append(
            (
                Scene((gravity, motor), BurningBody(1e-3, [1.0, 1.0, 1.0], [1.0, 1.0, 1.0])),
                burn_time,
            )
        )

    def renew(t, y):
        return BodyState(y.position, y.velocity, y.attitude, y.omega, 0.0 * y.mass + m0)

    flight = Mission([Phase(*stages[0], renew, "first"), Phase(*stages[1], name="second")])
    run = simulate_mission(flight, drifting(m0), accuracy=1e-13)
    np.testing.assert_allclose(run["first"].ts[-1], 120.98861283643893, rtol=1e-12)
    np.testing.assert_allclose(run["first"].final.velocity[2], 5990.948550014955, rtol=1e-11)
    np.testing.assert_allclose(run["first"].final.position[2], 249005.64392386706, rtol=1e-11)
    np.testing.assert_allclose(run.end, 310.7746721877157, rtol=1e-12)
    np.testing.assert_allclose(run.final.velocity[2], 13970.10973898655, rtol=1e-11)
    np.testing.assert_allclose(run.final.position[2], 1865234.6370001866, rtol=1e-11)
    top = run.final.position[2] + coast_height(run.final.velocity[2], run.final.position[2], g, R)
    np.testing.assert_allclose(top, 6134524.091755576, rtol=1e-11)


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Thrust(-1.0, 2500.0, 60.0), "Thrust.mean_thrust is -1"),
        (lambda: Thrust(1.0, 0.0, 60.0), "Thrust.exhaust_velocity is 0"),
        (lambda: Thrust(1.0, 2500.0, -60.0), "Thrust.burn_time is -60"),
        (lambda: Thrust.of_motor(1.0, 2.0, -3.0), "Thrust.propellant_mass is -3"),
        (
            lambda: Thrust(1.0, 1.0, 1.0).propellant_left(drifting(1.0)),
            "Thrust.burnout_mass is None",
        ),
        (lambda: ThrustProfile([0.0, 0.5], [1.0, 1.0]), "ascending from 0 to 1"),
        (lambda: ThrustProfile([0.0, 1.0], [1.0, 3.0]), "of mean 1"),
        (lambda: ThrustProfile.tabulated([0.0, 2.0, 1.0], [1.0, 1.0, 1.0]), "ascending"),
        (lambda: JetDamping(lambda t, m: -m, 1.0, -0.1), "JetDamping.exit_radius is -0.1"),
        (lambda: BurningBody(-1.0, [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]), "BurningBody.dry_mass is -1"),
        (lambda: rocket_equation(2500.0, -2.0), "mass_ratio is -2"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def burnt_out(burnout_mass, accuracy):
    """The end of a burn by the event of its propellant."""
    thrust = SteeredThrust(
        FixedDirection([0.0, 0.0, 1.0]), 5000.0, 2500.0, 1e3, burnout_mass=burnout_mass
    )
    left = Event(PropellantDepletion(thrust.propellant_left), direction=-1)
    ts = jnp.array([0.0, 100.0])
    return simulate(Scene((thrust,)), POINT, ts, accuracy=accuracy, events=(left,))


def test_a_burn_ends_where_its_propellant_does_at_any_tolerance():
    """Long steps pass the end of the thrust, which bends their polynomials."""

    def end(burnout_mass):
        run = burnt_out(burnout_mass, 1e-4)
        return run.ts[-1], run.final.mass

    masses = jnp.linspace(370.0, 390.0, 24)
    times, left = jax.jit(lambda masses: jax.lax.map(end, masses))(masses)
    # The event lies 1e-12 of the mass before the end of the thrust.
    np.testing.assert_allclose(left, masses, rtol=2e-12)
    # Within the tolerance of the mass, over its rate.
    np.testing.assert_allclose(times, (500.0 - masses) * 0.5, atol=1e-4 * 500.0 / 2.0)


def test_every_end_of_the_propellant_has_its_time_and_slope():
    def end_of_burn(burnout_mass):
        return burnt_out(burnout_mass, 1e-10).ts[-1]

    # Where the last step meets the end of the thrust hangs on the mass: one run after the other.
    masses = jnp.linspace(370.0, 390.0, 24)
    times, slopes = jax.jit(
        lambda masses: jax.lax.map(
            lambda m: jax.jvp(end_of_burn, (m,), (jnp.ones_like(m),)), masses
        )
    )(masses)
    # Some steps' tolerance of the mass, over its rate.
    np.testing.assert_allclose(times, (500.0 - masses) * 0.5, atol=2e-7)
    np.testing.assert_allclose(slopes, -0.5, rtol=1e-9)

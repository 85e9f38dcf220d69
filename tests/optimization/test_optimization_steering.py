"""Linear-tangent steering against 30-digit solutions, perturbed steering, and direct shooting
through the simulation."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases.thomson_8 import ASCENTS
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from jaxspace.core import InputError
from jaxspace.optimization import SteeredFlight, SteeringProfile, optimise_steering
from jaxspace.optimization.ascent import Ascent, ConstantMassFlow, FlightState, apex, burnout_state
from jaxspace.optimization.steering import linear_tangent_steering, minimum_time_steering
from jaxspace.simulation import simulate

A, C = ASCENTS["T8.3-A"], ASCENTS["T8.3-C"]

# dU/dY, dU/dv_0 and dU/dg to 1e-8
ENVELOPE = {
    "T8.3-A": (-0.002701615814124174, 1.2164628071388603, -88.7953347481597),
    "T8.3-C": (-0.0023373940899992906, 1.299860776696233, -147.52284215657093),
}

# U_loss of the steering phi + eps sin(k pi t/t_b) + c, and of a release angle changed by d with the
# steering phi + c
LOSSES = {
    "T8.3-A": {
        (1, 0.05): 2.042682450371754,
        (1, -0.05): 2.0432422669403145,
        (2, 0.05): 10.460605116963633,
        (2, -0.05): 10.511656682591475,
        (3, 0.05): 9.767844112312627,
        (3, -0.05): 9.764257387316837,
        (0, 0.02): 0.938092931258006,
        (0, -0.02): 0.9447262697184715,
    },
    "T8.3-C": {
        (1, 0.05): 1.039918713575456,
        (1, -0.05): 1.0417837902703282,
        (2, 0.05): 3.8966086416659276,
        (2, -0.05): 3.9122718320876553,
        (3, 0.05): 3.8823504431625713,
        (3, -0.05): 3.876344185688308,
        (0, 0.02): 0.24287035373172147,
        (0, -0.02): 0.2441118421430358,
    },
}


def velocity_at(ascent, Y, v0, g, scale=1.0):
    """With another height, speed and gravity, and a thrust that is scaled; and whether the apex is
    reached."""
    thrust = jax.tree.map(lambda x: x * scale, ascent.thrust)
    given = {"apex_height": Y, "release_speed": v0, "gravity": g, "thrust": thrust}
    found = linear_tangent_steering(dataclasses.replace(ascent, **given))
    return found.final_velocity, found.reached


# One program for every ascent with a thrust of the same kind.
by_reverse = eqx.filter_jit(jax.value_and_grad(velocity_at, (1, 2, 3, 4), has_aux=True))
by_forward = eqx.filter_jit(jax.jacfwd(lambda *x: velocity_at(*x)[0], (1, 2, 3)))


def numbers_of(case):
    ascent = jax.tree.map(jnp.asarray, ASCENTS[case])
    return ascent, ascent.apex_height, ascent.release_speed, ascent.gravity


@pytest.mark.parametrize("case", ASCENTS)
def test_envelope_derivatives(case):
    """Reverse and forward mode, through both nested roots, give the derivatives of the envelope
    theorem."""
    at = numbers_of(case)
    (_, reached), slopes = by_reverse(*at, jnp.asarray(1.0))
    assert reached
    np.testing.assert_allclose(slopes[:3], ENVELOPE[case], rtol=1e-8)
    np.testing.assert_allclose(by_forward(*at), ENVELOPE[case], rtol=1e-8)


@pytest.mark.parametrize("case", ASCENTS)
def test_thrust_derivatives_by_differences(case):
    """A thousandth more thrust, by gradient and by solving again."""
    at = numbers_of(case)
    _, (*_, slope) = by_reverse(*at, jnp.asarray(1.0))
    more, less = (by_reverse(*at, jnp.asarray(1.0 + h))[0][0] for h in (1e-4, -1e-4))
    difference = (more - less) / 2e-4
    np.testing.assert_allclose(
        slope, difference, rtol=1e-6
    )  # the square of the step, with a curvature of order 10


@pytest.mark.parametrize("case", ASCENTS)
def test_other_steering_is_slower(case):
    """Steering that differs, with the constant c that restores the height, loses the velocity that
    the case states."""
    ascent = ASCENTS[case]
    best = linear_tangent_steering(ascent)

    @jax.jit
    def burnout(k, eps, turn, c):
        def angle(t):
            return best.angle(t) + eps * jnp.sin(k * jnp.pi * t / ascent.burn_time) + c

        end = burnout_state(ascent, best.initial_angle + turn, angle)
        return end.u, apex(ascent, end)[1] - ascent.apex_height

    for (k, change), loss in LOSSES[case].items():
        eps, turn = (change, 0.0) if k else (0.0, change)
        c = brentq(
            lambda c, args=(float(k), eps, turn): float(burnout(*args, c)[1]), -0.3, 0.3, xtol=1e-15
        )
        assert (
            abs(float(best.final_velocity - burnout(float(k), eps, turn, c)[0]) / loss - 1.0) < 1e-7
        ), (k, change)


def test_spurious_root_is_excluded():
    """The same equations hold where the thrust outlasts the apex; such heights are refused, the
    others end after burnout."""
    with pytest.raises(InputError, match="Ascent.apex_height is 100000: it must be between"):
        linear_tangent_steering(dataclasses.replace(A, apex_height=1e5))
    with pytest.raises(InputError, match="Ascent.apex_height is 1e\\+07"):
        linear_tangent_steering(dataclasses.replace(A, apex_height=1e7))

    # The root of these equations at 600,000 ft with its apex within the burn of 160 s, by fsolve.
    def end(angle, T):
        return burnout_state(A, angle, lambda t: jnp.arctan((1.0 - t / T) * jnp.tan(angle)))

    angle, T = 1.1418439747, 78.942242002
    np.testing.assert_allclose(apex(A, end(angle, T)), [T, 6e5], rtol=1e-8)
    assert linear_tangent_steering(A).vanishing_time > 160.0 > T
    heights = np.array([1e5, 2.1e5, 6e5, 2e6, 4.0e6, 1e7])

    @jax.jit
    def solved(heights):
        return linear_tangent_steering(dataclasses.replace(A, apex_height=heights))

    found = solved(jnp.asarray(heights))
    assert list(found.reached) == [False, True, True, True, True, False]
    assert np.all(found.vanishing_time >= 160.0)
    assert np.all(np.diff(found.final_velocity[1:5]) < 0.0)
    slope = jax.jit(jax.grad(lambda h: jnp.sum(solved(h).final_velocity)))(heights)
    expected = -np.tan(found.initial_angle) / found.vanishing_time
    np.testing.assert_allclose(slope[1:5], expected[1:5], rtol=1e-7)
    assert slope[0] == 0.0 and slope[5] == 0.0


def test_later_apex_of_two_is_taken():
    """A strong late thrust: two apexes after burnout solve the equations, and the later one is
    faster."""
    ascent = Ascent(ConstantMassFlow(1.2, 1.023), 1.0, 0.0, 0.0, 0.0, 1.0)

    def end(T, theta0):
        return burnout_state(ascent, theta0, lambda t: jnp.arctan((1.0 - t / T) * jnp.tan(theta0)))

    @jax.jit
    def vertical(T, theta0):
        return end(T, theta0).w - (T - 1.0)

    @jax.jit
    def height_and_speed(T, theta0):
        return apex(ascent, end(T, theta0))[1], end(T, theta0).u

    def along(T):
        return height_and_speed(
            T, brentq(lambda q: float(vertical(T, q)), 1e-9, 1.5707, xtol=1e-14)
        )

    times = np.linspace(1.0, 2.5, 16)
    heights = np.array([float(along(T)[0]) for T in times])
    dip = int(np.argmin(heights))
    assert dip > 0
    target = 0.5 * (heights[0] + heights[dip])
    early = brentq(lambda T: float(along(T)[0]) - target, times[0], times[dip])
    late = brentq(lambda T: float(along(T)[0]) - target, times[dip], times[-1])
    found = linear_tangent_steering(dataclasses.replace(ascent, apex_height=target))
    np.testing.assert_allclose(found.vanishing_time, late, rtol=1e-9)
    np.testing.assert_allclose(found.final_velocity, along(late)[1], rtol=1e-9)
    assert found.final_velocity > along(early)[1]


def test_minimum_time():
    # OC-LINEAR-TANGENT (Betts 0.554570879), 1e-8
    found = minimum_time_steering(100.0, 5.0, 45.0)
    np.testing.assert_allclose(found.duration, 0.554570878334603050916499312287, rtol=1e-8)
    np.testing.assert_allclose(
        np.tan(found.initial_angle), 1.40850835570249078592129577079, rtol=1e-8
    )

    def rates(t, x):
        phi = float(found.angle(t))
        return [x[2], x[3], 100.0 * np.cos(phi), 100.0 * np.sin(phi)]

    end = solve_ivp(
        rates, (0.0, float(found.duration)), np.zeros(4), method="DOP853", rtol=1e-10, atol=1e-10
    ).y[:, -1]
    np.testing.assert_allclose(end[1:], [5.0, 45.0, 0.0], atol=1e-8)


def test_minimum_time_near_the_level_path():
    heights = jnp.asarray([-1.0, -1e-3, 0.0, 1e-6, 1e-3, 1.0, 500.0])
    found = minimum_time_steering(100.0, heights, 45.0)
    s = np.arcsinh(np.tan(found.initial_angle))
    reached = 45.0**2 / 100.0 * (s / 6.0 + s**3 / 30.0)  # the first terms of (sinh 2s - 2s)/(8 s^2)
    np.testing.assert_allclose(reached[1:5], heights[1:5], rtol=1e-6)
    np.testing.assert_allclose(found.duration[2], 0.45, rtol=1e-15)
    slope = jax.grad(lambda h: minimum_time_steering(100.0, h, 45.0).initial_angle)(0.0)
    np.testing.assert_allclose(slope, 600.0 / 45.0**2, rtol=1e-12)  # theta_0 = s = 6 a h/v^2


def test_flight_system_agrees_with_quadrature():
    """Steering linear in time is smooth, so that both roads to the burnout apply to it."""
    profile = SteeringProfile(np.array([0.0, 230.0]), np.array([0.7, 0.2]))
    start = FlightState(
        x=jnp.asarray(0.0), y=C.release_height, u=800.0 * jnp.cos(0.5), w=800.0 * jnp.sin(0.5)
    )
    trajectory = simulate(
        SteeredFlight(C.thrust, profile, C.gravity),
        start,
        jnp.asarray([0.0, 230.0]),
        accuracy=1e-11,
    )
    exact = burnout_state(C, 0.5, profile)
    for field in ("x", "y", "u", "w"):
        np.testing.assert_allclose(
            getattr(trajectory.final, field), getattr(exact, field), rtol=1e-9
        )


def test_profile_is_interpolation():
    times, angles = np.array([0.0, 1.0, 4.0]), np.array([0.3, -0.2, 1.0])
    profile, t = SteeringProfile(times, angles), np.linspace(-1.0, 5.0, 25)
    np.testing.assert_allclose(profile(jnp.asarray(t)), np.interp(t, times, angles), atol=1e-15)


@pytest.mark.sweep
@pytest.mark.parametrize("degrees", [20.0, 5.0])
def test_direct_shooting_finds_linear_tangent_steering(degrees):
    """T8.3-A from a constant angle: gradients through the simulation find what the optimality
    condition demands. From 5 degrees the rocket falls at the burnout: its apex lies before zero,
    where without a bound for it false optima are."""
    angle = float(np.radians(degrees))
    nodes = SteeringProfile(np.linspace(0.0, 160.0, 9), np.full(9, angle))
    found, best = optimise_steering(A, nodes, angle), linear_tangent_steering(A)
    assert found.converged
    assert found.violation < 1e-8
    assert found.burnout.w > 0.0
    # The violation counts in the height of the best vertical impulse, 8.8 times that of the apex.
    np.testing.assert_allclose(apex(A, found.burnout)[1], A.apex_height, rtol=8.8e-8)
    np.testing.assert_allclose(found.final_velocity, best.final_velocity, rtol=1e-6)
    np.testing.assert_allclose(found.apex_time, best.vanishing_time, rtol=1e-6)
    # straight lines miss the curve by phi'' h^2/8 with phi'' about 1e-5 rad/s^2 and h = 20 s
    np.testing.assert_allclose(found.steering.angles, best.angle(found.steering.times), atol=5e-4)
    np.testing.assert_allclose(found.release_angle, best.initial_angle, atol=1e-6)
    np.testing.assert_allclose(found.height_derivative, ENVELOPE["T8.3-A"][0], rtol=1e-6)


def test_bad_input_is_told():
    with pytest.raises(InputError, match="Ascent.burn_time"):
        dataclasses.replace(A, burn_time=-1.0)
    with pytest.raises(InputError, match="Ascent.thrust at burn_time"):
        dataclasses.replace(C, burn_time=270.0)
    with pytest.raises(InputError, match="does not accept a batch"):
        optimise_steering(
            eqx.tree_at(lambda a: a.gravity, A, jnp.ones(2)),
            SteeringProfile([0.0, 160.0], [0.3, 0.3]),
            0.3,
        )

"""Staging with fixed masses, the best number of stages, and losses of gravity by simulation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

from jaxspace.core import InputError
from jaxspace.optimization import optimal_staging
from jaxspace.optimization.fixed_masses import number_of_stages
from jaxspace.optimization.flown_staging import staging_with_losses
from jaxspace.optimization.staged_flight import StageDesign
from jaxspace.optimization.staging import equal_stages_payload

FIXED = np.array([1.0, 0.5, 0.1])
THREE = (np.array([3000.0, 3000.0, 4200.0]), np.array([0.08, 0.1, 0.12]), 9500.0)


def log_mass(velocities, fixed, u, b):
    """ln of the initial mass over the payload, of stages that give these velocities."""
    above = 1.0
    for v, c, ui, bi in reversed(list(zip(velocities, fixed, u, b, strict=True))):
        mu = np.exp(v / ui)
        above = (above + c) * mu * (1.0 - bi) / (1.0 - bi * mu)
    return np.log(above)


def test_fixed_masses():
    """Against SciPy's optimum; the multiplier is the
    derivative; without fixed masses it is the closed form."""
    u, b, v = THREE
    found = optimal_staging(u, b, v, FIXED)
    # In thousands, so that SciPy's differences are small enough.
    best = scipy.optimize.minimize(
        lambda s: log_mass(1e3 * s, FIXED, u, b),
        [3.0, 3.0, 3.5],
        bounds=[(0.0, None)] * 3,
        constraints={"type": "eq", "fun": lambda s: s.sum() - 1e-3 * v},
        options={"ftol": 1e-15, "maxiter": 500},
    )
    np.testing.assert_allclose(found.initial_mass, np.exp(best.fun), rtol=1e-10)
    np.testing.assert_allclose(found.mass_ratio, np.exp(1e3 * best.x / u), rtol=1e-5)
    slope = jax.grad(lambda v: jnp.log(optimal_staging(u, b, v, FIXED).initial_mass))(v)
    np.testing.assert_allclose(slope, -found.multiplier, rtol=1e-12)
    plain, none = optimal_staging(u, b, v), optimal_staging(u, b, v, np.zeros(3))
    np.testing.assert_allclose(none.mass_ratio, plain.mass_ratio, rtol=1e-12)
    np.testing.assert_allclose(none.multiplier, plain.multiplier, rtol=1e-12)
    with pytest.raises(InputError, match="one value for each of 3 stages"):
        optimal_staging(u, b, v, [1.0, 2.0])


def test_a_stage_that_does_not_pay_for_its_fixed_mass_vanishes():
    """The rocket without it is the best of the two that are left, and so is its derivative."""
    u, b, v = THREE
    heavy = np.array([1.0, 100.0, 0.1])
    found, left = optimal_staging(u, b, v, heavy), optimal_staging(u[::2], b[::2], v, heavy[::2])
    assert found.used.tolist() == [True, False, True] and float(found.mass_ratio[1]) == 1.0
    np.testing.assert_allclose(found.initial_mass, left.initial_mass, rtol=1e-12)
    np.testing.assert_allclose(found.multiplier, left.multiplier, rtol=1e-12)


def test_the_best_number_of_stages():
    """More stages save structure and cost fixed mass: each number against its own optimum, and
    without a fixed mass against the closed form of equal stages."""
    seen = number_of_stages(3000.0, 0.1, 9500.0, 0.5, most=7)
    assert np.isinf(seen.initial_mass[0]) and int(seen.best) == 6
    for n in (2, 6):
        one = optimal_staging(np.full(n, 3000.0), np.full(n, 0.1), 9500.0, np.full(n, 0.5))
        np.testing.assert_allclose(seen.initial_mass[n - 1], one.initial_mass, rtol=1e-12)
    free = number_of_stages(3000.0, 0.1, 9500.0, most=7)
    exact = [1.0 / equal_stages_payload(9500.0, 3000.0, 0.1, n) for n in range(2, 8)]
    np.testing.assert_allclose(free.initial_mass[1:], exact, rtol=1e-10)


def vertical_parts(masses, u, b, thrust, fixed, payload):
    """Initial mass and burnout speed of a vertical flight under constant gravity."""
    whole = masses + fixed
    carried = np.cumsum(whole[::-1])[::-1] + payload
    burnt = (1.0 - b) * masses
    fall = 9.80665 * np.sum(burnt * u / thrust)
    return carried[0], -np.sum(u * np.log1p(-burnt / carried)) - fall


@pytest.mark.sweep
def test_staging_with_the_losses_of_a_vertical_flight():
    """Constant gravity, where the losses are those of the burn times: SciPy's optimum."""
    u, b, thrust = np.array([2800.0, 3400.0]), np.array([0.07, 0.09]), np.array([200e3, 40e3])
    fixed, payload, speed = np.array([100.0, 50.0]), 200.0, 3000.0
    found = staging_with_losses(
        StageDesign(u, b, thrust, fixed), payload, speed, vertical=True, radius=None
    )
    assert found.converged
    best = scipy.optimize.minimize(
        lambda x: np.log(vertical_parts(x * 1e2, u, b, thrust, fixed, payload)[0]),
        np.asarray(found.stage_mass) / 1e2 * [1.1, 0.9],
        bounds=[(0.0, None)] * 2,
        constraints={
            "type": "eq",
            # The flight begins with 0.1 m/s.
            "fun": lambda x: (
                vertical_parts(x * 1e2, u, b, thrust, fixed, payload)[1] + 0.1
            ) / speed - 1.0,
        },
        options={"ftol": 1e-15, "maxiter": 300},
    )  # fmt: skip
    np.testing.assert_allclose(found.initial_mass, np.exp(best.fun), rtol=1e-8)
    np.testing.assert_allclose(found.losses, 9.80665 * jnp.sum(found.burn_times), rtol=1e-8)


@pytest.mark.sweep
def test_a_speed_out_of_reach_is_said_with_the_greatest_one():
    """An upper stage with too little thrust: straight up the greatest speed is SciPy's, with the
    thrust at the lift-off as its limit; in a gravity turn it is the speed that is just reached."""
    u, b, thrust = np.array([2800.0, 3300.0]), np.array([0.07, 0.09]), np.array([190e3, 6e3])
    fixed, payload = np.array([100.0, 50.0]), 200.0
    design = StageDesign(u, b, thrust, fixed)
    high = staging_with_losses(design, payload, 7000.0, vertical=True, radius=None)
    assert not high.converged and "at most" in high.sentence()
    best = scipy.optimize.minimize(
        lambda x: -1e-3 * vertical_parts(1e3 * x, u, b, thrust, fixed, payload)[1],
        [10.0, 0.5],
        bounds=[(0.1, None)] * 2,
        constraints={
            "type": "ineq",
            "fun": lambda x: (
                1.0
                - 1.05 * 9.80665 / 190e3
                * vertical_parts(1e3 * x, u, b, thrust, fixed, payload)[0]
            ),
        },
        options={"ftol": 1e-14, "maxiter": 300},
    )  # fmt: skip
    # The flight begins with 0.1 m/s.
    np.testing.assert_allclose(high.greatest_speed, 0.1 - 1e3 * best.fun, rtol=1e-6)
    turn = staging_with_losses(design, payload, 7800.0)
    assert not turn.converged and np.isinf(turn.velocity_price)
    np.testing.assert_allclose(np.degrees(turn.burnout.angle), 90.0, rtol=1e-6)
    below = staging_with_losses(design, payload, 0.98 * float(turn.greatest_speed))
    assert below.converged and np.isnan(below.greatest_speed)
    assert below.initial_mass < turn.initial_mass


@pytest.mark.sweep
def test_staging_with_the_losses_of_a_gravity_turn():
    """The multiplier is the slope of the optimum; the flight is that of SciPy; more thrust loses
    less, and the ideal rocket weighs less than both."""
    u, b, fixed = np.array([2800.0, 3300.0]), np.array([0.07, 0.09]), np.array([100.0, 50.0])
    design = StageDesign(u, b, [190e3, 26e3], fixed)
    found, more, less = (staging_with_losses(design, 200.0, v) for v in (7800.0, 7805.0, 7795.0))
    assert found.converged and more.converged and less.converged
    slope = np.log(more.initial_mass / less.initial_mass) / 10.0
    # The third derivative leaves 1e-6 of the central difference.
    np.testing.assert_allclose(found.velocity_price, slope, rtol=1e-5)

    def rate(t, y, F, u):
        v, psi, h, m = y
        r = 6378137.0 + h
        g = 9.80665 * (6378137.0 / r) ** 2
        return [F / m - g * np.cos(psi), (g / v - v / r) * np.sin(psi), v * np.cos(psi), -F / u]

    y = [0.1, 0.0, 0.0, float(found.initial_mass)]
    first, second = (float(x) for x in found.burn_times)
    for k, (F, span) in enumerate([(190e3, 10.0), (190e3, first - 10.0), (26e3, second)]):
        ode = scipy.integrate.solve_ivp(
            rate, (0.0, span), y, args=(F, u[max(k - 1, 0)]), rtol=1e-10, atol=1e-10
        )
        y = ode.y[:, -1]
        y += [0.0, float(found.kick), 0.0, 0.0] if k == 0 else np.zeros(4)
        if k == 1:
            y[3] -= float(found.stage_mass[0]) * b[0] + fixed[0]
    np.testing.assert_allclose(y[:2], [7800.0, 0.5 * np.pi], rtol=1e-6)
    np.testing.assert_allclose(y[2], found.burnout.height, rtol=1e-5)
    strong = staging_with_losses(StageDesign(u, b, [250e3, 40e3], fixed), 200.0, 7800.0)
    ideal = optimal_staging(u, b, 7800.0, fixed / 200.0)
    assert strong.converged and strong.losses < found.losses
    assert 200.0 * ideal.initial_mass < strong.initial_mass < found.initial_mass


@pytest.mark.sweep
def test_a_pitch_kick_and_a_gravity_turn_to_orbit():
    """Into the circle at 100 km: propellants and kick are settled by it, and the prices of speed
    and height are the slopes along each."""
    u, b, fixed = np.array([2800.0, 3300.0]), np.array([0.07, 0.09]), np.array([100.0, 50.0])
    design = StageDesign(u, b, [190e3, 26e3], fixed)
    height, speed = 100e3, np.sqrt(9.80665 * 6378137.0**2 / (6378137.0 + 100e3))

    def found(dv, dh):
        seen = staging_with_losses(design, 200.0, speed + dv, height + dh)
        assert seen.converged, seen.minimum.sentence()
        return seen

    best = found(0.0, 0.0)
    end = best.burnout
    np.testing.assert_allclose([end.speed, end.angle, end.height], [speed, np.pi / 2, height])
    faster, slower = (np.log(found(s, 0.0).initial_mass) for s in (5.0, -5.0))
    higher, lower = (np.log(found(0.0, s).initial_mass) for s in (100.0, -100.0))
    np.testing.assert_allclose(best.velocity_price, (faster - slower) / 10.0, rtol=1e-4)
    np.testing.assert_allclose(best.height_price, (higher - lower) / 200.0, rtol=1e-4)

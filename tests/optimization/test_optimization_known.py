"""Ascents and transfers whose optima are published, found by gradients through fixed steps.

The problems are those of `examples/known_optima`. The whole of each, compilation included, takes
seconds: the problem and its Jacobian are one small program.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from jaxspace.optimization.steering import minimum_time_steering

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "known_optima"))
import delta_iii
import goddard
import linear_tangent
import three_stages
import transfer
from three_stages import BURNS, GROUND, JET, LEFT, LIFT_OFF, PUSH, TARGET

pytestmark = pytest.mark.sweep


def converged_search(problem):
    """The minimum and its optimum, of a search that converged."""
    found = problem.search()
    assert found.converged, found.sentence()
    return found, problem.optimum(found)


def test_linear_tangent_steering():
    """0.5545709 (Betts), to its digits and 1e-7 of the closed form: a free angle, whose polynomial
    of eight is that near to the arctangent of a line."""
    found, duration = converged_search(linear_tangent)
    np.testing.assert_allclose(duration, linear_tangent.PUBLISHED, atol=5e-8)
    given = (linear_tangent.ACCELERATION, linear_tangent.HEIGHT, linear_tangent.SPEED)
    np.testing.assert_allclose(duration, minimum_time_steering(*given).duration, rtol=1e-7)
    assert found.criterion.report < 1e-8


def test_goddards_rocket():
    """Final altitude 1.01283 (Bryson and Ho; Betts), relative error 1e-5. Between both thrusts lies
    an arc that no switching function decides, here a polynomial of five."""
    found, altitude = converged_search(goddard)
    np.testing.assert_allclose(altitude, goddard.PUBLISHED, rtol=1e-5)
    assert found.criterion.report < 1e-6


def test_a_transfer_from_a_poor_start():
    """Burns 15 and 32 % too long, half a radian off the horizontal, a coast 18 % short. With
    twenty times the weight as thrust, the losses over Hohmann's impulses are below 1e-5."""
    _, velocity = converged_search(transfer)
    assert 0.0 < velocity / transfer.HOHMANN - 1.0 < 1e-5


def test_the_ascent_of_a_delta_iii():
    """37 unknowns in four phases, from a rough guess of upwards and then eastwards: the published
    final mass, 7529.71 kg at 924.139 s, to 1e-6."""
    found, mass = converged_search(delta_iii)
    _, end, error = found.criterion.report
    np.testing.assert_allclose(mass, delta_iii.PUBLISHED, rtol=1e-6)
    np.testing.assert_allclose(end, delta_iii.PUBLISHED_TIME, atol=2e-3)
    assert error < 1e-8


def primer_flight(x):
    """State and costates of position and velocity where the launch of Pontryagin's conditions ends,
    and the Hamiltonian of the coast, for the first costates of position (2) and the x of the
    velocity's, its y being 1, and the lengths of the coast and the last burn."""
    state = [GROUND / TARGET, 0.0, 0.0, 0.0, *x[:3], 1.0]
    burns = [*zip(PUSH[:2], JET[:2], BURNS, strict=True)]
    flown = [*burns, (0.0, 1.0, x[3]), (PUSH[2], JET[2], x[4])]
    mass, hamiltonian = 1.0, 0.0
    for k, (push, jet, span) in enumerate(flown):

        def rate(t, y, push=push, jet=jet, mass=mass):
            r, v, q, p = y[:2], y[2:4], y[4:6], y[6:]
            d = np.hypot(*r)
            a = push / (mass - push / jet * t) * p / np.hypot(*p)
            return [*v, *(a - r / d**3), *(p / d**3 - 3.0 * r * (p @ r) / d**5), *(-q)]

        if k == 2:
            y = np.array(state)
            hamiltonian = y[4:6] @ y[2:4] - y[6:] @ y[:2] / np.hypot(*y[:2]) ** 3
        ode = solve_ivp(rate, (0.0, span), state, rtol=1e-11, atol=1e-11, method="DOP853")
        state = ode.y[:, -1]
        mass -= push / jet * span + (LEFT[k] if k < 2 else 0.0)
    return state, hamiltonian


def conditions(x):
    """The circle, a coast of the best length, and an end anywhere on the circle."""
    y, hamiltonian = primer_flight(x)
    r, v, q, p = y[:2], y[2:4], y[4:6], y[6:]
    # The torque of the costates is zero, because the end may turn about the centre.
    turn = r[0] * q[1] - r[1] * q[0] + v[0] * p[1] - v[1] * p[0]
    return [np.hypot(*r) - 1.0, r @ v, r[0] * v[1] - r[1] * v[0] - 1.0, turn, hamiltonian]


def test_a_three_stage_launch_with_a_coast():
    """To a circle at 185 km: the mass that arrives, by gradients from a guess of upwards and then
    eastwards, against Pontryagin's conditions solved by SciPy; 1e-5 is wanted."""
    found, reached = converged_search(three_stages)
    first = np.array([np.polyval(c, -1.0) for c in np.moveaxis(found.x["vectors"][0], 1, 0)])
    bend = np.array(
        [np.polyval(np.polyder(c), -1.0) for c in np.moveaxis(found.x["vectors"][0], 1, 0)]
    )
    tangent = first[0] / first[1]
    # The slope of the tangent is -(q_x - q_y tangent) over the velocity's costate.
    slope = 2.0 / BURNS[0] * (bend[0] * first[1] - first[0] * bend[1]) / first[1] ** 2
    guess = [-slope, 0.0, tangent, float(found.x["coast"]), float(found.x["last"])]
    best, _, ok, text = fsolve(conditions, guess, full_output=True, xtol=1e-12)
    assert ok == 1, text
    left = 1.0 - sum(PUSH[k] / JET[k] * BURNS[k] + LEFT[k] for k in (0, 1))
    mass = LIFT_OFF * (left - PUSH[2] / JET[2] * best[4])
    # The example states it to ten digits.
    np.testing.assert_allclose(three_stages.REFERENCE, mass, rtol=1e-9)
    np.testing.assert_allclose(reached, mass, rtol=1e-5)
    _, error = found.criterion.report
    assert error < 1e-7 and best[3] > 0.0

"""Derivatives of flights by a drag, a wind and a deviation of the wind that are zero, against
integrals along the flight without them by SciPy: all three are first-order effects there."""

import jax.numpy as jnp
import numpy as np
from both_modes import both_modes
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from jaxspace import BodyState, Event, Scene, simulate
from jaxspace.bodies import ExponentialAtmosphere, RigidBody
from jaxspace.orbits import UniformGravity
from jaxspace.vehicles import AirDrag, MeasuredWind, UncertainWind
from jaxspace.vehicles.local_air import LocalAir

G, MASS, AREA, DENSITY, SCALE = 9.81, 2.0, 0.02, 1.2, 8e3
AIR = ExponentialAtmosphere(DENSITY, 0.0, SCALE)
# Levels that are not equally far apart, and an east wind there, m and m/s.
HEIGHTS = np.array([0.0, 30.0, 40.0, 150.0, 200.0, 400.0])
EAST = np.array([1.0, 3.0, 3.0, 7.0, 4.0, -2.0])
GRAVITY = UniformGravity([0.0, 0.0, -G])
BODY = RigidBody(MASS)


def thrown(velocity):
    return BodyState(jnp.zeros(3), jnp.array(velocity))


def loss(z):
    """Of a drag of the coefficient one: rho A / (2 m), 1/m."""
    return 0.5 * DENSITY * np.exp(-z / SCALE) * AREA / MASS


def test_the_time_of_an_impact_by_a_drag_coefficient_that_is_zero():
    v0 = np.array([0.1, 0.0, 30.0])

    def time(coefficient):
        down = Event(lambda t, y: y.position[2], direction=-1)
        scene = Scene([GRAVITY, AirDrag(AREA, coefficient, LocalAir(AIR))], BODY)
        run = simulate(scene, thrown(v0), np.array([0.0, 10.0]), events=[down], accuracy=1e-9)
        return run.ts[-1]

    # The parabola, along which z changes by -int (T - t) loss |v| v_z dt, and the impact by z / v0.
    t = np.linspace(0.0, 2.0 * v0[2] / G, 200_001)
    vz = v0[2] - G * t
    lost = loss(v0[2] * t - 0.5 * G * t**2) * np.hypot(v0[0], vz) * vz
    right = -np.trapezoid((t[-1] - t) * lost, t) / v0[2]
    _, forward, reverse = both_modes(time)(0.0)
    # A thousand steps, each within 1e-9; the quadrature is good to 1e-10.
    np.testing.assert_allclose([forward, reverse], right, rtol=1e-6)


def test_the_drift_by_winds_that_are_zero():
    """Of a body that is thrown upwards with drag, by the strength of a measured wind, of a mean
    wind and of its deviation, each beside calm air."""
    span, coefficient, v0 = 8.0, 0.5, 60.0
    zero = np.zeros(6)

    def drift(x):
        measured, mean, deviation = x
        winds = (
            MeasuredWind(HEIGHTS, measured * EAST, zero),
            UncertainWind(HEIGHTS, mean * EAST, zero, zero, 200.0, zero, zero),
            # Far longer than the levels are high, so that all errors are the first one.
            UncertainWind(HEIGHTS, zero, zero, deviation + zero, 1e30, 1.5 + zero, zero),
        )
        drags = [AirDrag(AREA / 3.0, coefficient, LocalAir(AIR, wind=wind)) for wind in winds]
        scene = Scene([GRAVITY, *drags], BODY)
        y0 = thrown([0.0, 0.0, v0])
        return simulate(scene, y0, np.array([0.0, span]), accuracy=1e-9).final.position[:2]

    _, forward, reverse = both_modes(drift)([0.0, 0.0, 0.0])
    ends = np.r_[0, np.arange(5)], np.r_[np.arange(1, 6), 5]
    chords = (EAST[ends[1]] - EAST[ends[0]]) / (HEIGHTS[ends[1]] - HEIGHTS[ends[0]])
    east = CubicHermiteSpline(HEIGHTS, EAST, chords)

    def rate(t, y):
        z, vz, _, u1, _, u2 = y
        k = coefficient * loss(z) * abs(vz)
        # Each wind blows on a third of the area, and all of it is carried along.
        return [vz, -G - k * vz, u1, k * (east(z) / 3.0 - u1), u2, k * (1.5 / 3.0 - u2)]

    end = solve_ivp(rate, (0.0, span), [0.0, v0, 0, 0, 0, 0], "DOP853", rtol=1e-11, atol=1e-12).y
    right = [[end[2, -1], end[2, -1], end[4, -1]], [0.0, 0.0, 0.0]]
    for slopes in (forward, reverse):
        np.testing.assert_allclose(slopes, right, rtol=1e-6, atol=1e-9)

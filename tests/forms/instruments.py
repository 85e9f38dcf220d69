"""Closed forms of gyroscopic instruments: responses, linear motions, places, noise."""

import jax.numpy as jnp
import twins

from jaxspace import gyros as g
from jaxspace.rotations import Quaternion

from .form import Form
from .mechanics import numbers


def forced_oscillator(x):
    """First order, balance and resonance of an oscillator: mass, stiffness, softening, force,
    frequency, damping and amplitude."""
    one = g.duffing.DuffingOscillator(*x[:6])
    found = one.first_order, one.resonance_frequencies(x[6])
    return numbers(*found[0], one.harmonic_balance(), *found[1])


def compass(x):
    """Frame, slow and small motion of a gyrocompass: 6 numbers, speed, course, 4 of the state,
    time."""
    one = g.Gyrocompass(*x[:6], speed=x[6], course=x[7], earth_rate=7.3e-5 + 0.0 * x[0])
    y = one.state(*x[8:12])
    small = one.small_motion(x[12], y)
    slow = one.slow_motion(x[12], x[8], x[9])
    frame = jnp.stack(jnp.broadcast_arrays(*one.frame_rate))
    turning = (
        jnp.stack([small.tilt, small.azimuth]),
        jnp.stack([small.tilt_rate, small.azimuth_rate]),
    )
    return frame, jnp.stack(slow), *turning


def gyropendulum_motion(x):
    """Frequencies, tuned momentum and motion of a gyropendulum: 6 numbers, gravity, radius, state,
    time."""
    one = g.Gyropendulum(*x[:7])
    later = one.closed_form().flow(x[12], g.GyropendulumState(*x[8:12]))
    angles = jnp.stack([later.theta, later.phi]), jnp.stack([later.theta_rate, later.phi_rate])
    return *numbers(*one.frequencies, one.tuned(x[7]).spin_momentum), *angles


def platform(x):
    """First angle, nutation and motion of an axis: 8 numbers and time."""
    one = g.PlatformAxis(*x[:8])
    later = one.closed_form().flow(x[8], one.at_rest)
    found = later.gyro_angle, later.platform_angle, later.gyro_rate, later.platform_rate
    # Some of them grow with the cube of a short time, the fastest with the time.
    return jnp.stack(found), *numbers(one.first_angle(x[8]), one.nutation_frequency)


def rate_gyro_figures(x):
    """Figures and errors of a rate gyro: 13 numbers, frequency."""
    one = g.RateGyro(*x[:13])
    answer = one.frequency_response(x[13])
    parts = jnp.stack([answer.real, answer.imag])
    error = one.error_torque, one.drift_rate
    return parts, *numbers(one.damping_ratio, one.natural_frequency, *error)


def rate_gyro_response(x):
    """The step response and the free motion of a rate gyro: 5 numbers, state, time."""
    one = g.RateGyro(*x[:5])
    later = one.closed_form().flow(x[7], g.RateGyroState(x[5], x[6]))
    return numbers(one.step_response(x[7]), later.angle, later.angle_rate)


def turned_place(x):
    """Attitude and body rate at a place, from its 6 numbers and their rates."""
    place = g.Place(*x[:6])
    return place.attitude.wxyz, place.body_rate(g.Place(*x[6:]))


def navigator(x):
    """What a vehicle feels and what an inertial navigator holds: 7 numbers of the motion, errors of
    place, velocity and tilt, time."""
    one = g.InertialNavigator(*x[:7], roll_amplitude=0.1, roll_frequency=0.05)
    felt = one.felt(x[16])
    y = one.state(x[7:10], x[10:13], x[13:16])
    earth = one.earth.curvature_radii(x[0])
    held = felt.velocity, felt.specific_force, felt.level_rate, felt.attitude.wxyz
    return *held, y.velocity, y.attitude.wxyz, *numbers(*earth)


def held_errors(x):
    """Errors of what a navigator holds: 7 numbers of the motion, then its place, velocity and
    attitude."""
    one = g.InertialNavigator(*x[:7], roll_amplitude=0.1, roll_frequency=0.05)
    y = g.NavigatorState(x[7], x[8], x[9], x[10:13], Quaternion(x[13:17]))
    errors = one.errors(0.0 * x[0], y)
    return errors.position, errors.velocity, errors.tilt


def error_equations(x):
    """The rate of errors by the linear equations of a navigator at a time."""
    one = g.InertialNavigator(*x[:7], roll_amplitude=0.1, roll_frequency=0.05)
    linear = one.error_equations(x[16])
    y = g.navigation_errors.NavigationErrors.errors(x[7:10], x[10:13], x[13:16])
    rate = linear.vector_field(jnp.zeros_like(x[0]), y)
    return rate.position, rate.velocity, rate.tilt


def error_motion(x):
    """Errors a time later: radius, gravity, rate and specific force, errors, time."""
    linear = g.navigation_errors.NavigationErrors(x[0], x[1], x[2:5], x[5:8])
    later = linear.closed_form().flow(
        x[17], g.navigation_errors.NavigationErrors.errors(x[8:11], x[11:14], x[14:17])
    )
    return later.position, later.velocity, later.tilt


def gimbals(x):
    """Axes of four gimbals, held rates and the vehicle's: angles, sway and rates, time."""
    one = g.StablePlatform(
        *([0.3, 0.4, 0.5], 0.02, 2e-3, 0.05, 4.0, 0.2),
        vehicle_rate=x[4:7],
        sway=x[7:10],
        fourth=True,
    )
    held = one.held(x[10], x[:4])
    return g.stable_platform.gimbal_axes(x[:4]).reshape(-1), held, one.vehicle_turn(x[10])


def noise(x):
    """Allan's variance of a record and of walks: five rates, step, time and both walks."""
    record = g.noise.allan_variance(x[:5], x[5], (1, 2))
    return record, *numbers(g.noise.allan_of_walks(*x[6:9]))


COMPASS = (30.0, 0.2, 0.2, 8.5, 0.8, 0.17)
MOTION = (0.8, 0.3, 1e4, 200.0, -50.0, 1.0, 0.4)
ERRORS = (100.0, 200.0, 30.0, 0.1, 0.2, 0.3, 1e-4, 2e-4, 3e-4)


def of(kind, *methods):
    """ "gyros.kind.method" for each."""
    return tuple(f"gyros.{kind}.{method}" for method in methods)


FORMS = (
    Form(
        forced_oscillator,
        of("DuffingOscillator", "first_order", "harmonic_balance", "resonance_frequencies"),
        [
            (2.0, 30.0, 4.0, 1.0, 3.0, 0.1, 0.2),
            (2.0, 30.0, 0.0, 1.0, 3.0, 0.0, 0.2),
            (2.0, 30.0, 4.0, 1e-6, 3.0, 1e-6, 1e-3),
        ],
    ),
    Form(
        compass,
        of("Gyrocompass", "frame_rate", "slow_motion", "small_motion", "state"),
        [
            (*COMPASS, 8.0, 0.3, 0.02, 0.3, 0.01, 0.02, 1.0),
            (*COMPASS, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 100.0),
            (*COMPASS, 8.0, 0.3, 0.02, 0.3, 0.01, 0.02, 0.0),
        ],
    ),
    Form(
        gyropendulum_motion,
        of("Gyropendulum", "frequencies", "tuned", "closed_form"),
        [
            (1.0, 1e-2, 0.3, 0.02, 0.02, 0.01, 9.8, 6.4e6, 0.02, -0.01, 0.3, 0.1, 0.5),
            (1.0, 1e-2, 0.0, 0.0, 0.0, 0.0, 9.8, 6.4e6, 0.02, -0.01, 0.0, 0.0, 0.5),
            (1.0, 1e-6, 0.3, 0.02, 0.02, 0.01, 9.8, 6.4e6, 0.02, -0.01, 0.3, 0.1, 0.0),
        ],
    ),
    Form(
        platform,
        of("PlatformAxis", "at_rest", "closed_form", "first_angle", "nutation_frequency"),
        [
            (0.4, 2e-4, 0.05, 0.1, 5.0, 0.3, 0.2, 1e-3, 0.2),
            (0.4, 2e-4, 0.05, 0.1, 0.0, 0.0, 0.0, 0.0, 1e-4),
            (0.4, 2e-4, 0.05, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0),
        ],
    ),
    Form(
        rate_gyro_figures,
        of(
            "RateGyro",
            "frequency_response",
            "damping_ratio",
            "natural_frequency",
            "error_torque",
            "drift_rate",
        ),
        [
            (1e-4, 4e-4, 0.05, 0.2, 0.1, 0.02, 1e-3, 1e-5, 1e-6, 2e-6, 3e-7, 9.8, 4.0, 20.0),
            (1e-4, 4e-9, 0.05, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 44.7213595499958),
        ],
        exact=twins.rate_gyro,
    ),
    Form(
        rate_gyro_response,
        of("RateGyro", "step_response", "closed_form"),
        [
            (1e-4, 4e-4, 0.05, 0.2, 0.1, 0.02, -0.4, 0.2),
            (1e-4, 4e-4, 0.05, 0.0, 0.1, 0.02, -0.4, 0.2),
            (1e-4, 0.008944271909999158, 0.05, 0.2, 0.1, 0.02, -0.4, 0.02),
            (1e-4, 4e-4, 0.05, 0.2, 0.1, 0.0, 0.0, 0.0),
        ],
    ),
    Form(
        turned_place,
        of("Place", "attitude", "body_rate"),
        [
            (0.8, 0.3, 1e4, 0.4, 0.2, -0.1, 1e-5, 1e-5, 2.0, 0.01, 0.02, 0.03),
            (0.8, 0.3, 1e4, 0.0, 1.5707963, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.03),
        ],
    ),
    Form(
        navigator,
        of("InertialNavigator", "felt", "state", "earth"),
        [(*MOTION, *ERRORS, 10.0), (0.0, 0.0, 0.0, 200.0, 0.0, 0.0, 0.0, *(0.0,) * 9, 0.0)],
    ),
    Form(
        held_errors,
        of("InertialNavigator", "errors"),
        [(*MOTION, 0.80001, 0.30002, 10030.0, 200.1, -50.2, 1.3, 0.1, 0.7, 0.7, 0.15)],
    ),
    Form(
        error_equations,
        of("InertialNavigator", "error_equations"),
        [(*MOTION, *ERRORS, 10.0), (0.0, 0.0, 0.0, 200.0, 0.0, 0.0, 0.0, *ERRORS, 0.0)],
    ),
    Form(
        error_motion,
        of("NavigationErrors", "closed_form", "errors"),
        [
            (6.4e6, 9.8, 0.0, 5e-5, 5e-5, 0.0, 0.1, 9.8, *ERRORS, 600.0),
            (6.4e6, 9.8, 0.0, 0.0, 0.0, 0.0, 0.0, 9.8, *ERRORS, 0.0),
        ],
    ),
    Form(
        gimbals,
        ("gyros.gimbal_axes", *of("StablePlatform", "held", "vehicle_turn")),
        [
            (0.3, -0.2, 0.5, 0.1, 0.1, 0.2, 0.3, 0.3, 0.1, 0.05, 2.0),
            (0.0, 1.5707963, 0.0, 0.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0),
        ],
    ),
    Form(
        noise,
        ("gyros.allan_variance", "gyros.allan_of_walks"),
        [
            (0.1, 0.3, -0.2, 0.4, 0.2, 0.01, 5.0, 1e-3, 1e-4),
            (0.1, 0.1, 0.1, 0.1, 0.1, 0.01, 5.0, 1e-3, 0.0),
        ],
    ),
)

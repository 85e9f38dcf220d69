"""Thomson, chapter 6: gyroscopic instruments."""

import jax.numpy as jnp

from jaxspace.gyros import Gyrocompass, Gyropendulum, PlatformAxis, RateGyro
from jaxspace.gyros.duffing import DuffingOscillator
from jaxspace.gyros.gyropendulum import schuler_frequency, schuler_period
from jaxspace.gyros.navigation_errors import NavigationErrors, coupled_rates, table_rates
from jaxspace.gyros.platform import resolve_signals

from .case import DEG, Case, vec

OMEGA = 7.27220521664304e-05
RADIUS, G = 6373002.24, 9.81456
# In lbf in s^2 and lbf in.
COMPASS = {"C": 3.0, "spin": 1000.0, "wl": 75.0, "latitude": 45 * DEG}


def compass(C, spin, wl, latitude, we=0.0, I=1.8):
    return Gyrocompass(
        C * spin, I, I, wl, latitude, damping_moment=we, earth_rate=OMEGA, radius=RADIUS
    )


def damped(we, **given):
    found = compass(we=we, **given)
    # The rest of the linear equations, after fifty times of decay.
    tilt, azimuth = found.slow_motion(2e5, 0.0, 0.0)
    return (
        *(azimuth, found.damping_ratio, found.slow_frequency),
        *(found.damping_ratio * found.slow_frequency, tilt),
    )


def at_rest(we, **given):
    """Tilt without damping; tilt and azimuth with it."""
    found = compass(we=we, **given)
    return compass(**given).rest_tilt, found.rest_tilt, found.rest_azimuth


def nutating(azimuth, **given):
    """Azimuth and tilt after 1 s and after 600 s, both motions together."""
    found = compass(**given)
    end = found.small_motion(vec(1.0, 600.0), found.state(0.0, azimuth))
    return end.azimuth[0], end.tilt[0], end.azimuth[1], end.tilt[1]


def heading(speed, course, latitude):
    found = Gyrocompass(
        1.0, 1.0, 1.0, 1.0, latitude, speed=speed, course=course, earth_rate=OMEGA, radius=RADIUS
    )
    slow = Gyrocompass(
        1.0, 1.0, 1.0, 1.0, latitude, speed=speed * jnp.cos(course), earth_rate=OMEGA, radius=RADIUS
    )
    # The book's angle is small, and its tangent.
    return jnp.tan(found.rest_azimuth), jnp.tan(slow.rest_azimuth), found.heading_error


def tuned(R, g):
    """H / Wl, and the period of the precession, of a gyropendulum whose inertia is small."""
    pendulum = Gyropendulum(1.0, 1e-12, 0.01, gravity=g).tuned(R)
    slow, _ = pendulum.frequencies
    return pendulum.spin_momentum / pendulum.weight_moment, 2.0 * jnp.pi / slow / 60.0


def rate_gyro(A, c, K, H, rate, t):
    gyro = RateGyro(A, c, H, spring=K, input_rate=rate)
    return (
        *(gyro.steady_angle, gyro.natural_frequency, gyro.damping_ratio),
        *(gyro.step_response(t), gyro.overshoot),
    )


def integrating_gyro(A, c, H, rate, t):
    gyro = RateGyro(A, c, H, input_rate=rate)
    return H * rate * t / c, gyro.integrated_angle(t), gyro.step_response(t)


def platform(J, I, h, T, t):
    axis = PlatformAxis(J, I, h, T)
    end = axis.closed_form().flow(t, axis.at_rest)
    return axis.nutation_frequency, end.gyro_angle, end.platform_angle, axis.first_angle(t)


def fast_vehicle(r, R, g, v):
    w0, w = schuler_frequency(g * (R / r) ** 2, r), v / r
    ringing, growth = coupled_rates(w0, w)
    return w0, w, jnp.sqrt(w0**2 - w**2), jnp.sqrt(2.0 * w0**2 + w**2), ringing, growth


def level(bias, speed, t):
    errors = NavigationErrors(RADIUS, G, accelerometer_bias=(bias, 0.0, 0.0))
    end = errors.closed_form().flow(t, errors.errors(velocity=vec(speed, 0, 0)))
    return end.position[0], 2.0 * bias / schuler_frequency(G, RADIUS) ** 2


def vertical(dz, t):
    errors = NavigationErrors(RADIUS, G)
    end = errors.closed_form().flow(t, errors.errors(position=vec(0, 0, dz)))
    return end.position[2], 1.0 / (jnp.sqrt(2.0) * schuler_frequency(G, RADIUS))


def at_orbital_speed(dz):
    w = schuler_frequency(G, RADIUS)
    errors = NavigationErrors(RADIUS, G, rate=(-w, 0.0, 0.0))
    end = errors.closed_form().flow(2.0 * jnp.pi / w, errors.errors(position=vec(0, 0, dz)))
    return end.position[1], end.position[2]


def duffing(m, k, b, F, p):
    oscillator = DuffingOscillator(m, k, b, F, p)
    return *oscillator.first_order, oscillator.harmonic_balance()


CASES = [
    Case(
        "T6.3-P3",
        "Forced oscillator with a softening spring",
        (DuffingOscillator.first_order, DuffingOscillator.harmonic_balance),
        {"m": 1.0, "k": 4.0, "b": 0.1, "F": 1.0, "p": 1.0},
        duffing,
        {
            "sin pt (m)": 0.33425925925925926,
            "sin 3pt (m)": 0.00018518518518518518,
            "balance (m)": 0.3342670621493151,
        },
    ),
    Case(
        "T6.5-P3",
        "Gyrocompass with the tilt clamped",
        (Gyrocompass.clamped_frequency,),
        COMPASS,
        lambda **given: (compass(**given).clamped_frequency,),
        {"frequency (rad/s)": 0.29275204590427945},
    ),
    Case(
        "T6.5-16",
        "Damped gyrocompass: rest and decay",
        (Gyrocompass.slow_motion, Gyrocompass.damping_ratio),
        {**COMPASS, "we": 1.5},
        damped,
        {
            "azimuth (rad)": -0.01995894663727853,
            "damping ratio": 0.22026639857067926,
            "frequency (rad/s)": 0.0011349892749064937,
            "decay (1/s)": 0.00025,
            "tilt (rad)": 0.0020526681360735666,
        },
    ),
    Case(
        "T6.4",
        "Gyrocompass at rest: without damping, and with it",
        (Gyrocompass.rest_tilt, Gyrocompass.rest_azimuth),
        {**COMPASS, "we": 1.5},
        at_rest,
        {
            # arctan(H W sin / (wl + H W cos))
            "tilt (rad)": 0.002052665253145079,
            # By Newton's method in thirty digits from both equations.
            "tilt, damped (rad)": 0.0020526660924559547,
            "azimuth, damped (rad)": -0.019960238120741176,
        },
    ),
    Case(
        "T6.5-resp",
        "Damped gyrocompass after half an hour",
        (Gyrocompass.slow_motion,),
        {**COMPASS, "we": 1.5},
        lambda **given: compass(**given).slow_motion(1800.0, 0.0, 5 * DEG),
        {"tilt (rad)": -3.860508227881678e-05, "azimuth (rad)": -0.06089624577234923},
    ),
    Case(
        "T6.5-full",
        "Gyrocompass with its nutation, after 1 s and after 600 s",
        (Gyrocompass.small_motion,),
        {**COMPASS, "azimuth": 5 * DEG},
        nutating,
        {
            "azimuth, 1 s (rad)": 0.08721501284496455,
            "tilt, 1 s (rad)": -4.4505250956888556e-06,
            "azimuth, 600 s (rad)": 0.03927884392478471,
            "tilt, 600 s (rad)": -0.00203124252591251,
        },
        1e-8,
        why="closed form: a million radians of nutation leave ten digits",
    ),
    Case(
        "T6.5-P5",
        "Heading error at 15 knots, N 20 E, 48 deg N",
        (Gyrocompass.rest_azimuth, Gyrocompass.heading_error),
        {"speed": 15 * 1852 / 3600, "course": 20 * DEG, "latitude": 48 * DEG},
        heading,
        {
            "full (rad)": 0.02318536815523867,
            "simple (rad)": 0.023382689619447165,
            "exact (rad)": 0.02318121497585442,
        },
    ),
    Case(
        "T6.5-P10",
        "Gyropendulum tuned to Schuler's period",
        (Gyropendulum.tuned, Gyropendulum.frequencies),
        {"R": RADIUS, "g": G},
        tuned,
        {"H / Wl (s)": 805.8173582809148, "period (min)": 84.38499643034855},
    ),
    Case(
        "T6.6",
        "Rate gyro after a step",
        (RateGyro.step_response, RateGyro.overshoot),
        {"A": 1e-4, "c": 0.004, "K": 0.2, "H": 0.05, "rate": 0.1, "t": 0.02},
        rate_gyro,
        {
            "steady (rad)": 0.025,
            "frequency (rad/s)": 44.721359549995796,
            "damping ratio": 0.4472135954999579,
            "angle (rad)": 0.0073138610644803035,
            "overshoot": 0.2078795763507619,
        },
    ),
    Case(
        "T6.7",
        "Integrating gyro with inertia",
        (RateGyro.integrated_angle, RateGyro.step_response),
        {"A": 1e-4, "c": 0.004, "H": 0.05, "rate": 0.1, "t": 0.1},
        integrating_gyro,
        {
            "ideal (rad)": 0.125,
            "angle (rad)": 0.09432236371527294,
            "by its flow (rad)": 0.09432236371527294,
        },
    ),
    Case(
        "T6.8",
        "Platform without servo under a steady torque",
        (PlatformAxis.closed_form, PlatformAxis.nutation_frequency, PlatformAxis.first_angle),
        {"J": 0.4, "I": 0.0002, "h": 0.05, "T": 0.01, "t": 0.05},
        platform,
        {
            "nutation (rad/s)": 5.5901699437494745,
            "gyro (rad)": 0.00012970065211086122,
            "platform (rad)": 3.1047078559727675e-05,
            "first term (rad)": 0.00013020833333333333,
        },
    ),
    Case(
        "T6.9-resolved",
        "Pickoff signals of T6.9 by the book's matrix",
        (resolve_signals,),
        {"pitch": 20 * DEG, "yaw": 35 * DEG},
        lambda pitch, yaw: resolve_signals(vec(1.0, -0.5, 0.25), pitch, yaw),
        {
            "roll": 1.0427704977479604,
            "pitch": -1.0981085860302817,
            "yaw": 0.5769432985221459,
        },
    ),
    Case(
        "T6.11-12",
        "Schuler's period",
        (schuler_period, schuler_frequency),
        {"g": G, "r": RADIUS},
        lambda g, r: (schuler_period(g, r) / 60.0, schuler_frequency(g, r)),
        {"period (min)": 84.38499643034855, "frequency (rad/s)": 0.0012409759975056177},
    ),
    Case(
        "T6.11-P12",
        "Table rates at 600 mph, N 60 W, 32 deg N",
        (table_rates,),
        {"v": 268.224, "latitude": 32 * DEG, "course": -60 * DEG},
        lambda v, latitude, course: table_rates(
            latitude, v * jnp.cos(course), v * jnp.sin(course), RADIUS, OMEGA
        ),
        {
            "latitude (rad/s)": 2.1043771043771045e-05,
            "longitude (rad/s)": -4.297973286639517e-05,
            "polar axis (rad/s)": 2.9742319300035228e-05,
        },
    ),
    Case(
        "T6.11-P13",
        "Errors at 12,000 mph: uncoupled and coupled",
        (coupled_rates, schuler_frequency),
        {"r": RADIUS + 160934.4, "R": RADIUS, "g": G, "v": 5364.48},
        fast_vehicle,
        {
            "w0 (rad/s)": 0.0011954106210016627,
            "v/r (rad/s)": 0.0008210180623973727,
            "uncoupled (rad/s)": 0.0008688704702202995,
            "uncoupled growth (1/s)": 0.0018793838789321084,
            "coupled (rad/s)": 0.0012621446146989484,
            "coupled growth (1/s)": 0.001293782927562296,
        },
    ),
    Case(
        "T6.11-sch",
        "Level channel after an hour: bias and error of speed",
        (NavigationErrors.closed_form,),
        {"bias": 0.000981456, "speed": 0.3048, "t": 3600.0},
        level,
        {"error (m)": 553.5184925332069, "greatest of the bias (m)": 1274.600448},
    ),
    Case(
        "T6.11-vert",
        "Vertical channel after an hour",
        (NavigationErrors.closed_form,),
        {"dz": 3.048, "t": 3600.0},
        vertical,
        {"error (m)": 845.0197673766827, "e-folding (s)": 569.7989184382646},
    ),
    Case(
        "T6.11-CW-table",
        "Error equations at orbital speed after one orbit, as T6.11-CW",
        (NavigationErrors.closed_form,),
        {"dz": 3.048},
        at_orbital_speed,
        {"dy (m)": -114.90689289770027, "dz (m)": 3.048},
    ),
]

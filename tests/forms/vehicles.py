"""Closed forms of space vehicles, of the relatives of the top, of gyros and of variable mass."""

import jax.numpy as jnp

from jaxspace import attitude as a
from jaxspace import gyros as g
from jaxspace import rockets as k
from jaxspace import rotations as r
from jaxspace.rotations import Quaternion

from .form import Form


def principal_spins(x):
    """Stiffness, frequencies and growth of the spins about three axes, and the cone's bounds."""
    modes = a.principal_spins.spin_modes(x[:3], x[3])
    return (
        a.principal_spins.spin_stiffness(x[:3], x[3]),
        *modes,
        *a.principal_spins.cone_bounds(x[:3], x[4:7]),
    )


def librations(x):
    """Ratios of inertia, frequencies and growth, forced pitch: moments, mean motion, e, anomaly."""
    moments, n, e, nu = x[:3], x[3], x[4], x[5]
    modes = a.libration.libration_modes(moments, n)
    ratios = jnp.stack(a.libration.inertia_ratios(moments))
    return ratios, modes.frequency, modes.growth, a.libration.forced_pitch(e, nu, moments)[None]


def drift_of_energy(x):
    """Energy and rate of the axis: angle, both moments, momentum, dissipation."""
    return a.drift.drift_energy(*x[:4])[None], a.drift.drift_by_dissipation(*x)[None]


def drifting(x):
    """Rate, time and later angle of a drift: constant, ratio, damping, two angles, duration."""
    drift = a.AttitudeDrift(x[0], x[1], x[2])
    times = drift.rate(x[3]), drift.drift_time(x[3], x[4]), drift.angle_after(x[5], x[3])
    return tuple(f[None] for f in times)


def drift_constants(x):
    """Of a tube with two disks, and of whip antennas."""
    tube = a.drift.tube_drift_constant(*x[:10])
    whips = a.drift.antenna_drift_constant(*x[:8])
    return tube[None], whips[None], a.drift.structural_damping(x[0])[None]


def released(x):
    """Spin after radial release, and the cord for none: rate, cord, inertia, radius, mass."""
    return a.swinging.radial_release_spin(*x)[None], a.swinging.zero_spin_radial_cord(*x[2:])[None]


def precessing_earth(x):
    """Secular and periodic luni-solar rates, and amplitudes: longitude, then five parameters."""
    rates = jnp.stack(jnp.broadcast_arrays(*a.precession_of_earth.luni_solar_rates_at(*x)))
    return (
        a.precession_of_earth.luni_solar_rate(*x[1:])[None],
        rates,
        jnp.stack(a.precession_of_earth.luni_solar_nutation(*x[1:])),
    )


def top_relatives(x):
    """Springs, crusher: angle, rate, weight, radius, arm, both moments."""
    frequencies = a.top_relatives.sprung_flywheel_frequencies(x[5], x[6], x[2], x[3])
    force, spin = (
        a.top_relatives.crusher_force(*x),
        a.top_relatives.crusher_spin(x[0], x[1], x[3], x[4]),
    )
    return *(f[None] for f in frequencies), force[None], spin[None]


def on_a_shaft(x):
    """Critical rate, equilibrium and frequency of a pendulum on a turning shaft."""
    pendulum = a.ShaftPendulum(x[0], x[1], x[2], x[3])
    found = pendulum.critical_rate, pendulum.equilibrium, pendulum.frequency(x[4])
    return tuple(f[None] for f in found)


def gyrostat(x):
    """The nutation rate, and the moment of a rotor."""
    moment = a.wheels.rotor_moment(x[4:7], x[7:10], x[10], x[11], x[12])
    return a.wheels.gyrostat_nutation_rate(*x[:4])[None], moment


def attack(x):
    """The tilt of an axis as complex numbers, and its angle with a velocity."""
    attitude = Quaternion.from_rotation_vector(x[:3])
    inertial, body = (r.tilt.complex_tilt(attitude, axes) for axes in ("inertial", "body"))
    return (
        inertial,
        body,
        k.angle_of_attack.angle_of_attack(attitude, x[3:6])[None],
    )


def turning_by_gravity(x):
    """Time and state at an angle: angle, thrust ratio, g, speed, first angle."""
    time, y = k.gravity_turn.gravity_turn(*x)
    return tuple(f[None] for f in (time, y.speed, y.range, y.height))


def variable_mass(x):
    """Speed and distance of a body that sweeps mass up, and the thrust of a jet engine."""
    engine = k.variable_mass.jet_engine_thrust(*x[6:12])
    return *(f[None] for f in k.variable_mass.swept_motion(*x[:6])), engine[None]


def sprinkling(x):
    """Moment and speed of a sprinkler: flow, arm, jet speed, bend, friction, rate."""
    flow, arm, jet, bend, friction, rate = x
    moment = k.sprinkler.sprinkler_moment(flow, arm, rate, jet, bend)
    return moment[None], k.sprinkler.sprinkler_speed(flow, arm, jet, bend, friction)[None]


def burning_and_spinning(x):
    """Mass, spin, angle and damping of a rocket that burns: six parameters and the time."""
    rocket, t = k.SpinningRocket(*x[:5]), x[5]
    found = rocket.mass_ratio(t), rocket.spin_rate(t), rocket.spin_angle(t), rocket.damping(t)
    return *(f[None] for f in found), rocket.transverse_rate(t, x[6:8])


def compass_at_rest(x):
    """Frequencies, errors and damping of a gyrocompass."""
    compass = g.Gyrocompass(*x[:6], speed=x[6], course=x[7])
    rest = compass.rest_tilt, compass.rest_azimuth, compass.heading_error
    slow = compass.slow_frequency, compass.damping_ratio, compass.clamped_frequency
    return tuple(jnp.atleast_1d(f) for f in (*rest, *slow, *compass.frequencies))


def rate_gyro(x):
    """Integrated angle, steady angle and overshoot of a rate gyro."""
    gyro = g.RateGyro(*x[:5])
    return tuple(f[None] for f in (gyro.integrated_angle(x[5]), gyro.steady_angle, gyro.overshoot))


def of_navigation(x):
    """Schuler's frequency, coupled rates and those of a table."""
    gravity, radius, rate, latitude, north, east, earth = x
    schuler = g.gyropendulum.schuler_frequency(gravity, radius)
    coupled = g.navigation_errors.coupled_rates(schuler, rate)
    table = g.navigation_errors.table_rates(latitude, north, east, radius, earth)
    period = g.gyropendulum.schuler_period(gravity, radius)
    return schuler[None], period[None], *(jnp.atleast_1d(f) for f in (*coupled, *table))


def resolved(x):
    """Signals on the gimbals of a platform, and the margin of lock."""
    found = *g.platform.resolve_signals(x[:3], x[3], x[4]), g.platform.gimbal_lock_margin(x[4])
    return tuple(jnp.atleast_1d(f) for f in found)


def _names(package, *names):
    return tuple(f"{package}.{name}" for name in names)


MISSILE = (10.0, 0.01, 2.0, 0.5, 0.3, 3.0, 0.1, 0.2)

FORMS = (
    Form(
        principal_spins,
        _names("attitude", "spin_stiffness", "spin_modes", "cone_bounds"),
        [
            (3.0, 2.0, 1.0, 0.5, 0.1, 0.2, 0.3),
            (2.0, 2.0, 1.0, 1.0, 1.0, 0.0, 1e-9),
            (3.0, 2.0000001, 2.0, 1.0, 1e-9, 1.0, 0.0),
            (1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0),
        ],
    ),
    Form(
        librations,
        _names("attitude", "inertia_ratios", "libration_modes", "LibrationModes", "forced_pitch"),
        [
            (2.0, 3.0, 1.5, 1e-3, 0.1, 1.0),
            (2.0, 3.0, 2.0, 1.0, 0.0, 0.0),
            (3.0, 2.0, 1.0, 1.0, 0.1, 1.0),
            (2.0, 2.0, 1.0, 1.0, 0.01, 3.0),
        ],
    ),
    Form(
        drift_of_energy,
        _names("attitude", "drift_energy", "drift_by_dissipation"),
        [(0.3, 2.0, 1.0, 3.0, 0.01), (1e-9, 2.0, 1.0, 3.0, 0.01), (1.57, 1.0, 1.0000001, 1.0, 0.0)],
    ),
    Form(
        drifting,
        _names(
            "attitude",
            "AttitudeDrift.rate",
            "AttitudeDrift.drift_time",
            "AttitudeDrift.angle_after",
        ),
        [
            (1e-3, 0.0, 0.0, 0.3, 0.6, 10.0),
            (1e-3, 0.3, 0.01, 0.3, 0.6, 10.0),
            (1e-3, 0.0, 0.0, 1e-6, 1.57, 0.0),
        ],
    ),
    Form(
        drift_constants,
        _names("attitude", "tube_drift_constant", "antenna_drift_constant", "structural_damping"),
        [(0.1, 2.0, 3.0, 4.0, 0.5, 0.6, 0.7, 0.8, 1.5, 1.2)],
    ),
    Form(
        released,
        _names("attitude", "radial_release_spin", "zero_spin_radial_cord"),
        [(10.0, 1.0, 5.0, 0.5, 0.1), (10.0, 0.0, 5.0, 0.5, 0.1), (10.0, 1.0, 5.0, 0.5, 1e-12)],
    ),
    Form(
        precessing_earth,
        _names("attitude", "luni_solar_rate", "luni_solar_rates_at", "luni_solar_nutation"),
        [
            (1.0, 1.0, 3.15e7, 3.27e-3, 0.409, 7.29e-5),
            (0.0, 0.012, 2.36e6, 3.27e-3, 1.5707963, 7.29e-5),
        ],
    ),
    Form(
        top_relatives,
        _names("attitude", "sprung_flywheel_frequencies", "crusher_force", "crusher_spin"),
        [(0.3, 2.0, 10.0, 0.5, 1.5, 2.0, 1.0), (1e-9, 2.0, 10.0, 0.5, 1.5, 1.0, 1.0)],
    ),
    Form(
        on_a_shaft,
        _names(
            "attitude",
            "ShaftPendulum.critical_rate",
            "ShaftPendulum.equilibrium",
            "ShaftPendulum.frequency",
        ),
        [(2.0, 1.0, 3.0, 2.0, 0.5), (2.0, 1.0, 3.0, 1.0, 0.0), (2.0, 1.0, 3.0, 1.7320509, 1e-6)],
    ),
    Form(
        gyrostat,
        _names("attitude", "gyrostat_nutation_rate", "rotor_moment"),
        [
            (1.0, 2.0, 1.5, 0.3, 0.1, 0.2, 0.3, 0.0, 0.6, 0.8, 0.1, 100.0, 1.0),
            (1.0, 2.0, 2.0, 0.0, 0.1, 0.2, 0.3, 0.0, 0.0, 1.0, 0.1, 0.0, 0.0),
        ],
    ),
    Form(
        attack,
        ("rockets.angle_of_attack", "rotations.complex_tilt", "rotations.tilt_of_axis"),
        [
            (0.1, 0.2, 0.3, 1.0, 2.0, 3.0),
            (0.0, 0.0, 0.3, 0.0, 0.0, 1.0),
            (1e-9, 0.0, 0.0, 0.0, 0.0, 1.0),
            (0.0, 3.1415926, 0.0, 0.0, 0.0, 1.0),
        ],
    ),
    Form(
        turning_by_gravity,
        ("rockets.gravity_turn",),
        [
            (0.6, 1.5, 9.81, 100.0, 0.2),
            (0.6, 1.0, 9.81, 100.0, 0.2),
            (0.6, 0.5, 9.81, 100.0, 0.2),
            (0.6, 1.0000001, 9.81, 100.0, 0.2),
            (0.2, 2.0, 9.81, 100.0, 0.2),
            (0.6, 2.0, 9.81, 1.0, 1e-6),
        ],
    ),
    Form(
        variable_mass,
        _names("rockets", "swept_motion", "jet_engine_thrust"),
        [
            (1.0, 10.0, 0.5, 3.0, 0.1, 2.0, 50.0, 1.0, 600.0, 200.0, 1e4, 0.3),
            (1.0, 10.0, 1e-12, 3.0, 0.0, 0.0, 50.0, 0.0, 200.0, 200.0, 0.0, 0.0),
            (0.0, 10.0, -0.5, 3.0, 0.1, 2.0, 50.0, 1.0, 600.0, 0.0, 0.0, 0.0),
        ],
    ),
    Form(
        sprinkling,
        _names("rockets", "sprinkler_moment", "sprinkler_speed"),
        [(1.0, 0.3, 5.0, 0.7, 0.1, 2.0), (1.0, 0.3, 5.0, 0.0, 0.0, 0.0)],
    ),
    Form(
        burning_and_spinning,
        _names(
            "rockets",
            "SpinningRocket.mass_ratio",
            "SpinningRocket.spin_rate",
            "SpinningRocket.spin_angle",
            "SpinningRocket.damping",
            "SpinningRocket.transverse_rate",
        ),
        [
            MISSILE,
            (10.0, 0.0, 2.0, 0.5, 0.3, 3.0, 0.1, 0.2),
            (10.0, 0.3, 2.0, 0.0, 0.0, 3.0, 0.1, 0.2),
            (10.0, 0.1, 1.0, 1.0, 1.0, 9.99, 0.1, 0.2),
        ],
    ),
    Form(
        compass_at_rest,
        _names(
            "gyros",
            "Gyrocompass.rest_tilt",
            "Gyrocompass.rest_azimuth",
            "Gyrocompass.heading_error",
            "Gyrocompass.slow_frequency",
            "Gyrocompass.damping_ratio",
            "Gyrocompass.frequencies",
            "Gyrocompass.clamped_frequency",
        ),
        [
            (10.0, 0.01, 0.01, 2.0, 0.7, 0.0, 10.0, 0.5),
            (10.0, 0.01, 0.01, 2.0, 0.0, 0.1, 0.0, 0.0),
            (10.0, 0.01, 0.01, 2.0, 1.5, 0.1, 10.0, 3.0),
        ],
    ),
    Form(
        rate_gyro,
        _names("gyros", "RateGyro.integrated_angle", "RateGyro.steady_angle", "RateGyro.overshoot"),
        [
            (1e-4, 1e-2, 0.1, 1.0, 0.5, 0.1),
            (1.0, 2.0, 1.0, 1.0, 1.0, 1.0),
            (1.0, 2.0000001, 1.0, 1.0, 1.0, 1.0),
            (1.0, 1e-9, 1.0, 1.0, 1.0, 10.0),
            (1.0, 5.0, 1.0, 1.0, 1.0, 1e-9),
        ],
    ),
    Form(
        of_navigation,
        _names("gyros", "schuler_frequency", "schuler_period", "coupled_rates", "table_rates"),
        [
            (9.81, 6.378e6, 7.29e-5, 0.7, 100.0, 200.0, 7.29e-5),
            (9.81, 6.378e6, 0.0, 0.0, 0.0, 0.0, 7.29e-5),
            (9.81, 6.378e6, 1.24e-3, 1.5, 0.0, 0.0, 7.29e-5),
        ],
    ),
    Form(
        resolved,
        _names("gyros", "resolve_signals", "gimbal_lock_margin"),
        [(1.0, 2.0, 3.0, 0.3, 0.4), (1.0, 2.0, 3.0, 0.0, 1.5707963)],
    ),
)

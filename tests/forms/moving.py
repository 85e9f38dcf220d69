"""Closed forms of attitude beside those of `attitude.py`: disks, cords, arms, missiles, parts."""

import jax.numpy as jnp

from jaxspace import attitude as a
from jaxspace.bodies import (
    BodyState,
    ExponentialAtmosphere,
    InertiaTensor,
    PadAtmosphere,
    PrincipalInertia,
    RigidBody,
    StandardAtmosphere,
)
from jaxspace.bodies.mass_properties import inertia_ellipsoid
from jaxspace.rotations import Quaternion
from jaxspace.rotations.direction_cosines import (
    cosine_conditions,
    cosine_rates,
    omega_from_cosine_rates,
)
from jaxspace.rotations.mean import mean_attitude

from .form import Form
from .mechanics import numbers


def disk(x):
    """Energy, contact and forces of a rolling disk from 5 numbers, angles and rates."""
    one = a.RollingDisk(*x[:5])
    y = one.state(x[5:8], x[8:11])
    places = one.velocity(y), one.contact(y), one.contact_force(y)
    return *numbers(one.energy(y), a.disk_tilt.disk_tilt(y.attitude)), *places


def steady_disk(x):
    """Steady circles of a disk: 5 numbers, tilt, precession and spin."""
    one = a.RollingDisk(*x[:5])
    steady = *one.steady_precession_rates(x[5], x[7]), one.steady_spin(x[5], x[6])
    bounds = one.least_rolling_spin, one.least_standing_spin
    small = one.tilt_acceleration(*x[5:8]), one.tilt_stiffness(*x[5:8])
    return numbers(*steady, *bounds, *small)


def settling(x):
    """Growth and settling of a uniform disk and a hoop: mass, radius, gravity, tilt, rates and
    friction."""
    one, hoop = a.RollingDisk.uniform(*x[:3]), a.RollingDisk.hoop(*x[:3])
    A, C, *_ = one._letters()
    rough = a.RollingDisk(x[0], x[1], A, C, x[2], contour_friction=x[6])
    wet = a.RollingDisk(x[0], x[1], A, C, x[2], contour_damping=x[6])
    times = rough.settling_time(x[3]), wet.settling_time(x[3])
    return numbers(*times, hoop.least_rolling_spin, one.growth_rate(*x[3:6]))


def cords(x):
    """Tensions: I, R, m, stiffness, spin and angle; cord and rate of those that swing."""
    firm, soft = a.unwinding.UnwindingCords(*x[:3]), a.unwinding.StretchingCords(*x[:4])
    y = soft.state(x[4], x[5])
    swung = a.swinging.SwingingCords(*x[:3], x[6])
    at = a.swinging.SwingingCords.state(x[4], x[7])
    start = a.unwinding.UnwindingCords.state(x[4])
    pulls = firm.tension(y), soft.tension(y), swung.tension(at), firm.inertia_ratio
    return numbers(*pulls, start.angle_rate, y.stretch_rate)


def arms(x):
    """Moment, spin, rates, acceleration and time of arms: 4 numbers, angle and first spin."""
    one = a.swinging.SwingOutArms(*x[:4])
    y = a.swinging.SwingState(one.spin_rate(x[4], x[5]), x[4], one.angle_rate(x[4], x[5]))
    found = one.moment(x[4]), y.spin, y.angle_rate, one.swing_time(x[4], x[5])
    return numbers(*found, one.outward_acceleration(y), a.swinging.SwingOutArms.state(x[5]).spin)


def spinning_missile(x):
    """Rates and angle of a spinning missile: A, C, n, time, angle, rate, moment and tilt."""
    one = a.SpinningMissile(*x[:3])
    rate = one.transverse_rate(x[3], x[6:8], x[8:10])
    turned = one.complex_tilt(x[3], x[4:6], x[6:8], x[8:10], tilt=x[10:12])
    centre, slow, fast = one.circles(x[8:10])
    figures = one.nutation_rate, one.precession_rate, slow, fast
    return rate, turned, centre, *numbers(*figures)


def gyros(x):
    """Axes and torques of control moment gyros at two angles; torques on wheels and their parts."""
    one = a.ControlMomentGyros(
        [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
        x[2:4], x[:2], 0.0 * x[:2],
    )  # fmt: skip
    axes = jnp.array([[1.0, 0.0, 0.6], [0.0, 1.0, 0.6], [0.0, 0.2, 0.5]], x.dtype)
    control = a.motors.PointingControl([0.6, -0.3, 0.7, 0.2], x[4], x[5])
    y = BodyState(attitude=Quaternion(x[6:10]), omega=x[10:13])
    constant = a.motors.ConstantTorque([0.1, 0.2, 0.3]).torque(0.0, y, axes, x[10:13])
    torques = (
        control.torque(0.0, y, axes, x[10:13]),
        a.motors.wheel_torques(axes, x[10:13]),
        constant,
    )
    return one.wheel_axes(x[:2]).reshape(-1), one.torque_matrix(x[:2]).reshape(-1), *torques


def limited_wheels(x):
    """Limited torques and speeds of wheels: speeds, attitude, rate and torque limit."""
    control = a.motors.PointingControl([0.6, -0.3, 0.7, 0.2], 2.0, 30.0)
    axes = jnp.eye(3, dtype=x.dtype)
    one = a.ReactionWheels(
        axes, [0.4, 0.5, 0.3], x[:3], torque_limit=x[10], speed_limit=49.0, motor=control
    )
    y = BodyState(attitude=Quaternion(x[3:7]), omega=x[7:10])
    body = RigidBody(200.0, [40.0, 50.0, 60.0])
    y = y.__class__(attitude=y.attitude, omega=y.omega, parts=one.start(y, body))
    return one.limited(0.0, y, axes, x[:3]), one.speeds(y)


def damper(x):
    """Energy and motion of a nutation damper: mass, stiffness, damping, place, momentum, omega."""
    one = a.NutationDamper(x[0], [0.8, 0.2, -0.1], [0.1, 0.2, 1.0], x[1], x[2])
    body = RigidBody(200.0, [40.0, 50.0, 60.0])
    part = {one.part: {"displacement": x[3], "momentum": x[4]}}
    y = BodyState(attitude=Quaternion.identity(), omega=x[5:8], parts=part)
    moving = one.motion(y, body)
    rates = moving.displacement, moving.rate, moving.momentum_rate
    return numbers(one.energy(y, body), one.reduced_mass(200.0 + 0.0 * x[0]), *rates)


def particles(x):
    """Moment and force of two moving particles: masses, places, velocities, rates, origin."""
    found = a.moving_masses.particle_equations(
        x[:2], x[2:8].reshape(3, 2), x[8:14].reshape(3, 2), x[2:8].reshape(3, 2), -0.1 * x[:2],
        x[8:14].reshape(3, 2), x[14:17], x[17:20], x[20:23],
    )  # fmt: skip
    masses = a.MovingMasses(lambda t: x[2:8].reshape(3, 2) + t * x[8:14].reshape(3, 2), x[:2])
    inertia, momentum = masses.moments(jnp.asarray(0.3), 200.0, 0)
    return found.moment, found.force, inertia.reshape(-1), momentum


def forced(x):
    """Torque, bearings and bank: moments, omega, its rate, mass, centre, speed, radius, gravity."""
    inertia = PrincipalInertia(x[:3])
    torque = a.forced_rotation.required_torque(inertia, x[3:6], x[6:9])
    shaft = jnp.array([0.1, 0.2, 1.0], x.dtype)
    held = a.forced_rotation.bearing_reactions(
        inertia, x[9], x[10:13], shaft, (-0.5, 0.7), x[5], x[8]
    )
    across = torque, jnp.concatenate([held.first, held.second])
    return *across, *numbers(
        held.drive,
        a.forced_rotation.bank_angle(*x[13:16]),
        a.torque_free.space_cone_angle(x[3:6], *x[:2]),
    )


def planes(x):
    """Invariable plane, tilt and Jacobi's integral: six elements, attitude, omega, place."""
    A, B, C, d, e, f = x[:6]
    inertia = InertiaTensor(jnp.stack([A, d, e, d, B, f, e, f, C]).reshape(3, 3))
    y = BodyState(
        attitude=Quaternion(x[6:10]), omega=x[10:13], position=x[13:16], velocity=x[16:19]
    )
    plane = a.principal_spins.invariable_plane(inertia, y)
    found = plane.normal, plane.herpolhode, a.spinning_missile.principal_tilt(inertia)
    return *found, *numbers(plane.distance, a.libration.jacobi_integral(y, inertia, x[19]))


def pitching(x):
    """Pitch on a circle: time, amplitude, three moments and the mean motion."""
    return numbers(a.pitch_libration.pitch_libration(x[0], x[1], x[2:5], x[5]))


def relatives(x):
    """Crusher, gyro on a string, shaft pendulum and energy sink."""
    shaft = a.ShaftPendulum(x[0], x[1], x[2], 0.0)
    string = a.top_relatives.gyro_on_a_string(x[3], x[4], x[5], x[0], x[1], x[6], x[7], x[8])
    sink = a.energy_sink.energy_sink_angle(x[3], x[9], x[0], x[1], x[10])
    crusher = a.top_relatives.best_crusher_tilt(x[4], x[2], x[6], x[7], x[0], x[1])
    return numbers(shaft.plane_period(x[3]), *string, sink, crusher)


def turning_circles(x):
    """Rates of a top at its turning circles, from N, alpha, beta and gamma."""
    return numbers(*a.nutation.Nutation.of(*x).circle_rates)


def cosines(x):
    """Conditions, rates and their inverse of nine cosines, from a quaternion and a rate; ellipsoid
    of inertia; a mean of two attitudes."""
    C = Quaternion(x[:4]).matrix()
    rate = cosine_rates(C, x[4:7])
    axes, _ = inertia_ellipsoid(PrincipalInertia(x[7:10]))
    mean = mean_attitude(Quaternion(jnp.stack([x[:4], x[10:14]], axis=1))).wxyz
    both = (mean[:, None] * mean[None]).reshape(-1), Quaternion(x[:4]).projected().wxyz
    # What is zero of cosines has their size.
    kept = jnp.concatenate([cosine_conditions(C), C.reshape(-1)])
    return kept, rate.reshape(-1), omega_from_cosine_rates(C, rate), axes, *both


def airs(x):
    """Pressure, density and temperature of both atmospheres at a height, from 3 numbers."""
    one, standard = ExponentialAtmosphere(*x[:3]), StandardAtmosphere.named("us_1976")
    state, found = one.air_at(x[3]), standard.air_at(x[3])
    numbers_ = state.density, one.density_at(x[3]), found.density, found.pressure, found.sound_speed
    return numbers(*numbers_)


def airs_of_a_pad(x):
    """Pressure, density and temperature over a pad, from 3 numbers."""
    pad = PadAtmosphere(*x[:3])
    found = pad.air_at(x[3])
    return numbers(pad.density_at(x[3]), found.pressure, found.temperature, found.sound_speed)


ROLLER = (1.0, 0.3, 0.0225, 0.045, 9.8)
GENERAL = (0.6, -0.3, 0.7, 0.2)
ONES = (1.0, 0.0, 0.0, 0.0)


def of(kind, *methods):
    """ "attitude.kind.method" for each."""
    return tuple(f"attitude.{kind}.{method}" for method in methods)


def free(*functions):
    return tuple(f"attitude.{name}" for name in functions)


FORMS = (
    Form(
        disk,
        (
            *of("RollingDisk", "energy", "velocity", "contact", "contact_force", "state"),
            *free("disk_tilt"),
        ),
        [
            (*ROLLER, 0.1, 1.3, 0.2, 0.5, 0.2, -11.0),
            (*ROLLER, 0.0, 1.5707963, 0.0, 0.0, 0.0, -11.0),
            (*ROLLER, 0.1, 0.01, 0.2, 0.5, 0.0, 1.0),
        ],
    ),
    Form(
        steady_disk,
        of(
            "RollingDisk",
            "steady_precession_rates",
            "steady_spin",
            "least_rolling_spin",
            "least_standing_spin",
            "tilt_acceleration",
            "tilt_stiffness",
        ),
        [(*ROLLER, 1.3, 0.5, 11.0), (*ROLLER, 1.5707, 0.5, 11.0), (*ROLLER, 0.01, 0.5, -1.0)],
    ),
    Form(
        settling,
        of("RollingDisk", "settling_time", "growth_rate", "uniform", "hoop"),
        [(1.0, 0.3, 9.8, 1.5, 0.1, 0.5, 0.01), (1.0, 0.3, 9.8, 1e-3, 0.1, 0.5, 0.01)],
    ),
    Form(
        cords,
        (
            *of("UnwindingCords", "tension", "inertia_ratio", "state"),
            *of("StretchingCords", "tension", "state"),
            *of("SwingingCords", "tension", "state"),
        ),
        [
            (0.264, 0.127, 0.01134, 40.0, 41.0, 1.5, 0.9, 40.0),
            (0.264, 0.127, 0.01134, 40.0, 41.0, 1e-3, 0.9, 0.0),
        ],
    ),
    Form(
        arms,
        of(
            "SwingOutArms",
            "moment",
            "spin_rate",
            "angle_rate",
            "swing_time",
            "outward_acceleration",
            "state",
        ),
        [(2.0, 0.2, 0.5, 0.8, 1.2, 10.0), (2.0, 0.2, 0.5, 0.8, 1e-8, 10.0)],
    ),
    Form(
        spinning_missile,
        of(
            "SpinningMissile",
            "transverse_rate",
            "complex_tilt",
            "circles",
            "nutation_rate",
            "precession_rate",
        ),
        [
            (10.0, 1.0, 30.0, 2.0, 0.01, 0.02, 0.1, -0.1, 3.0, 1.0, 1e-3, 2e-3),
            (10.0, 1.0, 30.0, 0.0, 0.01, 0.02, 0.1, -0.1, 3.0, 1.0, 1e-3, 2e-3),
            (10.0, 9.9999, 30.0, 2.0, 0.01, 0.02, 0.1, -0.1, 3.0, 1.0, 1e-3, 2e-3),
        ],
    ),
    Form(
        gyros,
        (
            *of("ControlMomentGyros", "wheel_axes", "torque_matrix"),
            *of("PointingControl", "torque"),
            *of("ConstantTorque", "torque"),
            *free("wheel_torques"),
        ),
        [
            (0.3, -0.4, 3.0, 2.0, 2.0, 30.0, *GENERAL, 0.2, -0.1, 0.5),
            (0.0, 0.0, 3.0, 2.0, 2.0, 30.0, *ONES, 0.0, 0.0, 0.5),
        ],
    ),
    Form(
        limited_wheels,
        of("ReactionWheels", "limited", "speeds"),
        [
            (20.0, -30.0, 48.0, *GENERAL, 0.2, -0.1, 0.5, 0.5),
            (20.0, -30.0, 49.0, *ONES, 0.0, 0.0, 0.0, 0.5),
        ],
    ),
    Form(
        damper,
        of("NutationDamper", "energy", "motion", "reduced_mass"),
        [(4.0, 24.5, 2.0, 0.02, -0.05, 0.2, -0.1, 0.5), (4.0, 24.5, 2.0, 0.0, 0.0, 0.0, 0.0, 0.5)],
    ),
    Form(
        particles,
        (*free("particle_equations"), *of("MovingMasses", "moments")),
        [tuple(0.1 * (k % 7) - 0.2 + (1.0 if k < 2 else 0.0) for k in range(23))],
    ),
    Form(
        forced,
        free("required_torque", "bearing_reactions", "bank_angle", "space_cone_angle"),
        [
            (
                3.0,
                2.0,
                1.0,
                0.3,
                -0.4,
                5.0,
                0.1,
                0.0,
                -0.2,
                4.0,
                0.01,
                -0.02,
                0.1,
                100.0,
                500.0,
                9.8,
            ),
            (2.0, 2.0, 1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 500.0, 9.8),
        ],
    ),
    Form(
        planes,
        free("invariable_plane", "principal_tilt", "jacobi_integral"),
        [
            (
                3.0,
                2.0,
                1.5,
                0.1,
                -0.02,
                0.015,
                *GENERAL,
                0.1,
                0.2,
                1.0,
                7e6,
                1e5,
                0.0,
                -1e2,
                7.5e3,
                0.0,
                3.986e14,
            ),
            (
                3.0,
                2.0,
                1.5,
                0.0,
                0.0,
                1e-9,
                *ONES,
                0.0,
                0.0,
                1.0,
                7e6,
                0.0,
                0.0,
                0.0,
                7.5e3,
                0.0,
                3.986e14,
            ),
        ],
    ),
    Form(
        pitching,
        free("pitch_libration"),
        [
            (3e3, 0.7, 9.0, 6.0, 5.0, 1.1e-3),
            (3e3, 0.0, 9.0, 6.0, 5.0, 1.1e-3),
            (3e3, 1.57, 9.0, 6.0, 5.0, 1.1e-3),
            (0.0, 0.7, 9.0, 6.0, 5.0, 1.1e-3),
            (3e3, 0.7, 5.0, 6.0, 5.0, 1.1e-3),
        ],
    ),
    Form(
        relatives,
        (
            *of("ShaftPendulum", "plane_period"),
            *free("gyro_on_a_string", "energy_sink_angle", "best_crusher_tilt"),
        ),
        [
            (0.1, 0.02, 2.94, 0.7, 5.0, 1.0, 0.5, 0.3, 9.8, 100.0, 1e-3),
            (0.1, 0.02, 2.94, 1e-6, 5.0, 1.0, 0.5, 0.3, 9.8, 0.0, 0.0),
        ],
    ),
    Form(
        turning_circles,
        of("Nutation", "circle_rates"),
        [(4.0, 1.5, 2.0, 3.0), (0.0, 0.5, 2.0, 0.1), (1.0, 1.0, -2.0, 0.3)],
    ),
    Form(
        cosines,
        (
            "rotations.cosine_conditions",
            "rotations.cosine_rates",
            "rotations.omega_from_cosine_rates",
            "bodies.inertia_ellipsoid",
            "rotations.mean_attitude",
            "rotations.Quaternion.projected",
        ),
        [(*GENERAL, 0.1, 0.2, -0.3, 3.0, 2.0, 1.5, 0.5, -0.4, 0.7, 0.1)],
    ),
    Form(
        airs_of_a_pad,
        ("bodies.PadAtmosphere.air_at", "bodies.PadAtmosphere.density_at"),
        [
            (1400.0, 308.0, 86e3, 1400.0),
            (0.0, 216.65, 101e3, 4e3),
            (0.0, 216.7, 101e3, 0.0),
            (100.0, 250.0, 102e3, 2e4),
        ],
    ),
    Form(
        airs,
        (
            "bodies.ExponentialAtmosphere.air_at",
            "bodies.ExponentialAtmosphere.density_at",
            "bodies.StandardAtmosphere.air_at",
            "bodies.StandardAtmosphere.named",
        ),
        [
            (1.2, 0.0, 7000.0, 5e3),
            (1.2, 0.0, 7000.0, 0.0),
            (1.2, 0.0, 7000.0, 1.5e4),
            (1.2, 0.0, 7000.0, 7e4),
        ],
    ),
)

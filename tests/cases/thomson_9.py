"""Thomson, chapters 6 and 9: gyroscopic instruments, pendulums, spin axes that are turned."""

import jax
import jax.numpy as jnp

from jaxspace import simulate
from jaxspace.attitude import SphericalPendulum, Top
from jaxspace.attitude.torque_free import symmetric_flow
from jaxspace.bodies import BodyState
from jaxspace.core.vectors import cross
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.rotations.euler_angles import euler_rates_from_omega, omega_from_euler_rates
from jaxspace.scene import Custom, Scene

from .case import DEG, LINEAR, MILE, STEPS, Case, rates, vec
from .motions import ACCURACY, fly, near_ground

X, Y, Z = vec(1, 0, 0), vec(0, 1, 0), vec(0, 0, 1)
G_FEET, G_SI = 32.2, 9.80665


def platform_signals(phi_y, phi_z, sigma):
    """Signals along roll, pitch and yaw; the gimbals lie in the order roll, yaw, pitch."""
    roll, yaw, pitch = euler_rates_from_omega(vec(0.0, -phi_z, -phi_y), vec(*sigma), "132")
    return (jnp.stack([roll, pitch, yaw]),)


def drift_after_orbit(dz, r, g):
    """Errors along the track and upwards after one orbit, from an error of the height."""
    rate = jnp.sqrt(g / r)
    start = (r * Z, rate * r * Y)
    # At rest in the axes that turn with the orbit, y forward and z up.
    error = (dz * Z, rate * dz * Y)
    period = 2.0 * jnp.pi / rate
    _, (moved, _) = jax.jvp(lambda p, v: kepler_flow(p, v, period, g * r**2), start, error)
    return moved[1], moved[2]


def spherical_pendulum(l, theta0, phi_rate, period, t):
    """Constants, turning angle, return after a period, and the state at t."""
    pendulum = SphericalPendulum(l, G_SI)
    y0 = pendulum.state(theta0, 0.0, 0.0, phi_rate)
    ts = vec(0.0, 0.5 * period, period, t)
    run = simulate(pendulum, y0, ts, accuracy=ACCURACY)
    u, v = run.states.direction, run.states.direction_rate
    across = jnp.hypot(u[0], u[1])
    theta = jnp.arctan2(across, -u[2])
    phi = jnp.arctan2(u[1], u[0]) % (2.0 * jnp.pi)
    out = jnp.stack([u[0] / across, u[1] / across])
    theta_rate = (out[0] * v[0] + out[1] * v[1]) * -u[2] + across * v[2]
    phi_rates = (u[0] * v[1] - u[1] * v[0]) / across**2
    energy = pendulum.invariants(0.0, y0)["energy"] + G_SI * l
    return (
        *(energy, theta[1], theta[2], phi[2], theta[3]),
        *(phi[3], theta_rate[3], phi_rates[3]),
    )


def conical(l, theta):
    """Rate of the conical pendulum, and the frequency of a small nutation about it."""
    pendulum = SphericalPendulum(l, G_SI)
    rate = pendulum.conical_rate(theta)
    # The pendulum as a top without spin; its angle is that from the upward vertical.
    top = Top(l * l, 1.0, G_SI * l)
    return rate, top.nutation_frequency(jnp.pi - theta, rate, 0.0)


def reorientation(C, k, w0, theta):
    """Two impulses that turn the spin axis: the second one half a precession later."""
    A = C / k
    impulse = C * w0 * jnp.tan(0.5 * theta)
    time = jnp.pi * jnp.cos(0.5 * theta) / (k * w0)
    y0 = BodyState(attitude=Quaternion.identity(), omega=vec(impulse / A, 0.0, w0))
    end = symmetric_flow(time, y0, A, C)
    # The second impulse stops the transverse rate.
    azimuth = (jnp.arctan2(-end.omega[1], -end.omega[0])) % (2.0 * jnp.pi)
    axis = end.attitude.rotate(Z)
    tilt = jnp.arctan2(jnp.hypot(axis[0], axis[1]), axis[2])
    return impulse, time, azimuth, tilt / DEG, axis[1], A * jnp.hypot(*end.omega[:2])


def rolling_sphere(angles, first, a):
    """Angular velocity in fixed axes, and the velocity of the centre."""
    attitude = from_euler_angles(vec(*angles))
    omega = attitude.rotate(omega_from_euler_rates(vec(*angles), vec(*first)))
    return omega, cross(omega, a * Z)[:2]


def spherical_components(place, first, second):
    """Components of an acceleration along r, theta, phi, and the forces on a unit mass."""

    def axes(t):
        _, theta, phi = vec(*place) + t * vec(*first) + 0.5 * t**2 * vec(*second)
        return Quaternion.about(2, phi).then(Quaternion.about(1, theta))

    def path(t):
        r = place[0] + t * first[0] + 0.5 * t**2 * second[0]
        return axes(t).rotate(r * Z)

    theta, phi, r = axes(jnp.zeros(())).rotate_back(rates(path)[1])
    return r, theta, phi, place[0] * theta, place[0] * jnp.sin(place[1]) * phi


def foucault(l, Omega, latitude, t):
    """Axes x north, y west, z up."""
    spin = Omega * jnp.sin(latitude)
    # Four hundred swings: with a tighter tolerance the steps run out.
    r, _ = fly(near_ground(0.0, spin * Z, G_SI / l), X, (0, 0, 0), t, 1e-11)
    return r[1, 0], r[1, 1]


CASES = [
    Case(
        "T6.9",
        "Pickoff signals of a stable platform onto its gimbals",
        (euler_rates_from_omega,),
        {"phi_y": 20 * DEG, "phi_z": 35 * DEG, "sigma": (1.0, -0.5, 0.25)},
        platform_signals,
        {"roll, pitch, yaw": [1.0427704977479604, -1.0981085860302817, 0.5769432985221459]},
    ),
    Case(
        "T6.11-13",
        "Error of the accelerometers on a tilted table",
        (cross,),
        {"tilt": (0.001, -0.002, 0.0005), "A": (3.0, -1.0, 32.2)},
        lambda tilt, A: (cross(vec(*tilt), vec(*A)),),
        {"error (ft/s^2)": [-0.0639, -0.0307, 0.005]},
    ),
    Case(
        "T6.11-CW",
        "Errors of an inertial navigator at orbital speed: one orbit later",
        (kepler_flow,),
        {"dz": 10.0, "r": 3960.0 * MILE, "g": G_FEET},
        drift_after_orbit,
        {"dy (ft)": -376.9911184307752, "dz (ft)": 10.0},
        why=LINEAR,
    ),
    Case(
        "T6.11-P1",
        "Torque that makes a directional gyro drift",
        (Top.precession_moment,),
        {"h": 3.0, "drift": 0.01 * DEG / 3600.0},
        lambda h, drift: (Top(1.0, 1.0, 0.0).precession_moment(0.5 * jnp.pi, drift, h),),
        {"torque (lbf in)": 1.454441043328608e-07},
    ),
    Case(
        "T9.3-simple",
        "Period of a pendulum with an amplitude of 90 deg",
        (SphericalPendulum.plane_period,),
        {"l": 1.0, "amplitude": 90 * DEG},
        lambda l, amplitude: (SphericalPendulum(l, G_SI).plane_period(amplitude),),
        {"period (s)": 2.3682463462860097},
        1e-12,
    ),
    Case(
        "T9.6-P3",
        "Rolling sphere: angular velocity in fixed axes, velocity of the centre",
        (omega_from_euler_rates, from_euler_angles),
        {"angles": (0.9, 0.6, -0.4), "first": (-0.7, 0.3, 1.5), "a": 0.25},
        rolling_sphere,
        {
            "omega (rad/s)": [0.8499324560746268, -0.2914830120687911, 0.5380034223645176],
            "V (m/s)": [-0.07287075301719778, -0.2124831140186567],
        },
        1e-12,
    ),
    Case(
        "T9.8-Ex1-a",
        "Spherical pendulum: turning angle, period, advance, and the state after 3 s",
        (simulate, SphericalPendulum),
        {
            **{"l": 2.0, "theta0": 1.0471975511965976, "phi_rate": 1.2},
            **{"period": 1.5261068198111631, "t": 3.0},
        },
        spherical_pendulum,
        {
            "energy (J)": 11.966649999999998,
            "theta, half a period (rad)": 0.40634522727137606,
            "theta, a period (rad)": 1.0471975511965976,
            "phi, a period (rad)": 3.7240266021926427,
            "theta (rad)": 1.0422642916452298,
            # Less a whole turn.
            "phi (rad)": 7.38527720127279 - 2.0 * 3.141592653589793,
            "theta' (rad/s)": 0.18876537941502897,
            "phi' (rad/s)": 1.2068944686588734,
        },
        1e-10,
        why=STEPS,
    ),
    Case(
        "T9.8-Ex1-conical",
        "Conical pendulum at 40 deg, and its small nutation",
        (SphericalPendulum.conical_rate, Top.nutation_frequency),
        {"l": 2.0, "theta": 40 * DEG},
        conical,
        {"phi' (rad/s)": 2.529987390673162, "nutation (rad/s)": 4.203490312125661},
        1e-12,
    ),
    Case(
        "T9.10-P1",
        "Acceleration and forces in spherical coordinates",
        (Quaternion,),
        {"place": (2.0, 0.7, 1.1), "first": (0.3, -0.4, 0.5), "second": (0.1, 0.2, -0.3)},
        spherical_components,
        {
            "a_r (m/s^2)": -0.4275082142749398,
            "a_theta (m/s^2)": -0.08636243249711503,
            "a_phi (m/s^2)": -0.8051390559988981,
            "Q_theta (N m)": -0.17272486499423007,
            "Q_phi (N m)": -1.0373696411206959,
        },
        1e-12,
    ),
    Case(
        "T9.10-P3",
        "Foucault's pendulum after an hour at 45 deg",
        (simulate, Scene, Custom),
        {"l": 20.0, "Omega": 7.2921159e-05, "latitude": 45 * DEG, "t": 3600.0},
        foucault,
        {"x (m)": 0.2652323873147261, "y (m)": -0.04973553828009396},
        1e-7,
        why=STEPS,
    ),
    Case(
        "T9.10-P24-disk",
        "Spin axis turned by 20 deg in two impulses, C / A = 2",
        (symmetric_flow,),
        {"C": 1e5, "k": 2.0, "w0": 0.5, "theta": 20 * DEG},
        reorientation,
        {
            "impulse (N m s)": 8816.349035423249,
            "time (s)": 3.0938648020614243,
            "azimuth (rad)": 4.688525054620506,
            "turn (deg)": 20.0,
            "axis, Y": 0.0,
            "second impulse (N m s)": 8816.349035423249,
        },
        1e-12,
        1e-13,
    ),
    Case(
        "T9.10-P24-k1.5",
        "Spin axis turned by 20 deg in two impulses, C / A = 1.5",
        (symmetric_flow,),
        {"C": 1e5, "k": 1.5, "w0": 0.5, "theta": 20 * DEG},
        reorientation,
        {
            "impulse (N m s)": 8816.349035423249,
            "time (s)": 4.125153069415233,
            "azimuth (rad)": 4.1728809209436015,
            "turn (deg)": 20.0,
            "axis, Y": 0.0,
            "second impulse (N m s)": 8816.349035423249,
        },
        1e-12,
        1e-13,
    ),
]

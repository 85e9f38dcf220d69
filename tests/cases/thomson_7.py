"""Thomson, chapter 7, 7.1 to 7.4: spinning bodies, thrust misalignment, attitude about an orbit."""

import jax
import jax.numpy as jnp

from jaxspace import BodyState, Scene, simulate
from jaxspace.attitude import (
    SpinningMissile,
    TorqueFreeBody,
)
from jaxspace.attitude.gravity_gradient import pitch_libration_period
from jaxspace.attitude.libration import libration_modes
from jaxspace.attitude.torque_free import (
    body_precession_rate,
    coning_omega,
    precession_rate,
    symmetric_flow,
)
from jaxspace.bodies import InertiaTensor, Load, RigidBody
from jaxspace.bodies.newton_euler import angular_acceleration
from jaxspace.core.vectors import cross, norm
from jaxspace.rotations import Quaternion, from_euler_angles, to_euler_angles
from jaxspace.rotations.euler_angles import omega_from_euler_rates
from jaxspace.scene import Custom

from .case import CLOSED, DEG, LINEAR, STEPS, Case, vec
from .motions import ACCURACY, angle_of_attack, turn

X, Y, Z = vec(1, 0, 0), vec(0, 1, 0), vec(0, 0, 1)
PI2 = 6.283185307179586
free = jax.jit(lambda inertia, t, y: TorqueFreeBody(inertia).closed_form().flow(t, y))


def tensor(A, B, C, D, E, F):
    """The inertia tensor from moments A, B, C and products D, E, F."""
    return InertiaTensor(jnp.array([[A, -D, -E], [-D, B, -F], [-E, -F, C]]))


def moment_of(inertia, omega, rate):
    """The moment for a given angular velocity and its rate; and the rate for that moment."""
    moment = inertia.times(rate) + cross(omega, inertia.times(omega))
    return moment, angular_acceleration(inertia, omega, moment)


def body_axes_velocity(m, spin, force, velocity, t):
    """Velocity in body axes under a body-fixed force."""
    push = Custom(lambda t, y, b: Load(force_N=y.attitude.rotate(vec(*force))))
    scene = Scene((push,), RigidBody(m, [1.0, 1.0, 1.0]))
    y0 = BodyState(vec(0, 0, 0), vec(*velocity), Quaternion.identity(), spin * Z)
    end = simulate(scene, y0, t * vec(0, 0.5, 1), accuracy=ACCURACY).final
    return (end.attitude.rotate_back(end.velocity),)


def final(inertia, omega, t, **moments):
    """The state at t of a body with a `Moment`."""
    return turn(inertia, omega, t * vec(0.0, 0.5, 1.0), **moments).final


def half_sine(A, C, n, peak, pulse):
    end = final([A, A, C], (0, 0, n), pulse, pulse=(peak, 0, 0), frequency=jnp.pi / pulse)
    return (end.omega[:2],)


def damped(A, C, k, start, n, t):
    """Angular velocity, and the angle between the axis and the angular momentum."""
    omega = final([A, A, C], (start, 0, n), t, damping=k).omega
    return omega, jnp.arctan2(A * jnp.hypot(omega[0], omega[1]), C * omega[2])


def large_nutation(A, C, n, rotation, start, t):
    """theta e^(i psi) of a free body, and the error of the linear formula 7.3-7."""
    y0 = BodyState(attitude=Quaternion.from_rotation_vector(rotation * X), omega=vec(start, 0.0, n))
    found = jnp.stack(angle_of_attack(free(jnp.diag(vec(A, A, C)), t, y0).attitude))
    one = jnp.ones(())

    def small(s):
        return small_nutation(A, C, n, s * rotation, s * start, t)

    linear = jnp.stack(jax.jvp(small, (0.0 * one,), (one,))[1])
    return found, jnp.hypot(*(found - linear))


def small_nutation(A, C, n, rotation, start, t):
    y0 = BodyState(
        attitude=Quaternion.from_rotation_vector(rotation * X),
        omega=start * X + n * Z,
    )
    return direction(symmetric_flow(t, y0, A, C).attitude)


def direction(attitude):
    """-s_y + i s_x of the axis s: theta e^(i psi) to first order, smooth at the vertical."""
    s = attitude.rotate(Z)
    return -s[1], s[0]


def euler_rates(angles, rates):
    """omega_12 and n; rate of the node axes; theta_12' + i n theta_12 (7.3-2, -10, -8)."""
    psi, theta, phi = angles
    psi1, theta1, phi1 = rates
    omega = omega_from_euler_rates(vec(*angles), vec(*rates))
    node = omega_from_euler_rates(vec(psi, theta, 0.0), vec(psi1, theta1, 0.0))

    def theta_12(t):
        turn = phi + phi1 * t
        return (theta + theta1 * t) * jnp.stack([jnp.cos(turn), -jnp.sin(turn)])

    start, rate = jax.jvp(theta_12, (jnp.zeros(()),), (jnp.ones(()),))
    return omega, node[:2], rate + omega[2] * jnp.stack([-start[1], start[0]])


def misaligned(A, C, n, M1, t):
    """theta e^(i psi) under a body-fixed moment: in closed form, to first order, exact; and the
    circles of the axis."""
    missile, still = SpinningMissile(A, C, n), vec(0, 0)
    closed = missile.complex_tilt(t, still, still, vec(M1, 0))
    centre, slow, fast = missile.circles(vec(M1, 0))
    ts = t * vec(0.0, 0.5, 1.0)

    def tip(moment):
        run = turn([A, A, C], (0, 0, n), ts, steady=moment * X)
        return direction(run.final.attitude)

    exact = angle_of_attack(turn([A, A, C], (0, 0, n), ts, steady=(M1, 0, 0)).final.attitude)
    zero = jnp.zeros(())
    first = jnp.stack(jax.jvp(tip, (zero,), (zero + M1,))[1])
    return closed, first, jnp.stack(exact), centre[0], slow, fast


def near_symmetric(ratio, beta, n, start, t):
    """First-order motion of the body's axis 3, which stands off the principal one by beta."""

    def tip(s):
        # In principal axes: the body's axes stand turned by -beta about x.
        askew = Quaternion.from_rotation_vector(-s * beta * X)
        omega = askew.rotate(vec(0, 0, n) + s * start * n * X)
        y0 = BodyState(attitude=askew.inverse(), omega=omega)
        end = symmetric_flow(t, y0, 1.0, ratio)
        return direction(end.attitude.then(askew))

    zero = jnp.zeros(())
    missile = SpinningMissile(1.0, ratio, n)
    closed = missile.complex_tilt(t, vec(0, 0), vec(start * n, 0), vec(0, 0), tilt=vec(beta, 0))
    return closed, *jax.jvp(tip, (zero,), (jnp.ones(()),))[1]


def near_symmetric_exact(I1, I3, beta, n, start, t):
    tilt = Quaternion.about(0, jnp.asarray(beta)).matrix()
    inertia = tilt @ jnp.diag(vec(I1, I1, I3)) @ tilt.T
    y0 = BodyState(attitude=Quaternion.identity(), omega=vec(start, 0.0, n))
    end = free(inertia, t, y0)
    return *angle_of_attack(end.attitude), inertia[1, 1], jnp.abs(inertia[1, 2])


def rolling(A, C, n, moment, t):
    """Pitch and yaw of a missile that rolls about x under a body-fixed yawing moment: in closed
    form with y and z as the transverse axes, to first order, exact."""
    closed = SpinningMissile(A, C, n).complex_tilt(t, vec(0, 0), vec(0, 0), vec(0, moment))
    ts = t * vec(0.0, 0.5, 1.0)

    def tilt(moment):
        run = turn([C, A, A], (n, 0, 0), ts, steady=moment * Z)
        # 3-2-1: yaw, pitch, roll.
        return to_euler_angles(run.final.attitude, "321")[1::-1]

    zero = jnp.zeros(())
    return closed, jax.jvp(tilt, (zero,), (zero + moment,))[1], tilt(zero + moment)


def steady(A, C, theta, n):
    """Precession, spin about the axis and transverse rate of a free symmetric body."""
    rate = precession_rate(vec(C * n * jnp.tan(theta) / A, 0.0, n), A, C)
    spin = -body_precession_rate(n, A, C)
    small = precession_rate(n * Z, A, C)
    return rate, spin, small, norm(coning_omega(theta, rate, A, C) * (X + Y))


def misaligned_rates(A, C, n, M1, start, t):
    """w_12, lambda, and the greatest |w_12| from rest."""
    missile = SpinningMissile(A, C, n)
    rate = missile.transverse_rate(t, vec(*start), vec(M1, 0))
    # From rest w_12 is a circle through the origin.
    half = missile.transverse_rate(jnp.pi / missile.nutation_rate, vec(0, 0), vec(M1, 0))
    return rate, missile.nutation_rate, jnp.hypot(*half)


def angles_321(angles, rates):
    """The matrix from inertial to body axes, and the body rates; angles in the order 3, 2, 1."""
    matrix = from_euler_angles(vec(*angles), "321").matrix().T
    return *matrix, omega_from_euler_rates(vec(*angles), vec(*rates), "321")


def libration(moments, mu, radius):
    """Mean motion, rate of the pitch, and those of all modes over the mean motion."""
    n = jnp.sqrt(mu / radius**3)
    modes = libration_modes(vec(*moments), n)
    return n, modes.frequency[0], modes.frequency / n


def wide_pitch(moments, mu, radius, amplitude):
    """Period of a wide libration in pitch, and its ratio to that of a small one."""
    n, rate, _ = libration(moments, mu, radius)
    period = pitch_libration_period(amplitude, vec(*moments), n)
    return period, period * rate / PI2


ORBIT = {"moments": (1000.0, 1200.0, 400.0), "mu": 398600441800000.0, "radius": 6778000.0}


SPUN = (simulate, Scene, Custom, RigidBody)
MISSILE = {"A": 4000.0, "C": 400.0, "n": PI2, "M1": 250.0}
SATELLITE = {"ratio": 1.2, "beta": 0.05, "n": PI2, "start": 0.1}
FREE = {"A": 10.0, "C": 2.0, "n": 6.0}


def tip(id, t, linear, exact):
    """A row of T7.4-P6."""
    return Case(
        id,
        f"Thrust misalignment of a spinning missile after {t} s",
        (SpinningMissile, *SPUN),
        {**MISSILE, "t": t},
        misaligned,
        {
            "theta_XY in closed form (rad)": linear,
            **{"theta_XY to first order (rad)": linear, "theta_XY (rad)": exact},
            "centre of the slow circle (rad)": -0.015831434944115277,
            "its radius (rad)": 0.017590483271239195,
            "radius of the fast circle (rad)": 0.0017590483271239196,
        },
        1e-9,
        why=STEPS,
    )


def wobble(id, t, expected):
    """A row of T7.4-P9."""
    return Case(
        id,
        f"Nearly symmetric satellite, axis 0.05 rad askew, after {t} s",
        (SpinningMissile, symmetric_flow),
        {**SATELLITE, "t": t},
        near_symmetric,
        {
            "theta_XY in closed form (rad)": expected,
            **{"re theta_XY (rad)": expected[0], "im theta_XY (rad)": expected[1]},
        },
        1e-10,
        1e-12,
        LINEAR,
    )


CASES = [
    Case(
        "T7.1-1",
        "Moment for a given motion, with products of inertia",
        (InertiaTensor, angular_acceleration),
        {
            "moments": (10.0, 14.0, 6.0, 1.0, -0.8, 0.5),
            **{"omega": (0.3, -0.2, 1.1), "rate": (0.05, 0.02, -0.04)},
        },
        lambda moments, omega, rate: moment_of(tensor(*moments), vec(*omega), vec(*rate)),
        {"M (N m)": [3.075, 2.656, -0.489], "rate (rad/s^2)": [0.05, 0.02, -0.04]},
        1e-12,
    ),
    Case(
        "T7.1-3",
        "Velocity in body axes under a body-fixed force and a constant spin",
        SPUN,
        {
            **{"m": 2.0, "spin": 0.7, "force": (3.0, -1.0, 0.5)},
            **{"velocity": (10.0, 2.0, -1.0), "t": 4.0},
        },
        body_axes_velocity,
        {"v (m/s)": [-9.421717027946872, -9.63550844872628, 0.0]},
        why=STEPS,
    ),
    *(
        Case(
            id,
            f"Misaligned thrust on a spinning missile, {title}",
            (SpinningMissile,),
            {**MISSILE, "start": start, "t": t},
            misaligned_rates,
            {
                "w_12 (rad/s)": rate,
                "lambda (rad/s)": -5.654866776461628,
                "greatest |w_12| from rest (rad/s)": 0.022104853207207686,
            },
            1e-12,
        )
        for id, title, start, t, rate in (
            (
                *("T7.2-P6-t7.5", "from rest", (0.0, 0.0), 7.5),
                [-0.011052426603603843, -0.011052426603603843],
            ),
            (
                *("T7.2-P6-ic", "from a transverse rate", (0.03, -0.02), 3.0),
                [-0.0007608618475766982, 0.020244221123154344],
            ),
        )
    ),
    Case(
        "T7.2-9",
        "Misalignment pulse, half a sine",
        SPUN,
        {"A": 4000.0, "C": 400.0, "n": PI2, "peak": 250.0, "pulse": 2.0},
        half_sine,
        {"w_12 (rad/s)": [-0.004354860477551602, -0.003163991340470974]},
        1e-10,
        why=STEPS,
    ),
    Case(
        "T7.2-P5",
        "Damped symmetric body, oblate: theta falls",
        SPUN,
        {"A": 3.0, "C": 5.0, "k": 0.2, "start": 0.15, "n": 4.0, "t": 6.0},
        damped,
        {
            "omega (rad/s)": [-0.008800983615100922, 0.10016209053351577, 3.1465114442662134],
            "theta (rad)": 0.019170886326624403,
        },
        1e-10,
        why=STEPS,
    ),
    Case(
        "T7.2-P5-prolate",
        "Damped symmetric body, prolate: theta grows",
        SPUN,
        {"A": 3.0, "C": 1.0, "k": 0.2, "start": 0.15, "n": 4.0, "t": 6.0},
        lambda **given: damped(**given)[1:],
        {"theta (rad)": 0.2453300246745711},
        1e-10,
        why=STEPS,
    ),
    Case(
        "T7.3-1",
        "Body rates from Euler's angles, complex and in node axes",
        (omega_from_euler_rates,),
        {"angles": (0.8, 0.25, -1.1), "rates": (0.4, 0.05, 5.0)},
        euler_rates,
        {
            "omega (rad/s)": [-0.06551548568710927, 0.08944895854034504, 5.3875649686842575],
            "node axes (rad/s)": [0.05, 0.09896158370180919],
            "theta_12' + i n theta_12 (rad/s)": [-0.06367038207706854, 0.08850985965197278],
        },
        1e-12,
    ),
    Case(
        "T7.3-NL-x10",
        "Large angle of attack of a free body, ten times the sample",
        (TorqueFreeBody, symmetric_flow),
        {**FREE, "rotation": 0.1, "start": 0.2, "t": 4.0},
        large_nutation,
        {
            "theta e^(i psi) (rad)": [-0.06434556674261972, 0.13784752868947156],
            "error of the linear formula (rad)": 0.014334979522898307,
        },
        why=CLOSED,
    ),
    Case(
        "T7.3-NL-x30",
        "Large angle of attack of a free body, thirty times the sample",
        (TorqueFreeBody, symmetric_flow),
        {**FREE, "rotation": 0.3, "start": 0.6, "t": 4.0},
        large_nutation,
        {
            "theta e^(i psi) (rad)": [-0.06698102499325669, 0.15736438664072325],
            "error of the linear formula (rad)": 0.32637472202288836,
        },
        why=CLOSED,
    ),
    Case(
        "T7.4-P5",
        "Steady precession of a free body at 0.1 rad",
        (precession_rate, body_precession_rate),
        {"A": 10.0, "C": 2.0, "theta": 0.1, "n": 6.0},
        steady,
        {
            "psi' (rad/s)": 1.2060251020805464,
            "phi' (rad/s)": 4.8,
            "n + lambda (rad/s)": 1.2,
            "|w_12| (rad/s)": 0.12040160650254064,
        },
        1e-12,
    ),
    tip(
        "T7.4-P6-t4.3",
        4.3,
        [-0.031204204246875353, 0.005816709131526195],
        [-0.031202701092512802, 0.005809406729380293],
    ),
    tip(
        "T7.4-P6-t7.7",
        7.7,
        [-0.013083186968763955, -0.0157788226826335],
        [-0.013067016575944971, -0.015774887881066856],
    ),
    wobble("T7.4-P9-t0.25", 0.25, (0.07471233492563999, 0.09871210437687701)),
    wobble("T7.4-P9-t0.5", 0.5, (-0.024357812456662235, 0.12626036401905924)),
    wobble("T7.4-P9-t2.5", 2.5, (0.1, 0.0)),
    Case(
        "T7.4-P9-NL-t2.5",
        "The same satellite after 2.5 s, exact",
        (TorqueFreeBody,),
        {"I1": 1.0, "I3": 1.2, "beta": 0.05, "n": PI2, "start": 0.1 * PI2, "t": 2.5},
        near_symmetric_exact,
        {
            "re theta e^(i psi) (rad)": 0.104663741654168,
            "im theta e^(i psi) (rad)": 0.005649329433166712,
            "I_yy (kg m^2)": 1.0004995834721975,
            "F (kg m^2)": 0.009983341664682814,
        },
        1e-12,
    ),
    Case(
        "T7.4-P11",
        "Yaw, pitch and roll: matrix and body rates",
        (from_euler_angles, omega_from_euler_rates),
        {"angles": (0.3, -0.2, 0.5), "rates": (0.11, -0.07, 0.05)},
        angles_321,
        {
            "x": [0.9362933635841992, 0.28962947762551555, 0.19866933079506122],
            "y": [-0.3503364588118941, 0.8102391858702562, 0.4698689469495153],
            "z": [-0.02488177918333981, -0.5095362866083979, 0.8600893382050473],
            "omega (rad/s)": [0.07185362638745674, -0.009745195167879417, 0.1281696149048494],
        },
        1e-12,
    ),
    Case(
        "T7.4-P14-15",
        "Small librations of a body in a circular orbit",
        (libration_modes,),
        ORBIT,
        libration,
        {
            "n (rad/s)": 0.0011314009553257084,
            "pitch (rad/s)": 0.0013856775175227058,
            "modes over n": [1.2247448713915892, 0.6944460469498098, 1.8214677290239822],
        },
        1e-12,
    ),
    Case(
        "T7.4-P15-pitch",
        "A libration of 40 degrees in pitch",
        (pitch_libration_period,),
        {**ORBIT, "amplitude": 40.0 * DEG},
        wide_pitch,
        {"period (s)": 5157.820957012799, "period over that of small ones": 1.137492559923922},
        1e-12,
    ),
    Case(
        "T7.4-P14-unst",
        "Growth of roll and yaw of a body that stands unstably",
        (libration_modes,),
        {"moments": (1000.0, 600.0, 800.0)},
        lambda moments: (jnp.max(libration_modes(vec(*moments), 1.0).growth),),
        {"growth over n": 0.437295970730166},
        1e-12,
    ),
    Case(
        "T7.4-P13",
        "Rolling missile under a body-fixed yawing moment",
        (SpinningMissile, *SPUN, to_euler_angles),
        {"A": 5000.0, "C": 500.0, "n": 1.5, "moment": 40.0, "t": 6.0},
        rolling,
        {
            "theta_2, theta_3 in closed form (rad)": [-0.029318125870747967, -0.007398597749762673],
            "theta_2, theta_3 to first order (rad)": [-0.029318125870747967, -0.007398597749762673],
            "theta_2, theta_3 (rad)": [-0.02931654371985564, -0.0074034562308989155],
        },
        why=STEPS,
    ),
]

"""Thomson, chapter 7: spinning bodies, thrust misalignment, drift of attitude, rockets."""

import jax
import jax.numpy as jnp

from jaxspace import BodyState, Scene, simulate
from jaxspace.attitude import (
    TorqueFreeBody,
    body_precession_rate,
    coning_omega,
    precession_rate,
    symmetric_flow,
)
from jaxspace.bodies import (
    BurningBody,
    InertiaTensor,
    Load,
    PrincipalInertia,
    RigidBody,
    angular_acceleration,
)
from jaxspace.core import cross, norm
from jaxspace.orbits import angular_momentum
from jaxspace.rockets import (
    JetDamping,
    SpinningRocket,
    spin_angle,
    spin_ratio,
    sprinkler_moment,
    sprinkler_speed,
)
from jaxspace.rotations import (
    Quaternion,
    omega_from_euler_rates,
    to_euler_angles,
)
from jaxspace.scene import Custom

from .case import CLOSED, LINEAR, STEPS, Case, vec
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
    push = Custom(
        lambda t, y, b: Load(force_N=y.attitude.rotate(vec(*force))), {"attitude"}, {"force"}
    )
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
    """theta e^(i psi) under a body-fixed moment: exact and to first order."""
    ts = t * vec(0.0, 0.5, 1.0)

    def tip(moment):
        run = turn([A, A, C], (0, 0, n), ts, steady=moment * X)
        return direction(run.final.attitude)

    exact = angle_of_attack(turn([A, A, C], (0, 0, n), ts, steady=(M1, 0, 0)).final.attitude)
    zero = jnp.zeros(())
    return jnp.stack(jax.jvp(tip, (zero,), (zero + M1,))[1]), jnp.stack(exact)


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
    return jax.jvp(tip, (zero,), (jnp.ones(()),))[1]


def near_symmetric_exact(I1, I3, beta, n, start, t):
    tilt = Quaternion.about(0, jnp.asarray(beta)).matrix()
    inertia = tilt @ jnp.diag(vec(I1, I1, I3)) @ tilt.T
    y0 = BodyState(attitude=Quaternion.identity(), omega=vec(start, 0.0, n))
    end = free(inertia, t, y0)
    return *angle_of_attack(end.attitude), inertia[1, 1], jnp.abs(inertia[1, 2])


def rolling(A, C, n, moment, t):
    """Pitch and yaw of a missile that rolls about x under a body-fixed yawing moment."""
    ts = t * vec(0.0, 0.5, 1.0)

    def tilt(moment):
        run = turn([C, A, A], (n, 0, 0), ts, steady=moment * Z)
        # 3-2-1: yaw, pitch, roll.
        return to_euler_angles(run.final.attitude, "321")[1::-1]

    zero = jnp.zeros(())
    return jax.jvp(tilt, (zero,), (zero + moment,))[1], tilt(zero + moment)


def steady(A, C, theta, n):
    """Precession, spin about the axis and transverse rate of a free symmetric body."""
    rate = precession_rate(vec(C * n * jnp.tan(theta) / A, 0.0, n), A, C)
    spin = -body_precession_rate(n, A, C)
    small = precession_rate(n * Z, A, C)
    return rate, spin, small, norm(coning_omega(theta, rate, A, C) * (X + Y))


def structural_point(xi, z, theta, phi, ratio, w0):
    """Acceleration of a point of a precessing body, in the axes of the node."""
    A, C = 1.0, ratio
    rate = ratio * w0  # h = C w0
    inertia = PrincipalInertia([A, A, C])
    omega = coning_omega(theta, rate, A, C)
    r = Quaternion.about(2, jnp.asarray(phi)).rotate(vec(xi, 0.0, z))
    a = cross(omega, cross(omega, r)) + cross(angular_acceleration(inertia, omega, None), r)
    return Quaternion.about(2, jnp.asarray(phi)).rotate_back(a), PI2 / jnp.abs(
        body_precession_rate(omega[2], A, C)
    )


def spinning_rocket(rho, t, k=1.5, kz=0.4, exit_station=-2.0, n=6.0, start=0.03):
    """Transverse rate, spin, angle of spin and attitude of a rocket with jet damping."""
    body = BurningBody(1e-9, PrincipalInertia(1e-9 * vec(k * k, k * k, kz * kz)), [k, k, kz])
    scene = Scene((LEAK, JetDamping(leak, exit_station, rho)), body)
    y0 = BodyState(attitude=Quaternion.identity(), omega=vec(start, 0.0, n), mass=jnp.array(1000.0))
    # The tolerance is that of the whole rate, a thousand times the transverse one.
    end = simulate(scene, y0, vec(0.0, t), accuracy=5e-15).final
    return (
        *(end.omega[:2], end.omega[2], n * spin_ratio(end.mass / 1000.0, rho / kz)),
        *(spin_angle(t, n, 8e-3, rho / kz), jnp.stack(angle_of_attack(end.attitude))),
    )


def leak(t, m):
    """Eight kilograms a second."""
    return -8.0 + 0.0 * m


LEAK = Custom(lambda t, y, b: Load(mass_rate=leak(t, y.mass)), {"mass"}, {"mass_rate"})


# Slugs a second of the sprinkler's nozzles: rho Q.
WATER = 62.4 / 32.2 * 0.1


def spiral(ratio, t, rate=0.02, tau=125.0, spin=10.0):
    """theta_XY and the transverse rate for rho = k_z and a lever that makes the exponent three."""
    rocket = SpinningRocket(spin, 1.0 / tau, jnp.sqrt(4.0 - 0.5 * ratio), 1.0, jnp.sqrt(ratio))
    start = vec(rate, 0.0)
    angle = spiral_angle(rocket, jnp.asarray(t), start)
    return angle, jnp.hypot(*rocket.transverse_rate(t, start))


spiral_angle = jax.jit(lambda rocket, t, start: rocket.angle_of_attack(t, start))


def gyrostat(A, C, rotor, acceleration, n, t):
    """A pitch motor that is spun up in a spinning satellite."""
    end = final([A, A, C], (0, 0, n), t, rotor=(0, rotor * acceleration, 0))
    momentum = vec(A, A, C) * end.omega + rotor * acceleration * t * Y
    return end.omega, norm(momentum)


def moving_bar(m, l, V, w, theta):
    """Momentum about the end of a turning bar, its rate, and R_0' x m r'; their sum is M_0."""
    inertia = PrincipalInertia(m * l**2 / 12.0 * vec(1.0, 1e-16, 1.0))

    def arm(t):
        turned = theta + w * t
        return 0.5 * l * jnp.stack([jnp.cos(turned), jnp.sin(turned), 0.0 * turned])

    def momentum(t):
        return (inertia.times(w * Z) + m * angular_momentum(arm(t), V * X))[2]

    zero = jnp.zeros(())
    h, rate = jax.jvp(momentum, (zero,), (zero + 1.0,))
    end = V * X - cross(w * Z, arm(zero))
    balance = cross(end, m * V * X)[2]
    return h, rate, balance, rate + balance


SPUN = (simulate, Scene, Custom, RigidBody)
ROCKET = (simulate, BurningBody, JetDamping, spin_angle, spin_ratio)
MISSILE = {"A": 4000.0, "C": 400.0, "n": PI2, "M1": 250.0}
SATELLITE = {"ratio": 1.2, "beta": 0.05, "n": PI2, "start": 0.1}
FREE = {"A": 10.0, "C": 2.0, "n": 6.0}


def rocket(id, title, rho, t, rate, spin, angle, tip):
    """A row of T7.9-Ex1."""
    return Case(
        id,
        f"Spinning rocket with jet damping: {title}",
        ROCKET,
        {"rho": rho, "t": t},
        spinning_rocket,
        {
            **{"w_xy (rad/s)": rate, "w_z (rad/s)": spin, "w_z by its formula (rad/s)": spin},
            **{"angle of spin (rad)": angle, "theta_XY (rad)": tip},
        },
        1e-9,
        1e-12,
        STEPS,
    )


def spiral_row(id, ratio, t, expected, rate):
    """A row of T7.10-P8."""
    return Case(
        id,
        f"Path of the axis for l^2/k^2 = 4, rho = k_z, k_z^2/k^2 = {ratio}, after {t} s",
        (SpinningRocket,),
        {"ratio": ratio, "t": t},
        spiral,
        {"theta_XY (rad)": expected, "|w_xy| (rad/s)": rate},
        1e-10,
        1e-12,
        "quadrature: the digits of the case",
    )


def sprinkler_row(id, nozzles, rate):
    """A row of T7.10-P2."""
    return Case(
        id,
        f"Sprinkler with friction, nozzles: {nozzles}",
        (sprinkler_speed,),
        {"flow": nozzles * WATER, "arm": 1.5, "jet_speed": 30.0, "bend": PI2 / 12.0},
        lambda **given: (sprinkler_speed(**given, friction=1.72) * 60.0 / PI2,),
        {"rate (rpm)": rate},
        1e-11,
    )


def tip(id, t, linear, exact):
    """A row of T7.4-P6."""
    return Case(
        id,
        f"Thrust misalignment of a spinning missile after {t} s",
        SPUN,
        {**MISSILE, "t": t},
        misaligned,
        {"theta_XY to first order (rad)": linear, "theta_XY (rad)": exact},
        1e-9,
        why=STEPS,
    )


def wobble(id, t, expected):
    """A row of T7.4-P9."""
    return Case(
        id,
        f"Nearly symmetric satellite, axis 0.05 rad askew, after {t} s",
        (symmetric_flow,),
        {**SATELLITE, "t": t},
        near_symmetric,
        {"re theta_XY (rad)": expected[0], "im theta_XY (rad)": expected[1]},
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
        "T7.4-P13",
        "Rolling missile under a body-fixed yawing moment",
        (*SPUN, to_euler_angles),
        {"A": 5000.0, "C": 500.0, "n": 1.5, "moment": 40.0, "t": 6.0},
        rolling,
        {
            "theta_2, theta_3 to first order (rad)": [-0.029318125870747967, -0.007398597749762673],
            "theta_2, theta_3 (rad)": [-0.02931654371985564, -0.0074034562308989155],
        },
        why=STEPS,
    ),
    Case(
        "T7.6-14",
        "Acceleration of a point of a precessing body, and the period of its load",
        (coning_omega, angular_acceleration, body_precession_rate),
        {"xi": 1.5, "z": -2.0, "theta": 0.4, "phi": 0.9, "ratio": 0.3, "w0": 7.0},
        structural_point,
        {
            "a (m/s^2)": [-65.21967109696368, -1.4780342211645245, 11.869390162807637],
            "t_0 (s)": 1.3921800229300771,
        },
        1e-12,
    ),
    rocket(
        "T7.9-Ex1-a-t20",
        "nozzles inside the radius of gyration",
        0.2,
        20.0,
        [0.02265170051521131, 0.013076051778517317],
        6.838199798129711,
        127.95608478552124,
        [0.019871574844924897, 0.12081681732498376],
    ),
    rocket(
        "T7.9-Ex1-b-t60",
        "nozzles at the radius of gyration",
        0.4,
        60.0,
        [0.003148824539818691, -0.01734177712488905],
        6.0,
        360.0,
        [0.020110411499214685, 0.033532422078701656],
    ),
    rocket(
        "T7.9-Ex1-c-t20",
        "one central nozzle, 20 s",
        0.0,
        20.0,
        [-0.012899386915686812, -0.022799389609519948],
        7.142857142857143,
        130.76504035858332,
        [0.009628992938004793, 0.1210994695919512],
    ),
    rocket(
        "T7.9-Ex1-c-t60",
        "one central nozzle, 60 s",
        0.0,
        60.0,
        [-0.018027022769078953, 0.0006824235862432634],
        11.538461538461538,
        490.444850554998,
        [-0.004566914446980836, 0.09098415027756093],
    ),
    rocket(
        "T7.9-Ex1-d-t20",
        "nozzles outside the radius of gyration",
        0.6,
        20.0,
        [0.02578983180583812, 0.001487509218308234],
        4.825033777560324,
        108.1650903805182,
        [0.07398018658816413, 0.060213995076644745],
    ),
    Case(
        "T7.11-Ex1",
        "Moment of a motor on its body, -M_p = [h_1'] + w x h_1",
        (cross,),
        {
            **{"omega": (0.1, 0.2, 0.3), "axis": (1 / 3, 2 / 3, 2 / 3)},
            **{"C1": 0.02, "speed": 300.0, "rate": 15.0},
        },
        lambda omega, axis, C1, speed, rate: (
            C1 * rate * vec(*axis) + cross(vec(*omega), C1 * speed * vec(*axis)),
        ),
        {"M_p (N m)": [-0.3, 0.4, 0.2]},
        1e-12,
    ),
    Case(
        "T7.11-Ex1-rest",
        "Reaction wheel that is spun up in a body at rest",
        (PrincipalInertia.solve,),
        {"A": 800.0, "rotor": 0.5, "speed": 200.0},
        lambda A, rotor, speed: (PrincipalInertia([A, A, A]).solve(-rotor * speed * Y),),
        {"omega (rad/s)": [0.0, -0.125, 0.0]},
        1e-12,
    ),
    Case(
        "T7.11-P2",
        "Turning bar whose mass centre moves uniformly, about one end",
        (PrincipalInertia, angular_momentum, cross),
        {"m": 3.0, "l": 2.0, "V": 5.0, "w": 0.8, "theta": 0.6},
        moving_bar,
        {
            "h_0 (kg m^2/s)": -7.66963710092553,
            "h_0' (N m)": -9.90402737891614,
            "R_0' x m r' (N m)": 9.90402737891614,
            "M_0 (N m)": 0.0,
        },
        1e-12,
        1e-13,
    ),
    Case(
        "T7.11-P4",
        "Pitch motor that is spun up in a spinning satellite",
        SPUN,
        {"A": 800.0, "C": 1200.0, "rotor": 0.5, "acceleration": 20.0, "n": 1.0, "t": 10.0},
        gyrostat,
        {
            "omega (rad/s)": [0.06241690688997962, 0.32097160625374205, 0.9538724480650776],
            "h (kg m^2/s)": 1200.0,
        },
        1e-11,
        why=STEPS,
    ),
    sprinkler_row("T7.10-P2-N1", 1, 57.82357539273749),
    sprinkler_row("T7.10-P2-N2", 2, 76.65827062393737),
    Case(
        "T7.10-P1-N2",
        "Moment that turns a sprinkler with two radial nozzles at 60 rpm",
        (sprinkler_moment,),
        {"flow": 2.0 * WATER, "arm": 1.5, "spin_rate": PI2},
        lambda **given: (sprinkler_moment(**given),),
        {"M (lb ft)": 5.479249795826173},
        1e-11,
    ),
    spiral_row("T7.10-P8-r0-t40", 0.0, 40.0, [0.4913664, 0.0], 0.006288639999999999),
    spiral_row("T7.10-P8-r0-t80", 0.0, 80.0, [0.6145024, 0.0], 0.00093312),
    spiral_row(
        "T7.10-P8-r0.05-t40",
        0.05,
        40.0,
        [0.013001345522707998, 0.034013424352213856],
        0.006288639999999999,
    ),
    spiral_row(
        "T7.10-P8-r0.2-t40",
        0.2,
        40.0,
        [-0.0029983342582919413, 0.010401205834851684],
        0.006288639999999999,
    ),
    spiral_row(
        "T7.10-P8-r0.2-t80",
        0.2,
        80.0,
        [0.00023746461583604305, 0.010450480775661925],
        0.00093312,
    ),
]

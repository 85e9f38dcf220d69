"""Thomson, chapter 7, 7.5 to 7.11: despin, drift of attitude, lost mass, moving parts."""

import jax
import jax.numpy as jnp

from jaxspace import BodyState, Scene, simulate
from jaxspace.attitude import (
    AttitudeDrift,
    NutationDamper,
    ReactionWheels,
    YoYo,
)
from jaxspace.attitude.despin import cord_length, zero_spin_cord_length
from jaxspace.attitude.drift import FASTEST_DRIFT, structural_damping, tube_drift_constant
from jaxspace.attitude.moving_masses import particle_equations
from jaxspace.attitude.swinging import SwingOutArms, SwingState
from jaxspace.attitude.torque_free import (
    body_precession_rate,
    coning_omega,
)
from jaxspace.attitude.unwinding import UnwindingCords
from jaxspace.attitude.wheels import rotor_moment
from jaxspace.bodies import BurningBody, Load, PrincipalInertia, RigidBody
from jaxspace.bodies.newton_euler import angular_acceleration
from jaxspace.core.vectors import cross, norm
from jaxspace.orbits.elements import angular_momentum
from jaxspace.rockets import JetDamping, SpinningRocket, spin_angle
from jaxspace.rockets.jet_damping import jet_damping_ratio, spin_ratio
from jaxspace.rockets.sprinkler import sprinkler_moment, sprinkler_speed
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom

from .case import DEG, STEPS, Case, vec
from .motions import ACCURACY, angle_of_attack
from .thomson_7 import PI2, SPUN, X, Y, Z, final


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


LEAK = Custom(lambda t, y, b: Load(mass_rate=leak(t, y.mass)))


# Slugs a second of the sprinkler's nozzles: rho Q.
WATER = 62.4 / 32.2 * 0.1


def spiral(ratio, t, rate=0.02, tau=125.0, spin=10.0):
    """theta_XY and the transverse rate for rho = k_z and a lever that makes the exponent three."""
    rocket = SpinningRocket(spin, 1.0 / tau, jnp.sqrt(4.0 - 0.5 * ratio), 1.0, jnp.sqrt(ratio))
    start = vec(rate, 0.0)
    angle = spiral_angle(rocket, jnp.asarray(t), start)
    return angle, jnp.hypot(*rocket.transverse_rate(t, start))


spiral_angle = jax.jit(lambda rocket, t, start: rocket.complex_tilt(t, start))


def gyrostat(A, C, rotor, acceleration, n, t):
    """A pitch motor that is spun up in a spinning satellite."""
    end = final([A, A, C], (0, 0, n), t, rotor=(0, rotor * acceleration, 0))
    momentum = vec(A, A, C) * end.omega + rotor * acceleration * t * Y
    return end.omega, norm(momentum)


def moving_bar(m, l, V, w, theta):
    """Momentum about the end of a turning bar, its rate, and R_0' x m r'; their sum is M_0."""
    inertia = PrincipalInertia(m * l**2 / 12.0 * vec(1.0, 0.0, 1.0))

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


def drift_of_disks(tube, A, C, w0):
    """K, times from 1 to 10 degrees to first order and exact, and the fastest drift."""
    K = tube_drift_constant(*tube, A, C, w0)
    drift = AttitudeDrift(K)
    first, last = DEG, 10.0 * DEG
    small = jnp.log(last / first) / K
    return K, small, drift.drift_time(first, last), FASTEST_DRIFT, drift.rate(FASTEST_DRIFT)


def rest_wheel(A, rotor, speed):
    """A body at rest whose wheel has been spun up: without momentum."""
    wheels = ReactionWheels.rotor(Y, rotor, speed)
    body = PrincipalInertia([A, A, A])
    y = BodyState(attitude=Quaternion.identity(), omega=-rotor * speed / A * Y)
    scene = Scene((wheels,), RigidBody(inertia=body))
    momentum = scene.invariants(0.0, scene.start(y))["rotational_momentum"]
    return body.solve(-rotor * speed * Y), momentum


def damper_of(k, c):
    return NutationDamper(4.0, [0.8, 0.0, 0.0], Z, k, c)


def damped_satellite(A, C, k, c, start, times):
    """omega, displacement, angle to h, energy and loss, at two times; at first angle, energy, h."""
    damper = damper_of(k, c)
    scene = Scene((damper,), RigidBody(200.0, jnp.array([A, A, C])))
    y0 = scene.start(BodyState(attitude=Quaternion.identity(), omega=vec(start, 0, 5)))
    run = simulate(scene, y0, vec(0.0, *times), accuracy=ACCURACY)
    h = scene.invariants(run.ts, run.states)["rotational_momentum"]
    inside = run.states.attitude.rotate_back(h)
    theta = jnp.arctan2(jnp.hypot(inside[0], inside[1]), inside[2])
    energy = damper.energy(run.states, scene.body)
    place = damper.motion(run.states, scene.body).displacement
    return (
        *(run.states.omega[:, 1:].T, place[1:], theta[1:], energy[1:]),
        *(energy[0] - energy[1:], theta[0], energy[0], norm(h)[0]),
    )


def damper_eigenvalues(A, C, k, c):
    """The fastest growth, and both pairs as real and imaginary part, slower decay first."""
    growth, frequency = damper_of(k, c).eigenvalues(vec(A, A, C), 200.0, 5.0)
    order = jnp.argsort(-growth)
    pairs = jnp.stack([growth, jnp.abs(frequency)])[:, order]
    return growth[order[0]], pairs[:, 0], pairs[:, 4]


def pioneer(w0, last):
    """C, both cords, time and angle of the unwinding."""
    I, R, m = PIONEER  # noqa: E741
    cord = cord_length(w0, last, I, R, m)
    yoyo = YoYo(I, R, m, cord)
    return (
        *(yoyo.inertia_ratio, cord, zero_spin_cord_length(I, R, m)),
        *(yoyo.unwinding_time(w0), cord / R),
    )


def unwound(w0, phi):
    """Time, spin, speed of the masses and tension at an angle unwound."""
    yoyo = YoYo(*PIONEER, phi * PIONEER[1])
    found = (f(phi, w0) for f in (yoyo.spin_rate, yoyo.mass_speed, yoyo.tension))
    return yoyo.unwinding_time(w0), *found


def unwinding(w0, phi, t):
    """Spin at first; angle, spin and rate a time later; greatest tension, and the angle of it."""
    cords = UnwindingCords(*PIONEER)
    flow, start = cords.closed_form().flow, cords.state(w0)
    y = flow(phi / w0, start)
    end = flow(t, y)
    most = jnp.sqrt(cords.inertia_ratio / 3.0)
    return y.spin, end.angle, end.spin, end.angle_rate, cords.tension(flow(most / w0, start)), most


def swung(theta, w0):
    """Spin, rate, time and outward acceleration of arms that have swung out."""
    arms = SwingOutArms(2.0, 0.2, 0.5, 0.8)
    y = SwingState(arms.spin_rate(theta, w0), jnp.asarray(theta), arms.angle_rate(theta, w0))
    return y.spin, y.angle_rate, arms.swing_time(theta, w0), arms.outward_acceleration(y)


PIONEER = (92.0 / 386.4, 5.0, 0.025 / 386.4)  # lbf s^2 in, in, lbf s^2/in
PARTICLES = {
    "mass": (2.0, 1.5, 3.0),
    "places": ((0.5, -0.2, 0.3), (-0.4, 0.6, 0.1), (0.2, 0.1, -0.7)),
    "velocities": ((0.1, 0.3, -0.2), (0.0, -0.1, 0.4), (-0.3, 0.2, 0.05)),
    "accelerations": ((0.02, -0.05, 0.1), (0.07, 0.0, -0.03), (-0.01, 0.04, 0.06)),
    "mass_rates": (0.0, -0.02, -0.05),
    "exhaust": ((0.0, 0.0, 0.0), (0.0, 0.0, -50.0), (5.0, 0.0, -80.0)),
    "omega": (0.3, -0.4, 1.2),
    "omega_rate": (0.05, -0.02, 0.1),
    "origin_acceleration": (0.4, -0.3, 0.2),
}
ROCKET = (simulate, BurningBody, JetDamping, spin_angle, spin_ratio)


def slowed(lever, rate, burnt):
    """Time of burnout, rates after 35 s and then over that at the start, and the angle turned."""
    end, rocket = burnt / rate, SpinningRocket(0.0, rate, lever)
    damped = (jet_damping_ratio(1.0 - rate * t, lever) for t in (35.0, end))
    return end, *damped, spiral_angle(rocket, jnp.asarray(end), vec(1.0, 0.0))[0]


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


CASES = [
    Case(
        "T7.5-Ex1",
        "Cord of a yo-yo that slows Pioneer III from 400 to 5.5 rpm",
        (YoYo, cord_length, zero_spin_cord_length),
        {"w0": 41.8879020478639, "last": 0.5759586531581287},
        pioneer,
        {
            **{"C": 148.2, "l_f (in)": 60.03744207821231, "l_0 (in)": 60.868711174132805},
            **{"t_f (s)": 0.28665767032022527, "phi_f (rad)": 12.007488415642461},
        },
        1e-12,
    ),
    Case(
        "T7.5-12-phi9",
        "The same yo-yo with 9 rad unwound",
        (YoYo,),
        {"w0": 41.8879020478639, "phi": 9.0},
        unwound,
        {
            **{"t (s)": 0.2148591731740587, "w (rad/s)": 12.281269710368475},
            **{"speed (in/s)": 2438.3860557369817, "tension (lbf)": 8.485538371812844},
        },
        1e-11,
    ),
    Case(
        "T7.5-dyn",
        "The motion of its cords from 0.5 rad on, and the greatest tension",
        (UnwindingCords,),
        {"w0": 41.88790204786391, "phi": 0.5, "t": 0.28665767032022527 - 0.01193662073189215},
        unwinding,
        {
            "w at first (rad/s)": 41.74681783753093,
            "phi (rad)": 12.007488415642463,
            "w (rad/s)": 0.5759586531581286,
            "phi' (rad/s)": 41.88790204786391,
            "greatest tension (lbf)": 8.915705462974516,
            "angle of the greatest tension (rad)": 7.0285133563222315,
        },
        1e-10,
    ),
    Case(
        "T7.6-P3",
        "Despin by four arms that swing out by 90 degrees",
        (SwingOutArms,),
        {"theta": 90.0 * DEG, "w0": 10.0},
        swung,
        {
            "w (rad/s)": 8.768177929854577,
            "theta' (rad/s)": 14.045782406890975,
            # By 30 digits from rest: the source leaves out the first 1e-15 rad, 6e-9 s.
            "swing (s)": 0.2090891405174409,
            "outward acceleration (m/s^2)": -257.772430209848,
        },
        1e-11,
    ),
    Case(
        "T7.6-P3b",
        "The same arms at 30 degrees",
        (SwingOutArms,),
        {"theta": 30.0 * DEG, "w0": 10.0},
        lambda **given: swung(**given)[:2],
        {"w (rad/s)": 9.481961147086032, "theta' (rad/s)": 9.108631073712607},
        1e-12,
    ),
    Case(
        "T7.6-Ex1-num",
        "Drift of two disks on a flexible tube, from 1 to 10 degrees",
        (tube_drift_constant, AttitudeDrift),
        {
            "tube": (0.05, 29e6, 0.1136, 12.0, 3.0, 2.71, 14.5),
            **{"A": 20.44, "C": 8.16, "w0": 157.07963267948966},
        },
        drift_of_disks,
        {
            "K (1/s)": 0.0006559051105058076,
            "t to first order (s)": 3510.546047153658,
            "t (s)": 3537.6717658157468,
            "angle of the fastest drift (rad)": 0.6154797086703874,
            "fastest drift (rad/s)": 0.0002524579947422528,
        },
        1e-12,
    ),
    *(
        Case(
            f"T7.6-f-{first:.0f}-{last:.0f}",
            f"Time of the drift from {first:.0f} to {last:.0f} degrees",
            (AttitudeDrift,),
            {"K": 0.0006559051105058076, "first": first * DEG, "last": last * DEG},
            lambda K, first, last: (AttitudeDrift(K).drift_time(first, last),),
            {"t (s)": t},
            1e-12,
        )
        for first, last, t in ((1.0, 30.0, 5456.489081195428), (5.0, 80.0, 11756.008641972363))
    ),
    Case(
        "T7.6-f-2h",
        "Angle two hours after 1 degree",
        (AttitudeDrift,),
        {"K": 0.0006559051105058076, "first": DEG, "t": 7200.0},
        lambda K, first, t: (AttitudeDrift(K).angle_after(t, first),),
        {"theta (rad)": 0.9295370339778448},
        1e-12,
    ),
    Case(
        "T7.6-P9",
        "Structural damping from the hysteretic factor",
        (structural_damping,),
        {"gamma": 0.05},
        lambda gamma: (structural_damping(gamma),),
        {"alpha": 0.007957747154594767},
        1e-14,
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
        (rotor_moment,),
        {
            **{"omega": (0.1, 0.2, 0.3), "axis": (1 / 3, 2 / 3, 2 / 3)},
            **{"C1": 0.02, "speed": 300.0, "rate": 15.0},
        },
        lambda omega, axis, C1, speed, rate: (
            rotor_moment(vec(*omega), vec(*axis), C1, speed, rate),
        ),
        {"M_p (N m)": [-0.3, 0.4, 0.2]},
        1e-12,
    ),
    Case(
        "T7.11-Ex1-rest",
        "Reaction wheel that is spun up in a body at rest",
        (ReactionWheels, Scene),
        {"A": 800.0, "rotor": 0.5, "speed": 200.0},
        rest_wheel,
        {"omega (rad/s)": [0.0, -0.125, 0.0], "h (kg m^2/s)": [0.0, 0.0, 0.0]},
        1e-12,
        1e-13,
    ),
    Case(
        "T7.11-11..14",
        "Moment and force of three particles that move and lose mass, term by term",
        (particle_equations,),
        PARTICLES,
        lambda **given: particle_equations(*(jnp.array(x).T for x in given.values())),
        {
            "M_0 (N m)": [-3.02685, 0.2146, -0.3972],
            "F (N)": [-2.07, -4.3485, -2.9215],
            "m r x R_0'' (N m)": [-0.245, -0.74, -0.62],
            "J w' (N m)": [0.12375, -0.0015, 0.1552],
            "w x J w (N m)": [-0.0216, 0.3216, 0.1126],
            "r x m [r''] (N m)": [0.065, -0.1105, -0.078],
            "2 r x w x m [r'] (N m)": [-1.949, 0.52, 0.058],
            "-r x m' u (N m)": [-1.0, 0.225, -0.025],
            "[J'] w (N m)": [-0.40256, -0.14094, -0.5729],
            "jet damping (N m)": [0.01756, -0.00806, 0.0169],
        },
        1e-12,
    ),
    Case(
        "T7.11-P12-oblate",
        "Satellite with a nutation damper, oblate, after 10 and 40 s",
        (NutationDamper, simulate),
        {"A": 40.0, "C": 60.0, "k": 24.5, "c": 2.0, "start": 0.4, "times": (10.0, 40.0)},
        damped_satellite,
        {
            "omega (rad/s)": [
                [-0.11829348604076954, -0.0344533268963404, 5.006657295552015],
                [-0.0011492139257429721, 0.006202773489972586, 5.007104049502204],
            ],
            "zeta (m)": [-0.024349050213598743, -0.0017615752898549812],
            "theta (rad)": [0.015511813878562928, 0.0009202084191357908],
            "energy (J)": [752.2929293988307, 752.1338502778293],
            "dissipated (J)": [0.9070706011694447, 1.066149722171045],
            "theta at first (rad)": 0.05328285155969089,
            "energy at first (J)": 753.2,
            "h (kg m^2/s)": 300.4263636900064,
        },
        2e-10,
        why=STEPS,
    ),
    Case(
        "T7.11-P12-prolate",
        "Satellite with a nutation damper, prolate, after 20 and 60 s",
        (NutationDamper, simulate),
        {"A": 60.0, "C": 40.0, "k": 100.0, "c": 10.0, "start": 0.1, "times": (20.0, 60.0)},
        damped_satellite,
        {
            "omega (rad/s)": [
                [-0.020792106078625455, 0.18577789126914743, 4.993993210183639],
                [0.34816063935561775, -0.413752341574462, 4.927204595021469],
            ],
            "zeta (m)": [0.014217064829308046, -0.1041784487153295],
            "theta (rad)": [0.05738010651270728, 0.17004092624894637],
            "energy (J)": [499.9162307955948, 495.6463690852157],
            "dissipated (J)": [0.38376920440501544, 4.653630914784025],
            "theta at first (rad)": 0.029991004856874958,
            "energy at first (J)": 500.3,
            "h (kg m^2/s)": 200.08997975910736,
        },
        2e-10,
        why=STEPS,
    ),
    Case(
        "T7.11-P12-prolate-lin",
        "Nutation damper, prolate: eigenvalues about the pure spin",
        (NutationDamper,),
        {"A": 60.0, "C": 40.0, "k": 100.0, "c": 10.0},
        damper_eigenvalues,
        {
            "greatest growth (1/s)": 0.027978582309987066,
            "nutation (1/s, rad/s)": [0.027978582309987066, 1.80234271240942],
            "damper (1/s, rad/s)": [-1.3615489948277686, 4.885316160979756],
        },
        1e-10,
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
    Case(
        "T7.10-P6",
        "Jet damping without spin, l/k = sqrt 3, 0.01 of the mass a second until 0.7 are burnt",
        (jet_damping_ratio, SpinningRocket),
        {"lever": 3.0**0.5, "rate": 0.01, "burnt": 0.7},
        slowed,
        {
            "t of burnout (s)": 70.0,
            "w/w0 at 35 s": 0.4225,
            "w/w0 at burnout": 0.09,
            "angle turned over w0 (s)": 32.43333333333334,
        },
        1e-12,
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

"""Thomson, chapter 8: vertical flight, impulsive and finite burns, the gravity turn."""

import jax
import jax.numpy as jnp

from jaxspace import Scene, simulate
from jaxspace.optimization.ascent import (
    Ascent,
    ConstantMassFlow,
    ConstantThrustAcceleration,
    apex,
    burnout_state,
)
from jaxspace.optimization.steering import linear_tangent_steering
from jaxspace.rockets import GravityTurn, GravityTurnState
from jaxspace.rockets.rocket_equation import (
    coast_height,
    vertical_burnout_height,
    vertical_burnout_velocity,
)
from jaxspace.rockets.variable_mass import jet_engine_thrust, variable_mass_acceleration
from jaxspace.scene import Custom

from .case import DEG, MILE, STEPS, Case, vec
from .motions import fly, near_ground

G = 32.2  # ft/s^2
R = 3960.0 * MILE


def burn_time(impulse, thrust_ratio, mass_ratio):
    """Time in which the propellant burns at a constant thrust, I (1 - 1 / mu) / ratio."""
    return impulse / thrust_ratio * (1.0 - 1.0 / mass_ratio)


def burnout_speed(impulse, thrust_ratio, mass_ratio):
    time = burn_time(impulse, thrust_ratio, mass_ratio)
    return vertical_burnout_velocity(impulse * G, mass_ratio, time, G)


def burnout_height(impulse, thrust_ratio, mass_ratio):
    time = burn_time(impulse, thrust_ratio, mass_ratio)
    return vertical_burnout_height(impulse * G, mass_ratio, time, G)


def stage(u, mu, t):
    """Speed and height at burnout; coast, total and total in miles under inverse-square gravity;
    coast and total under constant gravity; acceleration before burnout."""
    v, h = vertical_burnout_velocity(u, mu, t, G), vertical_burnout_height(u, mu, t, G)
    far, near = coast_height(v, h, G, R), coast_height(v, h, G)
    rate, exhaust = (1.0 - 1.0 / mu) / t, vec(0.0, 0.0, v - u)[:, None]
    burnt = vec(0.0, 0.0, v), vec(0.0, 0.0, -G / mu), vec(-rate), exhaust
    before = variable_mass_acceleration(1.0 / mu, *burnt)[2]
    return v, h, far, h + far, (h + far) / MILE, near, h + near, before


def single_stage(I, ratio, mu):
    time = burn_time(I, ratio, mu)
    return time, *stage(I * G, mu, time)


def weighed_stage(u, weight, burnout_weight, t):
    """The stage, and its thrust."""
    rate = (weight - burnout_weight) / G / t
    return *stage(u, weight / burnout_weight, t), jet_engine_thrust(0.0, rate, u, 0.0)


def coasts(v):
    """From the surface under constant and inverse-square gravity, and from 50 miles."""
    near, far = coast_height(v, 0.0, G), coast_height(v, 0.0, G, R)
    return near, near / MILE, far, far / MILE, coast_height(v, 50.0 * MILE, G, R)


def sensitivities(I, ratio, mu):
    """Slopes, changes by 50 s less and by a mass ratio of one more, and what the slopes say."""
    at = vec(I, ratio, mu)
    slopes = jax.grad(lambda x: burnout_speed(*x))(at)
    ends = burnout_speed(250.0, ratio, mu), burnout_speed(I, ratio, 6.0)
    changes = (end - burnout_speed(I, ratio, mu) for end in ends)
    return *slopes, *ends, *changes, (250.0 - I) * slopes[0], (6.0 - mu) * slopes[2]


def throw(u, w, t):
    """Height halfway and at the end, and the velocity there."""
    r, v = fly(near_ground(G), (0, 0, 0), (u, 0, w), t)
    return r[0, 2], r[1, 2], v[1, 0], v[1, 2]


def impulsive_launch(Y, U, w0, T):
    """One impulse at the start that brings a satellite to the height Y with the velocity U."""
    _, top, u, w = throw(U, w0, T)
    one = jnp.hypot(U, w0)
    # Straight up, and with what is left of the same propellant across at the apex.
    *_, across = split_impulses(0.0, 0.0, (w0, one - w0), (90.0 * DEG, 0.0), T)
    return top / MILE, w, one, jnp.arctan2(w0, U) / DEG, across


def ballistic_tangent(v0, theta0, t, T):
    u, w = v0 * jnp.cos(theta0), v0 * jnp.sin(theta0)
    *_, across, up = throw(u, w, t)
    return up / across, throw(u, w, T)[3]


def impulse_at_start(v0, theta0, Y, gain, phi, T):
    """All fuel at the start: height, climb and velocity at the time T."""
    u = v0 * jnp.cos(theta0) + gain * jnp.cos(phi)
    w = v0 * jnp.sin(theta0) + gain * jnp.sin(phi)
    _, top, across, up = throw(u, w, T)
    return top, up, across


def split_impulses(v0, theta0, gains, angles, T):
    """Fuel at the start and at the time T, which is too short for one impulse."""
    (first, last), (phi0, phiT) = gains, angles
    u = v0 * jnp.cos(theta0) + first * jnp.cos(phi0)
    w = v0 * jnp.sin(theta0) + first * jnp.sin(phi0)
    _, top, across, up = throw(u, w, T)
    return top, up + last * jnp.sin(phiT), across + last * jnp.cos(phiT)


def steered(ascent):
    """Angle at the start, time at which it vanishes, and final velocity of the best steering."""
    best = linear_tangent_steering(ascent)
    angle = best.initial_angle
    return angle, angle / DEG, best.vanishing_time, best.final_velocity


def finite_burn(burns, angles, times, v0, theta0, Y, gain):
    """Linear-tangent burns of several durations from a given release: height and velocity."""
    heights, ends, velocities = [], [], []
    for burn, phi0, T in zip(burns, angles, times, strict=True):
        ascent = Ascent(ConstantThrustAcceleration(gain / burn), burn, v0, 0.0, Y, G)

        def steering(t, phi0=phi0, T=T):
            return jnp.arctan((1.0 - t / T) * jnp.tan(phi0))

        end = burnout_state(ascent, jnp.asarray(theta0), steering)
        time, height = apex(ascent, end)
        heights.append(height)
        ends.append(time)
        velocities.append(end.u)
    return jnp.stack(velocities), jnp.stack(ends), jnp.stack(heights)


def turned(n, g, v0, psi0, t, rate=0.0):
    """Speed, angle from the vertical, range and height of a gravity turn at the time t."""
    start = v0 * vec(jnp.sin(psi0), 0.0, jnp.cos(psi0))
    r, v = fly(near_ground(g, thrust=n * g, rate=rate), (0, 0, 0), start, t)
    speed = jnp.hypot(v[1, 0], v[1, 2])
    return speed, jnp.arctan2(v[1, 0], v[1, 2]) / DEG, r[1, 0], r[1, 2]


def turned_with_constant(n, g, **given):
    """The gravity turn, and the constant of 8.5-7 there."""
    v, psi, x, y = turned(n, g, **given)
    there = GravityTurnState(v, psi * DEG, x, y)
    constant = GravityTurn(n, g).invariants(0.0, there)["C"]
    # The system keeps 1/C for n > 1, which is finite on a vertical path.
    return v, psi, x, y, 1.0 / constant if n > 1.0 else constant


def slopes_of_turn(**given):
    """State, and its derivatives by the initial angle per rad."""
    psi0 = jnp.asarray(given.pop("psi0"))
    state, slope = jax.jvp(lambda psi: turned(psi0=psi, **given), (psi0,), (jnp.ones(()),))
    return *state, state[1] * DEG, slope[1] * DEG, slope[0], slope[3]


def horizontal(angles, times):
    """Speed, path angle and height at 90 deg for several initial angles."""
    found = [turned(1.5, G, 400.0, a * DEG, t) for a, t in zip(angles, times, strict=True)]
    speed, psi, _, height = (jnp.stack(x) for x in zip(*found, strict=True))
    return speed, psi, height


VERTICAL = (vertical_burnout_velocity, vertical_burnout_height)
STAGED = (*VERTICAL, coast_height, variable_mass_acceleration)
FLOWN = (simulate, Scene, Custom)
# In ft and s, and in m and s.
ASCENTS = {
    "T8.3-A": Ascent(ConstantThrustAcceleration(96.6), 160.0, 3000.0, 0.0, 600000.0, G),
    "T8.3-C": Ascent(ConstantMassFlow(3300.0, 260.0), 230.0, 800.0, 40000.0, 250000.0, 9.80665),
}
STAGE = {"I": 300.0, "ratio": 2.0, "mu": 5.0}
FIGURE = [
    (I, ratio, 1 / f) for I in (200, 300, 400) for ratio in (1.5, 3) for f in (0.05, 0.1, 0.2, 0.5)
]


def gravity_row(id, n, psi0, psi, expected, g=G, v0=400.0):
    """A row of T8.5 with a constant thrust over weight; `expected`: v, t, x, y, C."""
    v, t, x, y, C = expected
    return Case(
        id,
        f"Gravity turn with F / m g = {n}, from {psi0} to {psi} deg",
        (*FLOWN, GravityTurn),
        {"n": n, "g": g, "v0": v0, "psi0": psi0 * DEG, "t": t},
        turned_with_constant,
        {"v": v, "psi (deg)": psi, "x": x, "y": y, "C": C},
        1e-11,
        why=STEPS,
    )


CASES = [
    Case(
        "T8.1-P3",
        "Burnout height for I = 150, 300, 400 s",
        VERTICAL[1:],
        {"impulses": (150.0, 300.0, 400.0)},
        lambda impulses: tuple(burnout_height(I, 2.0, 4.0) for I in impulses),
        {
            "150 s (ft)": 95199.81067107993,
            "300 s (ft)": 380799.24268431973,
            "400 s (ft)": 676976.4314387908,
        },
        1e-11,
    ),
    Case(
        "T8.1-P5",
        "Single stage, I = 300 s, thrust over weight 2, mass ratio 5",
        STAGED,
        STAGE,
        single_stage,
        {
            "t (s)": 120.0,
            "v (ft/s)": 11683.170234113408,
            "h (ft)": 460944.89297659765,
            "coast (ft)": 2469881.4417636762,
            "h_max (ft)": 2930826.3347402737,
            "h_max (mi)": 555.080745215961,
            "coast, constant g (ft)": 2119510.3527837503,
            # The sum of two numbers of the case.
            "h_max, constant g (ft)": 2580455.245760348,
            "acceleration before burnout (ft/s^2)": 289.8,
        },
        1e-11,
    ),
    Case(
        "T8.1-P4",
        "Single stage, I = 250 s, thrust over weight 3, mass ratio 1 / 0.22",
        STAGED,
        {"I": 250.0, "ratio": 3.0, "mu": 4.545454545454546},
        single_stage,
        {
            "t (s)": 65.0,
            "v (ft/s)": 10095.728247669695,
            "h (ft)": 231767.4821260557,
            "coast (ft)": 1752036.0916420228,
            "h_max (ft)": 1983803.5737680786,
            "h_max (mi)": 375.7203738197119,
            "coast, constant g (ft)": 1582666.5970620466,
            # The sum of two numbers of the case.
            "h_max, constant g (ft)": 1814434.0791881024,
            "acceleration before burnout (ft/s^2)": 406.89090909090913,
        },
        1e-11,
    ),
    Case(
        "T8.1-P9",
        "Coast from 8500 ft/s",
        (coast_height,),
        {"v": 8500.0},
        coasts,
        {
            "constant g (ft)": 1121894.4099378882,
            "constant g (mi)": 212.4800018821758,
            "from the surface (ft)": 1185504.511139464,
            "from the surface (mi)": 224.5273695339894,
            "from 50 mi (ft)": 1216501.3762802414,
        },
        1e-12,
    ),
    Case(
        "T8.1-P13",
        "10,000 lb, of which 2000 are left after 55 s",
        (*STAGED, jet_engine_thrust),
        {"u": 7500.0, "weight": 10000.0, "burnout_weight": 2000.0, "t": 55.0},
        weighed_stage,
        {
            "v (ft/s)": 10299.784343255753,
            "h (ft)": 197824.2152802334,
            "coast (ft)": 1823644.1341129576,
            "h_max (ft)": 2021468.349393191,
            # The same in miles.
            "h_max (mi)": 2021468.349393191 / MILE,
            "coast, constant g (ft)": 1647291.2658008747,
            "h_max, constant g (ft)": 1845115.481081108,
            "acceleration before burnout (ft/s^2)": 513.2545454545455,
            "thrust (lb)": 33879.164313946916,
        },
        1e-11,
    ),
    Case(
        "T8.1-P7",
        "Sensitivities of the speed at burnout",
        VERTICAL[:1],
        STAGE,
        sensitivities,
        {
            "dv/dI (ft/s^2)": 38.94390078037803,
            "dv/dR (ft/s)": 1932.0,
            "dv/dmu (ft/s)": 1738.8,
            "v at I = 250 s (ft/s)": 9735.975195094506,
            "v at mu = 6 (ft/s)": 13283.39647274301,
            "change to 250 s (ft/s)": -1947.1950390189013,
            "change to mu = 6 (ft/s)": 1600.2262386296024,
            "by the slope (ft/s)": -1947.1950390189015,
            "by the slope in mu (ft/s)": 1738.8000000000002,
        },
        1e-11,
    ),
    Case(
        "T8.1-P11",
        "I doubled by twice the time of burning",
        VERTICAL,
        STAGE,
        lambda I, ratio, mu: (
            burnout_speed(2.0 * I, ratio, mu) / burnout_speed(I, ratio, mu),
            burnout_height(2.0 * I, ratio, mu) / burnout_height(I, ratio, mu),
        ),
        {"ratio of speeds": 2.0, "ratio of heights": 4.0},
        1e-12,
    ),
    Case(
        "T8.1-P12",
        "Mass ratio doubled from 5 to 10",
        VERTICAL[1:],
        STAGE,
        lambda I, ratio, mu: (burnout_height(I, ratio, 2 * mu) / burnout_height(I, ratio, mu),),
        {"ratio of heights": 1.4687936244464175},
        1e-12,
    ),
    Case(
        "T8.1-Fig2",
        "Speed at burnout for I = 200, 300, 400 s, two thrusts and four mass fractions",
        VERTICAL[:1],
        {"rows": FIGURE},
        lambda rows: (burnout_speed(*vec(*zip(*rows, strict=True))),),
        {
            "v (ft/s)": [
                *(15213.849175021036, 10964.647998881657, 6930.113489408939, 2317.2011761393815),
                *(17253.18250835437, 12896.647998881659, 8647.446822742275, 3390.534509472715),
                *(22820.773762531553, 16446.971998322482, 10395.170234113408, 3475.8017642090717),
                *(25879.77376253155, 19344.971998322486, 12971.17023411341, 5085.801764209072),
                *(30427.698350042072, 21929.295997763315, 13860.226978817878, 4634.402352278763),
                *(34506.36501670874, 25793.295997763318, 17294.89364548455, 6781.06901894543),
            ]
        },
        1e-11,
    ),
    Case(
        "T8.3-A",
        "Greatest velocity at a height of 600,000 ft by a constant acceleration",
        (linear_tangent_steering,),
        {"ascent": ASCENTS["T8.3-A"]},
        steered,
        {
            "theta_0 (rad)": 0.6057846797556328,
            "theta_0 (deg)": 34.70890544368192,
            "T (s)": 256.3883440339024,
            "U (ft/s)": 16378.893311515902,
        },
        1e-10,
    ),
    Case(
        "T8.3-C",
        "Greatest velocity at a height of 250 km by a constant mass flow",
        (linear_tangent_steering,),
        {"ascent": ASCENTS["T8.3-C"]},
        steered,
        {
            "theta_0 (rad)": 0.6930309567107773,
            "theta_0 (deg)": 39.7077488914412,
            "T (s)": 355.2864646235237,
            "U (m/s)": 7038.150097083682,
        },
        1e-10,
    ),
    Case(
        "T8.4-P2",
        "Ballistic flight: tangent of the path after 20 s, and the time of the apex",
        FLOWN,
        {"v0": 2000.0, "theta0": 50 * DEG, "t": 20.0, "T": 47.58040019372534},
        ballistic_tangent,
        {"tangent": 0.6908105203451572, "climb at T (ft/s)": 0.0},
        1e-11,
        atol=1e-9,
        why=STEPS,
    ),
    Case(
        "T8.4-P5",
        "Satellite at 300 mi by one impulse",
        FLOWN,
        {"Y": 300.0, "U": 22000.0, "w0": 10099.98019800039, "T": 313.66398130435994},
        impulsive_launch,
        {
            "Y (mi)": 300.0,
            "climb at T (ft/s)": 0.0,
            "V_k (ft/s)": 24207.635159180667,
            "phi_0 (deg)": 24.65938247810715,
            "velocity across by two impulses (ft/s)": 14107.654961180277,
        },
        1e-11,
        atol=1e-8,
        why=STEPS,
    ),
    Case(
        "T8.4-P8",
        "Impulses at the start and at a prescribed time of 120 s",
        FLOWN,
        {
            **{"v0": 3000.0, "theta0": 30 * DEG, "T": 120.0},
            "gains": (10931.612903225807, 4068.387096774193),
            "angles": (0.351646953029878, -0.3516469530298779),
        },
        split_impulses,
        {"Y (ft)": 400000.0, "climb (ft/s)": 0.0, "U (ft/s)": 16680.17674911243},
        1e-11,
        atol=1e-8,
        why=STEPS,
    ),
    Case(
        "T8.4-split-up-low",
        "Target above: one impulse at the start",
        FLOWN,
        {
            **{"v0": 3000.0, "theta0": 30 * DEG, "Y": 400000.0, "gain": 15000.0},
            **{"phi": 0.24067895642322526, "T": 157.62208124782012},
        },
        impulse_at_start,
        {"Y (ft)": 400000.0, "climb (ft/s)": 0.0, "U (ft/s)": 17165.72163017579},
        1e-11,
        atol=1e-8,
        why=STEPS,
    ),
    Case(
        "T8.4-split-down",
        "Target below: one impulse at the end",
        FLOWN,
        {
            **{"v0": 3000.0, "theta0": 20 * DEG, "gains": (0.0, 15000.0)},
            **{"angles": (0.0, 0.30564490647498105), "T": 172.03988359983938},
        },
        split_impulses,
        {"Y - y_0 (ft)": -300000.0, "climb (ft/s)": 0.0, "U (ft/s)": 17123.87426056051},
        1e-11,
        atol=1e-8,
        why=STEPS,
    ),
    Case(
        "T8.4-finite",
        "Burns of 10, 40 and 160 s with linear-tangent steering",
        (Ascent, burnout_state, apex),
        {
            "burns": (10.0, 40.0, 160.0),
            "angles": (0.2561786146318576, 0.30709441707383994, 0.5700864745693154),
            "times": (161.18064163341128, 172.24069121117267, 218.46891178586966),
            **{"v0": 3000.0, "theta0": 30 * DEG, "Y": 400000.0, "gain": 15000.0},
        },
        finite_burn,
        {
            "U (ft/s)": [17136.969106935663, 17039.03494142279, 16431.319928700537],
            "T (s)": [161.18064163341128, 172.24069121117267, 218.46891178586966],
            "Y (ft)": [400000.0, 400000.0, 400000.0],
        },
        why="quadrature by 64 nodes: the digits of the case",
    ),
    gravity_row(
        "T8.5-n1.5-psi30",
        1.5,
        5,
        30,
        (
            1060.0467238970523,
            37.50607698638997,
            8215.830509523359,
            25397.335791691537,
            1910.6728749490148,
        ),
    ),
    gravity_row(
        "T8.5-n1.5-psi60",
        1.5,
        5,
        60,
        (
            1935.7299119903792,
            71.3784334097903,
            43873.89746603523,
            59052.361665554396,
            1910.6728749490148,
        ),
    ),
    gravity_row(
        "T8.5-n1.5-psi90",
        1.5,
        5,
        90,
        (
            3821.3457498980297,
            117.60349678535023,
            169845.97597072585,
            85749.84636607901,
            1910.6728749490148,
        ),
    ),
    gravity_row(
        "T8.5-n2-psi30",
        2.0,
        5,
        30,
        (
            2626.060208813329,
            65.50597713343448,
            34593.89593610614,
            90582.55115738408,
            9144.075070822948,
        ),
    ),
    gravity_row(
        "T8.5-n2-psi60",
        2.0,
        5,
        60,
        (
            7039.112271506367,
            169.76503933260062,
            399645.63477897295,
            414281.1358134388,
            9144.075070822948,
        ),
    ),
    gravity_row(
        "T8.5-n1.3SI-psi30",
        1.3,
        3,
        30,
        (
            215.18407417820617,
            34.9114206788801,
            1387.2807987002298,
            5148.7138171825945,
            298.045072683335,
        ),
        9.80665,
        100.0,
    ),
    gravity_row(
        "T8.5-n1.3SI-psi90",
        1.3,
        3,
        90,
        (
            596.09014536667,
            80.55081752070686,
            16321.790543594696,
            11430.667167908816,
            298.045072683335,
        ),
        9.80665,
        100.0,
    ),
    gravity_row(
        "T8.5-n1-psi60",
        1.0,
        5,
        60,
        (
            532.3185861577988,
            34.06808427613018,
            5918.399238247284,
            12643.517975011528,
            399.2389396183491,
        ),
    ),
    gravity_row(
        "T8.5-n1-psi90",
        1.0,
        5,
        90,
        (
            798.4778792366982,
            45.01168828635445,
            12767.620655984114,
            14262.60097182663,
            399.2389396183491,
        ),
    ),
    gravity_row(
        "T8.5-n0.5-psi90",
        0.5,
        30,
        90,
        (
            1931.8516525781365,
            73.13146920413288,
            103214.35699256754,
            69689.96695205878,
            965.9258262890683,
        ),
        v0=2000.0,
    ),
    gravity_row(
        "T8.5-retro-psi90",
        -2.0,
        60,
        90,
        (
            1443.3756729740644,
            47.75619724691378,
            139635.38198303324,
            53916.49413388544,
            721.6878364870322,
        ),
        v0=5000.0,
    ),
    Case(
        "T8.5-var2",
        "Gravity turn at constant thrust, F / m g = 1.3 / (1 - t / 150 s), and its derivatives",
        FLOWN,
        {
            **{"n": 1.3, "rate": 1.0 / 150.0, "g": 9.80665},
            **{"v0": 60.0, "psi0": 1 * DEG, "t": 110.0},
        },
        slopes_of_turn,
        {
            "v (m/s)": 1759.7475505738214,
            "psi (deg)": 65.49738518869172,
            "x (m)": 47468.53584943561,
            "y (m)": 38755.1569883828,
            "psi (rad)": 1.143145022989638,
            "dpsi / dpsi_0": 42.14717065708055,
            "dv / dpsi_0 (m/s)": 19842.150847870565,
            "dy / dpsi_0 (m)": -1498987.6864175946,
        },
        why=STEPS,
    ),
    Case(
        "T8.5-P2",
        "Initial angles of 1, 2, 5 and 10 deg: speed and height where the path is horizontal",
        FLOWN,
        {
            "angles": (1.0, 2.0, 5.0, 10.0),
            "times": (294.276106721131, 200.7526228646315, 117.60349678535023, 75.3357178738642),
        },
        horizontal,
        {
            "v (ft/s)": [
                *(8563.034915725386, 6053.366267406037),
                *(3821.3457498980297, 2684.1238304186118),
            ],
            "psi (deg)": [90.0, 90.0, 90.0, 90.0],
            "y (ft)": [
                *(450470.1168204687, 222631.86612657981),
                *(85749.84636607901, 39854.89196218849),
            ],
        },
        1e-11,
        why=STEPS,
    ),
    Case(
        "T8.5-P3",
        "Initial angle doubled from 5 to 10 deg: the state after 30 s",
        FLOWN,
        {"angles": (5.0, 10.0)},
        lambda angles: tuple(
            x * s
            for a in angles
            for x, s in zip(turned(1.5, G, 400.0, a * DEG, 30.0)[:2], (1.0, DEG), strict=True)
        ),
        {
            **{"v_a (ft/s)": 913.1278753257347, "psi_a (rad)": 0.41318226175032735},
            **{"v_b (ft/s)": 991.7808270849149, "psi_b (rad)": 0.7674738379440255},
        },
        1e-10,
        why=STEPS,
    ),
]

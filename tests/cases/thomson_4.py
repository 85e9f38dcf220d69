"""Thomson, chapter 4: gravity, central forces, orbits, changes of orbit, ballistic flight."""

import jax
import jax.numpy as jnp

from jaxspace import Scene, simulate
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.core.vectors import cross, dot, inverse_norm, norm
from jaxspace.mechanics.impact import (
    contact_impulse,
    contact_inverse_mass,
    crushable_pad,
    impact_energy_loss,
)
from jaxspace.orbits import PowerLawForce, SphereGravity
from jaxspace.orbits.ballistic import ballistic_flight, ballistic_impact, longest_range
from jaxspace.orbits.burnout import elements_from_burnout, escape_speed, vis_viva_speed
from jaxspace.orbits.central_force import (
    power_law_potential,
    shell_gravity,
    shell_potential,
    sphere_gravity,
)
from jaxspace.orbits.elements import (
    angular_momentum,
    apoapsis_radius,
    eccentricity_vector,
    elements_from_state,
    periapsis_radius,
    semi_major_axis,
)
from jaxspace.orbits.impulses import small_tangential_impulse, tangential_impulse
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert
from jaxspace.orbits.oblateness import node_regression_rate, oblateness
from jaxspace.orbits.point_gravity import point_gravity, point_gravity_potential
from jaxspace.orbits.radial_motion import (
    circular_rate,
    effective_potential,
    radial_frequency_squared,
    radial_motion,
)
from jaxspace.orbits.secular_rates import secular_rates
from jaxspace.orbits.time_of_flight import period, semi_major_axis_of_period
from jaxspace.orbits.transfers import coaxial_transfer, hohmann_transfer
from jaxspace.orbits.two_masses import from_relative, to_relative

from .case import CLOSED, DEG, LINEAR, MILE, STEPS, Case, vec
from .motions import fly, kepler

G = 32.2  # ft/s^2
R = 3960.0 * MILE
K = 1.407e16  # ft^3/s^2, as most problems have it; g R^2 where g is given
MPH = MILE / 3600.0
X, Y, Z = vec(1, 0, 0), vec(0, 1, 0), vec(0, 0, 1)

elements = jax.jit(elements_from_state)
orbit = jax.jit(orbit_from_radius)
transfer = jax.jit(hohmann_transfer)
burnout = jax.jit(elements_from_burnout)
push = jax.jit(tangential_impulse)
flight = jax.jit(ballistic_flight)
impact = jax.jit(ballistic_impact)


def place(q, e, true_anomaly=0.0, mu=1.0):
    """State on the orbit with the periapsis q, in the plane of x and y."""
    return orbit(q, mu, e, true_anomaly=true_anomaly)


def speed_between(near, far, at, mu=1.0):
    """Speed at the radius `at` of the orbit with these apsides (at one of them)."""
    e = (far - near) / (far + near)
    return norm(place(near, e, 0.0 if at == near else jnp.pi, mu)[1])


def launch(r, lam, beta, mu=1.0):
    """State at the distance r with r v^2 / mu = lam, at the angle beta above the horizontal."""
    v = jnp.sqrt(lam * mu / r)
    return r * X, v * vec(jnp.sin(beta), jnp.cos(beta), 0.0)


def pushed(r, v, gain):
    """The velocity with a tangential impulse."""
    return v * (1.0 + gain / norm(v))


def flat(x):
    """The first two components."""
    return x[:2]


def circle_through_centre(radius, h, r, speed, t):
    """A motion under 8 R^2 h^2 / r^5 on the circle that passes through the centre of force."""
    effect = PowerLawForce(8.0 * radius**2 * h**2, 5.0)
    turn = jnp.arccos(r / (2.0 * radius))
    start = r * vec(jnp.cos(turn), jnp.sin(turn), 0.0)
    radial = (start - radius * X) / radius
    path, _ = fly(effect, start, speed * cross(Z, radial), t)
    return attraction(effect, start), *(norm(p - radius * X) for p in path)


def attraction(effect, position):
    """The force of an effect on a unit mass along its distance from the origin."""
    y = BodyState(position=position, velocity=0.0 * position)
    force = effect.load(0.0, y, RigidBody()).acceleration_N
    return dot(force, position) / norm(position)


def equal_areas(areal_rate, r, t):
    """A circle under h^2 / r^3, on which every circle has the same areal rate."""
    h = 2.0 * areal_rate
    effect = PowerLawForce(h**2, 3.0)
    path, _ = fly(effect, r * X, h / r * Y, t)
    return -attraction(effect, r * X), *(norm(p) for p in path)


def power(n):
    """The potential of the attraction 1 / r^n."""
    return lambda r: power_law_potential(r, 1.0, n)


@jax.jit
def radial(n, inner, outer):
    return radial_motion(power(n), inner, outer)


def apsis(n, inner, outer):
    """Apsidal angle, angular momentum and energy of the motion between two radii."""
    motion = radial(n, inner, outer)
    return motion.apsidal_angle / DEG, motion.angular_momentum, motion.energy


@jax.jit
def change_of_circle(n, r, h, t):
    """First-order change of the radius at t / 2 and t, over that at the start, h kept: 1 / r^n."""
    zero = jnp.zeros(())

    def radius(s):
        start = r * (1.0 + s)
        path, _ = fly(PowerLawForce(1.0, n), start * X, h / start * Y, t)
        return norm(path.T)

    return jax.jvp(radius, (zero,), (zero + 1.0,))[1] / r


def circles(L, exponents):
    """Circles of one angular momentum under r^n: radius, frequency, effective potential."""
    n = jnp.asarray(exponents)
    r = L ** (2.0 / (n + 3.0))
    potential = power(-n)
    rate = circular_rate(potential, r)
    frequency = jnp.sqrt(radial_frequency_squared(potential, r))
    # The potential of a power has its zero at r = 1, here at the centre or at infinity.
    zero = jnp.where(n == -1.0, 0.0, 1.0 / jnp.where(n == -1.0, 1.0, n + 1.0))
    return r * r * rate, frequency, effective_potential(potential, r, L) + zero


def head_on(m1, m2, V1, V2, e):
    """Velocities after a central impact, and the energy that it takes."""
    inverse = 1.0 / m1 + 1.0 / m2
    J = contact_impulse(V1 - V2, inverse, e)
    return V1 - J / m1, V2 + J / m2, impact_energy_loss(V1 - V2, inverse, e)


def dumbbell(v, l, e, m, omega0_ccw=0.0):
    """Two masses m on a light rod along x, of which the left one falls on a ledge."""
    arm, mass, inertia = -0.5 * l * X, 2.0 * m, 0.5 * m * l**2
    # About its own axis any moment of inertia will do.
    tensor = jnp.diag(vec(1.0, inertia, inertia))
    # Turning counterclockwise about z, the left mass moves down.
    J = contact_impulse(v + 0.5 * l * omega0_ccw, contact_inverse_mass(mass, tensor, arm, Y), e)
    v_cm = -v + J / mass
    omega = omega0_ccw + cross(arm, J * Y)[2] / inertia
    return -omega, v_cm, J, v_cm - 0.5 * l * omega, v_cm + 0.5 * l * omega


def tunnel(G_rho, R, a):
    """The field of a uniform sphere, and an oscillation through it."""
    mu = 4.0 / 3.0 * jnp.pi * G_rho * R**3
    period = 5060.568653073561
    r, _ = fly(SphereGravity(mu, R), 0.9 * R * X, (0.0, 0.0, 0.0), period)
    return -sphere_gravity(jnp.asarray(a) * X[:, None], mu, R)[0], r[0, 0] / R, r[1, 0] / R


def power_orbit(K, n, r0, v0, t):
    """State, energy and angular momentum under K / r^n."""
    r, v = fly(PowerLawForce(K, n), (*r0, 0.0), (*v0, 0.0), t)
    energy = 0.5 * dot(v[1], v[1]) - K / (n - 1.0) * norm(r[1]) ** (1.0 - n)
    return flat(r[1]), flat(v[1]), energy, cross(r[1], v[1])[2]


def moon(mass_ratio, days):
    """The Moon's distance by its period, the common centre, the neutral point."""
    pull = G * R**2
    moon_pull = pull * mass_ratio
    D = semi_major_axis_of_period(days * 86400.0, pull + moon_pull)
    centre, _ = to_relative(pull, moon_pull, 0.0 * X, D * X)
    neutral = 0.9 * D * X
    balance = point_gravity(neutral, pull) + point_gravity(neutral - D * X, moon_pull)
    rest = norm(balance) / norm(point_gravity(neutral, pull))
    return D / MILE, norm(centre) / MILE, neutral[0] / MILE, rest


def two_masses(m1, m2, r1, r2, v1, v2, t):
    """Two bodies by their relative orbit and the motion of their centre."""
    m = m1 + m2
    r1, r2, v1, v2 = (vec(*x, 0) for x in (r1, r2, v1, v2))
    centre, r = to_relative(m1, m2, r1, r2)
    drift, v = to_relative(m1, m2, v1, v2)
    apart, _ = kepler(r, v, t, m)
    first, second = from_relative(m1, m2, centre + drift * t, apart)
    a = semi_major_axis(r, v, m)
    again, _ = kepler(r, v, 2.0 * jnp.pi * jnp.sqrt(a**3 / m), m)
    e = norm(eccentricity_vector(r, v, m))
    return flat(first), flat(second), a, e, norm(again - r)


def hohmann(x):
    """Both impulses from a circle to one x times as large, over the circular speed."""
    return transfer(1.0, x, 1.0).total


def hohmann_inwards(r2, r1):
    plan = transfer(r2, r1, K)
    e = (r2 - r1) / (r2 + r1)
    end, _ = kepler(*place(r1, e, jnp.pi, K), plan.duration, K)
    return *-plan.impulses, e, plan.duration, norm(end) / MILE


def coaxial(e1, a1, e2, a2):
    """From the perigee of the inner ellipse to the apogee of the outer one."""
    a1, a2 = a1 * R, a2 * R
    q1, Q2 = a1 * (1.0 - e1), a2 * (1.0 + e2)
    plan = coaxial_transfer(q1, a1 * (1.0 + e1), Q2, a2 * (1.0 - e2), K)
    v_p1, v_a2 = vis_viva_speed(q1, a1, K), vis_viva_speed(Q2, a2, K)
    leave, arrive = plan.impulses
    return v_p1, v_p1 + leave, leave, v_a2, arrive, plan.total


def radial_impulse(beta0):
    r, v = X, Y + jnp.tan(beta0) * X
    x = elements(r, v, 1.0)
    q, Q = periapsis_radius(r, v, 1.0), apoapsis_radius(r, v, 1.0)
    # The time to the apogee is the area over the areal rate.
    rate = 0.5 * norm(angular_momentum(r, v))
    end, _ = kepler(r, v, 1.4122928361164249 / rate, 1.0)
    return x.eccentricity, x.true_anomaly / DEG, q, Q, rate, norm(end)


def turned_apses(e1, a1, theta, gain):
    p = a1 * (1.0 - e1 * e1)
    r = p / (1.0 + e1 * jnp.cos(theta))
    change = push(p, e1, theta, gain / jnp.sqrt(r) / vis_viva_speed(r, a1, 1.0))
    turn = change.true_anomaly
    new = (e1 + change.eccentricity, a1 + change.semi_major_axis, (theta + turn) / DEG)
    return *new, -turn / DEG


def apogee_impulse(h, lam, beta0, gain):
    r, v = launch(R + h, lam, beta0, K)
    x = elements(r, v, K)
    a = semi_major_axis(r, v, K)
    r_a, v_a = place(a * (1.0 - x.eccentricity), x.eccentricity, jnp.pi, K)
    new = pushed(r_a, v_a, gain)
    y = elements(r_a, new, K)
    return (
        *(x.eccentricity, a / R, x.true_anomaly / DEG, norm(v_a)),
        *(y.eccentricity, semi_major_axis(r_a, new, K) / R, jnp.abs(y.true_anomaly) / DEG),
    )


def finite_impulse(lambda1, lambda2, beta):
    speeds = (jnp.sqrt(lam) for lam in (lambda1, lambda2))
    angles = [burnout(1.0, v, beta, 1.0).true_anomaly for v in speeds]
    difference = 1.0 / jnp.tan(angles[1]) - 1.0 / jnp.tan(angles[0])
    return angles[0] / DEG, angles[1] / DEG, difference


def disturbed_circle(r1, t):
    """First-order motion about a circle with the angular momentum kept."""

    def change(t):
        return jax.jvp(lambda r, v: kepler_flow(r, v, t, 1.0), (X, Y), (r1 * X, -r1 * Y))

    (r, v), (dr, dv) = change(jnp.asarray(t, float))
    dh = cross(dr, v) + cross(r, dv)
    outwards = dot(r, dr)
    return outwards, 1.0 - 2.0 * outwards, norm(dh)


def phasing(phi, n):
    """Retro impulse to meet after one revolution; forward impulse, N = 1."""
    found = []
    for periods, sign in ((1.0 - phi / 360.0, -1.0), (n - phi / 360.0, 1.0)):
        other = 2.0 * periods ** (2.0 / 3.0) - 1.0
        v = speed_between(min(other, 1.0), max(other, 1.0), 1.0)
        back, _ = kepler(X, v * Y, 2.0 * jnp.pi * periods, 1.0)
        found += [sign * (v - 1.0), norm(back - X)]
    return found


def straight_transfer(q, phi):
    """Angle from the perigee of a transfer in almost no time."""
    end = q * vec(jnp.cos(phi), jnp.sin(phi), 0.0)
    v, _ = lambert(X, end, 1e-6, 1.0)
    return (elements(X, v, 1.0).true_anomaly / DEG,)


def ballistic(lam, beta0):
    v = jnp.sqrt(lam * K / R)
    x = burnout(R, v, beta0, K)
    phi, height, time = flight(R, v, beta0, K)
    a = x.semi_latus_rectum / (1.0 - x.eccentricity**2) / R
    return x.eccentricity, phi / DEG, phi * R / MILE, a, height / MILE, time


def farthest(lam):
    phi, beta = longest_range(1.0, jnp.sqrt(lam), 1.0)
    return beta / DEG, phi / DEG


def equatorial(v_rel, beta_rel, Omega):
    """Flights to the east and to the west, over ground that turns with Omega."""
    found = []
    for sign in (1.0, -1.0):
        end = impact(R, v_rel, beta_rel, sign * 0.5 * jnp.pi, 0.0, K, Omega)
        found += [end.range_angle / DEG, end.duration]
    return found[0] + Omega * found[1] / DEG, *found


def bulge_moment(a_over_R, theta, phi, ratio):
    """Moment per K m_s / R, on a satellite above a bulge with C = 0.4 m R^2."""
    place = a_over_R * vec(
        jnp.cos(phi), jnp.sin(phi) * jnp.cos(theta), -jnp.sin(phi) * jnp.sin(theta)
    )
    moment = cross(place, oblateness(place, 1.0, 0.4 * ratio, 1.0))
    return (moment,)


def expansion(rho, cosine):
    """(a / r)^3 of a point at the distance rho from the mass centre of a satellite."""
    along = vec(cosine, jnp.sqrt(1.0 - cosine**2), 0.0)

    def cube(s):
        return inverse_norm(X - s * along, 3)

    def slope(s):
        return jax.jvp(cube, (s,), (jnp.ones(()),))[1]

    one, zero = jnp.ones(()), jnp.zeros(())
    first, second = jax.jvp(slope, (zero,), (one,))
    exact = cube(jnp.asarray(rho))
    return exact, 1.0 + rho * first, 1.0 + rho * first + 0.5 * rho**2 * second


ORBIT = (orbit_from_radius,)
FLOWN = (simulate, Scene, PowerLawForce)
POWER = (power_law_potential,)


def node_shift(a, i, mu, j2, radius):
    """Of one revolution on a circle."""
    return (secular_rates(a, 0.0, i, mu, j2, radius).node * 2.0 * jnp.pi * jnp.sqrt(a**3 / mu),)


def regression(a, i, mu, j2, radius, rate):
    """Period, and the turns of node and ground in it."""
    turn = period(a, mu)
    node = node_regression_rate(a, 0.0, i, mu, j2, radius) * turn / DEG
    ground = rate * turn / DEG
    return turn, node, ground, node + ground


CASES = [
    Case(
        "T4.2-1",
        "Landing of 200 lb from 20 ft on a honeycomb of 50 lb/in^2 with 10 g",
        (crushable_pad,),
        {"weight": 200.0, "height": 20.0, "deceleration": 10.0, "strength": 50.0, "gravity": G},
        crushable_pad,
        {"A (in^2)": 44.0, "crush (ft)": 2.0, "t (s)": 0.11145564251507056},
        1e-13,
    ),
    Case(
        "T4.2-2",
        "Central impact with restitution",
        (contact_impulse, impact_energy_loss),
        {"m1": 3.0, "m2": 5.0, "V1": 7.0, "V2": -2.0, "e": 0.6},
        head_on,
        {"v1 (m/s)": -2.0, "v2 (m/s)": 3.4, "energy loss (J)": 48.6},
        1e-13,
    ),
    Case(
        "T4.4-1",
        "A dumbbell that falls flat with its left mass on a ledge",
        (contact_impulse, contact_inverse_mass),
        {"v": 6.0, "l": 1.2, "e": 0.7, "m": 2.0},
        dumbbell,
        {
            "theta' (rad/s)": 8.5,
            "v_cm (m/s)": -0.9,
            "impulse (N s)": 20.4,
            "v_left (m/s)": 4.2,
            "v_right (m/s)": -6.0,
        },
        1e-13,
    ),
    Case(
        "T4.4-P6",
        "The same dumbbell, which turns at 0.2 rad/s before",
        (contact_impulse, contact_inverse_mass),
        {"v": 6.0, "l": 1.2, "e": 0.7, "m": 2.0, "omega0_ccw": 0.2},
        lambda **given: dumbbell(**given)[:1],
        {"theta', clockwise (rad/s)": 8.47},
        1e-13,
    ),
    Case(
        "T4.3-10",
        "Potential energy of a slug at 400 miles",
        (point_gravity_potential,),
        {"h": 400 * MILE},
        lambda h: (
            point_gravity_potential((R + h) * X, G * R**2)
            - point_gravity_potential(R * X, G * R**2),
        ),
        {"U (ft lbf)": 61767280.73394495},
    ),
    Case(
        "T4.4-P1",
        "Speed of a meteor from rest at infinity",
        (point_gravity_potential,),
        {},
        lambda: (jnp.sqrt(-2.0 * point_gravity_potential(R * X, G * R**2)),),
        {"v (ft/s)": 36695.05034742424},
    ),
    Case(
        "T4.5-P1",
        "Equal areal rate on all circles: attraction h^2 / r^3",
        FLOWN,
        {"areal_rate": 3.0, "r": 2.0, "t": 2.0},
        equal_areas,
        {"f (m/s^2)": 4.5, "halfway (m)": 2.0, "end (m)": 2.0},
        why=STEPS,
    ),
    Case(
        "T4.5-P3",
        "Circle through the centre of force: attraction 8 R^2 h^2 / r^5",
        FLOWN,
        {"radius": 2.0, "h": 5.0, "r": 3.0, "speed": 2.2222222222222223, "t": 0.3},
        circle_through_centre,
        {"F (m/s^2)": -3.292181069958848, "halfway (m)": 2.0, "end (m)": 2.0},
        why=STEPS,
    ),
    Case(
        "T4.5-pow",
        "Central attraction 1 / r^2.5: the state at t = 5",
        FLOWN,
        {"K": 1.0, "n": 2.5, "r0": (1, 0), "v0": (0, 1.1), "t": 5.0},
        power_orbit,
        {
            "r": [-2.0198463686514745, 0.25183171470189836],
            "v": [-0.2744255033108277, -0.5103808739827946],
            "E": -0.06166666666666667,
            "h": 1.1,
        },
        why=STEPS,
    ),
    Case(
        "T4.6-P1",
        "Distance of the Moon, common centre, neutral point at 0.9 of the way",
        (semi_major_axis_of_period, to_relative, point_gravity),
        {"mass_ratio": 1 / 81, "days": 27.32},
        moon,
        {
            "D (mi)": 239069.09137076788,
            "centre (mi)": 2915.4767240337546,
            "neutral point (mi)": 215162.1822336911,
            "balance": 0.0,
        },
        atol=1e-14,
    ),
    Case(
        "T4.6-dyn",
        "Two bodies of masses 3 and 1 whose centre moves",
        (to_relative, from_relative, kepler_flow, semi_major_axis, eccentricity_vector),
        {
            **{"m1": 3.0, "m2": 1.0, "r1": (0.75, 0), "r2": (-2.25, 0)},
            **{"v1": (0.1, 0.225), "v2": (0.1, -0.675), "t": 10.0},
        },
        two_masses,
        {
            "r1": [1.7497604728805087, 0.014772290042572245],
            "r2": [-1.249281418641526, -0.044316870127716734],
            "a": 2.154398563734291,
            "e": 0.3925,
            "gap after the period": 0.0,
        },
        atol=1e-14,
    ),
    Case(
        "T4.11-9",
        "Hohmann transfer: total impulse, equal to that of escape at a ratio of 3.304",
        (hohmann_transfer,),
        {
            "ratios": (1.5, 2.0, 4.0, 8.0, 20.0),
            "escape": 3.3041671317677737,
            "most": 15.581718738763179,
        },
        lambda ratios, escape, most: (
            jnp.stack([hohmann(x) for x in ratios]),
            hohmann(escape),
            *jax.jvp(hohmann, (jnp.asarray(most),), (jnp.ones(()),)),
        ),
        {
            "dv / v_c": [
                *(0.18164495259783678, 0.2844570503761733, 0.4486832980505138),
                *(0.5202200572599405, 0.534731360500452),
            ],
            "at 3.304: sqrt(2) - 1": 0.41421356237309503,
            "greatest": 0.5362583055704092,
            "slope at the greatest": 0.0,
        },
        atol=1e-12,
    ),
    Case(
        "T4.11-10",
        "Constant of the Sun from the Earth's orbit",
        (semi_major_axis,),
        {"K": 4.6780928535673045e21, "r": 490.5e9, "year": 365.25 * 86400.0},
        lambda K, r, year: (semi_major_axis(r * X, 2.0 * jnp.pi * r / year * Y, K),),
        {"a (ft)": 490.5e9},
    ),
    Case(
        "T4.11-P5",
        "Radial impulse on a circular orbit, 20 deg",
        (elements_from_state, periapsis_radius, apoapsis_radius, kepler_flow),
        {"beta0": 20 * DEG},
        radial_impulse,
        {
            "e": 0.36397023426620234,
            "theta0 (deg)": 90.0,
            "r_p": 0.7331538290774993,
            "r_a": 1.5722534602547793,
            "areal rate": 0.5,
            "r where the area to the apogee is swept": 1.5722534602547793,
        },
    ),
    Case(
        "T4.11-P7",
        "Retro rocket at 300 mi, to come down to 100 mi",
        ORBIT,
        {"v_p": 18300 * MPH, "high": R + 300 * MILE, "low": R + 100 * MILE},
        lambda v_p, high, low: (
            speed_between(low, high, high, K) / MPH,
            (v_p - speed_between(low, high, high, K)) / MPH,
            v_p - speed_between(low, high, high, K),
        ),
        {
            "v_new (mph)": 16846.520609676336,
            "dv (mph)": 1453.4793903236653,
            "dv (ft/s)": 2131.769772474709,
        },
    ),
    Case(
        "T4.11-P9",
        "Hohmann transfer inwards, from 3 R to 1.2 R",
        (hohmann_transfer, kepler_flow),
        {"r2": 11880 * MILE, "r1": 4752 * MILE},
        hohmann_inwards,
        {
            "departure (ft/s)": 3655.427238867438,
            "arrival (ft/s)": 4623.121765086922,
            "e": 0.42857142857142855,
            "time (s)": 7705.936550306528,
            "radius then (mi)": 4752,
        },
    ),
    Case(
        "T4.11-P11",
        "Speed of escape from the Sun at the Earth's orbit",
        (escape_speed,),
        {"K": 4.68e21, "r": 490.5e9},
        lambda K, r: (escape_speed(r, K),),
        {"v (ft/s)": 138139.67137408227},
    ),
    Case(
        "T4.12",
        "Transfer between coplanar coaxial ellipses",
        (coaxial_transfer, vis_viva_speed),
        {"e1": 0.2, "a1": 1.5, "e2": 0.3, "a2": 4.0},
        coaxial,
        {
            "v_p1 (ft/s)": 25940.74798221808,
            "v_pt (ft/s)": 30186.902644884005,
            "dv_p1 (ft/s)": 4246.154662665926,
            "v_a2 (ft/s)": 9517.652467044369,
            "dv_a2 (ft/s)": 2551.444164378829,
            "total (ft/s)": 6797.598827044755,
        },
    ),
    Case(
        "T4.13-P1",
        "Tangential impulse at 150 deg",
        (tangential_impulse, vis_viva_speed),
        {"e1": 0.5081941891541355, "a1": 3.3333333333333335, "theta": 150 * DEG, "gain": 0.202},
        turned_apses,
        {
            "e": 0.41556884475897027,
            "a / R": 4.6385462483081605,
            "theta (deg)": 108.37466575266158,
            "turn of the apses (deg)": 41.62533424733842,
        },
    ),
    Case(
        "T4.13-P4",
        "Launch at 400 mi, impulse of 2000 ft/s at the apogee",
        (elements_from_state, semi_major_axis, orbit_from_radius),
        {"h": 400 * MILE, "lam": 1.5, "beta0": 10 * DEG, "gain": 2000.0},
        apogee_impulse,
        {
            "e": 0.5221257197316412,
            "a / R": 2.202020202020202,
            "theta0 (deg)": 29.42540014068281,
            "v_apogee (ft/s)": 9794.976790332053,
            "new e": 0.3070514095314394,
            "new a / R": 2.564360942822572,
            "new theta (deg)": 180.0,
        },
    ),
    Case(
        "T4.13-P6",
        "Launch at the perigee 1.2 R with e = 0.6: 100 deg on",
        (orbit_from_radius, semi_major_axis),
        {"e": 0.6, "q": 1.2, "theta": 100 * DEG},
        lambda e, q, theta: (
            semi_major_axis(*place(q, e, theta), 1.0),
            norm(place(q, e, theta)[0]),
        ),
        {"a / R": 3.0, "r / R": 2.1433090236838757},
    ),
    Case(
        "T4.14-P1",
        "Finite tangential impulse: true anomaly before and after",
        (elements_from_burnout,),
        {"lambda1": 0.7, "lambda2": 0.95, "beta": 20 * DEG},
        finite_impulse,
        {
            "theta1 (deg)": 149.49682177973148,
            "theta2 (deg)": 117.82198382228158,
            "difference of cotangents": 1.1697171630529415,
        },
    ),
    Case(
        "T4.14-P2",
        "At 107.46 deg a tangential impulse leaves e = 0.3",
        (small_tangential_impulse,),
        {"e": 0.3, "theta": 107.4576031237221 * DEG},
        lambda e, theta: (small_tangential_impulse(1.0, e, theta, 1.0).eccentricity,),
        {"de / dv": 0.0},
        atol=1e-14,
    ),
    Case(
        "T4.15-1",
        "Small radial disturbance of a circle",
        (kepler_flow,),
        {"r1": 0.01, "t": 2.0},
        disturbed_circle,
        {"r1": -0.004161468365471424, "theta'": 1.0083229367309428, "change of h": 0.0},
        atol=1e-14,
        why=LINEAR,
    ),
    Case(
        "T4.15-aps",
        "Apsidal angle from r = 0.5 to 1.5 under 1 / r and 1 / r^2.5",
        (radial_motion, *POWER),
        {"inner": 0.5, "outer": 1.5},
        lambda inner, outer: (
            *apsis(1.0, inner, outer),
            apsis(2.0, inner, outer)[0],
            *apsis(2.5, inner, outer)[:2],
        ),
        {
            **{"angle, n = 1 (deg)": 124.29977951580105, "h, n = 1": 0.7861103054761537},
            **{"E, n = 1": 0.5427916441916781, "angle, n = 2 (deg)": 180.0},
            **{"angle, n = 2.5 (deg)": 259.8972093935691, "h, n = 2.5": 0.9254923157692287},
        },
        1e-13,
    ),
    Case(
        "T4.15-unst",
        "Growth about the unit circle under 1 / r^4 with the rate 1: cosh(t)",
        (*FLOWN, radial_frequency_squared),
        {"n": 4.0, "t": 1.5},
        lambda n, t: (
            jnp.sqrt(-radial_frequency_squared(power(n), 1.0)),
            change_of_circle(n, 1.0, 1.0, t),
        ),
        {"rate": 1.0, "change of r at t / 2 and t": [1.2946832846768448, 2.352409615243247]},
        why=LINEAR,
    ),
    Case(
        "H5.8",
        "Gravity of a thin spherical shell with G m = 1 and R = 1",
        (shell_gravity, shell_potential),
        {"x": (0.4, 0.999, 1.001, 1.5)},
        lambda x: (
            shell_potential(jnp.asarray(x), 1.0, 1.0),
            -shell_gravity(jnp.asarray(x) * X[:, None], 1.0, 1.0)[0],
        ),
        {
            "V": [-1, -1, -0.999000999000999, -0.6666666666666666],
            "g": [0, 0, 0.998002996004994, 0.4444444444444444],
        },
        1e-13,
    ),
    Case(
        "H5.11",
        "Gravity of a uniform sphere, and an oscillation in a tunnel, 5060.57 s long",
        (sphere_gravity, SphereGravity, simulate, Scene),
        {"G_rho": 3.68020902e-07, "R": 6371000.0, "a": (1.0e6, 3.0e6, 6371000.0, 1.0e7)},
        tunnel,
        {
            "g (m/s^2)": [
                *(1.5415623494542523, 4.624687048362757),
                *(9.82129372837304, 3.9864278659021326),
            ],
            "half a period (R)": -0.9,
            "a period (R)": 0.9,
        },
        why=STEPS,
    ),
    Case(
        "H5.22",
        "Circles with L = 1.1 under r^n: moment of momentum, frequency, effective potential",
        (circular_rate, radial_frequency_squared, effective_potential, *POWER),
        {"L": 1.1, "exponents": (1.0, -1.0, -2.0, -2.5)},
        circles,
        {
            "r^2 theta'": [1.1, 1.1, 1.1, 1.1],
            "w_r": [2.0, 1.2856486930664501, 0.7513148009015778, 0.36285758522186085],
            "V": [1.1, 0.5953101798043249, -0.4132231404958678, -0.09407898834229624],
        },
        1e-13,
    ),
    Case(
        "H5.24",
        "Apsidal angles of nearly circular orbits under r^n, n = 1, 0, -1, -2, -2.5",
        (radial_motion, *POWER),
        {"exponents": (1.0, 0.0, -1.0, -2.0, -2.5)},
        lambda exponents: (
            jnp.stack([radial(-n, 1.0, 1.0).apsidal_angle for n in exponents]) / DEG,
        ),
        {
            "angle (deg)": [
                *(90.0, 103.92304845413264, 127.27922061357856),
                *(180.0, 254.55844122715712),
            ],
        },
        1e-13,
    ),
    Case(
        "T4.16-P3",
        "Phasing by 40 deg: retro impulse, and forward impulse with N = 1",
        (orbit_from_radius, kepler_flow),
        {"phi": 40.0, "n": 2.0},
        phasing,
        {
            "dv / v_c, retro": 0.041713601124672275,
            "gap, retro": 0.0,
            "dv / v_c, forward": 0.15998759354931014,
            "gap, forward": 0.0,
        },
        atol=1e-13,
    ),
    Case(
        "T4.16-P6",
        "Straight transfer: angle from its perigee",
        (lambert, elements_from_state),
        {"q": 1.3333333333333333, "phi": 50 * DEG},
        straight_transfer,
        {"theta1 (deg)": -7.967128601115746},
    ),
    Case(
        "T4.17",
        "Ballistic flight with R v^2 / K = 0.7 at 35 deg",
        (ballistic_flight, elements_from_burnout),
        {"lam": 0.7, "beta0": 35 * DEG},
        ballistic,
        {
            "e": 0.6240038740158755,
            "phi (deg)": 63.61511699246009,
            "range (mi)": 4396.761252416893,
            "a / R": 0.7692307692307693,
            "H (mi)": 986.9656470022056,
            "time of flight (s)": 1757.9930022037092,
        },
    ),
    Case(
        "T4.17-P2",
        "Greatest range for R v^2 / K = 0.6",
        (longest_range,),
        {"lam": 0.6},
        farthest,
        {"beta (deg)": 32.31153323742385, "phi (deg)": 50.753867050304606},
    ),
    Case(
        "T4.17-P7",
        "Launch from the equator at 20000 ft/s, to the east and to the west",
        (ballistic_impact,),
        {"v_rel": 20000.0, "beta_rel": 30 * DEG, "Omega": 7.29e-05},
        equatorial,
        {
            "inertial angle, east (deg)": 61.33420452478302,
            "ground, east (deg)": 55.2154566215754,
            "time, east (s)": 1464.9149109804155,
            "ground, west (deg)": 45.56226954744208,
            "time, west (s)": 1111.6322224894934,
        },
    ),
    Case(
        "T4.18-7",
        "Moment of the Earth's bulge on a satellite's orbit",
        (oblateness, cross),
        {"a_over_R": 1.5, "theta": 35 * DEG, "phi": 50 * DEG, "ratio": 0.0032},
        bulge_moment,
        {"M": [0.00031370482686647274, -0.0003213440122104169, 0.0]},
        1e-12,
    ),
    Case(
        "T4.18-J2",
        "First-order shift of the node in a revolution",
        (secular_rates,),
        {"a": 1.1, "i": 0.6108652381980153, "mu": 1.0, "j2": 0.00108262668, "radius": 1.0},
        node_shift,
        {"node shift, first order (rad)": -0.006907628967326636},
    ),
    Case(
        "T4.18-P3",
        "Regression in a revolution at 400 miles, and the ground's turn",
        (node_regression_rate, period),
        # J2 = 0.4 (C - A)/C for the uniform earth.
        {
            **{"a": 4360.0 * MILE, "i": 35 * DEG, "mu": 1.407e16, "j2": 0.4 * 0.0032},
            **{"radius": 3960.0 * MILE, "rate": 7.29e-5},
        },
        regression,
        {
            "period (s)": 5850.775543373628,
            "inertial regression (deg)": 0.46707394574665545,
            "earth rotation (deg)": 24.437883947946528,
            "total westward (deg)": 24.904957893693187,
        },
    ),
    Case(
        "T4.18-P2",
        "(a / r)^3: exact, to first and to second order",
        (inverse_norm,),
        {"rho": 0.05, "cosine": 0.3},
        expansion,
        {"exact": 1.0427149132409128, "first order": 1.045, "second order": 1.0429375},
        why=CLOSED,
    ),
]

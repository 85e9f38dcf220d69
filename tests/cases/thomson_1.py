"""Thomson, chapters 1 to 3: vectors, kinematics, motion on the rotating Earth, orientation."""

import jax.numpy as jnp

from jaxspace import Scene, simulate
from jaxspace.core.safe import safe_atan2
from jaxspace.core.vectors import axis, cross, dot, matvec, norm
from jaxspace.orbits.elements import apoapsis_radius
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.point_gravity import point_gravity
from jaxspace.orbits.rotating_earth import local_frame, navigation_rates, plumb_line_deviation
from jaxspace.rotations import MovingFrame, Quaternion, from_euler_angles
from jaxspace.rotations.direction_cosines import cosine_rates
from jaxspace.rotations.moving_frame import instantaneous_centre, path_components, polar_components
from jaxspace.scene import Custom

from .case import DEG, MILE, STEPS, Case, rates, vec
from .motions import fly, kepler, near_ground

G = 32.2  # ft/s^2, as the book has it
R = 3960.0 * MILE
K = G * R**2
UP = vec(0.0, 0.0, 1.0)


def pair(t):
    """The two vectors of T1.P13."""
    return t * vec(2, 0, 0) - t**2 * vec(0, 3, 0), vec(-4, 0, 0) + t * vec(0, 2, 0)


def moving(t):
    """The vector of T1.P15."""
    return t * vec(3, 0, 0) + vec(0, -4, 1)


def curvature(path, t):
    """Velocity, acceleration and radius of curvature."""
    v, a = rates(path, t)
    return v, a, 1.0 / path_components(v, a)[2]


def surface_acceleration(Omega, latitude):
    """The centripetal acceleration of the surface."""
    frame = local_frame(latitude, 0.0, R, Omega)
    return (frame.attitude.rotate_back(frame.acceleration),)


def angle(a, b):
    """Angle between two vectors."""
    return safe_atan2(norm(cross(a, b)), dot(a, b))


def polar(radius, turn):
    """Components along and across the radius of velocity and acceleration at t = 0."""
    return polar_components(radius(0.0), *rates(radius), *rates(turn))


def slot(omega, omegadot, slot_radius, slot_centre, phi, sdot, sddot):
    """Velocity, acceleration and Coriolis acceleration of a point in the slot of a disk."""

    def path(t):
        along = phi + (sdot * t + 0.5 * sddot * t**2) / slot_radius
        place = vec(*slot_centre, 0) + Quaternion.about(2, along).rotate(vec(slot_radius, 0, 0))
        return Quaternion.about(2, omega * t + 0.5 * omegadot * t**2).rotate(place)

    v, a = rates(path)
    along_slot = Quaternion.about(2, jnp.asarray(phi)).rotate(vec(0, sdot, 0))
    return v[:2], a[:2], cross(2.0 * omega * UP, along_slot)[:2]


def pin(b, theta, thetadot, thetaddot, disk_omega, disk_omegadot):
    """Rates of a pin in the slot y = b of a disk, driven by an arm about the disk's centre."""

    def place(t):
        arm = theta + thetadot * t + 0.5 * thetaddot * t**2
        return jnp.stack([b / jnp.tan(arm), b + 0.0 * arm, 0.0 * arm])

    def turned(t):
        return Quaternion.about(2, disk_omega * t + 0.5 * disk_omegadot * t**2).rotate(place(t))

    along = rates(lambda t: norm(place(t)))
    still, turning = rates(place), rates(turned)
    return *along, still[0][:2], still[1][:2], turning[0][:2], turning[1][:2]


def leaning_rod(h, theta):
    """A rod whose foot slides on the floor, on a pin at the height h."""

    def foot(t):
        return -h / jnp.tan(theta + t) * vec(1, 0, 0)

    return (instantaneous_centre(foot(jnp.zeros(())), rates(foot)[0], UP)[:2],)


def crank(R, k, theta):
    """A rod of the length k R between a crank of the length R and a slider on the x axis."""

    def tilt(t):
        return -jnp.arcsin(jnp.sin(theta + t) / k)

    def slider(t):
        return R * (jnp.cos(theta + t) + k * jnp.cos(tilt(t))) * vec(1, 0, 0)

    found = instantaneous_centre(slider(jnp.zeros(())), rates(slider)[0], rates(tilt)[0] * UP)
    return found[:2], norm(found)


def parachutist(height, vx, vz, slope, times):
    """Height above the hillside where it is met, and the distance along it."""
    met = []
    for sign, t in zip((1.0, -1.0), times, strict=True):
        r, _ = fly(near_ground(), (0, 0, height), (sign * vx, 0, vz), t)
        met += [r[1, 2] - r[1, 0] * jnp.tan(slope), jnp.abs(r[1, 0]) / jnp.cos(slope)]
    return met


def polar_satellite(period, latitude, day):
    """Angle west of north of the path of a polar satellite over the turning Earth."""
    rate = 2.0 * jnp.pi / period
    # In units of the radius of the orbit.
    r, v = orbit_from_radius(1.0, rate**2, inclination=0.5 * jnp.pi, true_anomaly=latitude)
    seen = v - cross(2.0 * jnp.pi / day * UP, r)
    return (safe_atan2(-seen[1], norm(seen - seen[1] * axis(1, seen[1]))) / DEG,)


def sounding_rocket(v0, t, latitude, Omega):
    """A launch straight up from the turning Earth, seen from inertial space."""
    r = R * vec(jnp.cos(latitude), 0.0, jnp.sin(latitude))
    v = v0 * r / R + cross(Omega * UP, r)
    top, speed = kepler(r, v, t, K)
    west = Omega * t - safe_atan2(top[1], top[0])
    north = safe_atan2(top[2], norm(top - top[2] * axis(2, top[2]))) - latitude
    climb = dot(top, speed) / norm(top)
    return apoapsis_radius(r, v, K) / MILE, climb, west * R * jnp.cos(latitude), north / DEG


def navigation(lat, latdot, londot, Omega, r, rdot):
    """Angular velocity and acceleration in the axes east, north, up of a moving vehicle."""
    omega, omega_rate = navigation_rates(lat, latdot, londot, Omega)
    frame = MovingFrame(Quaternion.identity(), omega, omega_rate)
    _, _, a = frame.to_inertial(r * UP, rdot * UP, vec(0, 0, 0))
    return omega, a


def look_angles(inclination, phi, h, lat0, psi0):
    """A satellite on a circular orbit, seen from a station on the surface."""
    r, _ = orbit_from_radius(R + h, K, inclination=inclination, true_anomaly=phi)
    # South, east, up: turned about the pole to the station, then down to its latitude.
    station = from_euler_angles(vec(psi0, 0.5 * jnp.pi - lat0, 0.0), "323")
    away = r - R * station.rotate(UP)
    ground = norm(r - r[2] * axis(2, r[2]))
    return (
        safe_atan2(r[2], ground) / DEG,
        safe_atan2(r[1], r[0]) / DEG,
        dot(r, station.rotate(UP)) / norm(r),
        norm(away) / MILE,
        away / norm(away),
        station.rotate_back(away / norm(away)),
    )


def rates_of_cosines(theta, psi, phi, omega):
    """Rates of direction cosines between inertial and body axes."""
    q = from_euler_angles(vec(psi, theta, phi))
    c = cosine_rates(q.matrix(), vec(*omega))
    return c[0, 0], c[1, 0], c[2, 2]


def eastward_shot(v0, theta0, latitude_south, Omega, t):
    """Axes south, east, up; the shot curves towards the equator, which is to the north."""
    field = near_ground(G, -Omega * vec(jnp.cos(latitude_south), 0, jnp.sin(latitude_south)))
    r, _ = fly(field, (0, 0, 0), v0 * vec(0.0, jnp.cos(theta0), jnp.sin(theta0)), t)
    return -r[1, 0], r[1, 2]


def inertial_circle(v, latitude, Omega, period):
    """Half a period and a whole one on a smooth horizontal plane."""
    field = near_ground(spin=Omega * jnp.sin(latitude) * UP)
    r, _ = fly(field, (0, 0, 0), (v, 0, 0), period)
    return 0.5 * norm(r[0]), norm(r[1])


def shot(v0, theta0, t, z=0.0):
    """Height halfway, and range and height of a projectile at the time t."""
    r, _ = fly(near_ground(G), (0, 0, z), v0 * vec(jnp.cos(theta0), 0.0, jnp.sin(theta0)), t)
    return r[0, 2], r[1, 0], r[1, 2]


def bomb(closing, t, drop):
    """Depression of the target at the release, and the height at the end."""
    _, x, end = shot(closing, 0.0, t, drop)
    return safe_atan2(drop - end, x) / DEG, end


SHOT = (simulate, Scene, Custom)
TURNED = (Quaternion,)
CASES = [
    Case(
        "TA-6",
        "Matrix product, column by column",
        (matvec,),
        {
            "a": [[1.0, 2.0, -1.0], [0.0, 3.0, 4.0], [5.0, -2.0, 1.0]],
            "b": [[2.0, 0.0, 1.0], [1.0, -1.0, 3.0], [4.0, 2.0, -2.0]],
        },
        lambda a, b: tuple(matvec(vec(*a), vec(*column)) for column in zip(*b, strict=True)),
        {"c_i1": [0.0, 19.0, 12.0], "c_i2": [-4.0, 5.0, 4.0], "c_i3": [9.0, 1.0, -3.0]},
        1e-13,
    ),
    Case(
        "T1.1",
        "Weight at 400 miles, and K = g R^2",
        (point_gravity,),
        {"h": 400 * MILE},
        lambda h: (norm(point_gravity((R + h) * UP, K)), norm(point_gravity(UP, K))),
        {"g_h (ft/s^2)": 26.56276407709789, "K (ft^3/s^2)": 1.4077128941568e16},
    ),
    Case(
        "T1.P3",
        "Dot product, angle, cross product",
        (dot, cross, norm, safe_atan2),
        {"r1": (4, -3, 1), "r2": (-2, 2, 3)},
        lambda r1, r2: (
            dot(vec(*r1), vec(*r2)),
            angle(vec(*r1), vec(*r2)) / DEG,
            cross(vec(*r1), vec(*r2)),
        ),
        {"dot": -11, "angle (deg)": 121.5482659819298, "cross": [-11, -14, 2]},
    ),
    Case(
        "T1.P10",
        "Angles between the space diagonals of a cube",
        (dot, cross, norm, safe_atan2),
        {},
        lambda: tuple(angle(vec(1, 1, 1), s * vec(1, 1, -1)) / DEG for s in (1.0, -1.0)),
        {"small (deg)": 70.52877936550931, "large (deg)": 109.47122063449069},
    ),
    Case(
        "T1.P11",
        "Area of a triangle",
        (cross, norm),
        {"r1": (3, 4, 0), "r2": (-5, 7, 2)},
        lambda r1, r2: (0.5 * norm(cross(vec(*r1), vec(*r2))),),
        {"area": 21.10094784600919},
    ),
    Case(
        "T1.P13",
        "Rates of the products of r1 = (2t, -3t^2, 0) and r2 = (-4, 2t, 0)",
        (dot, cross),
        {"t": 2.0},
        lambda t: (rates(lambda t: dot(*pair(t)), t)[0], rates(lambda t: cross(*pair(t)), t)[0]),
        {"dot'": -80, "cross'": [0, 0, -32]},
    ),
    Case(
        "T1.P15",
        "Rate of (3t, -4, 1) in a frame that turns with 2t about z",
        TURNED,
        {"t": 0.7},
        # Turned by the difference of the angles, so that the axes are those of the instant.
        lambda t: rates(lambda s: Quaternion.about(2, s**2 - t**2).rotate(moving(s)), t)[:1],
        {"r'": [8.6, 2.94, 0]},
    ),
    Case(
        "T2.3-P1",
        "Path (6t, 4t^2): velocity, acceleration, radius of curvature",
        (path_components,),
        {"t": 1.5},
        lambda t: curvature(lambda t: t * vec(6, 0, 0) + t**2 * vec(0, 4, 0), t),
        {"v (ft/s)": [6, 12, 0], "a (ft/s^2)": [0, 8, 0], "rho (ft)": 50.31152949374527},
    ),
    Case(
        "T2.3-P2",
        "Height and range of a projectile",
        SHOT,
        {"v0": 300.0, "theta0": 35 * DEG, "t": 10.687759683559864},
        shot,
        {"height (ft)": 459.76853339044885, "range (ft)": 2626.4700580972594, "end (ft)": 0.0},
        atol=1e-9,
        why=STEPS,
    ),
    Case(
        "T2.3-P3",
        "The speed 56.745 ft/s at 45 deg just clears a wall 40 ft away",
        SHOT,
        {"v0": 56.74504383644443, "theta0": 45 * DEG, "distance": 40.0},
        lambda v0, theta0, distance: shot(v0, theta0, distance / (v0 * jnp.cos(theta0)))[1:],
        {"distance (ft)": 40, "height of the wall (ft)": 24},
        why=STEPS,
    ),
    Case(
        "T2.3-P4",
        "The throw at 22.86 deg touches the ceiling of a tunnel",
        SHOT,
        {"v0": 80.0, "theta0": 22.861617304082742 * DEG, "t": 1.9304683562633607},
        shot,
        {"ceiling (ft)": 15, "range (ft)": 142.30576824928298, "end (ft)": 0.0},
        atol=1e-9,
        why=STEPS,
    ),
    Case(
        "T2.3-P5",
        "Both elevations, 24.04 and 69.39 deg, hit the same point",
        SHOT,
        {"v0": 500.0, "elevations": (24.04028764555617, 69.39334271689435), "x": 5000.0},
        lambda v0, elevations, x: tuple(
            shot(v0, e * DEG, x / (v0 * jnp.cos(e * DEG)))[2] for e in elevations
        ),
        {"height, flat (ft)": 300.0, "height, steep (ft)": 300.0},
        why=STEPS,
    ),
    Case(
        "T2.3-P7",
        "Radial and transverse components for r = 20 + 10t, theta = 0.2t^2",
        (polar_components,),
        {"t": 2.0},
        lambda t: polar(lambda s: 20.0 + 10.0 * (t + s), lambda s: 0.2 * (t + s) ** 2),
        {"v_r, v_theta (ft/s)": [10, 32.0], "a_r, a_theta (ft/s^2)": [-25.6, 32.0]},
    ),
    Case(
        "T2.4",
        "Point in a circular slot of a turning disk",
        (*TURNED, cross),
        {
            **{"omega": 2.0, "omegadot": 0.5, "slot_radius": 1.5, "slot_centre": (1.0, 0)},
            **{"phi": 50 * DEG, "sdot": 3.0, "sddot": -1.0},
        },
        slot,
        {
            "v (m/s)": [-4.596266658713868, 5.856725658119236],
            "a (m/s^2)": [-19.2353915216972, -18.045763537277107],
            "Coriolis (m/s^2)": [-7.713451316238472, -9.192533317427737],
        },
    ),
    Case(
        "T2.5-P1",
        "Wheel on a moving belt: speed of the top and the rear point",
        (cross,),
        {"R": 2.0, "omega": 2.0, "v_centre": -3.0},
        lambda R, omega, v_centre: tuple(
            vec(v_centre, 0, 0) + cross(omega * UP, R * vec(*place))
            for place in ((0, -1, 0), (0, 1, 0), (1, 0, 0))
        ),
        {"v belt (ft/s)": [1, 0, 0], "v top (ft/s)": [-7, 0, 0], "v right (ft/s)": [-3, 4, 0]},
    ),
    Case(
        "T2.5-P3",
        "Pin in a straight slot, driven by a turning arm; disk still and turning",
        (*TURNED, norm),
        {
            **{"b": 0.5, "theta": 30 * DEG, "thetadot": -3.0, "thetaddot": 4.0},
            **{"disk_omega": -2.0, "disk_omegadot": -4.0},
        },
        pin,
        {
            "r' (ft/s)": 5.196152422706632,
            "r'' (ft/s^2)": 56.07179676972449,
            "v, disk still (ft/s)": [6.0, 0],
            "a, disk still (ft/s^2)": [54.353829072479584, 0],
            "v, disk turning (ft/s)": [7.0, -1.7320508075688772],
            "a, disk turning (ft/s^2)": [52.88972745734183, -29.464101615137753],
        },
    ),
    Case(
        "T2.5-P6",
        "Particle on a spoke with the speed k r",
        TURNED,
        {"k": 0.4, "r": 2.0, "thetadot": 3.0, "thetaddot": -1.0},
        lambda k, r, thetadot, thetaddot: polar(
            lambda t: r * jnp.exp(k * t), lambda t: thetadot * t + 0.5 * thetaddot * t**2
        ),
        {"v_r, v_theta (m/s)": [0.8, 6.0], "a_r, a_theta (m/s^2)": [-17.68, 2.8]},
    ),
    Case(
        "T2.5-P7",
        "Line of sight to an aircraft that passes overhead",
        (safe_atan2, norm),
        {"h": 12000.0, "v": 660.0, "theta": 30 * DEG},
        lambda h, v, theta: (
            *rates(lambda t: safe_atan2(h * jnp.tan(theta) + v * t, h + 0.0 * t)),
            rates(lambda t: norm(jnp.stack([h * jnp.tan(theta) + v * t, h + 0.0 * t, 0.0 * t])))[0],
        ),
        {
            "theta' (rad/s)": 0.04125,
            "theta'' (rad/s^2)": -0.001964795134835945,
            "r' (ft/s)": 330.0,
        },
    ),
    Case(
        "T2.5-P8",
        "Depression of the target where a faster aircraft releases a bomb",
        SHOT,
        {"closing": 150.0, "t": 22.291128503014114, "drop": 8000.0},
        bomb,
        {"depression (deg)": 67.31708881602196, "end (ft)": 0.0},
        atol=1e-9,
        why=STEPS,
    ),
    Case(
        "T2.5-P15",
        "Path of a polar satellite over the turning Earth, at 35 deg of latitude",
        (orbit_from_radius, cross),
        {"period": 120.0, "latitude": 35 * DEG, "day": 1440.0},
        polar_satellite,
        {"angle west of north (deg)": 3.905104769817694},
    ),
    Case(
        "T2.6-P1",
        "Deviation of the plumb line at 45 deg, and where it is greatest",
        (plumb_line_deviation,),
        {"Omega": 7.29e-05, "latitudes": (45.0, 44.95048450279786)},
        lambda Omega, latitudes: tuple(
            plumb_line_deviation(x * DEG, K, R, Omega) / DEG for x in latitudes
        ),
        {"at 45 deg (deg)": 0.09903084648077252, "greatest (deg)": 0.09903099440427672},
    ),
    Case(
        "T2.6-P4",
        "Sounding rocket to 150 miles at 35 deg north, as a Kepler orbit",
        (kepler_flow, apoapsis_radius, cross),
        {
            **{"v0": 7002.2562699083155, "t": 229.0444633307507},
            **{"latitude": 35 * DEG, "Omega": 7.29e-05},
        },
        sounding_rocket,
        {
            "apoapsis (mi)": 4110.0,
            "climb (ft/s)": 0.0,
            "west of the launch site (ft)": 13855.288885662469,
            "change of latitude (deg)": -0.0033979515733525436,
        },
        1e-8,
        # The case states v0 and the time to 1e-8, the arcs to 1e-6 and 1e-4.
        atol=1e-7,
        why="the digits of the case, which comes from an integration",
    ),
    Case(
        "T2.6-P7",
        "Eastward shot at 30 deg south: deviation towards the equator",
        SHOT,
        {
            **{"v0": 1500.0, "theta0": 40 * DEG, "latitude_south": 30 * DEG},
            # The time of flight, by another integration.
            **{"Omega": 7.29e-05, "t": 60.15781859321022},
        },
        eastward_shot,
        {"north (ft)": 151.41351091533758, "end (ft)": 0.0},
        1e-8,
        atol=1e-8,
        why=STEPS,
    ),
    Case(
        "T2.6-acc",
        "Acceleration of a place on the surface at 35 deg, axes south, east, up",
        (local_frame,),
        {"Omega": 7.29e-05, "latitude": 35 * DEG},
        surface_acceleration,
        {"a (ft/s^2)": [-0.052208352157869925, 0, -0.07456125406955232]},
    ),
    Case(
        "T2.6-circ",
        "Inertial circle of a smooth horizontal motion at 45 deg, period 16.93 h",
        SHOT,
        {"v": 10.0, "latitude": 45 * DEG, "Omega": 7.29e-05, "period": 60944.89627103383},
        inertial_circle,
        {"radius (m)": 96996.81497757854, "gap (m)": 0.0},
        atol=1e-5,
        why=STEPS,
    ),
    Case(
        "T3-P6",
        "Instantaneous centre of the rod of a crank and slider",
        (instantaneous_centre,),
        {"R": 2.0, "k": 1.8, "theta": 35 * DEG},
        crank,
        {
            "centre (ft)": [5.050640573547093, 3.5364966023854865],
            "distance (ft)": 6.165693669153877,
        },
    ),
    Case(
        "T3-P7",
        "Instantaneous centre of a rod that leans on a pin",
        (instantaneous_centre,),
        {"h": 4.0, "theta": 40 * DEG},
        leaning_rod,
        {"centre (ft)": [-4.76701437037684, 9.681106501844825]},
    ),
    Case(
        "T3-P8",
        "Parachutist over a hillside, towards uphill and downhill",
        SHOT,
        {
            **{"height": 60.0, "vx": 10.0, "vz": -20.0, "slope": 20 * DEG},
            "times": (2.5381030238997293, 3.667414936860186),
        },
        parachutist,
        {
            **{"gap, uphill (ft)": 0.0, "uphill (ft)": 27.009928222879907},
            **{"gap, downhill (ft)": 0.0, "downhill (ft)": 39.027814582527604},
        },
        atol=1e-11,
        why=STEPS,
    ),
    Case(
        "T3-P11",
        "Satellite seen from a ground station",
        (orbit_from_radius, from_euler_angles),
        {
            **{"inclination": 35 * DEG, "phi": 50 * DEG, "h": 500 * MILE},
            **{"lat0": 20 * DEG, "psi0": 10 * DEG},
        },
        look_angles,
        {
            "latitude (deg)": 26.064650968207165,
            "longitude (deg)": 44.310805811960535,
            "cosine of the arc": 0.8475188508906496,
            "distance (mi)": 2374.051837306718,
            "direction X, Y, Z": [-0.33605707285671216, 0.9066794605233554, 0.2549470526365341],
            "direction S, E, up": [-0.29891522325590575, 0.9512606605139775, -0.07584751191952964],
        },
    ),
    Case(
        "T3-P12",
        "Angular velocity and acceleration in axes east, north, up",
        (navigation_rates, MovingFrame),
        {
            **{"lat": 0.7, "latdot": 0.0002, "londot": 0.0003},
            **{"Omega": 7.292115e-05, "r": 6400000.0, "rdot": 30.0},
        },
        navigation,
        {
            "omega (rad/s)": [-0.0002, 0.0002852258280506468, 0.00024024240077502007],
            "a (m/s^2)": [-0.5979069963010126, 0.4505493612411549, -0.7766641471179336],
        },
    ),
    Case(
        "T3-P15",
        "Rates of direction cosines",
        (from_euler_angles, cosine_rates),
        {"theta": 30 * DEG, "psi": 45 * DEG, "phi": 30 * DEG, "omega": (0.3, -0.7, 1.9)},
        rates_of_cosines,
        {
            "l_Xx' (1/s)": -1.4318912319027588,
            "l_Yx' (1/s)": 0.08838834764831845,
            "l_Zz' (1/s)": -0.3049038105676658,
        },
    ),
]

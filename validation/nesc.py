"""NASA's check-cases of flight through air: spheres, bricks and cannonballs."""

import csv
from itertools import combinations
from pathlib import Path
from typing import NamedTuple, final

import jax.numpy as jnp
import numpy as np

from jaxspace import Accuracy, BodyState, Scene, simulate_batch
from jaxspace.bodies import AbstractBody, AbstractEffect, Load, PrincipalInertia, RigidBody
from jaxspace.bodies.standard_atmosphere import standard_atmosphere
from jaxspace.constants import MU_EARTH, RADIUS_EARTH, ROTATION_RATE_EARTH
from jaxspace.core import NumberField, Scalar, Vector, quantity
from jaxspace.core.vectors import axis, cross, norm, unit
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.orbits.ground_track import GroundPoint, ground_point, position_of
from jaxspace.rotations import Quaternion, from_euler_angles, to_euler_angles
from jaxspace.solvers import DOP853
from jaxspace.vehicles.air_drag import drag_force

from ._row import Row

ABOUT = """## NASA's check-cases of flight through air

NASA/TM-2015-218675, *Check-Cases for Verification of 6-Degree-of-Freedom Flight Vehicle
Simulations*: the trajectories of six NASA simulators, from github.com/nasa/simupy-flight
(`NESC_data`, commit 70754e6). They are works of the US Government; the repository is under the NASA
Open Source Agreement 1.3. `validation/reference/nesc` contains every twentieth row.

*Reference* is the trajectory of the closest simulator, at the time of the largest difference, and
*Allowed* the median difference between two of the simulators over the same thirty seconds. Gravity,
atmosphere, rotation and drag are those of the library; the height above the ellipsoid and the
damping of the brick are defined by a user-defined effect of twenty lines, `AirOverEllipsoid` in
`validation/nesc.py`.

Cases 11 to 16 are not included: they require the model of an F-16 with its control laws, which is
not part of this library. Case 17 has a separate section.
"""
REFERENCE = Path(__file__).parent / "reference" / "nesc"
FOOT, SLUG = 0.3048, 14.593902937206365
# The J2 of the check-cases, which is not that of EGM96.
J2 = 1.08262982e-3
# Radius of the round earth of the cases 4 and 5, m.
ROUND = 20902255.199 * FOOT
CHORDS = np.array([1.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0]) * FOOT  # of the brick, by axis
PLATE = 0.22222 * FOOT**2
SPHERE_AREA = 0.1963495 * FOOT**2


class Case(NamedTuple):
    """What a case differs in, in SI units: the planet, the vehicle, the air and the start."""

    title: str
    round_earth: bool = False
    rate: float = ROTATION_RATE_EARTH
    brick: bool = False
    damped: bool = False
    drag: float = 0.1
    wind: tuple[float, float] = (0.0, 0.0)  # to the east: at sea level, m/s, and per metre
    height: float = 30000.0 * FOOT
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # north, east, down
    heading: float = 0.0
    omega: tuple[float, float, float] = (0.0, 0.0, 0.0)  # against inertial axes, rad/s


TUMBLING = tuple(np.radians([10.0, 20.0, 30.0]))
CANNON = 1000.0 * FOOT
SHEAR = (-20.0 * FOOT, 90.0 / 30000.0)
CASES = {
    "01": Case("a sphere dropped without drag", drag=0.0),
    "02": Case("a tumbling brick", brick=True, drag=0.0, omega=TUMBLING),
    "03": Case("a tumbling brick with damping", brick=True, damped=True, drag=0.0, omega=TUMBLING),
    "04": Case("a sphere, spherical earth at rest", round_earth=True, rate=0.0, omega=TUMBLING),
    "05": Case("a sphere, spherical rotating earth", round_earth=True, omega=TUMBLING),
    "06": Case("a sphere, ellipsoid"),
    "07": Case("a sphere in steady wind", wind=(20.0 * FOOT, 0.0)),
    "08": Case("a sphere in wind shear", wind=SHEAR),
    "09": Case(
        "a cannonball to the east",
        height=0.0,
        velocity=(0.0, CANNON, -CANNON),
        heading=np.pi / 2,
        omega=(0.0, -ROTATION_RATE_EARTH, 0.0),
    ),
    "10": Case("a cannonball to the north", height=0.0, velocity=(CANNON, 0.0, -CANNON)),
}


@final
class AirOverEllipsoid(AbstractEffect):
    """Drag and damping in the standard air over an ellipsoid that turns about the z axis."""

    radius: NumberField = quantity("m", positive=True, doc="equatorial, of the ellipsoid")
    flattening: NumberField = quantity("", doc="of the ellipsoid; none is a sphere")
    rate: NumberField = quantity("rad/s", doc="of the planet and its air")
    drag_area: NumberField = quantity("m^2", doc="C_D A")
    wind: NumberField = quantity("m/s", doc="to the east at sea level")
    shear: NumberField = quantity("1/s", doc="of the wind by the height")
    damping: Vector = quantity("m^4", doc="torque per density, speed and rate, by axis")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        place = ground_point(y.position, self.rate * t, self.radius, self.flattening)
        density = standard_atmosphere(place.altitude).density
        turning = cross(axis(2, y.position[2]), y.position)
        wind = self.wind + self.shear * place.altitude
        w = y.velocity - self.rate * turning - wind * unit(turning)
        torque = density * norm(w) * self.damping * y.omega
        return Load(force_N=drag_force(w, density, self.drag_area), torque_B=torque)


class Course(NamedTuple):
    """Where the runs were: columns (times, runs), in the units of the files."""

    altitudeMsl_ft: np.ndarray
    longitude_deg: np.ndarray
    latitude_deg: np.ndarray
    velocity_ft_s: np.ndarray
    eulerAngle_deg: np.ndarray
    bodyAngularRateWrtEi_deg_s: np.ndarray


def north_east_down(place: GroundPoint, angle: Scalar) -> Quaternion:
    """The attitude of the local axes against the inertial ones, from a place of the ellipsoid and
    the `angle` that the planet has turned."""
    zero = jnp.zeros_like(place.latitude)
    turns = (place.longitude + angle, -(place.latitude + 0.5 * jnp.pi), zero)
    return from_euler_angles(jnp.stack(turns), "321")


def fly(ts: np.ndarray) -> Course:
    """All cases in one batch, to a tolerance of 1e-12."""
    cases = list(CASES.values())

    def of(value) -> jnp.ndarray:
        return jnp.stack([jnp.asarray(value(case), float) for case in cases], -1)

    radius = of(lambda c: ROUND if c.round_earth else RADIUS_EARTH)
    flattening = of(lambda c: 0.0 if c.round_earth else 1.0 / 298.257223563)
    rate = of(lambda c: c.rate)
    start = GroundPoint(0.0 * rate, 0.0 * rate, of(lambda c: c.height))
    position = position_of(start, 0.0, radius, flattening)
    local = north_east_down(start, 0.0 * rate)
    spin = rate * axis(2, rate)
    velocity = local.rotate(of(lambda c: c.velocity)) + cross(spin, position)
    turned = local.then(Quaternion.about(2, of(lambda c: c.heading)))
    y0 = BodyState(position, velocity, turned, of(lambda c: c.omega))
    air = AirOverEllipsoid(
        radius,
        flattening,
        rate,
        of(lambda c: c.drag * SPHERE_AREA),
        *(of(lambda c, k=k: c.wind[k]) for k in (0, 1)),
        # -1 times p b/(2 V), of the dynamic pressure, the plate and the chord.
        of(lambda c: -0.25 * PLATE * CHORDS**2 * c.damped),
    )
    oblate = Oblateness(MU_EARTH, of(lambda c: 0.0 if c.round_earth else J2), RADIUS_EARTH)
    body = RigidBody(of(mass), PrincipalInertia(of(moments)))
    scene = Scene((PointGravity(MU_EARTH), oblate, air), body)
    accuracy = Accuracy(1e-12, method=DOP853())
    run = simulate_batch(scene, y0, ts, accuracy=accuracy, throw=True)
    return course(run.states, ts, radius, flattening, rate)


def course(states: BodyState, ts: np.ndarray, radius, flattening, rate) -> Course:
    """What the files have of states (components, times, runs)."""
    angle = jnp.asarray(ts)[:, None] * rate
    place = ground_point(states.position, angle, radius, flattening)
    local = north_east_down(place, angle)
    moving = states.velocity - cross(rate * axis(2, angle), states.position)
    angles = to_euler_angles(local.inverse().then(states.attitude), "321")
    degrees = (place.longitude, place.latitude, angles, states.omega)
    longitude, latitude, euler, rates = (np.degrees(np.asarray(x)) for x in degrees)
    feet = (np.asarray(x) / FOOT for x in (place.altitude, local.rotate_back(moving)))
    altitude, velocity = feet
    return Course(altitude, longitude, latitude, velocity, euler, rates)


def mass(case: Case) -> float:
    """Of brick or sphere, kg."""
    return (0.155404754 if case.brick else 1.0) * SLUG


def moments(case: Case) -> np.ndarray:
    """Moments of inertia of brick or sphere, kg m^2."""
    brick = [0.00189422, 0.006211019, 0.007194665]
    return np.array(brick if case.brick else [3.6] * 3) * SLUG * FOOT**2


def published(case: str) -> tuple[np.ndarray, dict[str, dict[str, np.ndarray]]]:
    """Times, s, and the columns (times,) of each simulator, by column and simulator."""
    with (REFERENCE / f"atmospheric_{case}.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    simulators = list(dict.fromkeys(line["simulator"] for line in lines))
    table = {name: [line for line in lines if line["simulator"] == name] for name in simulators}
    ts = np.array([float(line["time_s"]) for line in table[simulators[0]]])
    names = [name for name in lines[0] if name not in ("simulator", "time_s")]
    return ts, {
        name: {k: np.array([float(line[name]) for line in some]) for k, some in table.items()}
        for name in names
    }


# What is compared: words, unit, our field with its part, and the column of the files.
PLACE = (
    ("altitude, ft", "altitudeMsl_ft", None, "altitudeMsl_ft"),
    ("longitude, deg", "longitude_deg", None, "longitude_deg"),
    ("speed east, ft/s", "velocity_ft_s", 1, "feVelocity_ft_s_Y"),
    ("speed down, ft/s", "velocity_ft_s", 2, "feVelocity_ft_s_Z"),
)
NORTH = (("latitude, deg", "latitude_deg", None, "latitude_deg"),)
TURNING = (
    ("yaw, deg", "eulerAngle_deg", 0, "eulerAngle_deg_Yaw"),
    ("pitch, deg", "eulerAngle_deg", 1, "eulerAngle_deg_Pitch"),
    ("roll, deg", "eulerAngle_deg", 2, "eulerAngle_deg_Roll"),
    *(
        (f"{name.lower()} rate, deg/s", "bodyAngularRateWrtEi_deg_s", k, f"{column}_{name}")
        for column in ("bodyAngularRateWrtEi_deg_s",)
        for k, name in enumerate(("Roll", "Pitch", "Yaw"))
    ),
)
COMPARED = {"02": TURNING, "03": TURNING, "10": (*PLACE, *NORTH)}


def against(
    ours: np.ndarray, theirs: dict[str, np.ndarray], angle: bool, source: str, **said: str
) -> Row:
    """The row of a course (times,) beside that of the nearest simulator.

    Angles count by their shortest difference. The limit is the median of the distances between two
    simulators, so that one which is far off does not widen it."""
    theirs = {name: x for name, x in theirs.items() if np.all(np.isfinite(x))}

    def apart(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.abs((x - y + 180.0) % 360.0 - 180.0) if angle else np.abs(x - y)

    nearest = min(theirs, key=lambda name: np.max(apart(ours, theirs[name])))
    distance = apart(ours, theirs[nearest])
    at = int(np.argmax(distance))
    pairs = [float(np.max(apart(x, y))) for x, y in combinations(theirs.values(), 2)]
    # Where the simulators are equal, the twelfth digit of what they print.
    rounding = 1e-12 * float(np.max(np.abs(theirs[nearest])))
    return Row(
        ours=float(ours[at]),
        theirs=float(theirs[nearest][at]),
        difference=float(distance[at]),
        allowed=max(float(np.median(pairs)), rounding),
        why=f"the median difference between two of {len(theirs)} simulators",
        source=f"{source}, simulator {nearest}",
        **said,
    )


def rows() -> list[Row]:
    """The rows of the ten cases."""
    ts, _ = published("01")
    flown = fly(ts)
    found = []
    for number, (case, about) in enumerate(CASES.items()):
        _, columns = published(case)
        for words, field, part, column in COMPARED.get(case, PLACE):
            ours = getattr(flown, field)
            ours = (ours if part is None else ours[part])[:, number]
            said = {
                "what": f"{int(case)}: {about.title}",
                "source": f"Atmos_{case}",
                "quantity": words,
            }
            found.append(against(ours, columns[column], column.startswith("euler"), **said))
    return found

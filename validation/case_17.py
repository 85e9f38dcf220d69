"""NASA's check-case 17, two stages to orbit: where the published course differs from the model."""

import math
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import Accuracy, BodyState, Scene, simulate_batch
from jaxspace.bodies import AbstractBody, AbstractEffect, Load, PrincipalInertia
from jaxspace.bodies.inertia import AbstractInertia
from jaxspace.bodies.standard_atmosphere import standard_atmosphere
from jaxspace.constants import MU_EARTH, RADIUS_EARTH, ROTATION_RATE_EARTH
from jaxspace.core import NumberField, Scalar, Vector, quantity
from jaxspace.core.tables import polygon
from jaxspace.core.vectors import axis, cross, norm
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.orbits.ground_track import GroundPoint, position_of
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853

from ._row import JUDGED, Row
from .nesc import FOOT, J2, course, north_east_down, published

ABOUT = """## NASA's check-case 17: two stages to orbit

An unguided rocket is turned by gravity and its fins, coasts for 97 seconds and burns again. The
model is defined in `two-stage_package` of the check-cases; of the published trajectories only that
of simulator 06 is available. With the model of the package, the rocket in jaxspace is 5 percent
higher and its pitch 9 degrees greater at the end of the second burn. The published trajectory was
therefore analysed to determine its model. The frame and gravity agree: the last rows below are
computed with those of jaxspace. Three differences were found:

1. **Reference area.** The aerodynamic forces are those of the package times 1.00980, to nine
   digits: the area is pi (1.5 m)^2, the cross-section of the rocket, instead of 7 m^2 as in the
   package.
2. **Inertia of the propellant.** While a stage burns, the moment contains minus half the rate of
   change of the moment of inertia times the pitch rate. The package does not define such a term,
   and a body whose propellant leaves at rest relative to it does not have it.
3. **Initial velocity.** The initial velocity is 0.1 m/s vertically, instead of 0.1 ft/s along the
   axis as in the package.

With these three changes, jaxspace agrees with the published trajectory to within a thousandth of
the altitude and two tenths of a degree. The case is sensitive because of the coast of 97 seconds,
in which three hundredths of a degree per second become degrees, and because the direction of the
second burn follows the pitch.
"""
EXHAUST = 9.8066  # m/s^2, of the specific impulses of the package
COAST = 96.79  # s
AREA, SECTION = 7.0, math.pi * 1.5**2
LENGTH = 3.0
ANGLES = np.radians(np.arange(-10.0, 11.0, 2.0))
LIFT = np.array([-1.6, -1.0, -0.73, -0.49, -0.24, 0.0, 0.24, 0.49, 0.73, 1.0, 1.6])
DRAG = np.array([0.48, 0.38, 0.31, 0.25, 0.23, 0.21, 0.23, 0.25, 0.31, 0.38, 0.48])
PITCHING = -0.6 / np.radians(20.0)  # C_m by the angle of attack, between -20 and 20 degrees


class Stage(NamedTuple):
    """Of a stage with all above it: thrust, N, specific impulse, s, and, full and empty, mass, kg,
    centre of mass aft of the nose, m, moments about the axis and across it, kg m^2."""

    thrust: float
    impulse: float
    mass: tuple[float, float]
    centre: tuple[float, float]
    axial: tuple[float, float]
    transverse: tuple[float, float]

    @property
    def flow(self) -> float:
        """Mass that leaves, kg/s."""
        return self.thrust / (self.impulse * EXHAUST)

    @property
    def duration(self) -> float:
        """Of the burn, s."""
        return (self.mass[0] - self.mass[1]) / self.flow


FIRST = Stage(
    17e6,
    360.0,
    (314000.0, 134000.0),
    (16.91879, 9.421642),
    (353250.0, 150750.0),
    (33501637.473461, 10886636.572139),
)
SECOND = Stage(
    5e6,
    390.0,
    (99000.0, 19000.0),
    (4.79798, 3.947368),
    (111375.0, 21375.0),
    (941063.762626, 212384.868421),
)


def by_mass(values: tuple[float, float], stage: Stage, mass):
    """Linear between full and empty, as the package interpolates."""
    full, empty = stage.mass
    return values[1] + (values[0] - values[1]) * (mass - empty) / (full - empty)


@final
class StageBody(AbstractBody):
    """A stage, whose moments are linear in its mass; the mass is a part of the state."""

    stage: Stage = eqx.field(static=True)

    def constant_mass(self) -> Scalar | None:
        return None

    def loaded_mass(self) -> Scalar | None:
        return None

    def has_inertia(self) -> bool:
        return True

    def inertia(self, mass: Scalar | None) -> AbstractInertia:
        across = by_mass(self.stage.transverse, self.stage, mass)
        axial = by_mass(self.stage.axial, self.stage, mass)
        return PrincipalInertia(jnp.stack([axial, across, across]))

    def inertia_per_mass(self, mass: Scalar) -> Vector:
        raise NotImplementedError("No effect of this case asks for it.")

    def centre_of_mass(self, mass: Scalar | None) -> Vector | float:
        # The lever of the air stands in its load.
        return 0.0


@final
class StageForces(AbstractEffect):
    """Thrust along the axis, and the air on a rocket that stays in the plane of the equator."""

    stage: Stage = eqx.field(static=True)
    burns: bool = eqx.field(static=True)
    area: NumberField = quantity("m^2", doc="of reference")
    share: NumberField = quantity("", doc="of the rate of the inertia times the rate, as a torque")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        stage = self.stage
        spin = ROTATION_RATE_EARTH * axis(2, y.position[2])
        w = y.attitude.rotate_back(y.velocity - cross(spin, y.position))
        density = standard_atmosphere(norm(y.position) - RADIUS_EARTH).density
        pressure = 0.5 * density * (w[0] ** 2 + w[2] ** 2) * self.area
        attack = jnp.arctan2(w[2], w[0])
        lift, drag = (pressure * polygon(attack, ANGLES, jnp.asarray(c)) for c in (LIFT, DRAG))
        sine, cosine = jnp.sin(attack), jnp.cos(attack)
        ahead, down = lift * sine - drag * cosine, -drag * sine - lift * cosine
        # The centre of mass moves ahead of the point of reference, where it starts.
        lever = stage.centre[0] - by_mass(stage.centre, stage, y.mass)
        moment = pressure * LENGTH * PITCHING * attack + lever * down
        zero = 0.0 * ahead
        rate = zero
        if self.burns:
            ahead = ahead + stage.thrust
            rate = rate - stage.flow
            moment = moment - self.share * inertia_rate(stage) * y.omega[1]
        force = y.attitude.rotate(jnp.stack([ahead, zero, down]))
        torque = jnp.stack([zero, moment, zero])
        return Load(force_N=force, torque_B=torque, mass_rate=rate)


def inertia_rate(stage: Stage) -> float:
    """Rate of the transverse moment while the stage burns, kg m^2/s."""
    return (stage.transverse[1] - stage.transverse[0]) / stage.duration


class Variant(NamedTuple):
    """How the rocket is flown."""

    title: str
    area: float = AREA
    share: float = 0.0
    climbs: bool = False


VARIANTS = (
    Variant("17: two stages to orbit, model of the package"),
    Variant("17, with the cross-section as reference area", SECTION),
    Variant("17, also with the inertia term of the propellant", SECTION, 0.5),
    Variant("17, also with the published initial velocity", SECTION, 0.5, True),
)


def start() -> BodyState:
    """At sea level on the equator, heading east at 55.22 degrees; a run of each variant."""
    zero = np.zeros(len(VARIANTS))
    place = GroundPoint(*(jnp.asarray(zero) for _ in range(3)))
    position = position_of(place, 0.0, RADIUS_EARTH)
    local = north_east_down(place, jnp.asarray(zero))
    pitch = jnp.full(len(VARIANTS), np.radians(55.22))
    attitude = local.then(Quaternion.about(2, jnp.full_like(pitch, 0.5 * np.pi)))
    attitude = attitude.then(Quaternion.about(1, pitch))
    spin = ROTATION_RATE_EARTH * axis(2, pitch)
    along = attitude.rotate(axis(0, pitch)) * (0.1 * FOOT)
    upwards = axis(0, pitch) * 0.1
    climbs = np.array([variant.climbs for variant in VARIANTS])
    velocity = cross(spin, position) + jnp.where(climbs, upwards, along)
    return BodyState(
        position, velocity, attitude, attitude.rotate_back(spin), jnp.full(4, FIRST.mass[0])
    )


def fly(ts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Altitude, ft, and pitch, deg, at the times, (times, variants)."""
    area, share = (jnp.array([v[k] for v in VARIANTS]) for k in (1, 2))
    y, begin, found = start(), 0.0, []
    burnout = FIRST.duration
    ignition = burnout + COAST
    for stage, burns, end in (
        (FIRST, True, burnout),
        (FIRST, False, ignition),
        (SECOND, True, ignition + SECOND.duration),
    ):
        if stage is SECOND:
            y = eqx.tree_at(lambda y: y.mass, y, 0.0 * y.mass + SECOND.mass[0])
        saved = ts[(ts >= begin) & (ts < end)]
        scene = Scene(
            (
                PointGravity(MU_EARTH),
                Oblateness(MU_EARTH, J2, RADIUS_EARTH),
                StageForces(stage, burns, area, share),
            ),
            StageBody(stage),
        )
        accuracy = Accuracy(1e-10, method=DOP853())
        times = jnp.array([begin, *saved, end])
        run = simulate_batch(scene, y, times, accuracy=accuracy, throw=True)
        states = jax.tree.map(lambda x: x[..., 1:-1, :], run.states)
        rate = jnp.full(len(VARIANTS), ROTATION_RATE_EARTH)
        seen = course(states, saved, RADIUS_EARTH, 1.0 / 298.257223563, rate)
        found.append((seen.altitudeMsl_ft, seen.eulerAngle_deg[1]))
        y, begin = run.final, end
    altitude, pitch = (np.concatenate(x) for x in zip(*found, strict=True))
    return altitude, pitch


def of_published_course(ts: np.ndarray, theirs: dict[str, np.ndarray]) -> list[Row]:
    """What the published course says of its own area and of its moment, in the first burn."""
    burning = (ts > 1.0) & (ts < FIRST.duration)
    north, east, down = (theirs[f"feVelocity_ft_s_{k}"][burning] for k in "XYZ")
    del north
    attack = np.radians(theirs["eulerAngle_deg_Pitch"][burning]) - np.arctan2(-down, east)
    pressure = theirs["dynamicPressure_lbf_ft2"][burning]
    force = theirs["aero_bodyForce_lbf_X"][burning]
    lift, drag = (np.interp(attack, ANGLES, c) for c in (LIFT, DRAG))
    area = force / pressure / (lift * np.sin(attack) - drag * np.cos(attack)) * FOOT**2
    used = FIRST.flow * ts[burning]
    lever = FIRST.centre[0] - by_mass(FIRST.centre, FIRST, FIRST.mass[0] - used)
    air = pressure * SECTION / FOOT**2 * LENGTH / FOOT * PITCHING * attack
    air = air + lever / FOOT * theirs["aero_bodyForce_lbf_Z"][burning]
    rest = theirs["aero_bodyMoment_ftlbf_M"][burning] - air
    rate = np.radians(theirs["bodyAngularRateWrtEi_deg_s_Pitch"][burning])
    # lbf ft to N m.
    share = -np.sum(rest * rate) / np.sum(rate * rate) * 4.4482216152605 * FOOT
    words = {"source": "Atmos_17, simulator 06"}
    at = int(np.argmax(np.abs(area - SECTION)))
    return [
        Row(
            what="17: published force over coefficient and dynamic pressure",
            quantity="area, m^2, compared with pi (1.5 m)^2",
            ours=SECTION,
            theirs=float(area[at]),
            difference=float(abs(area[at] - SECTION)),
            allowed=1e-6,
            why="the digits of the published trajectory",
            **words,
        ),
        Row(
            what="17: published minus aerodynamic moment, over the pitch rate",
            quantity="fraction of the rate of the inertia, compared with one half",
            ours=0.5,
            theirs=float(share / inertia_rate(FIRST)),
            difference=float(abs(share / inertia_rate(FIRST) - 0.5)),
            allowed=2e-3,
            why=JUDGED + "the residual of a least-squares fit",
            **words,
        ),
    ]


DIFFERS = (
    "the reference area, the inertia term of the propellant and the initial velocity of the "
    "published trajectory differ from those of the package, as described above; the rows below "
    "adopt them one after the other."
)
LIMITS = (
    JUDGED + "one percent and one degree: the spread of simulators is unknown with one "
    "published trajectory"
)


def rows() -> list[Row]:
    """The rows of the four variants at 200 s, then what the course says of itself."""
    ts, columns = published("17")
    ((_, altitude),) = columns["altitudeMsl_ft"].items()
    ((_, pitch),) = columns["eulerAngle_deg_Pitch"].items()
    last = float(FIRST.duration + COAST + SECOND.duration)
    flown = ts < last
    ours = fly(ts[flown])
    found = []
    for k, variant in enumerate(VARIANTS):
        for quantity_, mine, theirs, allowed in (
            ("altitude, ft", ours[0][-1, k], altitude[flown][-1], 1e-2 * altitude[flown][-1]),
            ("pitch, deg", ours[1][-1, k], pitch[flown][-1], 1.0),
        ):
            difference = float(abs(mine - theirs))
            found.append(
                Row(
                    what=variant.title,
                    source="Atmos_17, simulator 06",
                    quantity=f"{quantity_}, at {ts[flown][-1]:.0f} s",
                    ours=float(mine),
                    theirs=float(theirs),
                    difference=difference,
                    allowed=float(allowed),
                    why=LIMITS,
                    note="" if difference <= allowed else DIFFERS,
                )
            )
    theirs = {name: next(iter(column.values())) for name, column in columns.items()}
    return found + of_published_course(ts, theirs)

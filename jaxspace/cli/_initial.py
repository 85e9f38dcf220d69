"""The initial state of a body as a file gives it: vectors or an orbit; an attitude along a
direction, or Euler's angles."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..bodies import BodyState
from ..core import Scalar, Vector, cross, unit
from ..io import Choice, InitialEntry, Key, Lanes, ListOf
from ..orbits import ClassicalElements, state_from_elements
from ..rotations import Quaternion, from_euler_angles
from . import _kinds as kinds
from ._effects import thrust_complaints

Values = dict[str, Any]

ORBIT = {
    "periapsis_radius": Key(kinds.DISTANCE, None),
    "periapsis_altitude": Key(kinds.LENGTH, None),
    "eccentricity": Key(kinds.ECCENTRICITY, 0.0),
    "inclination": Key(kinds.ANGLE, 0.0),
    "node": Key(kinds.ANGLE, 0.0),
    "argument_of_periapsis": Key(kinds.ANGLE, 0.0),
    "true_anomaly": Key(kinds.ANGLE, 0.0),
}
ATTITUDE = {
    "along": Key(Choice(("velocity", "position")), None),
    "lead": Key(kinds.ANGLE, 0.0),
    "tilt": Key(ListOf(kinds.ANGLE, 2), [0.0, 0.0]),
    "angles": Key(ListOf(kinds.ANGLE, 3), None),
}
MOTION = {
    "position": Key(ListOf(kinds.LENGTH, 3), None),
    "velocity": Key(ListOf(kinds.SPEED, 3), None),
    "orbit": Key(ORBIT, None),
}
INITIAL = {**MOTION, "attitude": Key(ATTITUDE, None), "omega": Key(ListOf(kinds.RATE, 3), None)}


def orbit_complaints(initial: Values, planet: Values | None) -> list[str]:
    """What does not fit together in position, velocity and orbit."""
    found, orbit = [], initial["orbit"]
    if orbit is None:
        if (initial["position"] is None) != (initial["velocity"] is None):
            found.append("initial must have position and velocity together, or an orbit.")
        return found
    if initial["position"] is not None or initial["velocity"] is not None:
        found.append(
            "initial has an orbit, and position or velocity as well: it must have one or the other."
        )
    if (orbit["periapsis_radius"] is None) == (orbit["periapsis_altitude"] is None):
        found.append(
            "initial.orbit must have either periapsis_radius or periapsis_altitude, in m or with a unit of length."
        )
    if planet is None:
        found.append("planet.mu is missing: initial.orbit needs it.")
    elif orbit["periapsis_altitude"] is not None and planet["radius"] is None:
        found.append(
            "planet.radius is missing: initial.orbit.periapsis_altitude is counted from it."
        )
    return found


def complaints(values: Values) -> list[str]:
    """What does not fit together in the initial state of a body."""
    initial = values["initial"]
    found = orbit_complaints(initial, values["planet"]) + thrust_complaints(values)
    attitude, there = initial["attitude"], parts(values)
    if attitude is not None and (attitude["along"] is None) == (attitude["angles"] is None):
        found.append(
            "initial.attitude must have either along, a direction, or angles, Euler's angles 3-1-3."
        )
    if attitude is not None and attitude["along"] is not None and "position" not in there:
        found.append(
            f'initial.attitude.along is "{attitude["along"]}": without an orbit there is no such direction.'
        )
    if (attitude is None) != (initial["omega"] is None):
        found.append("initial must have attitude and omega together: a body that turns needs both.")
    if attitude is not None and values["body"]["inertia"] is None:
        found.append("body.inertia is missing: initial.attitude makes the body turn.")
    if not there:
        found.append(
            "initial is empty: it must have an orbit, or position and velocity, or attitude and omega."
        )
    return found


def parts(values: Values) -> set[str]:
    """The parts of the state that the file gives."""
    initial = values["initial"]
    moves = initial["orbit"] is not None or (
        initial["position"] is not None and initial["velocity"] is not None
    )
    turns = initial["attitude"] is not None and initial["omega"] is not None
    return ({"position", "velocity"} if moves else set()) | (
        {"attitude", "omega"} if turns else set()
    )


def motion(initial: Values, planet: Values | None, lanes: Lanes) -> tuple[Vector, Vector]:
    """Position, m, and velocity, m/s."""
    orbit = initial["orbit"]
    if orbit is None:
        return lanes.full(initial["position"]), lanes.full(initial["velocity"])
    assert planet is not None
    radius = orbit["periapsis_radius"]
    radius = planet["radius"] + orbit["periapsis_altitude"] if radius is None else radius
    rest = {k: v for k, v in orbit.items() if not k.startswith("periapsis")}
    elements = ClassicalElements.from_periapsis(radius, **rest)
    return state_from_elements(
        eqx.tree_at(_leaves, elements, [lanes.scalar(x) for x in _leaves(elements)]), planet["mu"]
    )


def _leaves(e: ClassicalElements) -> list[Any]:
    return [
        e.semi_latus_rectum,
        e.eccentricity,
        e.inclination,
        e.node,
        e.argument_of_periapsis,
        e.true_anomaly,
    ]


def pointing(attitude: Values, position: Vector, velocity: Vector, lanes: Lanes) -> Quaternion:
    """The orientation whose z axis lies along a direction, turned in the plane of the orbit by
    `lead` in the sense of the motion, then tilted about the body's x and y; the x axis starts along
    the normal of the orbit."""
    lead = lanes.scalar(attitude["lead"])
    normal = unit(cross(position, velocity))
    along = unit(velocity if attitude["along"] == "velocity" else position)
    z = jnp.cos(lead) * along + jnp.sin(lead) * cross(normal, along)
    straight = Quaternion.from_matrix(jnp.stack([normal, cross(z, normal), z], axis=1))
    return _tilted(straight, *(lanes.scalar(a) for a in attitude["tilt"]))


def _tilted(straight: Quaternion, about_x: Scalar, about_y: Scalar) -> Quaternion:
    return straight.then(Quaternion.about(0, about_x)).then(Quaternion.about(1, about_y))


def build(values: Values, lanes: Lanes) -> BodyState:
    """All parts of the state but the mass."""
    initial, there = values["initial"], parts(values)
    position = velocity = attitude = omega = None
    if "position" in there:
        position, velocity = motion(initial, values["planet"], lanes)
    if "attitude" in there:
        omega = lanes.full(initial["omega"])
        attitude = oriented(initial["attitude"], position, velocity, lanes)
    return BodyState(position, velocity, attitude, omega)


def oriented(attitude: Values, position: Any, velocity: Any, lanes: Lanes) -> Quaternion:
    """The orientation, by a direction or by Euler's angles."""
    if attitude["along"] is not None:
        return pointing(attitude, position, velocity, lanes)
    return _tilted(
        from_euler_angles(lanes.full(attitude["angles"])),
        *(lanes.scalar(a) for a in attitude["tilt"]),
    )


ENTRY = InitialEntry(INITIAL, complaints, parts, build)

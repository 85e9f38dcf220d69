"""What may end a phase, and what may happen then."""

from typing import Any

from ..attitude import YoYo
from ..bodies import BodyState
from ..core import Scalar, dot
from ..io import JumpEntry, Key, Lanes
from . import _kinds as kinds

YO_YO = {
    "radius": Key(kinds.DISTANCE),
    "mass": Key(kinds.MASS),
    "cord_length": Key(kinds.DISTANCE),
    "axial_inertia": Key(kinds.INERTIA, None),
}


def yo_yo(table: dict[str, Any], values: dict[str, Any], lanes: Lanes) -> YoYo:
    """The yo-yo; about the spin axis the body has its own, or its dry, moment of inertia if the
    table gives none."""
    del lanes
    own = table["axial_inertia"]
    return YoYo(
        values["body"]["inertia"][2] if own is None else own,
        table["radius"],
        table["mass"],
        table["cord_length"],
    )


def radial_motion(t: Scalar, y: BodyState) -> Scalar:
    """r . v, m^2/s: zero at both apsides, rising at the periapsis."""
    del t
    return dot(y.position, y.velocity)


def height_over_equator(t: Scalar, y: BodyState) -> Scalar:
    """z, m: zero at the nodes, rising at the ascending one."""
    del t
    return y.position[2]


JUMPS = {"yo_yo": JumpEntry(YO_YO, yo_yo, ("omega", "body.inertia"))}
EVENTS = {
    "periapsis": (radial_motion, 1),
    "apoapsis": (radial_motion, -1),
    "ascending_node": (height_over_equator, 1),
    "descending_node": (height_over_equator, -1),
}

"""The textbook systems that a scene file may name. A new one takes one line in `SYSTEMS`."""

from typing import Any

from ..attitude import Top, TorqueFreeBody
from ..bodies import BodyState, PrincipalInertia
from ..gyros import GimbalState, TwoGimbalGyro
from ..io import Key, Lanes, ListOf, SystemEntry
from ..orbits import TwoBody
from ..rotations import from_euler_angles
from . import _kinds as kinds
from ._initial import MOTION, motion, orbit_complaints

Values = dict[str, Any]


def _parameters(values: Values) -> Values:
    return {k: v for k, v in values["system"].items() if k != "name"}


def top(values: Values, lanes: Lanes) -> tuple[Top, BodyState]:
    """A top from its parameters, Euler's angles 3-1-3 and their rates."""
    initial = values["initial"]
    return Top(**_parameters(values)), Top.state(
        lanes.full(initial["angles"]), lanes.full(initial["rates"])
    )


def two_body(values: Values, lanes: Lanes) -> tuple[TwoBody, BodyState]:
    """Two bodies from position and velocity or an orbit."""
    position, velocity = motion(values["initial"], values["system"], lanes)
    return TwoBody(values["system"]["mu"]), BodyState(position, velocity)


def two_body_complaints(values: Values) -> list[str]:
    """What does not fit together in the initial state of two bodies."""
    initial, found = values["initial"], orbit_complaints(values["initial"], values["system"])
    if initial["orbit"] is None and initial["position"] is None and not found:
        found.append("initial is empty: it must have an orbit, or position and velocity.")
    return [line.replace("planet.radius", "system.radius") for line in found]


def torque_free_body(values: Values, lanes: Lanes) -> tuple[TorqueFreeBody, BodyState]:
    """A free body from its principal moments, Euler's angles 3-1-3 and its angular velocity."""
    initial = values["initial"]
    attitude = from_euler_angles(lanes.full(initial["angles"]))
    inertia = PrincipalInertia(lanes.vector(values["system"]["inertia"]))
    return TorqueFreeBody(inertia), BodyState(attitude=attitude, omega=lanes.full(initial["omega"]))


def two_gimbal_gyro(values: Values, lanes: Lanes) -> tuple[TwoGimbalGyro, GimbalState]:
    """A gyro from its parameters, the angles of its gimbals and their rates."""
    gyro = TwoGimbalGyro(**_parameters(values))
    return gyro, gyro.state(**{k: lanes.scalar(v) for k, v in values["initial"].items()})


def inertia_complaints(values: Values) -> list[str]:
    """What is wrong with the moments of a free body."""
    moments = sorted(values["system"]["inertia"])
    if moments[2] <= (1.0 + 1e-6) * (moments[0] + moments[1]):
        return []
    return [
        f"system.inertia is {values['system']['inertia']}: it must be such that no moment exceeds the sum of the other two."
    ]


ANGLES = Key(ListOf(kinds.ANGLE, 3), [0.0, 0.0, 0.0])
TOP = {
    "transverse_inertia": Key(kinds.INERTIA),
    "axial_inertia": Key(kinds.INERTIA),
    "weight_moment": Key(kinds.MOMENT),
}
GYRO = {
    "transverse_inertia": Key(kinds.INERTIA),
    "axial_inertia": Key(kinds.INERTIA),
    "spin_rate": Key(kinds.RATE),
    **{k: Key(kinds.GIMBAL, 0.0) for k in ("inner_xi", "inner_eta", "inner_zeta", "outer")},
    **{k: Key(kinds.MOMENT, 0.0) for k in ("moment_inner", "moment_outer")},
}
GIMBALS = {
    **{k: Key(kinds.ANGLE, 0.0) for k in ("theta", "psi")},
    **{k: Key(kinds.RATE, 0.0) for k in ("theta_rate", "psi_rate")},
}
SYSTEMS = {
    "top": SystemEntry(TOP, {"angles": ANGLES, "rates": Key(ListOf(kinds.RATE, 3))}, top),
    "two_body": SystemEntry(
        {"mu": Key(kinds.MU), "radius": Key(kinds.DISTANCE, None)},
        MOTION,
        two_body,
        two_body_complaints,
    ),
    "torque_free_body": SystemEntry(
        {"inertia": Key(ListOf(kinds.INERTIA, 3))},
        {"angles": ANGLES, "omega": Key(ListOf(kinds.RATE, 3))},
        torque_free_body,
        inertia_complaints,
    ),
    "two_gimbal_gyro": SystemEntry(GYRO, GIMBALS, two_gimbal_gyro),
}

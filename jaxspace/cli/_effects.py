"""The effects that a scene file may name. A new one takes one line in `EFFECTS`."""

from typing import Any, final

import equinox as eqx

from ..attitude import GravityGradient
from ..core import Scalar
from ..io import EffectEntry, Key, Lanes, ListOf
from ..orbits import Oblateness, PointGravity
from ..rockets import JetDamping, Thrust, ThrustProfile
from . import _kinds as kinds

Values = dict[str, Any]

THRUST = {
    "total_impulse": Key(kinds.IMPULSE),
    "burn_time": Key(kinds.DURATION),
    "specific_impulse": Key(kinds.ISP, None),
    "ignition": Key(kinds.TIME, 0.0),
    "station": Key(kinds.LENGTH, None),
    "offset": Key(ListOf(kinds.LENGTH, 2), [0.0, 0.0]),
    "misalignment": Key(ListOf(kinds.TANGENT, 2), [0.0, 0.0]),
    "profile": Key(
        {
            "times": Key(ListOf(kinds.SHAPE_TIME, least=2)),
            "thrusts": Key(ListOf(kinds.SHAPE_THRUST, least=2)),
        },
        None,
    ),
}
JET_DAMPING = {"exit_station": Key(kinds.LENGTH), "exit_radius": Key(kinds.RADIUS, 0.0)}


@final
class MotorFlow(eqx.Module):
    """How fast a motor takes mass away, kg/s: what its thrust does to the mass, for the effects
    that follow from it."""

    motor: Thrust

    def __call__(self, t: Scalar, mass: Scalar) -> Scalar:
        return -self.motor.thrust(t, mass) / self.motor.exhaust_velocity


def thrust(values: Values, lanes: Lanes) -> Thrust:
    """The motor. The profile gives the shape alone: total impulse and burn time give its size."""
    table = values["effects"]["thrust"]
    impulse, burn_time = table["total_impulse"], table["burn_time"]
    x, y = table["offset"]
    fields = {"ignition": table["ignition"], "misalignment": lanes.vector(table["misalignment"])}
    fields["point"] = None if table["station"] is None else lanes.vector([x, y, table["station"]])
    if table["profile"] is not None:
        fields["profile"], _, _ = ThrustProfile.tabulated(
            table["profile"]["times"], table["profile"]["thrusts"]
        )
    if table["specific_impulse"] is not None:
        return Thrust.of_specific_impulse(
            impulse / burn_time, table["specific_impulse"], burn_time, **fields
        )
    return Thrust.of_motor(impulse, burn_time, values["body"]["propellant_mass"], **fields)


def thrust_complaints(values: Values) -> list[str]:
    """What does not fit together in the table of the thrust."""
    table, found = values["effects"]["thrust"], []
    if table is None:
        return found
    if table["specific_impulse"] is None and values["body"]["propellant_mass"] is None:
        found.append(
            "effects.thrust.specific_impulse is missing: it must be there, or body.propellant_mass, from which it follows."
        )
    if table["profile"] is not None:
        times, thrusts = table["profile"]["times"], table["profile"]["thrusts"]
        if len(times) != len(thrusts):
            found.append(
                f"effects.thrust.profile has {len(times)} times and {len(thrusts)} thrusts: it must have as many."
            )
        if any(b <= a for a, b in zip(times, times[1:], strict=False)):
            found.append(f"effects.thrust.profile.times is {times}: it must ascend.")
        if not any(thrusts):
            found.append(
                "effects.thrust.profile.thrusts is zero throughout: it must have a positive entry."
            )
    return found


def jet_damping(values: Values, lanes: Lanes) -> JetDamping:
    """Jet damping by the motor of the same file."""
    table = values["effects"]["jet_damping"]
    return JetDamping(MotorFlow(thrust(values, lanes)), table["exit_station"], table["exit_radius"])


def point_gravity(values: Values, lanes: Lanes) -> PointGravity:
    """The attraction of the planet."""
    del lanes
    return PointGravity(values["planet"]["mu"])


def oblateness(values: Values, lanes: Lanes) -> Oblateness:
    """The attraction of the bulge of the planet."""
    del lanes
    planet = values["planet"]
    return Oblateness(planet["mu"], planet["j2"], planet["radius"])


def gravity_gradient(values: Values, lanes: Lanes) -> GravityGradient:
    """The torque by the gradient of the attraction of the planet."""
    del lanes
    return GravityGradient(values["planet"]["mu"])


EFFECTS = {
    "point_gravity": EffectEntry({}, PointGravity, point_gravity, ("planet.mu",)),
    "oblateness": EffectEntry(
        {}, Oblateness, oblateness, ("planet.mu", "planet.j2", "planet.radius")
    ),
    "gravity_gradient": EffectEntry({}, GravityGradient, gravity_gradient, ("planet.mu",)),
    "thrust": EffectEntry(THRUST, Thrust, thrust),
    "jet_damping": EffectEntry(
        JET_DAMPING, JetDamping, jet_damping, ("effects.thrust", "body.propellant_mass")
    ),
}
PLANET = {"mu": Key(kinds.MU), "radius": Key(kinds.DISTANCE, None), "j2": Key(kinds.NUMBER, None)}

"""The flight of a sounding rocket from its rail to the ground, in phases.

    rail -> ascent -> [fall] -> [wait] -> parachute -> [wait] -> parachute -> ground

On the rail there is no rotation; from its end to the first parachute the rocket has six degrees of
freedom, under parachutes three: the attitude is no longer part of the state. A parachute opens a
lag after its trigger: the apogee, a height above the ground on the way down, or a time after the
ignition, as for a delay charge. If that height or time has already been passed, because of a lower
apogee or while the previous parachute opens, it is triggered as soon as that one is open. Before a
first parachute with a time the ascent ends at that time, during climb or fall.

Axes: x to the east, y to the north, z up from the ground at the rail; they rotate with the Earth.

Source: Niskanen, OpenRocket technical documentation, 4.
"""

__all__ = ["apogee", "flight_phases"]

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple, final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractEffect, BodyState
from ..core import (
    AbstractParameters,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    event,
    quantity,
)
from ..core.field_types import check_kind
from ..core.formula import POSITIVE, formula
from ..core.shapes import with_rank
from ..core.types import as_float
from ..rotations import Quaternion
from ..scene import Scene
from ..simulation import Event, Mission, Phase
from ._launch_site import LaunchSite
from ._rail import Rail
from ._vehicle import Vehicle
from .air_drag import Parachute
from .ground_gravity import STANDARD_GRAVITY
from .local_air import LocalAir

# Of the search for the end of the rail and the apogee, which each happen once: more would only
# enlarge what every step writes.
SAMPLES = 32


@final
class Recovery(AbstractParameters):
    """A parachute: its drag area and its opening."""

    drag_area: NumberField = quantity("m^2", positive=True, doc="C_D A")
    lag: OptionalNumberField = quantity(
        "s",
        non_negative=True,
        optional=True,
        doc="delay from its trigger to its opening; none by default",
    )
    height: OptionalNumberField = quantity(
        "m",
        non_negative=True,
        optional=True,
        doc="above the ground at which it is triggered during the descent, or at once below it; "
        "at the apogee without a height or a time",
    )
    time: OptionalNumberField = quantity(
        "s",
        positive=True,
        optional=True,
        doc="after the ignition at which it is triggered instead of a height, during ascent or "
        "descent",
    )

    def __check_init__(self):
        super().__check_init__()
        if self.height is not None and self.time is not None:
            raise InputError(
                "Recovery.time is given together with a height: omit one of them, because only one "
                "triggers the parachute."
            )

    def trigger(self, within: Scalar, passed: bool) -> Event | None:
        """The event that triggers it, or `None` at the apogee.

        **Arguments**

        - `within`: the longest time to wait for it, s.
        - `passed`: whether it is triggered immediately if its height or time has already been
          passed.
        """
        if self.time is not None:
            return _falls(_TimeLeft(self.time), within, passed)
        return None if self.height is None else _falls(_Above(self.height), within, passed)


@final
class _Above(eqx.Module):
    """Height above `height`, m."""

    height: Scalar

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        del t
        return y.position[2] - self.height


@final
class _TimeLeft(eqx.Module):
    """Remaining time until `time`, s."""

    time: Scalar

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        # With the runs of the state.
        return self.time - t + 0.0 * y.position[2]


@formula
@event("m/s", direction=-1, needs=("velocity",))
def apogee(t: Scalar, y: BodyState) -> Scalar:
    """v_z, m/s: it falls through zero at the apogee over flat ground.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with a velocity."""
    del t
    return y.velocity[2]


def as_point(t: Scalar, y: BodyState) -> BodyState:
    """The state without its rotation."""
    del t
    return dataclasses.replace(y, attitude=None, omega=None)


def flight_phases(recovery: Sequence[Recovery]) -> list[str]:
    """The names of the phases of a flight with these parachutes, in order."""
    names = ["rail", "ascent"]
    # One with a time ends the ascent itself.
    if recovery and recovery[0].height is not None:
        names.append("fall")
    for number, chute in enumerate(recovery, 1):
        # By whether a lag is given and not by its value, which may differ between the runs.
        names += [] if chute.lag is None else [f"wait {number}"]
        names.append(f"parachute {number}")
    return names


@formula(rail_within=POSITIVE, ascent_within=POSITIVE, descent_within=POSITIVE)
def sounding_flight(
    vehicle: Vehicle,
    site: LaunchSite,
    recovery: Sequence[Recovery] = (),
    *,
    rail_within: Scalar | None = None,
    ascent_within: Scalar = 300.0,
    descent_within: Scalar = 2000.0,
) -> tuple[Mission, BodyState]:
    """The mission of a sounding rocket and its state on the rail.

    **Arguments**

    - `vehicle`: with a defined propellant mass.
    - `site`: of the launch.
    - `recovery`: the parachutes in the order of their opening, the first at the apogee unless it
      has a height or a time; without one the mission ends at the apogee.
    - `rail_within`, `ascent_within`, `descent_within`: the longest times to wait for the end of the
      rail (by default the longest possible time of a rocket that leaves it), for the apogee, and
      for the next parachute or the ground, s. The event search samples the whole time: tight limits
      make runs faster.

    **Returns** the mission, with the phases "rail", "ascent", "fall" to the height of the first
    parachute, if it has one, and for each parachute "wait", if it has a lag, and "parachute",
    numbered; and the state at ignition of every run.

    **Raises** `InputError` for arguments of another class, and for a parachute after the first one
    without a height or a time.
    """
    check_kind("sounding_flight: vehicle", vehicle, Vehicle)
    check_kind("sounding_flight: site", site, LaunchSite)
    check_kind("sounding_flight: recovery", recovery, list | tuple)
    for number, chute in enumerate(recovery, 1):
        check_kind(f"sounding_flight: recovery {number}", chute, Recovery)
    for number, chute in enumerate(recovery[1:], 2):
        if chute.height is None and chute.time is None:
            raise InputError(
                f"Recovery.height of parachute {number} is None: give a height in m or a time in "
                "s, because the apogee triggers the first parachute only."
            )
    # Computed, because a default in seconds would be wrong for a large rocket, and slow for a small
    # one: the search samples all of it.
    leaving = _longest_on_rail(vehicle, site) if rail_within is None else as_float(rail_within)
    first = recovery[0] if recovery else None
    names = iter(flight_phases(recovery))
    here = _AtSite(vehicle, site.air, site.environment)
    rail = Rail(site.direction, site.rail_length)
    phases = _ascent(here, rail, first, (leaving, ascent_within), names)
    phases = _with_descent(phases, here, recovery, descent_within, names)
    return Mission(phases), _at_rest(vehicle, site)


class _AtSite(NamedTuple):
    """A vehicle in the air of its site, with gravity and the inertial forces there: one of each,
    shared by all phases."""

    vehicle: Vehicle
    air: LocalAir
    environment: tuple[AbstractEffect, ...]

    def scene(self, effects: Sequence[AbstractEffect], carry: tuple[str, ...] = ()) -> Scene:
        """The scene of the vehicle with these additional effects."""
        return Scene((*self.environment, *effects), self.vehicle.body, carry)


def _ascent(
    here: _AtSite,
    rail: Rail,
    first: Recovery | None,
    within: tuple[Scalar, Scalar],
    names: Iterator[str],
) -> list[Phase]:
    """The phases on the rail and from it to the apogee, or to the time of the `first` parachute;
    `within`: the longest times to wait for their ends, s."""
    burning = here.vehicle.as_body(here.air)
    timed = None if first is None or first.time is None else first.trigger(within[1], True)
    return [
        Phase(
            here.scene((*burning, rail)),
            Event(rail.rail_exit, 1, within[0], samples=SAMPLES),
            name=next(names),
        ),
        Phase(
            here.scene(burning),
            Event(apogee, -1, within[1], samples=SAMPLES) if timed is None else timed,
            name=next(names),
        ),
    ]


def _with_descent(
    ascent: Sequence[Phase],
    here: _AtSite,
    recovery: Sequence[Recovery],
    within: Scalar,
    names: Iterator[str],
) -> list[Phase]:
    """The phases of the ascent, followed by those to the ground; `within`: the longest time to
    wait for the end of each, s."""
    phases = list(ascent)
    # The mass remains part of the state, although it is constant: phases before and after
    # have it.
    flying = here.scene(here.vehicle.as_body(here.air, powered=False), ("mass",))
    if recovery and recovery[0].height is not None:
        phases.append(Phase(flying, recovery[0].trigger(within, True), name=next(names)))
    last = len(recovery) - 1
    for number, chute in enumerate(recovery):
        hanging = here.scene((Parachute(chute.drag_area, air=here.air),), ("mass",))
        # Under a parachute the rocket is a point: the rotation ends with the ascent.
        turn = as_point if number == 0 else None
        if chute.lag is not None:
            phases.append(Phase(flying, chute.lag, turn, next(names)))
        else:
            phases[-1] = dataclasses.replace(phases[-1], then=turn)
        # The last parachute lasts to the ground, each other one until the next opens.
        ground = _falls(_Above(as_float(0.0)), within, False)
        until = ground if number == last else recovery[number + 1].trigger(within, True)
        phases.append(Phase(hanging, until, name=next(names)))
        flying = hanging
    return phases


def _falls(condition: _Above | _TimeLeft, within: Scalar, passed: bool) -> Event:
    """The event where a height or a remaining time falls through zero. The parachute opens
    immediately where the height is already `passed`; below the ground there is no landing."""
    # An array for both, so that phases of a descent differ in numbers alone and share a program.
    flag = jnp.asarray(passed)
    return Event(condition, -1, within, at_start=True, passed=flag)


def _longest_on_rail(vehicle: Vehicle, site: LaunchSite) -> Scalar:
    """The time, s, after which no rocket leaves its rail: the burnout plus the time of a climb that
    just comes to rest at the end, L = g sin(i) t^2/2, taken for 6 deg on a flatter rail."""
    slope = jnp.maximum(jnp.sin(site.inclination), 0.1)
    coast = jnp.sqrt(2.0 * site.rail_length / (STANDARD_GRAVITY * slope))
    return jnp.max(vehicle.motor.burnout() + coast)


def _at_rest(vehicle: Vehicle, site: LaunchSite) -> BodyState:
    """The state on the rail, with the runs of the vehicle and the site."""
    mass = vehicle.body.loaded_mass()
    attitude = site.attitude
    assert mass is not None
    wxyz = attitude.wxyz
    runs = jnp.broadcast_shapes(jnp.shape(mass), wxyz.shape[1:])
    zero = jnp.zeros((3, *runs), wxyz.dtype)
    wxyz = jnp.broadcast_to(with_rank(wxyz, len(runs)), (4, *runs))
    return BodyState(zero, zero, Quaternion(wxyz), zero, jnp.broadcast_to(mass, runs))

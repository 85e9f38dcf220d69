"""The flight of a sounding rocket from its rail to the ground, in phases.

    rail -> ascent -> [wait] -> parachute -> [wait] -> parachute -> ground

On the rail nothing turns; from its end to the first parachute the rocket flies with six degrees of
freedom, under parachutes with three: the attitude is no longer a part of the state. A parachute
opens a lag after its trigger, the apogee or a height above the ground.

Axes: x to the east, y to the north, z up from the ground at the rail; they turn with the Earth.

Source: Niskanen, OpenRocket technical documentation, 4.
"""

import dataclasses
from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractAtmosphere, AbstractEffect, BodyState
from ..core import (
    AbstractParameters,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    quantity,
)
from ..core.shapes import with_rank
from ..core.types import as_float
from ..orbits import RotatingFrame
from ..rotations import Quaternion
from ..scene import Scene
from ..simulation import Event, Mission, Phase
from ._dryden_gusts import DrydenGusts
from ._rail import Rail
from ._vehicle import Vehicle
from .air_drag import Parachute
from .ground_gravity import GroundGravity
from .local_air import AbstractWind, LocalAir

EARTH_RATE = 7.2921159e-5  # rad/s
# Of the search for the end of the rail and the apogee, which each happen once: more would only
# enlarge what every step writes.
SAMPLES = 32


@final
class LaunchSite(AbstractParameters):
    """Where and how a sounding rocket is launched."""

    latitude: NumberField = quantity("rad", low=-1.6, high=1.6, doc="geodetic")
    rail_length: NumberField = quantity("m", positive=True, doc="travel on the rail")
    inclination: NumberField = quantity(
        "rad", low=0.0, high=1.6, doc="of the rail above the horizontal"
    )
    heading: NumberField = quantity("rad", default=0.0, doc="of the rail, from north towards east")
    elevation: NumberField = quantity("m", default=0.0, doc="of the ground above sea level")
    wind: AbstractWind | None = eqx.field(default=None, metadata={"doc": "calm by default"})
    atmosphere: AbstractAtmosphere | None = eqx.field(
        default=None, metadata={"doc": "over the site; the U.S. standard by default"}
    )
    gusts: DrydenGusts | None = eqx.field(
        default=None, metadata={"doc": "turbulence beside the wind; none by default"}
    )

    def air(self) -> LocalAir:
        """The air over the site: its atmosphere, wind and gusts."""
        return LocalAir(self.atmosphere, elevation=self.elevation, wind=self.wind, gusts=self.gusts)

    def environment(self) -> tuple[AbstractEffect, ...]:
        """Gravity, and the forces of inertia in axes that turn with the Earth."""
        s, c = jnp.sin(self.latitude), jnp.cos(self.latitude)
        turning = EARTH_RATE * jnp.stack([0.0 * s, c, s])
        return GroundGravity.of_latitude(self.latitude, self.elevation), RotatingFrame(turning)

    def direction(self) -> Vector:
        """The unit vector of the rail, (3, *runs)."""
        c = jnp.cos(self.inclination)
        east, north = c * jnp.sin(self.heading), c * jnp.cos(self.heading)
        return jnp.stack(jnp.broadcast_arrays(east, north, jnp.sin(self.inclination)))

    def attitude(self) -> Quaternion:
        """The attitude of a rocket on the rail: turned about z by the heading, then off the
        vertical."""
        tilt = 0.5 * (0.5 * jnp.pi - self.inclination)
        c, s = jnp.cos(tilt), jnp.sin(tilt)
        # The axis of the tilt lies across the heading: (cos, -sin, 0) turns z towards north for 0.
        a, b = jnp.sin(self.heading), jnp.cos(self.heading)
        return Quaternion(jnp.stack(jnp.broadcast_arrays(c, -s * b, s * a, 0.0 * c)))


@final
class Recovery(AbstractParameters):
    """A parachute: what it drags, and when it opens."""

    drag_area: NumberField = quantity("m^2", non_negative=True, doc="C_D A")
    lag: OptionalNumberField = quantity(
        "s",
        non_negative=True,
        optional=True,
        doc="from its trigger to its opening; without it the parachute opens at once",
    )
    height: OptionalNumberField = quantity(
        "m",
        non_negative=True,
        optional=True,
        doc="above the ground, at which it is triggered on the way down; without it at the apogee",
    )


@final
class _Above(eqx.Module):
    """Height above `height`, m."""

    height: Scalar

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        del t
        return y.position[2] - self.height


def climb_rate(t: Scalar, y: BodyState) -> Scalar:
    """v_z, m/s: it falls through zero at the apogee over flat ground."""
    del t
    return y.velocity[2]


def as_point(t: Scalar, y: BodyState) -> BodyState:
    """The state without its rotation."""
    del t
    return dataclasses.replace(y, attitude=None, omega=None)


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

    - `vehicle`: with a known mass of its propellant.
    - `site`: of the launch.
    - `recovery`: the parachutes in the order of their opening, the first at the apogee; without
      one the mission ends at the apogee.
    - `rail_within`, `ascent_within`, `descent_within`: the longest times to wait for the end of the
      rail (by default the burn time), for the apogee, and for the next parachute or the ground, s.
      The search for an event samples all of that time: a narrow limit
      is a fast run.

    **Returns** the mission, with the phases "rail", "ascent" and for each parachute "wait", if it
    has a lag, and "parachute", numbered; and the state at ignition, of every run.

    **Raises** `InputError` for a parachute after the first one without a height.
    """
    air, environment = site.air(), site.environment()

    def scene(*effects: AbstractEffect, carry: tuple[str, ...] = ()) -> Scene:
        return Scene((*environment, *effects), vehicle.body, carry)

    rail = Rail(site.direction(), site.rail_length)
    burning, gliding = vehicle.as_body(air), vehicle.as_body(air, powered=False)
    leaving = jnp.max(vehicle.motor.burnout()) if rail_within is None else as_float(rail_within)
    for number, chute in enumerate(recovery[1:], 2):
        if chute.height is None:
            raise InputError(
                f"Recovery.height of parachute {number} is None: it must be a height in m, for the "
                f"apogee triggers the first one alone."
            )
    phases = [
        # A rocket that has not left its rail by the burnout never does.
        Phase(
            scene(*burning, rail), Event(rail.rail_exit, 1, leaving, samples=SAMPLES), name="rail"
        ),
        Phase(
            scene(*burning), Event(climb_rate, -1, ascent_within, samples=SAMPLES), name="ascent"
        ),
    ]
    flying, last = scene(*gliding, carry=("mass",)), len(recovery) - 1
    for number, chute in enumerate(recovery):
        name = f"{number + 1}"
        drag = Parachute(chute.drag_area, air=air)
        hanging = scene(drag, carry=("mass",))
        # Under a parachute hangs a point: the rotation ends with the ascent.
        turn = as_point if number == 0 else None
        # By whether it is given and not by its value, which may be another one in every run.
        if chute.lag is not None:
            phases.append(Phase(flying, chute.lag, turn, f"wait {name}"))
        else:
            phases[-1] = dataclasses.replace(phases[-1], then=turn)
        # The last parachute hangs until the ground, each other one until the next opens.
        below = as_float(0.0) if number == last else recovery[number + 1].height
        phases.append(
            Phase(hanging, Event(_Above(below), -1, descent_within), name=f"parachute {name}")
        )
        flying = hanging
    return Mission(phases), _at_rest(vehicle, site)


def _at_rest(vehicle: Vehicle, site: LaunchSite) -> BodyState:
    """The state on the rail, with the runs of the vehicle and the site."""
    mass, attitude = vehicle.body.loaded_mass(), site.attitude()
    assert mass is not None
    wxyz = attitude.wxyz
    runs = jnp.broadcast_shapes(jnp.shape(mass), wxyz.shape[1:])
    zero = jnp.zeros((3, *runs), wxyz.dtype)
    wxyz = jnp.broadcast_to(with_rank(wxyz, len(runs)), (4, *runs))
    return BodyState(zero, zero, Quaternion(wxyz), zero, jnp.broadcast_to(mass, runs))

"""The launch site of a sounding rocket: its place on the Earth, its air, and its rail.

Axes: x to the east, y to the north, z up from the ground at the rail; they turn with the Earth.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractAtmosphere, AbstractEffect, BodyState, PadAtmosphere
from ..core import (
    AbstractParameters,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    output,
    quantity,
)
from ..core.jit import quick_jit
from ..core.listed import no_method
from ..core.types import as_float
from ..core.vectors import norm
from ..orbits import RotatingFrame
from ..rotations import Quaternion
from ._dryden_gusts import DrydenGusts
from .ground_gravity import STANDARD_GRAVITY, GroundGravity
from .local_air import AbstractWind, LocalAir

EARTH_RATE = 7.2921159e-5  # rad/s


@final
class LaunchSite(AbstractParameters):
    """Launch site of a sounding rocket, with rail and wind."""

    rail_length: NumberField = quantity("m", positive=True, doc="travel on the rail")
    inclination: NumberField = quantity(
        "rad", low=0.0, high=1.6, doc="of the rail above the horizontal"
    )
    heading: NumberField = quantity("rad", default=0.0, doc="of the rail, from north towards east")
    latitude: OptionalNumberField = quantity(
        "rad",
        low=-1.6,
        high=1.6,
        optional=True,
        doc="geodetic; without it gravity is standard and the Earth does not rotate",
    )
    longitude: OptionalNumberField = quantity(
        "rad", low=-6.3, high=6.3, optional=True, doc="to the east, for the place of the landing"
    )
    elevation: NumberField = quantity("m", default=0.0, doc="of the ground above sea level")
    wind: AbstractWind | None = eqx.field(default=None, metadata={"doc": "calm by default"})
    atmosphere: AbstractAtmosphere | None = eqx.field(
        default=None, metadata={"doc": "over the site; the U.S. standard by default"}
    )
    gusts: DrydenGusts | None = eqx.field(
        default=None, metadata={"doc": "turbulence added to the wind; none by default"}
    )
    temperature: OptionalNumberField = quantity(
        "K",
        low=180.0,
        high=340.0,
        optional=True,
        doc="of the air at the ground; without an atmosphere, of the standard by default",
    )
    pressure: OptionalNumberField = quantity(
        "Pa",
        positive=True,
        optional=True,
        doc="of the air at the ground; without an atmosphere, of the standard by default",
    )

    def __check_init__(self):
        for name in ("temperature", "pressure"):
            if getattr(self, name) is not None and self.atmosphere is not None:
                raise InputError(
                    f"LaunchSite.{name} and LaunchSite.atmosphere are both given: give only one of "
                    "them."
                )

    @property
    def air(self) -> LocalAir:
        """The air over the site: its atmosphere, wind and gusts."""
        atmosphere = self.atmosphere
        if self.temperature is not None or self.pressure is not None:
            atmosphere = PadAtmosphere(self.elevation, self.temperature, self.pressure)
        return LocalAir(atmosphere, elevation=self.elevation, wind=self.wind, gusts=self.gusts)

    # Outside of `jit` each of some hundred operations would be compiled by itself.
    @quick_jit
    def winds(self, top: Scalar, count: int = 100) -> tuple[Scalar, Scalar]:
        """The wind to the east and to the north, m/s, each (count, *runs), at heights that are
        evenly spaced from the ground to `top`, m."""
        height = jnp.linspace(0.0, as_float(top), count)
        east, north, _ = self.air.velocity(jnp.stack([0.0 * height, 0.0 * height, height]))
        return east, north

    @property
    @no_method
    def environment(self) -> tuple[AbstractEffect, ...]:
        """Gravity, and the inertial forces in axes that turn with the Earth where the latitude is
        known."""
        if self.latitude is None:
            # Without a latitude neither the rate of the axes nor the gravity of the place is known.
            return (GroundGravity(STANDARD_GRAVITY),)
        s, c = jnp.sin(self.latitude), jnp.cos(self.latitude)
        turning = EARTH_RATE * jnp.stack([0.0 * s, c, s])
        return GroundGravity.of_latitude(self.latitude, self.elevation), RotatingFrame(turning)

    @output("m")
    def east(self, position: Vector) -> Scalar:
        """Distance to the east of the rail, m."""
        return position[0]

    @output("m")
    def north(self, position: Vector) -> Scalar:
        """Distance to the north of the rail, m."""
        return position[1]

    @output("m")
    def distance(self, position: Vector) -> Scalar:
        """Distance from the rail over the ground, m."""
        return over_ground(position)

    @output("m")
    def drift(self, position: Vector, began: BodyState) -> Scalar:
        """Straight distance over the ground from the start of the phase to its end, m."""
        return over_ground(position - began.position)

    @property
    def direction(self) -> Vector:
        """The unit vector of the rail, (3, *runs)."""
        c = jnp.cos(self.inclination)
        east, north = c * jnp.sin(self.heading), c * jnp.cos(self.heading)
        return jnp.stack(jnp.broadcast_arrays(east, north, jnp.sin(self.inclination)))

    @property
    def attitude(self) -> Quaternion:
        """The attitude of a rocket on the rail: turned about z by the heading, then off the
        vertical."""
        # Half of the angle off the vertical, as a quaternion has it.
        tilt = 0.5 * (0.5 * jnp.pi - self.inclination)
        c, s = jnp.cos(tilt), jnp.sin(tilt)
        # The axis of the tilt is perpendicular to the heading: (cos, -sin, 0) turns z towards north
        # for 0.
        a, b = jnp.sin(self.heading), jnp.cos(self.heading)
        return Quaternion(jnp.stack(jnp.broadcast_arrays(c, -s * b, s * a, 0.0 * c)))


def over_ground(way: Vector) -> Scalar:
    """The length of a way, m, (3, *runs), over the ground."""
    level = jnp.array([1.0, 1.0, 0.0], way.dtype)
    return norm(way * jnp.reshape(level, (3,) + (1,) * (way.ndim - 1)))

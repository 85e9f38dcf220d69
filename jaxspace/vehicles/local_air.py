"""The air about a vehicle: its state by the height, and its motion by wind and rotation.

    h = |r| - R + h_0,   or z + h_0 over flat ground
    v_air = omega x r + east e + north n + gusts

    symbol       meaning                                              unit
    r, h         position, height above sea level                     m
    R, h_0       radius of the planet, height of its ground           m
    omega        rotation of the air about the z axis                 rad/s
    e, n         directions of east and north                         1

Over a planet e = z x r / |z x r| and n = r x e / |r|; over flat ground x points east, y north and z
up. At a pole, where east is undefined, the wind is zero.

Source: Zipfel, Modeling and Simulation of Aerospace Vehicle Dynamics, 8.3 (wind).
"""

__all__ = ["AbstractWind", "LocalAir"]

from abc import abstractmethod
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..bodies import AbstractAtmosphere, Air, BodyState, StandardAtmosphere
from ..core import (
    AbstractParameters,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    check,
    quantity,
)
from ..core.checks import is_concrete
from ..core.tables import polygon
from ..core.vectors import axis, cross, norm, unit
from ._dryden_gusts import DrydenGusts
from ._sounding_file import FASTEST


def check_nodes(name: str, nodes: Array, **values: Array) -> None:
    """Raise `InputError` for nodes that do not ascend, or another number of values."""
    if nodes.ndim == 0:
        raise InputError(f"{name} is a single number: it must be a list of nodes.")
    for field, value in values.items():
        count = value.shape[0] if value.ndim else 1
        check(
            np.asarray(value.ndim and nodes.shape[0] == count),
            f"{name}.{field}",
            np.asarray(count),
            f"as many as the {nodes.shape[0]} nodes",
        )
    # Traced nodes have no order that is known here.
    if is_concrete(nodes):
        check(np.diff(np.asarray(nodes), axis=0) > 0.0, name, nodes, "ascending")


class AbstractWind(AbstractParameters):
    """A wind that varies with the height. A concrete wind is final."""

    @abstractmethod
    def at(self, height: Scalar) -> tuple[Scalar, Scalar]:
        """The components to the east and to the north, m/s, at a `height` above sea level, m."""


@final
class Wind(AbstractWind):
    """A wind that varies with the height above sea level, linear between its points and constant
    outside. It blows towards the direction that it names: `east` is positive where it moves the air
    eastwards."""

    heights: Float[Array, "nodes *#runs"] = quantity("m", doc="above sea level, ascending")
    east: Float[Array, "nodes *#runs"] = quantity(
        "m/s", low=-FASTEST, high=FASTEST, doc="towards the east at these heights"
    )
    north: Float[Array, "nodes *#runs"] = quantity(
        "m/s", low=-FASTEST, high=FASTEST, doc="towards the north"
    )

    def __check_init__(self):
        super().__check_init__()
        check_nodes("Wind.heights", self.heights, east=self.east, north=self.north)

    def at(self, height: Scalar) -> tuple[Scalar, Scalar]:
        return (
            polygon(height, self.heights, self.east),
            polygon(height, self.heights, self.north),
        )


def air_about(air: "LocalAir | None") -> "LocalAir":
    """The air that is given, or calm standard air over flat ground at sea level."""
    return LocalAir() if air is None else air


@final
class LocalAir(AbstractParameters):
    """The air about a vehicle: an atmosphere, a wind, and the ground from which heights count."""

    atmosphere: AbstractAtmosphere | None = eqx.field(
        default=None,
        metadata={"doc": "state of the air by its height; the U.S. standard by default"},
    )
    radius: OptionalNumberField = quantity(
        "m", positive=True, optional=True, doc="of the planet; without it z is up from flat ground"
    )
    elevation: NumberField = quantity(
        "m", default=0.0, doc="of the ground at the origin above sea level"
    )
    air_rate: NumberField = quantity(
        "rad/s", default=0.0, doc="rotation of the air about the z axis"
    )
    wind: AbstractWind | None = eqx.field(default=None, metadata={"doc": "calm by default"})
    gusts: DrydenGusts | None = eqx.field(
        default=None, metadata={"doc": "turbulence added to the wind; none by default"}
    )

    def height(self, position: Vector) -> Scalar:
        """Above sea level, m, of a `position`, m, (3, *runs)."""
        above = position[2] if self.radius is None else norm(position) - self.radius
        return above + self.elevation

    def at(self, position: Vector) -> tuple[Air, Vector]:
        """The state of the air, and its velocity in the axes of the position, m/s, (3, *runs)."""
        height = self.height(position)
        # Made here and not as a default: importing the package makes no array.
        atmosphere = StandardAtmosphere() if self.atmosphere is None else self.atmosphere
        return atmosphere.air_at(height), self._velocity(position, height)

    def velocity(self, position: Vector) -> Vector:
        """The velocity of the air at a `position`, m, by wind and rotation, m/s, (3, *runs)."""
        return self._velocity(position, self.height(position))

    def _velocity(self, position: Vector, height: Scalar) -> Vector:
        up = axis(2, position[2])
        # A wind is level; gusts may rise.
        blowing = [] if self.wind is None else [(*self.wind.at(height), 0.0 * height)]
        if self.gusts is not None:
            # Turbulence depends on the height above the ground, a wind on that above the sea.
            blowing.append(self.gusts.at(height - self.elevation))
        if self.radius is None:
            moving = jnp.zeros_like(position)
            if not blowing:
                return moving
            return jnp.stack([sum(parts, x) for *parts, x in zip(*blowing, moving, strict=True)])
        # Towards the east, and as long as the distance from the axis: by it the air turns with the
        # planet.
        across = cross(up, position)
        moving = self.air_rate * across
        if not blowing:
            return moving
        east, north, rising = (sum(parts[1:], parts[0]) for parts in zip(*blowing, strict=True))
        # At a pole `unit` gives zero: no wind, and no NaN.
        e, outwards = unit(across), unit(position)
        # North is up x east.
        moving = moving + east * e + north * cross(outwards, e)
        return moving if self.gusts is None else moving + rising * outwards


def flow_pressure(air: LocalAir | None, y: BodyState) -> Scalar:
    """Dynamic pressure rho |w|^2 / 2, Pa, of the flow about a vehicle in the state `y`."""
    state, moving = air_about(air).at(y.position)
    return 0.5 * state.density * norm(y.velocity - moving) ** 2

"""Prescribed paths: the position of another body as a function of time.

    circle  s = d (cos u, sin u cos i, sin u sin i) turned by the node,  u = phase + rate t
    conic   s = the two-body motion of a state at t = 0
    table   s_k(t), a natural cubic spline of each component

    symbol  meaning                                                  unit
    s, d    position from the centre of the scene, its length        m
    u, i    angle from the ascending node, inclination to z = 0      rad

Any function of the time that returns a position, (3, *runs), can be used as a path in Python.
"""

__all__ = ["AbstractPath"]

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax.numpy as jnp
import numpy.typing as npt
from jaxtyping import Array, Float

from ..core import (
    AbstractParameters,
    InputError,
    NumberField,
    Scalar,
    Spline,
    Vector,
    argument,
    constructor,
    quantity,
)
from ..core.field_types import is_real, shown
from ..core.types import as_float
from .kepler import conic_flow


class AbstractPath(AbstractParameters):
    """The position of a body as a function of the time. A concrete path is final."""

    @abstractmethod
    def __call__(self, t: Scalar) -> Vector:
        """Position, m, (3, *runs), at the time `t`, s."""


Path: TypeAlias = AbstractPath | Callable[[Scalar], Vector]


@final
class CircularPath(AbstractPath):
    """A circle about the centre at a constant rate; a fixed place for the rate zero."""

    distance: NumberField = quantity("m", positive=True, doc="from the centre")
    rate: NumberField = quantity("rad/s", doc="of the motion on the circle")
    phase: NumberField = quantity("rad", default=0.0, doc="angle from the ascending node at t = 0")
    inclination: NumberField = quantity(
        "rad", low=-math.pi, high=math.pi, default=0.0, doc="of the circle to the plane z = 0"
    )
    node: NumberField = quantity("rad", default=0.0, doc="longitude of the ascending node")

    def __call__(self, t: Scalar) -> Vector:
        angle = self.phase + self.rate * t
        along, ahead = jnp.cos(angle), jnp.sin(angle)
        across = ahead * jnp.cos(self.inclination)
        cosine, sine = jnp.cos(self.node), jnp.sin(self.node)
        place = (
            cosine * along - sine * across,
            sine * along + cosine * across,
            ahead * jnp.sin(self.inclination),
        )
        return self.distance * jnp.stack(jnp.broadcast_arrays(*place))


@final
class KeplerPath(AbstractPath):
    """Two-body motion from a state at t = 0, on any conic."""

    position: Float[Array, "3 *#runs"] = quantity("m", doc="from the centre at t = 0")
    velocity: Float[Array, "3 *#runs"] = quantity("m/s", doc="at t = 0")
    mu: NumberField = quantity(
        "m^3/s^2", positive=True, doc="gravitational parameter of this motion, of both bodies"
    )

    def __call__(self, t: Scalar) -> Vector:
        return conic_flow(self.position, self.velocity, t, self.mu)[0]


@final
class TabulatedPath(AbstractPath):
    """Positions at times, with a natural cubic spline between them.

    The nodes are breaks of every integration. The spline is straight at its ends: extend the table
    some nodes beyond the run.

    - `times`, s: ascending, (nodes, *runs).
    - `positions`, m: at these times, (3, nodes, *runs).

    Raises `InputError` for times that do not ascend, or another number of positions."""

    # The spline of x. Of y and z only values and curvatures are stored, so that each node is one
    # break and not three.
    curve: Spline
    others: tuple[tuple[Array, Array], ...]

    def __init__(self, times: npt.ArrayLike, positions: npt.ArrayLike):
        """The path through the `positions`, m, (3, nodes, *runs), at the `times`, s, (nodes,
        *runs)."""
        nodes, places = as_float(times), as_float(positions)
        if not is_real(places):
            raise InputError(
                f"TabulatedPath.positions is {shown(places)}: it must be an array of numbers in m."
            )
        if places.ndim < 2 or places.shape[0] != 3:
            raise InputError(
                f"TabulatedPath.positions has the shape {places.shape}: it must be "
                f"(3, nodes, *runs)."
            )
        self.curve, *others = (Spline(nodes, component) for component in places)
        self.others = tuple((one.values, one.curvatures) for one in others)

    @classmethod
    @constructor(
        times=argument("s", shape=(None,), doc="ascending"),
        positions=argument("m", shape=(3, None), doc="there: a list for each component"),
    )
    def of_table(cls, times: npt.ArrayLike, positions: npt.ArrayLike) -> "TabulatedPath":
        """The path of a table in a scene file."""
        return cls(times, positions)

    def __call__(self, t: Scalar) -> Vector:
        others = [
            eqx.tree_at(lambda c: (c.values, c.curvatures), self.curve, numbers)
            for numbers in self.others
        ]
        return jnp.stack([curve(t) for curve in (self.curve, *others)])

"""Orientation of a planet or a moon: a pole and a rotation about it, each at a constant rate.

    r_body = Rz(W) Rx(90 deg - delta) Rz(90 deg + alpha) r
    each angle: its value at t = 0, plus rate t

    symbol         meaning                                                              unit
    alpha, delta   right ascension and declination of the pole                          rad
    W              prime meridian, from the node of the equator on the plane z = 0      rad
    Rx, Rz         rotation of the axes about x, z                                      1

Source: Archinal et al., Report of the IAU Working Group on Cartographic Coordinates and Rotational
Elements: 2015, Celestial Mechanics and Dynamical Astronomy 130 (2018), 22, figure 1.

Without a pole the axis is the inertial z axis, and W is the angle from the x axis: of the earth,
the sidereal time at Greenwich. Periodic terms, such as those of the moon, are not included.
"""

from typing import final

import jax.numpy as jnp

from ..core import (
    AbstractParameters,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    quantity,
)
from ..core.vectors import components


@final
class PlanetRotation(AbstractParameters):
    """A constant rotation about the z axis, or about a pole that may move."""

    rate: NumberField = quantity("rad/s", doc="of the prime meridian")
    angle: NumberField = quantity("rad", default=0.0, doc="of the prime meridian at t = 0")
    right_ascension: OptionalNumberField = quantity(
        "rad", optional=True, doc="of the pole at t = 0; without it the axis is z"
    )
    declination: OptionalNumberField = quantity(
        "rad", optional=True, doc="of the pole at t = 0; without it the axis is z"
    )
    right_ascension_rate: NumberField = quantity("rad/s", default=0.0, doc="of the pole")
    declination_rate: NumberField = quantity("rad/s", default=0.0, doc="of the pole")

    def __check_init__(self):
        if (self.right_ascension is None) != (self.declination is None):
            raise InputError(
                "PlanetRotation has one of right_ascension and declination: it must have both or "
                "neither."
            )

    def to_body(self, t: Scalar, v: Vector) -> Vector:
        """A vector in axes fixed to the planet from inertial axes, (3, *runs), at the time `t`,
        s."""
        for index, angle in self._turns(t):
            v = _turned(v, index, angle)
        return v

    def to_inertial(self, t: Scalar, v: Vector) -> Vector:
        """A vector in inertial axes from axes fixed to the planet; undoes `to_body`."""
        for index, angle in reversed(self._turns(t)):
            v = _turned(v, index, -angle)
        return v

    def _turns(self, t: Scalar) -> list[tuple[int, Scalar]]:
        """The rotations of the axes in their order: an axis and an angle each."""
        meridian = (2, self.angle + self.rate * t)
        if self.right_ascension is None or self.declination is None:
            return [meridian]
        alpha = self.right_ascension + self.right_ascension_rate * t
        delta = self.declination + self.declination_rate * t
        return [(2, 0.5 * jnp.pi + alpha), (0, 0.5 * jnp.pi - delta), meridian]


def _turned(v: Vector, index: int, angle: Scalar) -> Vector:
    """The components in axes rotated about the axis `index`."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    parts = components(v)
    j, k = (index + 1) % 3, (index + 2) % 3
    turned = {index: parts[index], j: c * parts[j] + s * parts[k], k: c * parts[k] - s * parts[j]}
    return jnp.stack(jnp.broadcast_arrays(*(turned[i] for i in range(3))))

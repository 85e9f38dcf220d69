"""Inputs that are drawn together: a direction within a cone.

d = cos(t) n + sin(t) (cos(p) e_1 + sin(p) e_2)
1 - cos(t) = h (1 - exp(-(z_1^2 + z_2^2)/2)),  tan(p) = z_2 / z_1,  h = 1 - cos(a) = 2 sin^2(a/2)

symbol  meaning                                                   unit
z       independent standard normal numbers                       1
n, a    axis of the cone, and half its angle; pi is the sphere    1, rad

The share of the draws beyond a limit of a component is the common area of two spherical caps, by
quadrature: the terms of its closed form cancel for narrow cones.
"""

import math
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.checks import is_concrete
from ..core.printing import printed
from ..core.safe import phi1
from ..core.square_roots import sqrt
from ..core.types import as_float
from .joint import AbstractJoint


@final
@printed(half_angle="rad")
class ConeDirection(AbstractJoint):
    """A vector of fixed length whose direction is uniform over a cone; the nominal one is on its
    axis.

    - `vector`: the nominal vector, (3,); its length is that of all draws.
    - `half_angle`, rad: of the cone; pi for the whole sphere."""

    vector: Float[Array, "3"] = eqx.field(converter=as_float)
    half_angle: Float[Array, ""] = eqx.field(converter=as_float, default=np.pi)

    def __check_init__(self):
        if is_concrete(self.vector):
            length = float(np.linalg.norm(np.asarray(self.vector)))
            if np.shape(self.vector) != (3,) or not length > 0.0:
                raise InputError(
                    "ConeDirection.vector must be three numbers, not all of them zero."
                )
        if is_concrete(self.half_angle) and not 0.0 < float(self.half_angle) <= np.pi + 1e-6:
            raise InputError(
                f"ConeDirection.half_angle is {float(self.half_angle)}: it must be above 0, and at "
                f"most pi."
            )

    @property
    def size(self) -> int:
        return 3

    @property
    def dimensions(self) -> int:
        return 2

    @property
    def mean(self) -> Float[Array, "3"]:
        return self.vector

    @property
    def covariance(self) -> Float[Array, "3 3"]:
        # 1 - cos t is uniform from 0 to h: the means of (1 - cos t)^2 and of sin^2 t follow.
        h = self._height
        along, across = h * h / 3.0, (h - h * h / 3.0) / 2.0
        v = self.vector
        # v^2 I - v v^T as a product, which is accurate where v is along an axis.
        turn = jnp.cross(v, jnp.eye(3, dtype=v.dtype))
        return along * jnp.outer(v, v) + across * (turn.T @ turn)

    @property
    def _height(self) -> Float[Array, ""]:
        """1 - cos(a), of a narrow cone too."""
        return 2.0 * jnp.sin(0.5 * self.half_angle) ** 2

    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, "3"]:
        length = sqrt(jnp.sum(self.vector**2))
        n = self.vector / length
        e1, e2 = _across(n)
        s = 0.5 * (z[0] ** 2 + z[1] ** 2)
        h = self._height
        # h (1 - e^-s), and sin(t)/|z| without a division by zero at the axis.
        versine = h * s * phi1(-s)
        ratio = jnp.sqrt(0.5 * h * phi1(-s) * (2.0 - versine))
        return length * ((1.0 - versine) * n + ratio * (z[0] * e1 + z[1] * e2))

    def outside(self, index: int, low: float, high: float) -> float:
        v = np.asarray(self.vector, float)
        length = float(np.linalg.norm(v))
        across = float(np.linalg.norm(np.delete(v, index)))
        angle = min(float(self.half_angle), math.pi)
        return sum(
            _share_of_cap(angle, math.atan2(across, sign * v[index]), sign * limit / length)
            for sign, limit in ((-1.0, low), (1.0, high))
        )

    def text(self) -> str:
        vector = np.asarray(self.vector).tolist()
        angle = float(self.half_angle)
        return f"direction within {angle:.6g} rad of {vector}"


# Of the quadrature over the cone, which converges faster than any power of it.
NODES = 60


def _share_of_cap(a: float, g: float, limit: float) -> float:
    """The share of the directions within the angle `a` of an axis whose component along another
    direction, at the angle `g` from the axis, is above the `limit`.

    Circles about the axis, at the angle t, are partly above it from |g - b| to g + b, with
    cos(b) = limit, and in a part of their length that spherical trigonometry gives."""
    if abs(limit) >= 1.0:
        return float(limit < 0.0)
    b = math.acos(limit)
    around = 2.0 * math.pi - g - b
    start, end = abs(g - b), min(a, g + b, around)
    inside = math.sin(0.5 * min(start, a)) ** 2 if b > g else 0.0
    if around < a:
        inside += math.sin(0.5 * a) ** 2 - math.sin(0.5 * around) ** 2
    if start < end:
        x, weights = np.polynomial.legendre.leggauss(NODES)
        # The root at both ends becomes smooth in the angle of a cosine.
        p = 0.5 * math.pi * (x + 1.0)
        t = start + (end - start) * np.sin(0.5 * p) ** 2
        half = np.sin(0.5 * (b + g - t)) * np.sin(0.5 * (b + t - g))
        other = np.sin(0.5 * (b + g + t)) * np.sin(0.5 * (t + g - b))
        part = 2.0 / math.pi * np.arctan2(np.sqrt(abs(half)), np.sqrt(abs(other)))
        per_node = 0.25 * math.pi * (end - start) * np.sin(p) * weights
        inside += 0.5 * float((part * np.sin(t)) @ per_node)
    return min(inside / math.sin(0.5 * a) ** 2, 1.0)


def _across(n: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Two unit vectors that are perpendicular to the unit vector n and to each other, without a
    singular direction (Duff et al., J. Comput. Graph. Tech. 6 (2017), 1)."""
    sign: Scalar = jnp.where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    e1 = jnp.stack([1.0 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]])
    return e1, jnp.stack([b, sign + n[1] ** 2 * a, -n[1]])

"""Attraction by another body on a given path, relative to the attracted centre of the scene.

    a = mu ((s - r)/|s - r|^3 - s/|s|^3) = -mu/d^3 (r + f(q) s)
    d = |r - s|,  q = r . (r - 2 s) / s . s,  f(q) = q (3 + 3 q + q^2) / (1 + (1 + q)^(3/2))
    V = -mu (1/d - r . s / |s|^3)

    symbol  meaning                                                   unit
    r, s    position from the centre, that of the other body          m
    mu      gravitational parameter of the other body                 m^3/s^2
    V       potential energy per unit mass of a, at one time          m^2/s^2

Source: Battin, An Introduction to the Mathematics and Methods of Astrodynamics, 8.4 (f); Thomson
4.6 (relative motion).

Accurate close to the centre, where both attractions nearly cancel. Singular at the other body. The
motion of the other body does work: the energy is not conserved.
"""

__all__ = ["third_body", "third_body_potential"]

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity
from ..core.formula import AWAY, formula
from ..core.shapes import with_rank
from ..core.square_roots import sqrt
from ..core.vectors import dot, inverse_norm, over_norm, scale
from .paths import Path


@formula(s=AWAY)
def third_body(r: Vector, s: Vector, mu: Scalar) -> Vector:
    """Acceleration due to another body, minus that of the centre.

    **Arguments**

    - `r`, `s`: positions from the centre, of the attracted point and of the other body, m,
      (3, *runs).
    - `mu`: gravitational parameter of the other body, m^3/s^2.

    **Returns** a, m/s^2, (3, *runs)."""
    r, s = _same_rank(r, s)
    # In this order no factor leaves the range of float32.
    q = dot(r, r - 2.0 * s) * inverse_norm(s, 2)
    f = q * (3.0 + q * (3.0 + q)) / (1.0 + (1.0 + q) * jnp.sqrt(1.0 + q))
    return scale(over_norm(-mu, r - s, 3), r + scale(f, s))


@formula(s=AWAY)
def third_body_potential(r: Vector, s: Vector, mu: Scalar) -> Scalar:
    """Potential energy per unit mass V, m^2/s^2, less its value at the centre.

    **Arguments**

    - `r`, `s`, `mu`: as in `third_body`."""
    r, s = _same_rank(r, s)
    per_s = inverse_norm(s, 2)
    size, rise = dot(r, r) * per_s, dot(r, s) * per_s
    q = dot(r, r - 2.0 * s) * per_s
    root = sqrt(1.0 + q)
    # 1/d - 1/|s| = -q / (|s| root (1 + root)): the difference is formed as such; near the centre
    # also what the rise, (size - q)/2, leaves of it.
    far = q / (root * (1.0 + root)) + rise
    near = 0.5 * size - 0.5 * q * q * (root + 2.0) / (root * (1.0 + root) ** 2)
    return mu * inverse_norm(s) * jnp.where(size < 0.25, near, far)


def _same_rank(r: Vector, s: Vector) -> tuple[Vector, Vector]:
    rank = max(r.ndim, s.ndim) - 1
    return with_rank(r, rank), with_rank(s, rank)


@final
class ThirdBody(AbstractEffect):
    """Attraction by another body that moves on a given path, such as the moon or the sun."""

    mu: NumberField = quantity(
        "m^3/s^2", positive=True, doc="gravitational parameter of the other body"
    )
    # The checker takes the quantity above for a default.
    path: Path = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        metadata={"doc": "of the other body from the centre"}
    )

    uniform: ClassVar[bool] = True

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        assert y.position is not None
        return Load(acceleration_N=third_body(y.position, self.path(t), self.mu))

    def scaled(self, factor: Scalar) -> "ThirdBody | None":
        # A factor of zero would give the body no mass, which `mu` rejects.
        del factor
        return None

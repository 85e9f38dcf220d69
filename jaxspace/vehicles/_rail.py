"""A launch rail: it guides a body along a line without rotation, and supports it until the thrust
exceeds its weight.

    v' = d (d . a),   omega' = 0,   and v' = 0 while v = 0 and d . a < 0

    symbol  meaning                                            unit
    d       direction of the rail                              1
    a       acceleration that the body would have without it   m/s^2

Source: Harrison and Nettleton 4.7 (constraint of a smooth guide).
"""

import dataclasses
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, event, quantity
from ..core.shapes import with_rank
from ..core.vectors import dot, unit


@final
class Rail(AbstractEffect):
    """A smooth launch rail from the origin of the axes, which rests in them. It is left when the
    travel exceeds its length: the phase's event `rail_exit`."""

    direction: Float[Array, "3 *#runs"] = quantity("", direction=True, doc="of non-zero length")
    length: NumberField = quantity("m", positive=True, doc="travel along the rail")
    origin: Float[Array, "3 *#runs"] = quantity(
        "m", default=(0.0, 0.0, 0.0), doc="where the centre of mass rests before the launch"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, y, body
        return Load()

    def constrained(self, t: Scalar, y: BodyState, rate: BodyState) -> BodyState:
        del t
        d = self._axis(y.position)
        along = dot(d, rate.velocity)
        # Until the thrust exceeds the weight, the vehicle rests on its stop and does not slide
        # down.
        held = (along < 0.0) & (dot(d, y.velocity) <= 0.0)
        rates = {"velocity": jnp.where(held, 0.0, along) * d}
        if rate.omega is not None:
            # Not zero times the rate: the compiler then leaves out the moments.
            rates["omega"] = jnp.zeros_like(rate.omega)
        return dataclasses.replace(rate, **rates)

    @event("m", direction=1, needs=("position",))
    def rail_exit(self, t: Scalar, y: BodyState) -> Scalar:
        """Travel beyond the end of the rail, m."""
        del t
        moved = y.position - with_rank(self.origin, y.position.ndim - 1)
        return dot(self._axis(y.position), moved) - self.length

    def _axis(self, like: Vector) -> Vector:
        return unit(with_rank(self.direction, like.ndim - 1)) + 0.0 * like

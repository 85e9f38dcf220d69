"""Free numbers q in place of scaled unknowns z with bounds, for optimisers that know no bounds.

    a <= z <= b    z = z0 + h [sin(p + (q - z0)/h) - sin p],    h = (b - a)/2,  sin p = (z0 - m)/h
    a <= z         z = a - 1 + sqrt(1 + q^2)                    m = (a + b)/2
    z <= b         z = b + 1 - sqrt(1 + q^2)

No slope is above one: a step is as long in z as in q, and shorter near a bound, where the slope
vanishes, so that an optimum there is an ordinary point of a descent. A projection would do for
steps of a given length; a line search and the curvature of L-BFGS need a smooth function, which
the problem on a clipped step is not.

Source: James and Roos, MINUIT (Comput. Phys. Commun. 10, 1975), here with a slope of one.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Numbers = Float[Array, " n"]

# How near a bound a descent may begin, in sizes or in ranges: on it the slope of the map is zero.
NEAREST = 1e-3


class FreeNumbers(NamedTuple):
    """The map for unknowns between `low` and `high`, each of which may be infinite; `start`: z0,
    within them."""

    start: Numbers
    low: Numbers
    high: Numbers

    def inside(self, q: Numbers) -> Numbers:
        """The z of unconstrained variables."""
        below, above, low, h = self._sides()
        high = jnp.where(above, self.high, 0.0)
        # By the half of the difference, which preserves the digits of a z that is small compared
        # with h.
        half = 0.5 * (q - self.start) / h
        both = self.start + 2.0 * h * jnp.cos(self._phase(low, h) + half) * jnp.sin(half)
        root = q * q / (1.0 + jnp.sqrt(1.0 + q * q))
        one = jnp.where(below, low + root, jnp.where(above, high - root, q))
        return jnp.where(below & above, both, one)

    def first(self) -> Numbers:
        """The unconstrained variables of the start."""
        below, above, low, _ = self._sides()
        off = 1.0 + jnp.where(
            below, self.start - low, jnp.where(above, self.high, 0.0) - self.start
        )
        one = jnp.sqrt(jnp.maximum(off * off - 1.0, 0.0))
        return jnp.where(below != above, one, self.start)

    def _phase(self, low: Numbers, h: Numbers) -> Numbers:
        return jnp.arcsin(jnp.clip((self.start - low) / h - 1.0, -1.0, 1.0))

    def _sides(self) -> tuple[Array, Array, Numbers, Numbers]:
        """Whether there are bounds, and finite numbers for a and h: the branch that is not taken
        would be NaN in its derivative."""
        below, above = jnp.isfinite(self.low), jnp.isfinite(self.high)
        low = jnp.where(below, self.low, 0.0)
        return below, above, low, jnp.where(below & above, 0.5 * (self.high - low), 1.0)


def free_numbers(z: Numbers, low: Numbers, high: Numbers) -> FreeNumbers:
    """The map for a search from z, which is moved inside where it is on a bound or beyond."""
    near = NEAREST * jnp.minimum(high - low, 1.0)
    return FreeNumbers(jnp.clip(z, low + near, high - near), low, high)

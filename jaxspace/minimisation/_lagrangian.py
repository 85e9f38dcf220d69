"""The augmented Lagrangian of a scaled problem, which an optimiser of optax minimises.

    L(z) = f + y . c + (rho/2) |c|^2 + (1/2 rho) sum [max(0, nu - rho d)^2 - nu^2]
    grad L = g + J^T y+ - K^T nu+,     y+ = y + rho c,   nu+ = max(0, nu - rho d)

    symbol         meaning
    f, c, d        objective, equalities, inequalities d >= 0; g, J, K: their derivatives
    y, nu          multipliers, which become y+ and nu+ at the end of a round
    rho            weight of the constraints

The gradient of L is that of the Lagrangian with y+ and nu+, so that the same measure applies during
a round and at its end. An optimiser gets L times 10/rho: the curvature along the constraints then
is that of the first round, whatever rho is, and a rate that was stable remains so.

Source: Hestenes 1969, Powell 1969, Rockafellar 1973; Nocedal and Wright, 17.3, 17.4.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

FIRST_WEIGHT = 10.0


class Multipliers(NamedTuple):
    """`y` of c, `nu` of d, and the weight `rho`."""

    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    rho: Float[Array, ""]

    def of(self, c: Float[Array, " equal"], d: Float[Array, " inequal"]) -> "Multipliers":
        """Multipliers with which the gradient of L at c and d is that of the Lagrangian."""
        return Multipliers(
            self.y + self.rho * c, jnp.maximum(self.nu - self.rho * d, 0.0), self.rho
        )

    @property
    def share(self) -> Float[Array, ""]:
        """The factor of L for the optimiser."""
        if not self.y.size + self.nu.size:
            return jnp.ones_like(self.rho)
        return FIRST_WEIGHT / self.rho

    def lagrangian(self, f: Array, c: Array, d: Array) -> Float[Array, ""]:
        """L times its factor for the optimiser."""
        # Without constraints nothing is left to compile.
        if not c.size + d.size:
            return f
        active = jnp.maximum(self.nu - self.rho * d, 0.0)
        total = f + jnp.sum(self.y * c + 0.5 * self.rho * c * c)
        total = total + jnp.sum(active * active - self.nu * self.nu) / (2.0 * self.rho)
        return self.share * total

    def missed(self, c: Array, d: Array) -> Float[Array, ""]:
        """The largest |c|, or |min(d, nu/rho)|: either d or its multiplier must be zero, and
        neither negative."""
        largest = jnp.max(jnp.abs(c), initial=0.0)
        return jnp.maximum(
            largest, jnp.max(jnp.abs(jnp.minimum(d, self.nu / self.rho)), initial=0.0)
        )

"""Convergence judged by the scales at the place of the result.

The weights of a search (`_scaling.py`) come from the derivatives at its start. Near a singularity,
or where an exponential is large, those exceed the derivatives near the minimum by any factor, and a
tolerance in units of them is meaningless. A search that has met its tolerance is therefore judged
once more:

    |L_i| s_i <= tolerance F_i,     F_i = max(1e-3 |f|, max |g - L| s, 100 |D_i| s_i / h)
    |c_j|     <= tolerance 100 max |J_j| s

    symbol    meaning
    z, s      scaled unknowns, their sizes here
    L         slope of the Lagrangian, without those of active bounds
    f, g      objective, its slope
    c_j, J_j  violation of a constraint, its derivatives
    D, h      change of L along a displacement h s against the signs of L; its relative length

The slope at the displaced point is evaluated only where the first two sizes in F do not suffice.
The factor 100 allows an error of 100 tolerances in the unknowns, of which the objective shows the
square. If the judgement fails, the weights become those of this place, and the search continues.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._scaling import LEAST_SLOPE
from ._sqp_measures import slope
from ._sqp_state import Limits, Values

# Errors of the unknowns that are accepted, in units of the tolerance.
ALLOWED = 1e2
# By how much more than needed the weights grow.
BEYOND = 10.0
# Relative length of the displacement: short compared with the unknowns, long compared with their
# rounding.
DISPLACEMENT = 1e-3
# At a minimum without curvature every judgement leads closer; this many bring enough digits.
MOST_JUDGEMENTS = 12


class Judged(NamedTuple):
    """A place with its multipliers, and the sizes of the unknowns there."""

    z: Float[Array, " n"]
    at: Values
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    size: Float[Array, " n"]

    def displaced(self, limits: Limits) -> Float[Array, " n"]:
        """The point at which the slope is compared."""
        downhill = jnp.where(slope(self.at, self.y, self.nu) >= 0.0, -1.0, 1.0)
        place = self.z + DISPLACEMENT * self.reach(limits) * downhill
        return jnp.clip(place, limits.lower, limits.upper)

    def reach(self, limits: Limits) -> Float[Array, " n"]:
        """Sizes of the unknowns, at most the distance of the bound towards which each descends;
        zero at that bound."""
        down = slope(self.at, self.y, self.nu) >= 0.0
        room = jnp.where(down, self.z - limits.lower, limits.upper - self.z)
        rounding = 10.0 * jnp.finfo(self.z.dtype).eps * jnp.maximum(1.0, jnp.abs(self.z))
        return jnp.where(room <= rounding, 0.0, jnp.minimum(self.size, room))

    def growth(
        self, limits: Limits, curvature: Array | float = 0.0
    ) -> tuple[Bool[Array, ""], Float[Array, " all"]]:
        """Whether the place misses the tolerance, and the factors by which the weights of the
        objective and of the constraints have to grow to show it.

        - `curvature`: of the Lagrangian along each unknown."""
        at, s = self.at, self.reach(limits)
        whole = slope(at, self.y, self.nu)
        # The part of the slope that constraints and bounds balance.
        balanced = jnp.abs(at.g - jnp.where(s > 0.0, whole, 0.0)) * self.size
        value = jnp.maximum(LEAST_SLOPE * jnp.abs(at.f), jnp.max(balanced))
        own = jnp.maximum(value, ALLOWED * curvature * s * s)
        loose = jnp.minimum(jnp.maximum(at.d, 0.0), self.nu)
        violated = jnp.concatenate([jnp.abs(at.c), jnp.maximum(-at.d, loose)])
        rows = jnp.abs(jnp.concatenate([at.J, at.K])) * self.size
        allowed = ALLOWED * jnp.max(rows, axis=1, initial=0.0)
        f_missed = (jnp.abs(whole) * s > limits.tolerance * own) & (own > 0.0)
        missed = (violated > limits.tolerance * allowed) & (allowed > 0.0)
        f = jnp.max(jnp.where(f_missed, s / jnp.where(f_missed, own, 1.0), 0.0))
        others = jnp.where(missed, 1.0 / jnp.where(missed, allowed, 1.0), 0.0)
        factors = jnp.maximum(BEYOND * jnp.concatenate([f[None], others]), 1.0)
        return jnp.any(f_missed) | jnp.any(missed), factors

    def curvature(self, displaced: Values, limits: Limits) -> Float[Array, " n"]:
        """Magnitude of the curvature along each unknown, from the values at `displaced`."""
        change = slope(displaced, self.y, self.nu) - slope(self.at, self.y, self.nu)
        reach = self.reach(limits)
        found = jnp.abs(change) / (DISPLACEMENT * jnp.where(reach > 0.0, reach, self.size))
        # Beyond its domain the objective is meaningless.
        return jnp.where(displaced.sound(), found, jnp.inf)


def local_sizes(z: Float[Array, " n"], start: Float[Array, " n"]) -> Float[Array, " n"]:
    """Sizes of the scaled unknowns: the larger of z and of the start, if it is not zero."""
    least = float(jnp.finfo(z.dtype).eps) ** (2.0 / 3.0)
    first = jnp.where(start == 0.0, 1.0, jnp.maximum(jnp.abs(start), least))
    return jnp.maximum(jnp.abs(z), first)

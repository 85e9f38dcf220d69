"""Detection of constraints that cannot be met, as against a search that stops early.

    r = sum_i w_i grad c_i - sum_j w_j grad d_j        w_j >= 0, the largest |w| = 1
    |z - clip(z - r, lower, upper)| <= min(e, V/10),   V = sum_i w_i c_i - sum_j w_j d_j > 0

The projected r is the first-order condition of a least violation V: to first order no step within
the bounds reduces it; e is 1e-3, in float32 0.01. With the violations themselves as weights w it is
the condition for their sum of squares, with the multipliers of an exact penalty the one for their
sum. All numbers are scaled as in `_scaling.py`: a gradient that does not vanish is then of order
one.

Source: Nocedal and Wright, Numerical Optimization, 17.2, 18.5 (stationary points of infeasibility).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

# Bound on r. A search with penalty weights of 1e6 leaves a millionth of the objective's slope in r.
VANISHED = 1e-3
# The violation is flat at its minimum, so a search that compares violations ends within the square
# root of one rounding of it, and r as near to zero. This is the bound on r in such square roots.
NEAREST = 30.0
# A slope is small if meeting the constraints along it would take more than so many unit steps.
FARTHEST = 10.0
# Least violation, in roundings. Below it rounding decides the signs from which the weights follow.
ROUNDINGS = 1e4


def unit_weights(
    equal: Float[Array, " equal"], above: Float[Array, " inequal"]
) -> tuple[Float[Array, " equal"], Float[Array, " inequal"]]:
    """Weights of c and d divided by the largest of them, those of d not negative; zeros remain
    zero."""
    above = jnp.maximum(above, 0.0)
    largest = jnp.maximum(jnp.max(jnp.abs(equal), initial=0.0), jnp.max(above, initial=0.0))
    divisor = jnp.where(largest > 0.0, largest, 1.0)
    return equal / divisor, above / divisor


def least_violation(
    z: Float[Array, " n"],
    gradient: Float[Array, " n"],
    weighted: Float[Array, ""],
    largest: Float[Array, ""],
    ends: tuple[Float[Array, " n"], Float[Array, " n"]],
) -> Bool[Array, ""]:
    """Whether the first-order condition of a least violation is satisfied.

    - `gradient`: r at z, and `weighted`: V, both by weights whose largest is one.
    - `largest`: the largest violation.
    - `ends`: lower and upper bounds of z."""
    # z - clip(z - r) without the difference of large z, in which a small r would vanish.
    steps = jnp.clip(gradient, z - ends[1], z - ends[0])
    present = largest > ROUNDINGS * jnp.finfo(z.dtype).eps
    vanished = jnp.maximum(VANISHED, NEAREST * jnp.sqrt(jnp.finfo(z.dtype).eps))
    # False for NaN, which is not below anything.
    still = jnp.max(jnp.abs(steps)) <= jnp.minimum(vanished, weighted / FARTHEST)
    return present & (weighted > 0.0) & still

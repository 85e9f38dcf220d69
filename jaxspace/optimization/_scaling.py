"""A minimisation problem, scaled to numbers of order one for both methods of `minimise`.

    z = x / size        f, c, d -> weight * (f, c, d)

    size      `scale`; by default the range of the bounds, or the larger of the start and 1
    weight    the inverse of the largest derivative in z at the start

The multipliers of the problem itself follow: a multiplier is the quotient of two scaled numbers.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from ..core import Scalar
from ._criterion import Criterion, Minimum, Point
from ._entry import shapes_of
from ._search import Common, joined_rows, reason_of

# Near the optimum the slope vanishes and cannot set the scale: there the value does.
LEAST_SLOPE = 1e-3


class ScaledProblem(NamedTuple):
    """A problem in scaled unknowns z = x / `size`.

    - `start`: the first z, between the bounds `low` and `high`.
    - `unravel`: turns a flat x into a point.
    - `blank`: a criterion of zeros.
    - `me`, `mi`: numbers of equalities and of inequalities."""

    problem: Callable[[Point], Criterion]
    start: Float[Array, " n"]
    size: Float[Array, " n"]
    low: Float[Array, " n"]
    high: Float[Array, " n"]
    unravel: Callable[[Array], Point]
    blank: Criterion
    me: int
    mi: int

    def numbers(self, z: Array) -> tuple[Array, Criterion]:
        """f, c and d in one array, in their own units; and the criterion."""
        criterion = self.problem(self.unravel(self.size * z))
        parts = (criterion.objective, criterion.equal_zero, criterion.non_negative)
        return jnp.concatenate([jnp.ravel(x) for x in parts if x is not None]), criterion

    def minimum(
        self,
        last: Any,
        criterion: Criterion,
        z: Array,
        slope: Array,
        ends: tuple[Array, Array, Array, Array, bool],
        tolerance: Scalar,
        before: Minimum | None,
    ) -> Minimum:
        """Build the result of a search from its `last` state, in the units of the problem.

        **Arguments**

        - `last`: state of the search, in scaled numbers.
        - `criterion`, `z`: objective and constraints at the scaled unknowns z.
        - `slope`: gradient of the scaled Lagrangian in z.
        - `ends`: five flags: the numbers are finite; the steps are used up; the violation is at a
          minimum; the unknowns have diverged; the search was interrupted.
        - `tolerance`: largest gradient and violation, scaled, at which the search has converged.
        - `before`: result of the search that this one continues, or `None`."""
        finite, limited, least, astray, interrupted = ends
        c, d = criterion.equal_zero, criterion.non_negative
        weight = last.weight
        y = last.y * weight[1 : 1 + self.me] / weight[0]
        nu = last.nu * weight[1 + self.me :] / weight[0]
        violation = jnp.zeros_like(last.gradient)
        if c is not None:
            violation = jnp.maximum(violation, jnp.max(jnp.abs(c)))
        if d is not None:
            violation = jnp.maximum(violation, jnp.max(-d))
        missed = last.violation > tolerance
        # `finite` is needed as well: NaN does not exceed a tolerance, and an infinite objective can
        # have a gradient of zero.
        converged = (last.gradient <= tolerance) & ~missed & finite
        return Minimum(
            x=self.unravel(self.size * z),
            criterion=criterion,
            multipliers=Criterion(
                jnp.ones_like(last.gradient),
                None if c is None else y.reshape(c.shape),
                None if d is None else nu.reshape(d.shape),
            ),
            gradient=last.gradient,
            violation=violation,
            steps=last.steps,
            converged=converged,
            gradient_error=last.wrong,
            reason=reason_of(
                last.wrong, interrupted, finite, converged, limited, missed & least, astray
            ),
            bound_multipliers=self.unravel(slope / (weight[0] * self.size)),
            history=joined_rows(before, last.rows),
            search=last,
            tolerance=jnp.asarray(tolerance, last.gradient.dtype),
        )


def scaled_problem(common: Common, scale: PyTree | None, before: Minimum | None) -> ScaledProblem:
    """The problem of `minimise` in scaled unknowns: those of the search `before`, if given."""
    x0, unravel = ravel_pytree(common.start)
    low, high = (ravel_pytree(b)[0] for b in common.limits)
    size = _sizes(x0, low, high) if scale is None else ravel_pytree(scale)[0].astype(x0.dtype)
    if before is not None:
        size = getattr(before.search, "size", size)
    shapes = shapes_of(common.problem, common.start)
    blank = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)
    me = 0 if shapes.equal_zero is None else shapes.equal_zero.size
    mi = 0 if shapes.non_negative is None else shapes.non_negative.size
    # A start far outside of the bounds would leave the first programme without a solution.
    z0 = jnp.clip(x0, low, high) / size
    return ScaledProblem(
        common.problem, z0, size, low / size, high / size, unravel, blank, me, mi
    )  # fmt: skip


def weights(objective: Float[Array, ""], rows: Float[Array, " rows"]) -> Float[Array, " rows"]:
    """The inverse of the size of each row of the Jacobian, from the largest derivatives in the
    `rows`, of which the first is that of the `objective`; 1 for a row of zeros."""
    rows = rows.at[0].max(LEAST_SLOPE * jnp.abs(objective))
    usable = (rows > 0.0) & jnp.isfinite(rows)
    return jnp.where(usable, 1.0 / jnp.where(usable, rows, 1.0), 1.0)


def _sizes(x: Array, low: Array, high: Array) -> Array:
    """The range of the bounds, or the larger of the start and 1."""
    both = jnp.isfinite(low) & jnp.isfinite(high)
    return jnp.where(both, jnp.where(both, high - low, 1.0), jnp.maximum(jnp.abs(x), 1.0))

"""A minimisation problem, scaled to numbers of order one.

    z = x / size        f, c, d -> weight * (f, c, d)

    size      `scale`; by default the range of the bounds, or the larger of the start and 1
    weight    the inverse of the largest derivative in z at the start, or where that is far smaller
              than the value, of a part of the value; larger where the derivatives near the result
              are far smaller (`_local_scale.py`)

The multipliers of the problem itself follow: a multiplier is the quotient of two scaled numbers.
Source: Waechter and Biegler 2006, 3.8 (scaling by the gradients at the start).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from ._bounds import Bounds
from ._criterion import Criterion, Minimum, Point
from ._entry import shapes_of

# Where the slope vanishes, as that of an objective near its minimum or of |x|^2 - 1 at x = 0, the
# value sets the scale.
LEAST_SLOPE = 1e-3


class ScaledProblem(NamedTuple):
    """A problem in scaled unknowns z = x / `size`.

    - `start`: the first z, between the bounds `low` and `high`; `ends`: the bounds of x.
    - `unravel`: turns a flat x into a point.
    - `blank`: a criterion of zeros.
    - `me`, `mi`: numbers of equalities and of inequalities; `bounded`: whether there are bounds."""

    problem: Callable[[Point], Criterion]
    start: Float[Array, " n"]
    size: Float[Array, " n"]
    low: Float[Array, " n"]
    high: Float[Array, " n"]
    ends: tuple[Float[Array, " n"], Float[Array, " n"]]
    unravel: Callable[[Array], Point]
    blank: Criterion
    me: int
    mi: int
    bounded: bool

    def point(self, z: Array) -> Point:
        """The point of z, within its bounds, beyond which its product with the size may round."""
        x = self.size * z
        # The derivative is that without the bounds: at a bound, that of `clip` is one half.
        return self.unravel(x + jax.lax.stop_gradient(jnp.clip(x, *self.ends) - x))

    def numbers(self, z: Array) -> tuple[Array, Criterion]:
        """f, c and d in one array, unscaled; and the criterion."""
        criterion = self.problem(self.point(z))
        parts = (criterion.objective, criterion.equal_zero, criterion.non_negative)
        return jnp.concatenate([jnp.ravel(x) for x in parts if x is not None]), criterion

    def derivatives(self, z: Array, ratio: float) -> tuple[Array, tuple[Array, Criterion]]:
        """The Jacobian of f, c and d in z, with their values and the criterion: by forward mode
        for up to `ratio` unknowns for each number."""

        def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
            stacked, criterion = self.numbers(z)
            return stacked, (stacked, criterion)

        # Forward mode costs a run for each unknown; reverse mode costs several runs for each
        # number, and compiles for longer.
        forward = self.start.size <= ratio * (1 + self.me + self.mi)
        mode = jax.jacfwd if forward else jax.jacrev
        return mode(numbers, has_aux=True)(z)

    def values(self, z: Array, ratio: float) -> Array:
        """f, c and d, which a line search differentiates once more: by the mode of
        `derivatives`."""

        @jax.custom_jvp
        def values(z: Array) -> Array:
            return self.numbers(z)[0]

        @values.defjvp
        def by_jacobian(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
            jacobian, (stacked, _) = self.derivatives(*primals, ratio)
            return stacked, jacobian @ tangents[0]

        return values(z)


def scaled_problem(
    problem: Callable[[Point], Criterion],
    start: Point,
    limits: Bounds,
    scale: PyTree | None,
    before: Minimum | None,
    bounded: bool,
) -> ScaledProblem:
    """The problem of `minimise` in scaled unknowns, with the scales of the search `before`, if
    given."""
    x0, unravel = ravel_pytree(start)
    low, high = (ravel_pytree(b)[0] for b in limits)
    # A start outside of the bounds would leave the first programme without a solution, and does not
    # indicate the size of the unknowns.
    x0 = jnp.clip(x0, low, high)
    size = _sizes(x0, low, high) if scale is None else ravel_pytree(scale)[0].astype(x0.dtype)
    if before is not None:
        size = getattr(before.search, "size", size)
    shapes = shapes_of(problem, start)
    blank = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)
    me = 0 if shapes.equal_zero is None else shapes.equal_zero.size
    mi = 0 if shapes.non_negative is None else shapes.non_negative.size
    scaled = (x0 / size, size, low / size, high / size)
    return ScaledProblem(problem, *scaled, (low, high), unravel, blank, me, mi, bounded)


def weights(values: Float[Array, " rows"], jacobian: Float[Array, "rows n"]) -> Array:
    """The inverse of the size of each row of f, c and d, from its largest derivative in z, but at
    least from `LEAST_SLOPE` of its value; 1 for a row of zeros."""
    rows = jnp.max(jnp.abs(jacobian), axis=1)
    rows = jnp.maximum(rows, LEAST_SLOPE * jnp.abs(values))
    usable = (rows > 0.0) & jnp.isfinite(rows)
    return jnp.where(usable, 1.0 / jnp.where(usable, rows, 1.0), 1.0)


def _sizes(x: Array, low: Array, high: Array) -> Array:
    """The range of the bounds, or the larger of the start and 1."""
    both = jnp.isfinite(low) & jnp.isfinite(high)
    return jnp.where(both, jnp.where(both, high - low, 1.0), jnp.maximum(jnp.abs(x), 1.0))

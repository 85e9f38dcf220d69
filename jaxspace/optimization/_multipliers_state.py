"""State of a search by the method of multipliers, and its augmented Lagrangian.

The symbols are those of `_multipliers.py`."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int

from ..core import Scalar
from ._criterion import Criterion
from ._gradient_check import PROBES


class Line(NamedTuple):
    """A line search along p from x: the slope there, the trial t, its bracket with the value and
    the slope at the lower end and the value at the upper one, and how many trials there were."""

    p: Float[Array, " n"]
    slope: Float[Array, ""]
    t: Float[Array, ""]
    low: Float[Array, ""]
    low_value: Float[Array, ""]
    low_slope: Float[Array, ""]
    high: Float[Array, ""]
    high_value: Float[Array, ""]
    trials: Int[Array, ""]


class Descent(NamedTuple):
    """State of the search.

    - `x`: the free numbers; `value` and `slopes` are L there and its gradient.
    - `criterion`: objective and constraints at x; `values` are its f, c and d, in the units of the
      problem.
    - `y`, `nu`, `rho`: scaled multipliers, and the weight of the violation.
    - `held`: the gradient in the scaled unknowns, before the maps of the bounds.
    - `measured`: number of rows (f, c, d) whose largest derivative is in `sloped`, and whose slope
      along the probes of the gradient is in `claimed`.
    - `judged`: whether `outward` holds the gradient of the violation in the scaled unknowns.
    - `size`, `weight`, `rows`, `calls`, `probed`, `wrong`, `worst`: as in `_sqp_state.py`."""

    x: Float[Array, " n"]
    size: Float[Array, " n"]
    trial: Float[Array, " n"]
    value: Float[Array, ""]
    slopes: Float[Array, " n"]
    held: Float[Array, " n"]
    values: Float[Array, " all"]
    criterion: Criterion
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    rho: Float[Array, ""]
    memory: Any
    adam: Any
    adam_left: Int[Array, ""]
    line: Line
    fresh: Bool[Array, ""]
    gradient: Float[Array, ""]
    violation: Float[Array, ""]
    steps: Int[Array, ""]
    round_steps: Int[Array, ""]
    taken: Int[Array, ""]
    rows: Float[Array, "rounds 3"]
    calls: Int[Array, ""]
    probed: Float[Array, "4 all"]
    claimed: Float[Array, " all"]
    wrong: Float[Array, ""]
    worst: Int[Array, ""]
    weight: Float[Array, " all"]
    sloped: Float[Array, " all"]
    measured: Int[Array, ""]
    judged: Bool[Array, ""]
    outward: Float[Array, " n"]


class Evaluation(NamedTuple):
    """L and its gradient at a trial, and `held`, `values` and `criterion` of `Descent`."""

    value: Float[Array, ""]
    slopes: Float[Array, " n"]
    held: Float[Array, " n"]
    values: Float[Array, " all"]
    criterion: Criterion


class Options(NamedTuple):
    """The options of `minimise` that this method has, and how far the free numbers may go."""

    tolerance: Scalar
    max_steps: int
    adam_rate: Scalar
    farthest: Scalar


def begin(
    x: Float[Array, " n"],
    size: Float[Array, " n"],
    me: int,
    mi: int,
    blank: Criterion,
    max_rounds: int,
    adam_steps: int,
    check: bool,
) -> Descent:
    """The state before the first evaluation; `size`, `me`, `mi` as in `_sqp_state.py`, `blank`: a
    criterion of zeros."""
    zeros, one = jnp.zeros_like(x), jnp.ones((), x.dtype)
    values = jnp.zeros(1 + me + mi, x.dtype)
    no, none = jnp.asarray(0), 0.0 * one
    calls = jnp.asarray(-PROBES if check else 0)
    with jax.numpy_dtype_promotion("standard"):
        memory, adam = optax.scale_by_lbfgs().init(x), optax.scale_by_adam().init(x)
    return Descent(
        x, size, x, none, zeros, zeros, values, blank, values[1 : 1 + me], values[1 + me :],
        10.0 * one,
        memory, adam, jnp.asarray(adam_steps), line_from(zeros, one, none, none), jnp.asarray(True),
        jnp.inf * one, one, no, no, no, jnp.full((max_rounds, 3), jnp.nan, x.dtype), calls,
        jnp.zeros((PROBES, values.size), x.dtype), values, none, no, jnp.ones_like(values), values,
        no, jnp.asarray(False), zeros,
    )  # fmt: skip


def line_from(p: Array, slope: Array, value: Array, t: Array) -> Line:
    """A line search along p before its first trial t."""
    zero = 0.0 * value
    return Line(p, slope, t, zero, value, slope, jnp.inf + zero, zero, jnp.asarray(0))


def lagrangian(values: Array, s: Descent) -> Float[Array, ""]:
    """The augmented Lagrangian L of f, c, d in the units of the problem."""
    f, c, d = scaled_numbers(values, s)
    active = jnp.maximum(s.nu - s.rho * d, 0.0)
    total = f + jnp.sum(s.y * c + 0.5 * s.rho * c * c)
    return total + jnp.sum(active * active - s.nu * s.nu) / (2.0 * s.rho)


def scaled_numbers(values: Array, s: Descent) -> tuple[Array, Array, Array]:
    """f, c and d times the weight of each."""
    values = s.weight * values
    return values[0], values[1 : 1 + s.y.size], values[1 + s.y.size :]

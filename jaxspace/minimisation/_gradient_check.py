"""Check of the gradient of an objective against a difference along one direction.

    D(h) = [f(x + h d) - f(x - h d)] / 2h          D = [4 D(h/2) - D(h)] / 3 + O(h^4)
    D(h) = [4 f(x + h d/2) - f(x + h d) - 3 f(x)] / h      beside bounds; D as above, + O(h^3)

The gradient of a run is that of its steps. Where a control has kinks that are not breaks of the
integration, steps pass over the effect of a single value: the run is right and its gradient is not,
and a descent ends at a wrong point or diverges. A search therefore does not start with a gradient
that is not the slope. Beyond its bounds an objective may be anything: near a bound the direction d
leads inwards, half of the way to the other bound at most, and the difference is one-sided.

A slope that changes within h, like that of -log(x) at x << h, has no accurate difference: D(h)
and D(h/2) then differ by a large part of themselves. Such a difference judges nothing, and the
check is repeated with a hundredth of h, up to four times.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..core import InputError

GRADIENT_TOLERANCE = 1e-3
"""Measured for runs at the default tolerance: right gradients agree with the difference to 1e-8,
those by an interpolation without breaks to 1e-2; an error below 1e-3 does not harm a descent."""
ALLOWANCE = 3.0
"""Allowance for the errors of D(h) and D(h/2), in units of their difference. The part of rounding
and of the tolerance of a run is effectively random."""
PROBES = 4
FINER, MOST_LEVELS = 1e-2, 4
"""Factor by which h is reduced where the slope changes within it, and the number of reductions."""
VARIES = 0.1
"""Relative difference of D(h) and D(h/2) above which they do not approximate a slope."""
MOST_NAMED = 4
NEAR = 0.1
"""Relative distance of the probes up to which the slope of a singular function, as log(x), is the
slope at x: beyond it the slope may be another one, as constant as that of x - log(x) at x >> 1."""
NOISE = 1e-8
"""Relative errors of values, as of runs: differences within them are not counted as a change of the
slope."""


class Probes(NamedTuple):
    """Points at which a gradient is checked: x plus `shares` of a `direction`.

    - `inwards`: whether all are on one side of x, which is close to a bound; the last is x
      itself."""

    direction: Float[Array, " n"]
    shares: Float[Array, "4"]
    inwards: Bool[Array, ""]


def probes(
    x: Float[Array, " n"],
    size: Float[Array, " n"],
    low: Float[Array, " n"] | float = -jnp.inf,
    high: Float[Array, " n"] | float = jnp.inf,
    level: Int[Array, ""] | int = 0,
) -> Probes:
    """The probes about an `x` between bounds: along one fixed direction of effectively random
    components, each of the `size` of its unknown; the `level` counts reductions of h."""
    # The best step of a difference of fourth order, before it is reduced.
    h = jnp.asarray(float(jnp.finfo(x.dtype).eps) ** 0.2, x.dtype) * FINER ** jnp.asarray(
        level, x.dtype
    )
    # Not random: the same start has the same result every time.
    d = size * jnp.asarray(np.cos(2.4 * np.arange(x.size) + 1.0), x.dtype)
    # Never up to a bound, where the objective may be singular.
    above, below = 0.5 * (high - x) / h, 0.5 * (x - low) / h
    fits = jnp.abs(d) <= jnp.minimum(above, below)
    # To the side with more space, as far as it allows.
    turned = jnp.where(above >= below, 1.0, -1.0) * jnp.minimum(
        jnp.abs(d), jnp.maximum(above, below)
    )
    inwards = ~jnp.all(fits)
    both, one = (jnp.array(k, x.dtype) for k in ([1.0, -1.0, 0.5, -0.5], [1.0, 0.5, 0.25, 0.0]))
    shares = h * jnp.where(inwards, one, both)
    return Probes(jnp.where(fits, d, turned), shares, inwards)


def probed_error(
    rows: Float[Array, "4 rows"], p: Probes, claimed: Float[Array, " rows"]
) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Error of gradients against differences of the `rows` of values at the probes.

    **Arguments**

    - `rows`: scaled values at the probes.
    - `claimed`: the gradient of each row times the direction.

    **Returns** the relative error, and the row with the largest one. The error is that of one
    mixture of all rows, because in a row that hardly changes rounding would dominate. If it exceeds
    the tolerance, the error of the named row replaces it where that is larger. Within the
    uncertainty of the differences the error is zero."""
    mixture = jnp.cos(1.3 * jnp.arange(claimed.size, dtype=claimed.dtype))
    beyond, largest = _beyond(rows @ mixture, p, claimed @ mixture)
    error = _quotient(beyond, largest)
    errors, sizes = _beyond(rows, p, claimed)
    worst = jnp.argmax(jnp.where(jnp.isfinite(errors), errors, 0.0))
    # If the mixture is wrong, the error of the named row is reported where it is larger.
    named = jnp.maximum(error, _quotient(errors[worst], sizes[worst]))
    return jax.lax.stop_gradient(jnp.where(error > GRADIENT_TOLERANCE, named, error)), worst


def varies(
    rows: Float[Array, "4 rows"],
    p: Probes,
    claimed: Float[Array, " rows"],
    x: Float[Array, " n"],
) -> Bool[Array, ""]:
    """Whether the slope of some row with a wrong gradient changes so much between the probes that
    their difference is meaningless, or the probes are so far from a small `x` that it may be; the
    other arguments are those of `probed_error`."""
    slope, uncertain, h = _slopes(rows, p)
    least = jnp.maximum(NOISE, 1e2 * jnp.finfo(rows.dtype).eps)
    noise = least * jnp.max(jnp.abs(rows), axis=0) / h
    known = uncertain <= jnp.maximum(VARIES * jnp.abs(slope), noise)
    errors, sizes = _beyond(rows, p, claimed)
    # Written so that a value that is not finite counts as one.
    right = errors <= GRADIENT_TOLERANCE * sizes
    return jnp.any(~right & (~known | too_far(p, x)))


def too_far(p: Probes, x: Float[Array, " n"]) -> Bool[Array, ""]:
    """Whether some unknown other than zero is small compared with the distance of its probe."""
    size = jnp.abs(x)
    return jnp.any((size > 0.0) & (jnp.abs(p.shares[0] * p.direction) > NEAR * size))


def _quotient(beyond: Array, largest: Array) -> Array:
    error = beyond / jnp.where(largest > 0.0, largest, 1.0)
    # Outside its domain the objective is infinite and has no slope.
    return jnp.where(jnp.isfinite(error), error, 0.0)


def _beyond(values: Array, p: Probes, claimed: Array) -> tuple[Array, Array]:
    """Difference of slopes beyond its uncertainty, and the larger magnitude of both."""
    slope, uncertain, h = _slopes(values, p)
    rounding = 10.0 * jnp.finfo(values.dtype).eps * jnp.max(jnp.abs(values), axis=0) / h
    error = jnp.abs(slope - claimed)
    beyond = jnp.maximum(error - ALLOWANCE * jnp.maximum(uncertain, rounding), 0.0)
    return beyond, jnp.maximum(jnp.abs(slope), jnp.abs(claimed))


def _slopes(values: Array, p: Probes) -> tuple[Array, Array, Array]:
    """D, the difference of D(h) and D(h/2), and h."""
    h = p.shares[0]
    first, second, third, fourth = values
    coarse = jnp.where(p.inwards, 4.0 * second - first - 3.0 * fourth, 0.5 * (first - second)) / h
    near = 2.0 * (4.0 * third - second - 3.0 * fourth)
    fine = jnp.where(p.inwards, near, third - fourth) / h
    return (4.0 * fine - coarse) / 3.0, jnp.abs(fine - coarse), h


def has_kink(
    values: Callable[[Float[Array, " n"]], Float[Array, " rows"]],
    z: Float[Array, " n"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
    row: int,
) -> bool:
    """Whether the slope of a row of `values` jumps at the scaled unknowns `z`, within the distance
    of the probes: whether its differences on both sides disagree.

    False for unknowns close to a bound, beyond which nothing is evaluated."""
    h = float(jnp.finfo(z.dtype).eps) ** 0.2
    d = jnp.asarray(np.cos(2.4 * np.arange(z.size) + 1.0), z.dtype)
    if not bool(jnp.all((z - 2.0 * h > low) & (z + 2.0 * h < high))):
        return False
    far_below, below, at, above, far_above = (
        float(values(z + share * h * d)[row]) for share in (-1.0, -0.5, 0.0, 0.5, 1.0)
    )
    forward, backward = 4.0 * above - far_above - 3.0 * at, far_below + 3.0 * at - 4.0 * below
    return abs(forward - backward) > VARIES * max(abs(forward), abs(backward))


def refuse(
    error: float,
    what: str = "the objective",
    unread: Sequence[str] = (),
    kink: Callable[[], bool] = lambda: False,
) -> None:
    """Raise `InputError` for a gradient of `what` that differs from finite differences by this
    relative `error`.

    - `unread`: the unknowns by which its derivative is exactly zero.
    - `kink`: returns whether its slope jumps at the start."""
    if error <= GRADIENT_TOLERANCE:
        return
    if unread:
        some = ", ".join(unread[:MOST_NAMED]) + (", ..." if len(unread) > MOST_NAMED else "")
        cause = (
            f"its derivative with respect to {some} is exactly zero: if {what} depends on it, "
            "jax.lax.stop_gradient, a rounding, an integer or a comparison has cut the derivative"
        )
    elif kink():
        cause = (
            f"{what} has a kink or a jump within the distance of the differences, such as by abs, "
            "jnp.maximum, jnp.clip or a limit inside of problem; start away from it, or pass a "
            "limit of an unknown as bounds= and another limit as a constraint"
        )
    else:
        cause = (
            f"{what} is smooth there, so that part of its derivative is missing or wrong: by "
            "jax.lax.stop_gradient, a rounding, a custom derivative rule, or, in a simulation, a "
            "control with kinks that are not declared as breaks. Make such a control a "
            "jaxspace.core.Table or Spline, let the system declare its breaks(), or use finer "
            "steps"
        )
    raise InputError(
        f"The gradient at the start differs from finite differences of {what} by a relative "
        f"{error:.1g}, and a search would converge to a wrong point: {cause}. "
        "(check_gradient=False skips this check.)"
    )

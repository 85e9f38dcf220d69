"""The greatest and the least value of a quantity along a run, with its time.

    q(u) = q_0 + u (b + u (c + u d)),   u from 0 to 1 between two states
    b = s_0,   c = 3 (q_1 - q_0) - 2 s_0 - s_1,   d = 2 (q_0 - q_1) + s_0 + s_1
    u* = b / (sqrt(c^2 - 3 b d) - c)                            where q(u) is greatest

    symbol  meaning                                       unit
    q_k     quantity at the state k                       its own
    s_k     its slope there per interval                  its own
    u       time since the state over the interval        1

The slopes are given, or fourth-order differences between evenly spaced states. The error
is max |q''''| h^4 / 384 for a quantity that is smooth over an interval h; at a kink, and where the
states are too few for an oscillation, it is of first order.
Source: cubic Hermite interpolation, Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, II.6.
"""

__all__ = ["Extreme", "greatest", "least"]

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, PyTree

from ..core import InputError
from ..core.printing import printed

LEAST = 5
"""States of a phase that the slopes need."""


@printed(time="s")
class Extreme(NamedTuple):
    """An extreme `value` of each run, and the `time` at which it is taken, s; each (*runs,)."""

    value: Float[Array, "*runs"]
    time: Float[Array, "*runs"]


def greatest(
    times: ArrayLike | Sequence[ArrayLike],
    values: ArrayLike | Sequence[ArrayLike],
    slopes: ArrayLike | Sequence[ArrayLike] | None = None,
) -> Extreme:
    """The greatest value of a quantity along a run.

    **Arguments**

    - `times`: of the states of a phase, s, (times,) or (times, *runs), evenly from its start to its
      end; at least five. A list or tuple of them for several phases.
    - `values`: of the quantity there, (times, *runs); as many.
    - `slopes`: rates of the quantity there, per second, as `values`. With them two states are
      sufficient, at any ascending times.

    **Returns** an `Extreme`; between the states by a cubic. Differentiable, except where two places
    compete.

    **Raises** `InputError` for fewer states, and for times that do not fit the values."""
    result = [_of_phase(*phase) for phase in _phases(times, values, slopes)]
    value, time = result[0]
    for other in result[1:]:
        # The first of equal values is taken.
        better = other.value > value
        value, time = jnp.where(better, other.value, value), jnp.where(better, other.time, time)
    return Extreme(value, time)


def least(
    times: ArrayLike | Sequence[ArrayLike],
    values: ArrayLike | Sequence[ArrayLike],
    slopes: ArrayLike | Sequence[ArrayLike] | None = None,
) -> Extreme:
    """The least value of a quantity along a run.

    **Arguments**

    - `times`, `values`, `slopes`: as in `greatest`.

    **Returns** an `Extreme`, as `greatest` does."""
    phases = _phases(times, values, slopes)
    rates = None if slopes is None else [-s for _, _, s in phases if s is not None]
    result = greatest([t for t, _, _ in phases], [-q for _, q, _ in phases], rates)
    return Extreme(-result.value, result.time)


def _phases(
    times: PyTree, values: PyTree, slopes: PyTree
) -> list[tuple[Array, Array, Array | None]]:
    """Times, values and slopes of each phase, of one shape."""
    several = isinstance(times, list | tuple) and isinstance(values, list | tuple)
    pairs: list[Any] = list(zip(times, values, strict=True)) if several else [(times, values)]
    rates: list[Any] = [None] * len(pairs)
    if slopes is not None:
        rates = list(slopes) if several else [slopes]
    # Differences of order four need five states.
    least = LEAST if slopes is None else 2
    checked = []
    for pair, s in zip(pairs, rates, strict=True):
        t, q = map(jnp.asarray, pair)
        if q.ndim == 0 or q.shape[0] < least:
            raise InputError(
                f"values has the shape {q.shape}: an extreme requires at least {least} states per "
                "phase (`Campaign.num_saved`)."
            )
        if t.shape[:1] != q.shape[:1]:
            raise InputError(
                f"times has the shape {t.shape}: it must be compatible with {q.shape}, the shape "
                "of values."
            )
        t = t.reshape(*t.shape, *(1,) * (q.ndim - t.ndim))
        checked.append((jnp.broadcast_to(t, q.shape), q, s))
    return checked


def _slopes(q: Float[Array, " times *runs"]) -> Float[Array, " times *runs"]:
    """dq/du at even places a unit apart, by differences of order four."""
    inner = (q[:-4] - 8.0 * q[1:-3] + 8.0 * q[3:-1] - q[4:]) / 12.0

    def ends(q: Array) -> list[Array]:
        first = -25.0 * q[0] + 48.0 * q[1] - 36.0 * q[2] + 16.0 * q[3] - 3.0 * q[4]
        second = -3.0 * q[0] - 10.0 * q[1] + 18.0 * q[2] - 6.0 * q[3] + q[4]
        return [first / 12.0, second / 12.0]

    # The last slopes are the first ones of the reversed values, with the other sign.
    (a, b), (z, y) = ends(q), ends(q[::-1])
    return jnp.concatenate([jnp.stack([a, b]), inner, jnp.stack([-y, -z])])


def _of_phase(
    t: Float[Array, " times *runs"],
    q: Float[Array, " times *runs"],
    rate: Float[Array, " times *runs"] | None,
) -> Extreme:
    """The greatest value among the cubics between the states."""
    q_0 = q[:-1]
    q_1 = q[1:]
    if rate is None:
        s = _slopes(q)
        b, s_1 = s[:-1], s[1:]
    else:
        h = t[1:] - t[:-1]
        b, s_1 = h * rate[:-1], h * rate[1:]
    c, d = 3.0 * (q_1 - q_0) - 2.0 * b - s_1, 2.0 * (q_0 - q_1) + b + s_1
    square = c * c - 3.0 * b * d
    real = square > 0.0
    root = jnp.sqrt(jnp.where(real, square, 1.0))
    # Where b = 0 and c > 0 the quotient is 0/0, and the place that of the least value.
    some = real & (root - c > 0.0)
    u = b / jnp.where(some, root - c, 1.0)
    inside = some & (u > 0.0) & (u < 1.0)
    u = jnp.where(inside, u, jnp.where(q_1 > q_0, 1.0, 0.0))
    # At a state the value there is taken, which the cubic would give with rounding.
    value = jnp.where(inside, q_0 + u * (b + u * (c + u * d)), jnp.maximum(q_0, q_1))
    time = t[:-1] + u * (t[1:] - t[:-1])
    best = jnp.argmax(value, axis=0)[None]
    return Extreme(
        jnp.take_along_axis(value, best, axis=0)[0], jnp.take_along_axis(time, best, axis=0)[0]
    )

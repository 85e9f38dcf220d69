"""The zero of a condition between two samples, by Newton's method within a bracket.

In a dip, where the condition has one sign at both samples, the extremum is sought first, by the
secant of the slopes. As soon as a point beyond zero is found, the search continues as elsewhere. It
ends without a zero where neither tangent at the ends of the bracket reaches zero within it. Of a
dip that is |x|^p with p >= 1/2, such as a corner or a parabola, one tangent does as long as the
bracket holds a zero.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..core import Scalar, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from .events import Event

# Most steps within the bracket. Four are enough for a simple zero. The last bounces of a ball have
# their zero next to another one, the start, where Newton's method gains one bit a step, as does
# bisection.
CLOSING_STEPS = 128
# Width, as a part of an interval, to which the place of an extremum is sought.
NARROW = 1e-4


class _RunBracket(NamedTuple):
    """The bracket of the zero: from `low`, where the condition has the `sign`, to `high`; the next
    point is `guess`.

    - `dip`: whether the condition has had a single sign so far.
    - `sizes`, `slopes`: distances of the condition from zero at both ends, and their rates along
      the run.
    - `moving`: whether the guess still changes.
    - `left`: number of further steps that are allowed.
    - `finite`: whether the condition was finite at every guess.
    - `y`: the state at the guess."""

    low: Scalar
    high: Scalar
    guess: Scalar
    sign: Scalar
    dip: Bool[Array, "*#runs"]
    sizes: tuple[Scalar, Scalar]
    slopes: tuple[Scalar, Scalar]
    moving: Bool[Array, "*#runs"]
    left: Array | int
    finite: Bool[Array, "*#runs"]
    y: State


class ConditionValue(NamedTuple):
    """The function that is zero at the event at one time: its `value` and its rate, the `slope`;
    the state there and its rate, or `None` where the search is for a time alone."""

    value: Scalar
    slope: Scalar
    y: State = None
    rate: State = None


class ClosedIn(NamedTuple):
    """The end of a search between two samples: the time, the state there, whether it is a zero,
    whether the search converged, and whether the condition rises there along the run."""

    time: Scalar
    y: State
    met: Bool[Array, "*#runs"]
    sure: Bool[Array, "*#runs"]
    rising: Bool[Array, "*#runs"]


@runtime_checkable
class ConditionOnSpan(Protocol):
    """The condition of an event as a function of time, or of normalised time."""

    @property
    def event(self) -> Event:
        """The event."""
        ...

    def at(self, t: Scalar) -> ConditionValue:
        """The function that is zero at the event, at the time `t`."""
        ...

    def condition(self, t: Scalar, y: State) -> Scalar:
        """The condition itself, where the state of `at` is `y`."""
        ...


def close_in(
    on_span: ConditionOnSpan,
    span: tuple[Scalar, Scalar],
    g: tuple[Scalar, Scalar],
    slopes: tuple[Scalar, Scalar],
    sought: Bool[Array, "*runs"],
    behind: Scalar | None = None,
) -> ClosedIn:
    """The zero between two samples.

    **Arguments**

    - `on_span`: the condition between them.
    - `span`: the times of the samples, `g` the condition there, and `slopes` its rates.
    - `sought`: the runs whose zero is sought.
    - `behind`: time after which the zero is sought, by default that of the first sample. If it is
      given, `g[0]` is the condition just after it."""
    t, end = span
    first = t if behind is None else behind
    start = _first_bracket(on_span, (first, end), g, slopes, sought)
    forwards = jnp.sign(end - first)
    length = jnp.abs(end - first)
    # In a dip, the condition has the same sign at both ends. The first point of the opposite sign
    # splits the span into two parts with one zero each. The event is the first zero, unless its
    # direction admits only the second one, at which the condition returns to the sign of the ends.
    back = jnp.sign(g[0]) * on_span.event.direction > 0.0
    result = jax.lax.while_loop(
        lambda bracket: (bracket.left > 0) & jnp.any(bracket.moving),
        lambda bracket: _closer(on_span, bracket, forwards, length, back),
        start,
    )
    met = ~result.dip
    touch = on_span.event.touch
    if touch is not None:
        met = met & (jnp.abs(on_span.condition(result.guess, result.y)) <= touch)
    sure = ~result.moving & result.finite
    return ClosedIn(result.guess, result.y, met, sure, result.sign < 0.0)


def _first_bracket(
    on_span: ConditionOnSpan,
    span: tuple[Scalar, Scalar],
    g: tuple[Scalar, Scalar],
    slopes: tuple[Scalar, Scalar],
    sought: Bool[Array, "*runs"],
) -> _RunBracket:
    """The bracket between two samples; arguments as of `close_in`."""
    first, end = span
    sign = jnp.sign(g[0])
    dip = g[0] * g[1] > 0.0
    away = tuple(jnp.sign(end - first) * sign * slope for slope in slopes)
    # The zero by the samples, away from both ends, because the start itself may be a zero. A failed
    # run must not pass a time that is NaN to the other runs of its block.
    share = jnp.where(
        dip, safe_divide(away[0], away[0] - away[1]), zero_share(g, slopes, end - first)
    )
    share = jnp.where(jnp.isfinite(share), jnp.clip(share, 0.02, 0.98), 0.5)
    guess = first + share * (end - first)
    there = jax.eval_shape(lambda t: on_span.at(t).y, guess)
    return _RunBracket(
        low=first,
        high=end,
        guess=guess,
        sign=sign,
        dip=dip,
        sizes=(jnp.abs(g[0]), jnp.abs(g[1])),
        slopes=away,
        moving=sought,
        left=CLOSING_STEPS,
        finite=jnp.ones(jnp.shape(first), bool),
        y=jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), there),
    )


def _closer(
    on_span: ConditionOnSpan,
    old: _RunBracket,
    forwards: Scalar,
    length: Scalar,
    back: Bool[Array, "*#runs"],
) -> _RunBracket:
    """The bracket after one more guess.

    **Arguments**

    - `forwards`, `length`: the direction of the run, and the length of the span.
    - `back`: whether only the second zero of a dip counts."""
    guess = old.guess
    value, slope, y, rate = on_span.at(guess)
    new = _narrowed(old, value, forwards * old.sign * slope, back)
    new, following = barrier((new, _next_guess(new, value, slope)))
    change = jnp.where(new.dip, jnp.abs(new.high - new.low), jnp.abs(following - guess))
    least = 16.0 * float(jnp.finfo(guess.dtype).eps)
    resolved = least * jnp.maximum(jnp.abs(guess), length)
    enough = jnp.where(new.dip, NARROW * length, resolved)
    change = jnp.where(new.dip & ~_reaching(new), 0.0, change)
    y = jax.tree.map(lambda x, k: x + k * (following - guess), y, rate)
    new = new._replace(guess=following, moving=old.moving & (change > enough), y=y)
    # A run whose search has ended stays at its zero while the others continue.
    new = jax.tree.map(
        lambda a, b: jnp.where(old.moving, a, b), new._replace(left=0), old._replace(left=0)
    )
    return new._replace(left=old.left - 1)


def zero_share(g: tuple[Scalar, Scalar], slopes: tuple[Scalar, Scalar], length: Scalar) -> Scalar:
    """The place of the zero between two samples, as a share of the time between them, `length`:
    by the cubic in the condition that has its slopes, if it is monotonic, or by the secant."""
    secant = safe_divide(g[0], g[0] - g[1])
    first, last = (safe_divide(g[1] - g[0], slope * length) for slope in slopes)
    rest = 1.0 - secant
    cubic = secant * (secant * (1.0 + 2.0 * rest - rest * last) + rest * rest * first)
    # Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238.
    monotonic = (first > 0.0) & (first < 3.0) & (last > 0.0) & (last < 3.0)
    return jnp.where(monotonic, cubic, secant)


def _reaching(bracket: _RunBracket) -> Bool[Array, "*#runs"]:
    """Whether a dip might reach zero within the bracket."""
    length = jnp.abs(bracket.high - bracket.low)
    sizes, (first, last) = bracket.sizes, bracket.slopes
    return tangent_reaches(sizes, (-first * length, last * length))


def tangent_reaches(
    sizes: tuple[Array, Array], changes: tuple[Array, Array]
) -> Bool[Array, "*#runs"]:
    """Whether a tangent at one of two points reaches zero between them: the condition is `sizes`
    away from zero there, and would change by `changes` towards it along each tangent."""
    return (sizes[0] <= changes[0]) | (sizes[1] <= changes[1])


def _narrowed(bracket: _RunBracket, value: Scalar, away: Scalar, back: Array) -> _RunBracket:
    """The bracket with its guess, where the condition is `value`, as one of its ends.

    **Arguments**

    - `away`: the rate of the condition away from zero, along the run.
    - `back`: whether only the second zero of a dip counts."""
    low, high, guess, sign, dip, sizes, slopes, *_ = bracket
    same = value * sign > 0.0
    # In a dip, the first point beyond zero separates two zeros, of which the direction selects one.
    turned = dip & ~same & back
    before = jnp.where(dip & same, away < 0.0, same) | turned
    return bracket._replace(
        low=jnp.where(before, guess, low),
        high=jnp.where(before, high, guess),
        sign=jnp.where(turned, -sign, sign),
        dip=dip & same,
        sizes=(
            jnp.where(before, jnp.abs(value), sizes[0]),
            jnp.where(before, sizes[1], jnp.abs(value)),
        ),
        slopes=(jnp.where(before, away, slopes[0]), jnp.where(before, slopes[1], away)),
        finite=bracket.finite & jnp.isfinite(value),
    )


def _next_guess(bracket: _RunBracket, value: Scalar, slope: Scalar) -> Scalar:
    """Newton's step; in a dip the zero of the secant of the slopes; else the middle."""
    low, high, guess, _, dip, _, slopes, *_ = bracket
    newton = guess - value / jnp.where(slope == 0.0, 1.0, slope)
    # Newton's step is taken only within the bracket. A step from one end exactly to the other is
    # not, because it might lead back where the condition is of the size of rounding at both.
    bracketed = ((newton - low) * (newton - high) < 0.0) | (newton == guess)
    inside = (slope != 0.0) & bracketed & ~dip
    share = jnp.where(dip, safe_divide(slopes[0], slopes[0] - slopes[1]), 0.5)
    # Away from both ends, so that the bracket shrinks by a tenth at least.
    return jnp.where(inside, newton, low + jnp.clip(share, 0.1, 0.9) * (high - low))

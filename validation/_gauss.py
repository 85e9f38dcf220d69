"""Gauss's collocation with steps of its own: the second method beside which errors are measured.

    Y_i = y + h sum_j A_ij k_j,    k_i = f(t + c_i h, Y_i),    y' = y + h sum_j b_j k_j

It shares nothing with the methods of the library: implicit, of order 20, without a tableau of
Runge and Kutta's explicit kind, the sums compensated. A step is short enough when the last
coefficients of the Legendre series of its rates are below the tolerance, which are the error of
order 8; its own, of order 20, is then far below it, except at a kink, where the two are alike."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.polynomial.legendre import leggauss, legvander

from jaxspace import Mission
from jaxspace.integration.events import Event

STAGES = 10
ITERATIONS = 16
# Coefficients that judge a step: of a kink one may be zero by chance, and hardly three.
LAST = 3
TIGHT = 1e-13
# Length of a block, in its unit, below which it has fewer digits: as `Accuracy.atol` has it.
SMALL = 1e-3
# Steps of a leg: a kink between the last stage of a step and its end is seen by no stage, and
# errs with the square of the length.
LEAST = 512
# Attempts, after which a leg is given up.
MOST = 10**6

_X, _W = leggauss(STAGES)
_P = legvander(_X, STAGES)
# Of the Legendre series through the stages: coefficients, and their integrals up to each stage.
_SERIES = ((np.arange(STAGES) + 0.5) * _P[:, :-1]).T * _W
_INTEGRALS = np.concatenate(
    [_X[:, None] + 1.0, (_P[:, 2:] - _P[:, :-2]) / (2.0 * np.arange(1, STAGES) + 1.0)], axis=1
)
_A, _B, _C = 0.5 * _INTEGRALS @ _SERIES, 0.5 * _W, 0.5 * (1.0 + _X)


class _State(NamedTuple):
    """Of the loop: time and state with what their sums have lost, the largest length of each block
    so far, the step, attempts."""

    t: jax.Array
    lost_t: jax.Array
    y: jax.Array
    lost_y: jax.Array
    size: jax.Array
    h: jax.Array
    attempts: jax.Array


def _plus(x, lost, change):
    """The sum and what it loses (Kahan)."""
    change = change + lost
    total = x + change
    return total, change - (total - x)


class End(NamedTuple):
    """Where a motion ends: its state, and the largest length that each block had on the way."""

    state: Any
    sizes: jax.Array

    def apart(self, other: Any) -> float:
        """How far another state is from it, of the block that is worst in units of its size."""
        pairs = zip(jax.tree.leaves(self.state), jax.tree.leaves(other), strict=True)
        lengths = np.array([np.linalg.norm(np.asarray(b, float) - a) for a, b in pairs])
        # A block that is zero all along has no size, and is to stay so.
        return float(np.max(lengths / np.where(self.sizes > 0.0, self.sizes, 1.0)))


@eqx.filter_jit
def flow(system, y0, start, end, tolerance) -> End:
    """The end of the motion from `y0` at `start` to `end`, s, without breaks between them; NaN
    where it is not reached."""
    first, restored = ravel_pytree(y0)
    sizes = [x.size for x in jax.tree.leaves(y0)]
    members = np.repeat(np.eye(len(sizes)), sizes, axis=1)

    def rate(t, y):
        return ravel_pytree(system.vector_field(t, restored(y)))[0]

    def length(v):
        return jnp.sqrt(members @ (v * v))

    def attempt(s: _State) -> _State:
        h = jnp.minimum(jnp.minimum(s.h, (end - start) / LEAST), end - s.t)
        times = s.t + _C * h

        def better(_, both):
            k, _ = both
            new = jax.vmap(rate)(times, s.y + (s.lost_y + h * (_A @ k)))
            return new, new - k

        zero = jnp.zeros((STAGES, first.size))
        k, change = jax.lax.fori_loop(0, ITERATIONS, better, (zero, zero))
        step = h * (_B @ k)
        wrong = sum(length(h * (row @ k)) for row in _SERIES[-LAST:])
        wrong += length(h * (_B @ jnp.abs(change)))
        # A block that passes through zero has no digits of its own there.
        size = jnp.maximum(s.size, length(step))
        share = jnp.max(wrong / (size + SMALL)) / tolerance
        factor = jnp.clip(0.9 * share ** (-1.0 / (STAGES - LAST + 1)), 0.2, 2.0)
        # NaN is no step.
        good = share <= 1.0
        factor = jnp.where(jnp.isnan(factor), 0.2, factor)
        sums = (*_plus(s.t, s.lost_t, h), *_plus(s.y, s.lost_y, step))
        new = _State(*sums, jnp.maximum(size, length(sums[2])), s.h, s.attempts)
        kept = jax.tree.map(lambda a, b: jnp.where(good, a, b), new, s)
        # The last step is cut by the end, and says nothing of the next one.
        return kept._replace(h=h * factor, attempts=s.attempts + 1)

    zero = jnp.zeros(())
    begin = _State(
        start + zero, zero, first, 0.0 * first, length(first), 0.01 * (end - start), zero
    )
    left = 1e-15 * jnp.maximum(jnp.abs(end), jnp.abs(start))
    last = jax.lax.while_loop(lambda s: (end - s.t > left) & (s.attempts < MOST), attempt, begin)
    return End(restored(jnp.where(end - last.t > left, jnp.nan, last.y)), last.size)


def _through_breaks(system, y, start, end, tolerance) -> End:
    """The end of a motion whose field may jump at the breaks of its system."""
    breaks = system.breaks()
    inside = [] if breaks is None else np.unique(np.asarray(breaks, float))
    times = [start, *(float(x) for x in inside if start < x < end), end]
    sizes = 0.0
    for a, b in zip(times, times[1:], strict=False):
        y, some = flow(system, y, jnp.asarray(a), jnp.asarray(b), jnp.asarray(tolerance))
        sizes = jnp.maximum(sizes, some)
    return End(y, sizes)


def end_of(system, y0, ts, ends=(), tolerance: float = TIGHT) -> End:
    """The end of a run.

    **Arguments**

    - `system`, `y0`, `ts`: as `simulate` takes them; of a mission `ts` is the time of its start.
    - `ends`: of a mission roughly when its phases end, s: an event is sought from there.
    - `tolerance`: of each step, relative to the largest length of each block so far.

    **Returns** the state, of a mission after its last jump, and the sizes, of a mission in its last
    phase."""
    if not isinstance(system, Mission):
        return _through_breaks(system, y0, float(ts[0]), float(ts[-1]), tolerance)
    t, y, sizes = float(ts), y0, None
    for phase, rough in zip(system.phases, ends, strict=True):
        known = not isinstance(phase.until, Event)
        end = t + float(phase.until) if known else rough
        y, sizes = _through_breaks(phase.system, y, t, end, tolerance)
        if not known:
            # The rough end is microseconds off at most: one correction leaves nothing.
            value, slope = phase.until.slope(phase.system, jnp.asarray(end), y)
            later = -value / slope
            rate = phase.system.vector_field(jnp.asarray(end), y)
            y = jax.tree.map(lambda y, k, h=later: y + h * k, y, rate)
            end += float(later)
        t = end
        y = y if phase.then is None else phase.then(jnp.asarray(t), y)
    return End(y, sizes)

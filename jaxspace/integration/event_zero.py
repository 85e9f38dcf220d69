"""The first zero of a condition between samples, closed in interval by interval."""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import AbstractSystem, Scalar, State
from ._event_bracket import WithinSpan, close_in
from .events import Event

# Depth of a dip below its lowest sample, in second differences: at most 1/2 at a corner (as in the
# distance to a point that is passed) and 1/8 for a parabola; a little more for other curves.
REACH = 0.55
# Rounding of the condition in a state at the event itself, in units in the last place.
ROUNDINGS = 64.0
# Least time between two events that are resolved as two, in roundings of the time.
APART = 256.0


class Zero(NamedTuple):
    """The first zero of one event: its time, whether it happens, the size of the condition, how the
    search failed, and when (infinite if it did not).

    Times of a run are in s after its start, those of a step in normalised time."""

    time: Scalar
    hit: Bool[Array, "*runs"]
    size: Scalar
    status: Int[Array, "*runs"]
    failed: Scalar


def candidates(
    g: Array, dip: Array, at_zero: Array, away: Array, direction: int
) -> tuple[Array, Array]:
    """The condition at the samples with the sign that it is about to take from a zero at the start
    (a ball on the floor), and the intervals in which there may be a zero.

    `away` is the rate along the run, which may go backwards in time."""
    g = g.at[0].set(jnp.where(at_zero, jnp.sign(away), g[0]))
    rise = (g[:-1] < 0.0) & (g[1:] >= 0.0)
    fall = (g[:-1] > 0.0) & (g[1:] <= 0.0)
    crossing = {1: rise, -1: fall, 0: rise | fall}[direction]
    return g, crossing | dip & ~(rise | fall)


def first_in_intervals(
    within: Callable[[Int[Array, "*runs"]], WithinSpan],
    times: Float[Array, "samples *#runs"],
    g: Float[Array, "samples *#runs"],
    candidate: Bool[Array, "intervals *#runs"],
) -> tuple[Scalar, Bool[Array, "*runs"], Bool[Array, "*runs"]]:
    """The first zero of a condition between samples.

    **Arguments**

    - `within`: the condition in the interval of this number, of each run.
    - `times`, `g`: of the samples, and the condition there.
    - `candidate`: the intervals in which there may be a zero.

    **Returns** the time, that of the last sample where there is none; whether there is a zero; and
    whether the search for it did not converge."""
    count, *runs = candidate.shape
    numbers = jnp.arange(count).reshape(-1, *(1,) * len(runs))

    # Intervals are searched one by one, because a dip may turn out to hold no zero.
    def look(search: tuple[Scalar, Array, Array, Array]) -> tuple[Scalar, Array, Array, Array]:
        when, hit, unresolved, first = search
        ahead = candidate & (numbers >= first)
        index = jnp.argmax(ahead, axis=0)
        t, value = pick((times, g), index, len(runs))
        end, other = pick((times, g), index + 1, len(runs))
        sought = jnp.any(ahead, axis=0) & ~hit & ~unresolved
        zero = close_in(within(index), (t, end), (value, other), sought)
        good = sought & zero.met & zero.sure
        unresolved = unresolved | (sought & ~zero.sure)
        last = good | ~sought | unresolved
        when = jnp.where(sought & (good | unresolved), zero.time, when)
        return when, hit | good, unresolved, jnp.where(last, count, index + 1)

    nowhere = jnp.zeros(tuple(runs), bool)
    start = (
        jnp.broadcast_to(times[-1], tuple(runs)),
        nowhere,
        nowhere,
        jnp.zeros(tuple(runs), int),
    )
    when, hit, unresolved, _ = jax.lax.while_loop(
        lambda search: jnp.any(candidate & (numbers >= search[3])), look, start
    )
    return when, hit, unresolved


def pick(tree: State, index: Array, run_axes: int) -> State:
    """Select sample number `index` of each run, from blocks with the samples on the first axis."""

    def leaf(x):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        rows = jnp.broadcast_to(where, (1, *x.shape[1 : x.ndim - run_axes], *index.shape))
        # Without a check of the numbers, which would be most of the program of a search.
        return jnp.take_along_axis(x, rows, axis=0, mode="promise_in_bounds")[0]

    return jax.tree.map(leaf, tree)


def put(tree: PyTree, index: Array, rows: PyTree, run_axes: int) -> PyTree:
    """The blocks with `rows` in place of sample number `index` of each run; see `pick`."""

    def leaf(x, row):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        where = jnp.broadcast_to(where, (1, *row.shape))
        return jnp.put_along_axis(x, where, row[None], 0, inplace=False, mode="promise_in_bounds")

    return jax.tree.map(leaf, tree, rows)


def ill_after(g: Array, states: State, times: Array, run_axes: int) -> Scalar:
    """Time after the start, s, at which the condition is first not finite; infinite if it always is
    finite.

    States that are not finite do not count, because they have another status."""
    ill = ~jnp.isfinite(g)
    for x in jax.tree.leaves(states):
        ill = ill & jnp.all(jnp.isfinite(x), axis=tuple(range(1, x.ndim - run_axes)))
    after = jnp.abs(pick(times, jnp.argmax(ill, axis=0), run_axes) - times[0])
    return jnp.where(jnp.any(ill, axis=0), after, jnp.inf)


def rounding_change(
    event: Event, system: AbstractSystem, t: Scalar, y: State, run_axes: int
) -> Scalar:
    """sum |dg/dy_i| |y_i|: change of the condition for a relative change of one in every component.

    Times the rounding unit, it bounds the condition at a rounded zero."""
    leaves, structure = jax.tree.flatten(y)
    shapes = [leaf.shape[: leaf.ndim - run_axes] for leaf in leaves]
    ends = np.cumsum([math.prod(shape) for shape in shapes])
    # Component by component, because their absolute values are summed; all of them at once, with
    # one copy of the condition in the program.
    parts = np.split(np.eye(ends[-1]), ends[:-1], axis=1)
    basis = [
        jnp.asarray(part.reshape(-1, *shape, *(1,) * run_axes), leaf.dtype)
        for part, shape, leaf in zip(parts, shapes, leaves, strict=True)
    ]

    def change(direction: list[Array]) -> Scalar:
        tangent = structure.unflatten([d * x for d, x in zip(direction, leaves, strict=True)])
        return jax.jvp(lambda y: event.value(system, t, y), (y,), (tangent,))[1]

    return jnp.sum(jnp.abs(jax.vmap(change)(basis)), axis=0)


def dips(g: Array, changes: Array) -> Array:
    """Whether the condition might dip through zero and back, for each interval.

    Beyond both ends of the span the condition is extrapolated by its slopes: `changes` in an
    interval.
    """
    last = jnp.concatenate([g[:1] - changes[:1], g[:-1]])
    following = jnp.concatenate([g[1:], g[-1:] + changes[1:]])
    sign = jnp.sign(g)
    near = (
        (sign * g <= sign * last)
        & (sign * g <= sign * following)
        & (sign * last > 0.0)
        & (sign * following > 0.0)
    )
    near = near & (sign * g < REACH * sign * (last - 2.0 * g + following))
    return near[:-1] | near[1:]

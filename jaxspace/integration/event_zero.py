"""Common parts of the searches for zeros of a condition: candidates among samples, and
roundings."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.barrier import barrier
from ._event_bracket import tangent_reaches
from ._in_turn import in_turn
from .events import Event

# Rounding of the condition in a state at the event itself, in units in the last place.
ROUNDINGS = 64.0
# Least time between two events that are resolved as two, in roundings of the time.
RESOLVED_ROUNDINGS = 256.0


class Root(NamedTuple):
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


def next_candidates(candidate: Bool[Array, "intervals *#runs"]) -> Int[Array, "following *#runs"]:
    """The first candidate from each interval on; behind the last one the number of intervals."""
    count, *runs = candidate.shape
    none = jnp.full(tuple(runs), count)

    def before(following: Array, interval: tuple[Array, Array]) -> tuple[Array, Array]:
        number, here = interval
        following = jnp.where(here, number, following)
        return following, following

    _, ahead = jax.lax.scan(before, none, (jnp.arange(count), candidate), reverse=True)
    return jnp.concatenate([ahead, none[None]])


def pick(tree: PyTree, index: Array, run_axes: int) -> PyTree:
    """Select sample number `index` of each run, from blocks with the samples on the first axis."""

    def leaf(x):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        rows = jnp.broadcast_to(where, (1, *x.shape[1 : x.ndim - run_axes], *index.shape))
        # Without a check of the numbers, which would be most of the program of a search.
        return jnp.take_along_axis(x, rows, axis=0, mode="promise_in_bounds")[0]

    return jax.tree.map(leaf, tree)


def put(tree: PyTree, index: Array, rows: PyTree, run_axes: int) -> PyTree:
    """The blocks of `pick` with `rows` as sample number `index` of each run; a number behind the
    last sample changes nothing."""

    # By selection: a scatter takes as long, and the compiler treats the loop around it piece by
    # piece.
    def leaf(x, row):
        here = jnp.arange(x.shape[0]).reshape(-1, *(1,) * run_axes) == index
        return jnp.where(here.reshape(-1, *(1,) * (x.ndim - 1 - run_axes), *index.shape), row, x)

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
        # Otherwise the compiler would take the condition itself out of the loop, piece by piece.
        direction, at, leaves = barrier((direction, t, jax.tree.leaves(y)))
        tangent = structure.unflatten([d * x for d, x in zip(direction, leaves, strict=True)])
        y_at = structure.unflatten(leaves)
        return jax.jvp(lambda y: event.value(system, at, y), (y_at,), (tangent,))[1]

    return jnp.sum(jnp.abs(in_turn(change, basis)), axis=0)


def dips(times: Array, g: Array, slopes: Array) -> Array:
    """Whether the condition might dip through zero and back, for each interval between samples.

    It does not unless it approaches zero at the first end and leaves it at the last one, and one of
    the two tangents reaches zero in between."""
    sign = jnp.sign(g)
    steps = jnp.diff(times, axis=0).astype(g.dtype)
    approach, leave = -sign[:-1] * slopes[:-1] * steps, sign[1:] * slopes[1:] * steps
    turning = (sign[:-1] * sign[1:] > 0.0) & (approach >= 0.0) & (leave >= 0.0)
    return turning & tangent_reaches((jnp.abs(g[:-1]), jnp.abs(g[1:])), (approach, leave))

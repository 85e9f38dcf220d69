"""The nodes of a loop: times at which something happens, known before it runs.

The controller, the arrival of delayed commands and each sensor have separate clocks with individual
rates. States are saved, and the vector field breaks, at further times. All of them are nodes; each
integration goes from one node to the next, so that it lands on every node. Times that coincide to
rounding are one node.
"""

from typing import NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError
from ..core.checks import is_concrete

SLACK = 1e-6
"""Threshold for coinciding ticks, in periods: far above rounding, far below any intended
difference."""


MOST_TICKS = 10**7
"""Maximum number of ticks of a clock: their commands and readings require some gigabytes."""


class Clock(NamedTuple):
    """Ticks at `offset`, and then every `period`, s."""

    period: float
    offset: float = 0.0


@final
class Nodes(NamedTuple):
    """The nodes of a loop.

    - `times`: from the start of the loop, s, (nodes,), or (nodes, *runs) where breaks differ.
    - `ticks`: whether each clock ticks at each node but the last, (nodes - 1, clocks, *#runs).
    - `saved`: the numbers of the nodes at which states are saved, (saves, *#runs).
    - `at_every_node`: for each clock whether it ticks at every node."""

    times: Float[Array, "nodes *#runs"] | np.ndarray
    ticks: Array | np.ndarray
    saved: Array | np.ndarray
    at_every_node: tuple[bool, ...]


def known_times(ts: object) -> np.ndarray:
    """Save times as concrete numbers, ascending. Raises `InputError` for anything else."""
    if not all(map(is_concrete, ts if isinstance(ts, list | tuple) else [ts])):
        raise InputError(
            "ts is traced: it must be concrete, because it determines the number of samples; use "
            "numpy.linspace(...) instead of jax.numpy.linspace(...)."
        )
    times = np.asarray(ts, float)
    if times.ndim != 1 or times.size < 2 or not np.all(np.isfinite(times)):
        raise InputError(
            f"ts has the shape {times.shape}: it must contain at least two finite times."
        )
    if np.any(np.diff(times) <= 0.0):
        raise InputError("ts is not ascending: a closed loop runs forwards in time only.")
    return times


def nodes_of(ts: np.ndarray, clocks: tuple[Clock, ...], breaks: Array | None) -> Nodes:
    """The nodes of a loop.

    **Arguments**

    - `ts`: save times, s; the first is the start, from which the clocks count.
    - `clocks`: those of the loop.
    - `breaks`: times from the start, s, (times, *#runs), traced or not; `None` where there are
      none.

    **Raises** `InputError` for more than `MOST_TICKS` ticks of a clock."""
    span = float(ts[-1] - ts[0])
    shortest = min(clock.period for clock in clocks)
    count = span / shortest
    if count > MOST_TICKS:
        raise InputError(
            f"ts spans {span:.6g} s, which is {count:.3g} periods of {shortest:.6g} s: at most 1e7 "
            "periods are allowed."
        )
    slack = SLACK * shortest
    saves = ts - ts[0]
    every = [saves]
    for clock in clocks:
        # A tick at the end is none: no motion follows that it could command.
        count = int(np.ceil((span - slack - clock.offset) / clock.period))
        every.append(clock.offset + clock.period * np.arange(max(count, 0)))
    known = breaks is not None and is_concrete(breaks) and jnp.ndim(breaks) == 1
    if known:
        # A break at the start or the end parts nothing.
        inner = np.asarray(breaks, float)
        every.append(inner[(inner > slack) & (inner < span - slack)])
    candidates = np.concatenate(every)
    order = np.argsort(candidates, kind="stable")
    ordered = candidates[order]
    # Each time that follows the one before by more than the slack begins a new node.
    number = np.concatenate([[0], np.cumsum(np.diff(ordered) > slack)])
    # Of coinciding times the first one is taken: save times and clocks before breaks.
    times = candidates[np.minimum.reduceat(order, np.flatnonzero(np.diff(number, prepend=-1)))]
    index = np.empty_like(number)
    index[order] = number
    ends = np.cumsum([len(x) for x in every])
    ticks = np.zeros((times.size, len(clocks)), bool)
    for k in range(len(clocks)):
        ticks[index[ends[k] : ends[k + 1]], k] = True
    # A clock that ticks at every node needs no selection in the program.
    at_every_node = tuple(bool(np.all(ticks[:-1, k])) for k in range(len(clocks)))
    saved = index[: ends[0]]
    if breaks is None or known:
        return Nodes(times, ticks[:-1], saved, at_every_node)
    return _with_breaks(times, ticks, saved, breaks)


def _with_breaks(times: np.ndarray, ticks: np.ndarray, saved: np.ndarray, breaks: Array) -> Nodes:
    """The nodes with breaks that are traced, or differ between runs: breaks outside of the loop are
    moved to its ends, where they form intervals of zero length."""
    runs = breaks.shape[1:]
    inner = jnp.clip(breaks, times[0], times[-1])
    # Breaks are put after the start and before the end, so that the first and the last node stay.
    nodes = jnp.broadcast_to(
        jnp.asarray(times, breaks.dtype).reshape(-1, *(1,) * len(runs)), (times.size, *runs)
    )
    merged = jnp.concatenate([nodes, inner])
    # The start stays in front of a break that coincides with it, and the end behind one.
    rank = jnp.concatenate([nodes.at[0].set(-jnp.inf).at[-1].set(jnp.inf), inner])
    order = jnp.argsort(rank, axis=0, stable=True)
    merged = jnp.take_along_axis(merged, order, axis=0)
    flags = np.concatenate([ticks, np.zeros((breaks.shape[0], ticks.shape[1]), bool)])
    moved = jnp.moveaxis(jnp.asarray(flags)[order], -1, 1)[:-1]
    place = jnp.argsort(order, axis=0)
    return Nodes(merged, moved, place[saved], (False,) * ticks.shape[1])


def stopped_at(nodes: Nodes, end: Array, slack: float) -> Nodes:
    """The nodes of a loop that ends `end`, s, after its start: later nodes are moved to the end,
    and no clock ticks there.

    `end` is a scalar or (*runs,)."""
    times = jnp.asarray(nodes.times, end.dtype)
    ticks = jnp.asarray(nodes.ticks)
    times = times.reshape(*times.shape, *(1,) * (end.ndim - times.ndim + 1))
    ticks = ticks.reshape(*ticks.shape, *(1,) * (times.ndim - ticks.ndim + 1))
    before = times[:-1] < end - slack
    never = (False,) * len(nodes.at_every_node)
    return Nodes(jnp.minimum(times, end), ticks & before[:, None], nodes.saved, never)


def at_nodes(tree: object, saved: Array | np.ndarray) -> object:
    """Rows at the `saved` nodes, of arrays with the nodes first; the nodes may differ between
    runs."""

    def leaf(x: Array) -> Array:
        if saved.ndim == 1:
            return x[saved]
        rank = x.ndim - saved.ndim
        rows = saved.reshape(saved.shape[0], *(1,) * rank, *saved.shape[1:])
        return jnp.take_along_axis(x, rows, axis=0)

    return jax.tree.map(leaf, tree)

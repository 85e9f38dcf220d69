"""The loop around the steps of an integration: one after the other, with the states asked for and a
record of the steps.

diffrax's own loop does the same; this one is traced once where that one is traced three times, and
it records the states for reverse mode as densely as its memory allows,

    after every e-th step,    e = 1, and twice as large whenever the memory is full

so that a short run keeps every state, and a long one of unknown length as many as fit.
"""

from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import State

RECORD_BYTES = (
    2**18
)  # of states: more takes longer to fill and to move than the steps between take once more


class Record(NamedTuple):
    """What reverse mode needs of a run: the clock at the ends of its `count` steps, and the states
    after each `every` of them."""

    ends: Array
    states: State
    every: Array
    count: Array


class March(NamedTuple):
    """Where an integration stands: the clock, the proposed end of the next step, the state; what
    the solver and the control carry along; whether the solver has to begin `anew`; the steps
    counted; how many states were `reached` of those asked for, and these; the ends of the steps;
    and the states of the record with their distance `every`."""

    s: Any
    end: Any
    y: State
    solver: Any
    control: Any
    anew: Array
    accepted: Array
    rejected: Array
    reached: Array
    states: State | None
    ends: Array | None
    marks: State | None
    every: Array


def room(y0: State, limit: int) -> int:
    """How many states a record of at most `limit` steps holds: an even number where it cannot hold
    all of them."""
    size = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(y0))
    return min(limit, max(2, RECORD_BYTES // size // 2 * 2))


def rows(count: int, y: State) -> State:
    """Memory for so many states: nothing is written to it, because most of it will never be
    used."""
    return jax.tree.map(lambda x: jax.lax.empty((count, *x.shape), x.dtype), y)


def _written(every: State, index: Array, row: State) -> State:
    return jax.tree.map(lambda a, b: a.at[index].set(b), every, row)


def _thinned(every: State, count: int) -> State:
    """Every second of the first `count` rows."""
    return jax.tree.map(lambda x: x.at[: count // 2].set(x[1:count:2]), every)


def march(
    solver: diffrax.AbstractSolver,
    control: diffrax.AbstractStepSizeController,
    term: Any,
    rate: Any,
    y0: State,
    last: Array,
    limit: int,
    kept: Array | None,
    record: bool,
    marked: bool,
) -> March:
    """The integration of dy/ds = rate(s, y) from s = 0 to `last` in at most `limit` steps, with
    states at the clock times `kept` (ascending), the ends of the steps if asked to `record` these,
    and the states after them if these are to be `marked`."""
    order: Any = solver.error_order(term)
    places = room(y0, limit)
    s, zero = jnp.zeros_like(last), jnp.asarray(0)
    end, controlled = control.init(term, s, last, y0, None, rate, solver.func, order)
    states, marks = (
        None if kept is None else rows(kept.shape[0], y0),
        rows(places + 1, y0) if marked else None,
    )
    ends = rows(limit, last) if record or marked else None
    inner = solver.init(term, s, end, y0, rate)
    start = March(
        s,
        end,
        y0,
        inner,
        controlled,
        jnp.array(False),
        zero,
        zero,
        zero,
        states,
        ends,
        marks,
        zero + 1,
    )

    def kept_until(m: March, s1: Array, between: Any) -> tuple[Array, State | None]:
        if kept is None:
            return m.reached, None
        asked, count = kept, kept.shape[0]

        def next_one(k):
            return asked[jnp.minimum(k, count - 1)]

        def within(c):
            return (c[0] < count) & (next_one(c[0]) <= s1)

        def keep(c):
            return (c[0] + 1, _written(c[1], c[0], between.evaluate(next_one(c[0]))))

        return jax.lax.while_loop(within, keep, (m.reached, m.states))

    def marked_after(m: March, keep: Array, y: State) -> tuple[State | None, Array]:
        if not marked:
            return None, m.every
        count = m.accepted + 1
        # What is not to be kept goes to the last row: a condition around the writing would copy all
        # of them.
        row = jnp.where(keep & (count % m.every == 0), count // m.every - 1, places)
        marks = _written(m.marks, row, y)

        def full(c):
            return keep & (count // c[1] >= places) & (places < limit)

        return jax.lax.while_loop(
            full, lambda c: (_thinned(c[0], places), 2 * c[1]), (marks, m.every)
        )

    def step(m: March) -> March:
        y, error, dense, inner, result = solver.step(term, m.s, m.end, m.y, rate, m.solver, m.anew)
        failed = result != diffrax.RESULTS.successful
        error = jax.tree.map(lambda e: jnp.where(failed, jnp.inf, e), error)
        keep, s, end, anew, controlled, _ = control.adapt_step_size(
            m.s, m.end, m.y, y, rate, error, order, m.control
        )
        keep = jnp.asarray(keep)

        def choose(new, old):
            return jax.tree.map(lambda a, b: jnp.where(keep, a, b), new, old)

        between = solver.interpolation_cls(t0=m.s, t1=m.end, **dense)
        reached, states = kept_until(m, jnp.where(keep, m.end, -1.0), between)
        marks, every = marked_after(m, keep, y)
        return March(
            s,
            jnp.minimum(end, last),
            choose(y, m.y),
            choose(inner, m.solver),
            controlled,
            choose(anew, m.anew),
            jnp.where(keep, m.accepted + 1, m.accepted),
            jnp.where(keep, m.rejected, m.rejected + 1),
            reached,
            states,
            None if m.ends is None else m.ends.at[m.accepted].set(m.end),
            marks,
            every,
        )

    return jax.lax.while_loop(
        lambda m: (m.s < last) & (m.accepted + m.rejected < limit), step, start
    )

"""Reverse mode along the recorded steps of a run, from the last one to the first.

    (y_{n+1}, d_n) = step(p, s_n, s_{n+1}, y_n)             d: what the dense output of the step holds
    (p', y_n') = p' + [y_{n+1}', d_n'] d(step)/d(p, y_n)    ': derivative of the result with respect to it

Repetition that chose its steps anew could, by a difference of one rounding, choose others, and the
derivative would belong to no run at all (seen: wrong by its own size, over a thousand steps). So
the ends of the accepted steps are kept, with the state at as many of them as there is room for;
between these, the steps are taken once more (and twice, where they are many).
"""

from typing import Any, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import State, barrier
from ._loop import Record, rows

# steps between which all states are known at once: more of them leave the cache, fewer are taken
# twice in short runs
PIECE = 32


def _at(tree: Any, index: Any) -> Any:
    return jax.tree.map(lambda x: x[index], tree)


def _put(tree: Any, index: Any, row: Any) -> Any:
    return jax.tree.map(lambda x, a: x.at[index].set(a), tree, row)


def _sum(first: Any, second: Any) -> Any:
    return jax.tree.map(jnp.add, first, second)


@final
class Replay(eqx.Module):
    """The steps of a run once more, each as a function of its first state and of the part `moving`
    of dy/ds that is differentiated; `kept` holds the clock times of the states asked for (the end
    alone where it is `None`), and `most` says how many steps may lie between two states of the
    record."""

    method: diffrax.AbstractSolver
    term: Any
    rest: Any
    record: Record
    y0: State
    kept: Array | None
    most: int = eqx.field(static=True)

    def ends(self, n: Array) -> tuple[Array, Array]:
        """The clock at the start and at the end of step `n`."""
        return jnp.where(n > 0, self.record.ends[n - 1], 0.0), self.record.ends[n]

    def step(self, moving: Any, n: Array, y: State) -> tuple[State, Any]:
        """The state after step `n` from `y`, and what its dense output holds if a state within a
        step was asked for."""
        rate = eqx.combine(moving, self.rest)
        s0, s1 = self.ends(n)
        inner = self.method.init(self.term, s0, s1, y, rate)
        y1, _, dense, _, _ = self.method.step(self.term, s0, s1, y, rate, inner, jnp.array(False))
        return y1, None if self.kept is None else dense

    def fill(
        self, moving: Any, ys: State, to: Array, y: State, n: Array, count: Array, apart: Array
    ) -> State:
        """`ys` filled, from the row `to` on, with `count` states: that before step `n`, which is
        `y`, and those `apart` steps after one another. Its last row takes what is not kept."""
        ys = _put(ys, to, y)
        if self.most == 1:
            return ys

        def one(i: Array, carry: tuple[State, State]) -> tuple[State, State]:
            ys, y = (
                # the last state by itself: read from where the next one is written, all of them
                # would be copied
                carry
            )
            y, _ = self.step(moving, n + i, y)
            return _put(ys, jnp.where((i + 1) % apart == 0, to + (i + 1) // apart, -1), y), y

        return jax.lax.fori_loop(0, (count - 1) * apart, one, (ys, y))[0]

    def from_kept(self, n: Array, dense: Any, gradient: State, k: Array) -> tuple[Array, Any]:
        """The gradient with respect to what the dense output of step `n` holds, from the kept
        states up to number `k` that lie in it; and the number of the last one before it."""
        assert self.kept is not None
        kept, (s0, s1) = self.kept, self.ends(n)

        def one(carry: tuple[Array, Any]) -> tuple[Array, Any]:
            k, total = carry

            def state(d):
                return self.method.interpolation_cls(t0=s0, t1=s1, **d).evaluate(kept[k])

            return k - 1, _sum(total, jax.vjp(state, dense)[1](_at(gradient, k))[0])

        def inside(carry):
            return (carry[0] >= 0) & ((kept[carry[0]] > s0) | (n == 0))

        return jax.lax.while_loop(inside, one, (k, jax.tree.map(jnp.zeros_like, dense)))

    def pull_back(self, moving: Any, gradient: State) -> tuple[Any, State]:
        """The gradient with respect to `moving` and to the first state, from that with respect to
        the states asked for."""

        def back(
            i: Array, carry: tuple[Any, State, Array], ys: State, first: Array, count: Array
        ) -> tuple[Any, State, Array]:
            of_moving, of_y, k = carry
            n = first + count - 1 - i
            (_, dense), pull = jax.vjp(
                lambda p, y: self.step(p, n, y), moving, _at(ys, parts + count - 1 - i)
            )
            if self.kept is not None:
                k, dense = self.from_kept(n, dense, gradient, k)
            # Held, because the compiler would take parts of the step once more for everything that
            # asks for them.
            more, of_y = barrier(pull)((of_y, dense))
            return _sum(of_moving, more), of_y, k

        def stretch(i: Array, carry: tuple[Any, State]) -> tuple[Any, State]:
            j = stretches - 1 - i
            n, y = (
                j * every,
                jax.tree.map(
                    lambda a, b: jnp.where(j > 0, a, b), _at(self.record.states, j - 1), self.y0
                ),
            )
            length = jnp.minimum(every, self.record.count - n)
            pieces = -(-length // PIECE)

            def piece(i: Array, carry: tuple[Any, State]) -> tuple[Any, State]:
                # Number zero only takes the steps from one piece to the next.
                total, ys = carry
                k, before, known = pieces - i, i == 0, (i == 0) | (pieces == 1)
                first = n + jnp.where(before, 0, k * PIECE)
                count = jnp.where(before, pieces, jnp.minimum(PIECE, length - k * PIECE))
                at = jax.tree.map(lambda a, b: jnp.where(known, a, b), y, _at(ys, k))
                ys = self.fill(
                    moving,
                    ys,
                    jnp.where(before, 0, parts),
                    at,
                    first,
                    count,
                    jnp.where(before, PIECE, 1),
                )
                return jax.lax.fori_loop(
                    0, jnp.where(before, 0, count), lambda i, c: back(i, c, ys, first, count), total
                ), ys

            return jax.lax.fori_loop(jnp.where(pieces == 1, 1, 0), pieces + 1, piece, carry)

        every, parts = self.record.every, -(-self.most // PIECE)
        stretches = -(-self.record.count // every)
        times = 0 if self.kept is None else self.kept.shape[0]
        at_end = _at(gradient, 0) if self.kept is None else jax.tree.map(jnp.zeros_like, self.y0)
        start = (jax.tree.map(jnp.zeros_like, moving), at_end, jnp.asarray(times - 1))
        ys = rows(parts + min(self.most, PIECE) + 1, self.y0)
        return jax.lax.fori_loop(0, stretches, stretch, (start, ys))[0][:2]

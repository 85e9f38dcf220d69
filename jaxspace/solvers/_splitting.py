"""Splitting: exact drift and exact kick in turns, for motion that is nearly the drift alone.

    S(h) = K(h/2) D(h) K(h/2)                          order 2 (Strang)
    S(g_m h) ... S(g_1 h)                              orders 4 and 6, with g_i = g_{m+1-i} and sum_i g_i = 1

The error is of the size of the kick times h^p: a small perturbation may be stepped over with long
steps. The maps keep the volume and the symplectic form, so that the energy swings and does not
wander.

    symbol  meaning                                          unit
    D, K    flow of the drift and of the kick
    h       step                                             s
    p       order                                            1

Sources: Wisdom, Holman (1991), Symplectic maps for the N-body problem, Astronomical Journal 102,
1528; Hairer, Lubich, Wanner, Geometric Numerical Integration, II.4 (order 4: Suzuki's five), V.3.2
(order 6: Yoshida's seven).
"""

import functools
import math
from typing import Any, ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError, State, barrier, safe_divide
from ._protocol import AbstractFixedStep, ScaledField, SolverTraits
from ._second_order import estimate_by_coarsening

UNRESOLVED_FACTOR = 0.25  # what the differences are divided by where no order holds

_P = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
_Y = (0.78451361047755726382, 0.23557321335935813368, -1.17767998417887100695)
COMPOSITIONS = {
    2: (1.0,),
    4: (_P, _P, 1.0 - 4.0 * _P, _P, _P),
    6: (*_Y, 1.0 - 2.0 * sum(_Y), *reversed(_Y)),
}


@final
class Splitting(AbstractFixedStep):
    """Splitting of `order` 2, 4 or 6 with `steps` equal steps from one time to land on to the next.

    For systems with a drift and a kick (`AbstractSplitSystem`): a scene of `PointGravity`, free
    rotation, and loads that depend on position and attitude; or a `Top`. Every state asked for is
    landed on. The error is estimated for the stretch as a whole, from the same with a golden
    section of the steps (0.62 of them), which costs as much again as that; `estimate=False` leaves
    it out, and then no status tells of too few steps. Steps longer than a radian of the orbit or
    two of the rotation meet the kicks as if drawn by lot: no order holds, and the estimate is four
    times the difference.

    Order 6 steps back and forth beyond the ends of a stretch: there it takes a kick that depends on
    the time as it is at the end.

    Raises `InputError` for another order, or a number of steps that is not even."""

    p: int = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    estimate: bool = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def __init__(self, order: int = 4, *, steps: int, estimate: bool = True):
        self.p, self.steps, self.estimate = order, steps, estimate

    def __check_init__(self):
        if self.p not in COMPOSITIONS:
            raise InputError(f"Splitting.order is {self.p}: it must be 2, 4 or 6.")
        if self.steps < 2 or self.steps % 2:
            raise InputError(f"Splitting.steps is {self.steps}: it must be even, and at least 2.")

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            replayable=True,
            lands_on_save_times=True,
            fixed_step=True,
            needs="split",
            evaluations=self._evaluations,
            steps=self.steps,
        )

    @property
    def _evaluations(self) -> int:
        return len(COMPOSITIONS[self.p]) * (
            self.steps + (_fewer(self.steps) if self.estimate else 0)
        )

    def refined(self, factor: int) -> "Splitting":
        return Splitting(self.p, steps=factor * self.steps, estimate=self.estimate)

    def order(self, terms: Any) -> int:
        return self.p

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> None:
        return None

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        return terms.vf(t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: None, made_jump: Any
    ):
        del terms, solver_state, made_jump
        ratio = self.steps / _fewer(self.steps)
        turn = (t1 - t0) / self.steps * _pace(args, t1, y0)
        error_reduction = jnp.where(turn < 1.0, ratio**self.p - 1.0, UNRESOLVED_FACTOR)

        def integrate(steps):
            return self._integrate(args, t0, t1, y0, steps)

        y1, error = estimate_by_coarsening(
            integrate, self.steps, _fewer(self.steps), error_reduction, self.estimate
        )
        return y1, error, dict(y0=y0, y1=y1), None, diffrax.RESULTS.successful

    def _integrate(self, field: ScaledField, t0: Array, t1: Array, y0: State, steps: int) -> State:
        """The state after `steps` equal steps from `t0` to `t1`; kicks are timed from within.

        Two half kicks that follow one another are one. The composition is a loop, so that drift
        and kick are compiled once."""
        split = field.split()
        h = (t1 - t0) / steps
        # Just before the end: a kick that jumps there is that of the segment which ends.
        end = t1 - 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(t1), t1 - t0)
        g = np.array(COMPOSITIONS[self.p])
        closing = np.arange(g.size) == g.size - 1
        parts = jnp.asarray(
            np.stack([np.cumsum(g) - g, g, 0.5 * np.roll(g, -1), closing], axis=1), h.dtype
        )

        def drift(s: Array, ds: Array, y: State) -> State:
            return barrier(split.drift(field.duration(s, ds), y))

        def kick(s: Array, ds: Array, y: State) -> State:
            return barrier(split.kick(field.time(s), field.duration(s, ds), y))

        def part(n: Array, y: State, row: Array) -> tuple[State, None]:
            before, g, of_next, closing = row
            y = drift(jnp.clip(t0 + (n + before) * h, t0, end), g * h, y)
            # The last half kick of all has no half kick of a next step to be joined with.
            following = jnp.where((closing > 0.0) & (n == steps - 1), 0.0, of_next)
            weight = 0.5 * g + following
            return kick(jnp.clip(t0 + (n + before + g) * h, t0, end), weight * h, y), None

        def one(y: State, n: Array) -> tuple[State, None]:
            return jax.lax.scan(lambda y, row: part(n, y, row), y, parts)

        y = kick(t0, 0.5 * parts[0, 1] * h, y0)
        # Reverse mode keeps the state before each step, and repeats what lies within the step.
        return jax.lax.scan(jax.checkpoint(one), y, jnp.arange(steps, dtype=h.dtype))[0]


def _fewer(steps: int) -> int:
    """The golden section of the steps: of all quotients the one that shares least with whole turns,
    so that steps that see the drift always in one place are told by steps that do not."""
    return max(1, round(0.5 * (math.sqrt(5.0) - 1.0) * steps))


def _pace(split: Any, t: Any, y: Any) -> Any:
    """How fast the state moves, in its own size per clock time, for each run: the fastest of its
    vectors."""
    y = jax.lax.stop_gradient(y)

    def size(x):
        return jnp.sqrt(jnp.sum(x * x, axis=0))

    rates = jax.tree.map(lambda x, v: safe_divide(size(v), size(x)), y, split(t, y))
    return functools.reduce(jnp.maximum, jax.tree.leaves(rates))

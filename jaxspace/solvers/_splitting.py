"""Splitting: exact drift and exact kick in turns, for motion that is nearly the drift alone.

    S(h) = K(h/2) D(h) K(h/2)            order 2 (Strang)
    S(g_m h) ... S(g_1 h)                orders 4 and 6, with g_i = g_{m+1-i} and sum_i g_i = 1

The error is of the size of the kick times h^p: long steps pass over a small perturbation. The maps
keep the volume and the symplectic form, so that the energy oscillates and does not drift away.

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
from typing import ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError, State, barrier, safe_divide
from ._protocol import AbstractFieldSolver, AbstractFixedStep, Advance, SolverTraits
from ._second_order import estimate_by_coarsening
from ._vector_field import ScaledField, StepField, just_before

# Where the steps do not resolve the motion, no order holds: the error is taken to be four times the
# difference that is seen.
UNRESOLVED_FACTOR = 0.25

_SUZUKI = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
_YOSHIDA = (0.78451361047755726382, 0.23557321335935813368, -1.17767998417887100695)
COMPOSITIONS = {
    2: (1.0,),
    4: (_SUZUKI, _SUZUKI, 1.0 - 4.0 * _SUZUKI, _SUZUKI, _SUZUKI),
    6: (*_YOSHIDA, 1.0 - 2.0 * sum(_YOSHIDA), *reversed(_YOSHIDA)),
}


@final
class Splitting(AbstractFieldSolver, AbstractFixedStep):
    """Splitting of order 2, 4 or 6 with `steps` equal steps in each segment.

    For systems with a drift and a kick: a scene of `PointGravity`, free rotation, and loads that
    depend on position and attitude; or a `Top`. Steps land on every save time, so that a segment
    lasts from one to the next.

    The error of each segment is estimated by 0.62 as many steps, which costs as much again as
    these. Steps longer than a radian of the orbit or two of the rotation meet the kicks at
    effectively random places: there no order holds, and the estimate is four times the difference.

    Order 6 steps back and forth beyond the ends of a segment. A kick that depends on the time is
    there taken as at the end.

    **Arguments**

    - `order`: 2, 4 or 6.
    - `steps`: in each segment; even, and at least 2.
    - `estimate`: whether the error is estimated. Without it no status reports too few steps.

    **Raises** `InputError` for another order or number of steps.
    """

    p: int = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    estimate: bool = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def __init__(self, order: int = 4, *, steps: int, estimate: bool = True):
        self.p = order
        self.steps = steps
        self.estimate = estimate

    def __check_init__(self):
        if self.p not in COMPOSITIONS:
            raise InputError(f"Splitting.order is {self.p}: it must be 2, 4 or 6.")
        if self.steps < 2 or self.steps % 2:
            raise InputError(f"Splitting.steps is {self.steps}: it must be even, and at least 2.")

    @property
    def traits(self) -> SolverTraits:
        parts = len(COMPOSITIONS[self.p])
        # Each part has one kick, and the first step of all one before it.
        evaluations = parts * self.steps + 1
        if self.estimate:
            # The rate at which the state turns takes one more.
            evaluations += parts * _fewer(self.steps) + 2
        return SolverTraits(
            lands_on_save_times=True,
            fixed_step=True,
            needs="split",
            evaluations=evaluations,
            steps=self.steps,
        )

    def refined(self, factor: int) -> "Splitting":
        return Splitting(self.p, steps=factor * self.steps, estimate=self.estimate)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return self.p

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        field: ScaledField = f.args
        fewer = _fewer(self.steps)
        turn = (t1 - t0) / self.steps * _angular_rate(field, t0, y0)
        resolved = (self.steps / fewer) ** self.p - 1.0
        error_reduction = jnp.where(turn < 1.0, resolved, UNRESOLVED_FACTOR)

        def integrate(steps: int) -> State:
            return _integrate(field, t0, t1, y0, COMPOSITIONS[self.p], steps)

        y1, error = estimate_by_coarsening(
            integrate, self.steps, fewer, error_reduction, self.estimate
        )
        return Advance(y1, error, dict(y0=y0, y1=y1))


def _fewer(steps: int) -> int:
    """The golden section of the steps.

    Of all ratios it is the one that shares least with whole turns: where the steps meet the drift
    always in one place, those that they are compared with do not."""
    return max(1, round(0.5 * (math.sqrt(5.0) - 1.0) * steps))


def _angular_rate(field: ScaledField, s: Float[Array, ""], y: State) -> Float[Array, "*runs"]:
    """How fast the state turns in each run, in radians of normalised time: the rate of its fastest
    vector over the length of this vector."""
    y = jax.lax.stop_gradient(y)

    def length(x: Array) -> Array:
        return jnp.sqrt(jnp.sum(x * x, axis=0))

    rates = jax.tree.map(lambda x, v: safe_divide(length(v), length(x)), y, field(s, y))
    return functools.reduce(jnp.maximum, jax.tree.leaves(rates))


def _integrate(
    field: ScaledField,
    t0: Float[Array, ""],
    t1: Float[Array, ""],
    y0: State,
    composition: tuple[float, ...],
    steps: int,
) -> State:
    """The state after equal steps in normalised time.

    **Arguments**

    - `field`: the system in normalised time.
    - `t0`, `t1`: start and end of the segment, in normalised time.
    - `y0`: the state at `t0`.
    - `composition`: the parts g_i of each step.
    - `steps`: their number.

    **Returns** the state at `t1`.
    """
    split = field.split()
    h = (t1 - t0) / steps
    end = just_before(t0, t1)
    g = np.array(composition)
    is_last = np.arange(g.size) == g.size - 1
    # For each part of a step: what lies before it, itself, half of the part that follows.
    table = np.stack([np.cumsum(g) - g, g, 0.5 * np.roll(g, -1), is_last], axis=1)
    parts = jnp.asarray(table, h.dtype)

    def drift(s: Array, ds: Array, y: State) -> State:
        return barrier(split.drift(field.duration(s, ds), y))

    def kick(s: Array, ds: Array, y: State) -> State:
        return barrier(split.kick(field.time(s), field.duration(s, ds), y))

    def at(steps_done: Array) -> Array:
        # Within the segment, beyond which a composition with negative parts reaches.
        return jnp.clip(t0 + steps_done * h, t0, end)

    def part(n: Array, y: State, row: Float[Array, "4"]) -> tuple[State, None]:
        before, g, half_of_next, is_last = row
        y = drift(at(n + before), g * h, y)
        # Half kicks that follow one another are one; the last of all has none to be joined with.
        closing = (is_last > 0.0) & (n == steps - 1)
        weight = 0.5 * g + jnp.where(closing, 0.0, half_of_next)
        return kick(at(n + before + g), weight * h, y), None

    def step(y: State, n: Array) -> tuple[State, None]:
        # A loop, so that drift and kick are compiled once.
        return jax.lax.scan(lambda y, row: part(n, y, row), y, parts)

    y = kick(t0, 0.5 * parts[0, 1] * h, y0)
    # Reverse mode keeps the state before each step, and repeats what lies within the step.
    return jax.lax.scan(jax.checkpoint(step), y, jnp.arange(steps, dtype=h.dtype))[0]

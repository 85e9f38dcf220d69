"""Events: a condition whose zero ends a run, found for every run by itself, differentiable.

    t_e :  g(t_e, y(t_e)) = 0            dt_e = -(dg)/(g_t + g_y f)

The zero is bracketed on samples of the dense output and then closed in by Newton's method guarded by its bracket, outside
every derivative. One more correction of time and state, inside the derivatives, carries the exact first derivative through
the event: how its time moves, and the state with it (the saltation).

    symbol  meaning                            unit
    g       condition                          any
    f       vector field of the system         state/s
"""

from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._core import AbstractSystem, InputError, Scalar, State, as_optional_float, check_positive
from ._accuracy import Accuracy
from ._propagate import propagate

CLOSING_STEPS = 12  # Newton's steps, guarded by the bracket; four are enough for a simple zero


@final
class Event(eqx.Module):
    """A run stops where `condition(t, y)`, a scalar for each run, passes through zero.

    - `direction`: 1 for a rise, -1 for a fall, 0 for both. A zero at the start is no event.
    - `within`, s: how long to wait for it in a phase.
    - `samples`: how finely the span is searched; two zeros within one span / `samples` may be passed over.

    Raises `InputError` for another direction or a number of samples below 2."""

    condition: Callable[[Scalar, State], Scalar]
    direction: int = eqx.field(static=True, default=0)
    within: Scalar | None = eqx.field(converter=as_optional_float, default=None)
    samples: int = eqx.field(static=True, default=128)

    def __check_init__(self):
        if self.direction not in (-1, 0, 1):
            raise InputError(f"Event.direction is {self.direction}: it must be 1 (rise), -1 (fall) or 0 (both).")
        if self.samples < 2:
            raise InputError(f"Event.samples is {self.samples}: it must be at least 2.")
        check_positive("Event.within", self.within)

    def slope(self, system: AbstractSystem, t: Scalar, y: State) -> tuple[Scalar, Scalar]:
        """The condition and its rate along the motion, 1/s times its unit."""
        rate = system.vector_field(t, y)
        return jax.jvp(self.condition, (t, y), (jnp.ones_like(t), rate))


def _pick(tree: State, index: Array, run_axes: int) -> State:
    """Of blocks with the samples on the first axis, the one at `index` of each run."""

    def leaf(x):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        return jnp.take_along_axis(x, jnp.broadcast_to(where, (1, *x.shape[1 : x.ndim - run_axes], *index.shape)), axis=0)[0]

    return jax.tree.map(leaf, tree)


def first_event(
    system: AbstractSystem, y0: State, t0: Scalar, t1: Scalar, events: tuple[Event, ...], accuracy: Accuracy, run_axes: int
) -> tuple[Scalar, Array]:
    """The time of the first event of each run and its index among `events`; (t1, -1) where none happens. Not differentiable."""
    # A system may hold functions among its leaves.
    fixed = lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x  # noqa: E731
    system, y0, t0, t1 = jax.tree.map(fixed, (system, y0, t0, t1))
    when, which = t1, -jnp.ones(jnp.shape(t1), jnp.int32)
    for number, event in enumerate(events):
        t, hit = _first_zero(system, y0, t0, t1, event, accuracy, run_axes)
        sooner = hit & ((jnp.abs(t - t0) < jnp.abs(when - t0)) | (which < 0))
        when, which = jnp.where(sooner, t, when), jnp.where(sooner, number, which)
    return when, which


def _first_zero(
    system: AbstractSystem, y0: State, t0: Scalar, t1: Scalar, event: Event, accuracy: Accuracy, run_axes: int
) -> tuple[Scalar, Array]:
    fractions = jnp.linspace(0.0, 1.0, event.samples + 1, dtype=jnp.result_type(t0))
    states = propagate(system, y0, t0, t1, fractions, accuracy, run_axes).states
    times = t0 + jnp.multiply.outer(fractions, t1 - t0)
    g = jax.vmap(event.condition)(times, states)
    g = g.at[0].set(_sign_at_start(system, event, t0, y0, g))
    rise, fall = (g[:-1] < 0.0) & (g[1:] >= 0.0), (g[:-1] > 0.0) & (g[1:] <= 0.0)
    crossing = {1: rise, -1: fall, 0: rise | fall}[event.direction]
    index = jnp.argmax(crossing, axis=0)
    y, t, value = _pick((states, times, g), index, run_axes)
    end = _pick(times, index + 1, run_axes)
    return _close_in(system, event, y, t, value, end, accuracy, run_axes), jnp.any(crossing, axis=0)


def _sign_at_start(system: AbstractSystem, event: Event, t0: Scalar, y0: State, g: Array) -> Array:
    """The condition at the start; where it is zero to rounding (a ball on the floor), the sign that it is about to take."""
    zero = jnp.abs(g[0]) <= 64.0 * jnp.finfo(g.dtype).eps * jnp.max(jnp.abs(g), axis=0)
    return jnp.where(zero, jnp.sign(event.slope(system, t0, y0)[1]), g[0])


def _close_in(
    system: AbstractSystem, event: Event, y: State, t: Scalar, g: Scalar, end: Scalar, accuracy: Accuracy, run_axes: int
) -> Scalar:
    """The zero between `t` (state `y`, condition `g`) and `end`."""

    def step(_: Any, bracket: tuple[Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
        low, high, guess = bracket
        there = jax.tree.map(lambda x: x[-1], propagate(system, y, t, guess, None, accuracy, run_axes).states)
        value, slope = event.slope(system, guess, there)
        before = value * jnp.sign(g) > 0.0
        low, high = jnp.where(before, guess, low), jnp.where(before, high, guess)
        newton = guess - value / jnp.where(slope == 0.0, 1.0, slope)
        inside = (slope != 0.0) & ((newton - low) * (newton - high) <= 0.0)
        return low, high, jnp.where(inside, newton, 0.5 * (low + high))

    return jax.lax.fori_loop(0, CLOSING_STEPS, step, (t, end, 0.5 * (t + end)))[2]


def corrected(system: AbstractSystem, events: tuple[Event, ...], which: Array, t: Scalar, y: State) -> tuple[Scalar, State]:
    """Time and state at the event, moved by one Newton step whose derivative is that of the event."""
    delay = jnp.zeros_like(t)
    for number, event in enumerate(events):
        g, slope = event.slope(system, t, y)
        slope = jax.lax.stop_gradient(slope)
        hit = (which == number) & (slope != 0.0)
        delay = jnp.where(hit, -g / jnp.where(hit, slope, 1.0), delay)
    return t + delay, jax.tree.map(lambda a, k: a + k * delay, y, system.vector_field(t, y))

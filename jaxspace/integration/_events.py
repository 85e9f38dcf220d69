"""Events: a condition whose zero ends a run, differentiable.

    t_e :  g(t_e, y(t_e)) = 0            dt_e = -(dg)/(g_t + g_y f)

The search for the zero (`_event_search`) is outside every derivative. One more correction of time
and state, inside the derivatives, carries the exact first derivative through the event: how its
time moves, and the state with it (the saltation).

A condition that touches zero without a change of sign has no crossing. A touch is the zero of the
rate of the condition along the motion, where the condition is nearly zero:

    t_e :  dg/dt = g_t + g_y f = 0,   |g| <= touch

    symbol  meaning                            unit
    g       condition                          any
    f       vector field of the system         state/s
"""

from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from ..core import (
    AbstractSystem,
    InputError,
    Scalar,
    State,
    as_optional_float,
    check_positive,
)

# Room for so many states is some gigabyte: a larger number is a slip.
MOST = 10**7


@final
class Event(eqx.Module):
    """A run stops where `condition(t, y)`, a scalar for each run, passes through zero.

    - `direction`: 1 for a rise, -1 for a fall along the run, 0 for both.
    - `within`, s: how long to wait for it in a phase.
    - `samples`: how finely the span is searched. Two zeros within one span / `samples` are found
      where the samples about them bend towards zero; a dip so narrow that they do not may be passed
      over.
    - `touch`, in the unit of the condition: stop where it touches zero instead of where it passes
      through: at an extremum no farther from zero than this. `direction` 1 is a minimum, -1 a
      maximum. Without it a touch is no event, or by rounding it is one.
    - `at_start`: whether a zero at the start of the run, to rounding, is an event. By default it is
      none, because it is the one at which the run before has ended; an event that happens together
      with that one is named in `Trajectory.happened`.
    - `terminal`: with `False` the run goes on, and `Trajectory.crossings` holds every zero, up to
      `capacity` of them. The span is then sampled between its save times, in `samples` parts or
      more.
    - `then`: with `terminal=False` a jump in place, a function (t, y) -> y as `Phase.then`, after
      which the run goes on: a ball bounces. `Trajectory.crossings` then holds the states on both
      sides, and the run ends at a zero for which there is no room.

    Raises `InputError` for another direction, a number of samples that is not from 2 to 1e7, a
    capacity that is not from 1 to 1e7, a `touch` or `within` that is not positive, or a `then` of
    an event that ends the run."""

    condition: Callable[[Scalar, State], Scalar]
    direction: int = eqx.field(static=True, default=0)
    within: Scalar | None = eqx.field(converter=as_optional_float, default=None)
    samples: int = eqx.field(static=True, default=128)
    touch: Scalar | None = eqx.field(converter=as_optional_float, default=None)
    at_start: bool = eqx.field(static=True, default=False)
    terminal: bool = eqx.field(static=True, default=True)
    capacity: int = eqx.field(static=True, default=64)
    then: Callable[[Scalar, State], State] | None = None

    def __check_init__(self):
        if self.direction not in (-1, 0, 1):
            raise InputError(
                f"Event.direction is {self.direction}: it must be 1 (rise), -1 (fall) or 0 (both)."
            )
        _check_count("samples", self.samples, 2)
        _check_count("capacity", self.capacity, 1)
        if self.terminal and self.then is not None:
            raise InputError(
                "Event.then is given with terminal=True: after the jump the run goes on, so that "
                "terminal must be False."
            )
        check_positive("Event.within", self.within)
        check_positive("Event.touch", self.touch)

    def value(self, system: AbstractSystem, t: Scalar, y: State) -> Scalar:
        """What is zero at the event: the condition, or for a touch its rate along the motion."""
        if self.touch is None:
            return self.condition(t, y)
        return self._rate(self.condition, system, t, y)[1]

    def slope(self, system: AbstractSystem, t: Scalar, y: State) -> tuple[Scalar, Scalar]:
        """The `value` and its rate along the motion, 1/s times its unit."""
        return self._rate(lambda t, y: self.value(system, t, y), system, t, y)

    @staticmethod
    def _rate(
        g: Callable[[Scalar, State], Scalar], system: AbstractSystem, t: Scalar, y: State
    ) -> tuple[Scalar, Scalar]:
        return jax.jvp(g, (t, y), (jnp.ones_like(t), system.vector_field(t, y)))


def _check_count(name: str, value: int, least: int) -> None:
    """Raise `InputError` unless it is a whole number from `least` to `MOST`."""
    if not isinstance(value, int | np.integer) or not least <= value <= MOST:
        raise InputError(f"Event.{name} is {value}: it must be a whole number from {least} to 1e7.")


def closures_of_events(events: tuple[Event, ...], t: Scalar, y: State) -> tuple[Event, ...]:
    """The events with the traced arrays that their conditions close over as leaves, as those that
    a loss function differentiates.

    `t` and `y` are a time of each run, s, and a state, for their shapes."""

    def closed(event: Event) -> Event:
        constants = jax.make_jaxpr(event.condition)(t, y).consts
        # Others stay as they are: what is converted takes states of this shape alone.
        if not any(isinstance(x, Tracer) for x in constants):
            return event
        condition = eqx.filter_closure_convert(event.condition, t, y)
        return eqx.tree_at(lambda e: e.condition, event, condition)

    return tuple(map(closed, events))


def newton_correct(
    system: AbstractSystem, events: tuple[Event, ...], which: Array, t: Scalar, y: State
) -> tuple[Scalar, State]:
    """Time and state at the event, moved by one step of Newton's method with its curvature, whose
    first and second derivatives are those of the event."""
    rate = system.vector_field(t, y)
    delay = jnp.zeros_like(t)
    for number, event in enumerate(events):
        # g + g' d + g'' d^2/2 = 0: at the event g is zero, so that the second term has no value
        # and no first derivative, but the second one that the event has.
        (g, slope), (_, bend) = jax.jvp(
            lambda t, y, e=event: e.slope(system, t, y), (t, y), (jnp.ones_like(t), rate)
        )
        hit = (which == number) & (slope != 0.0)
        step = -g / jnp.where(hit, slope, 1.0)
        bend = bend / jnp.where(hit, slope, 1.0)
        delay = jnp.where(hit, step - 0.5 * bend * step * step, delay)
    _, change = jax.jvp(system.vector_field, (t, y), (jnp.ones_like(t), rate))
    moved = jax.tree.map(lambda a, k, c: a + k * delay + c * (0.5 * delay * delay), y, rate, change)
    return t + delay, moved

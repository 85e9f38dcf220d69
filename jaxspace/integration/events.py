"""Events: a condition whose zero ends a run, differentiable.

    t_e :  g(t_e, y(t_e)) = 0            dt_e = -(dg)/(g_t + g_y f)

The search for the zero (`event_search`) is outside every derivative. One more correction of time
and state, inside the derivatives, provides the exact first derivative through the event: the change
of its time, and of the state with it (saltation).

A condition that touches zero without a change of sign has no crossing. A touch is the zero of the
rate of the condition along the motion, where the condition is nearly zero:

    t_e :  dg/dt = g_t + g_y f = 0,   |g| <= touch

    symbol  meaning                            unit
    g       condition                          any
    f       vector field of the system         state/s
"""

from collections.abc import Callable
from typing import Any, Protocol, final, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.checks import check_positive
from ..core.field_types import check_types
from ..core.one_kernel import in_one_kernel
from ..core.structure import HashedModule
from ..core.types import as_optional_float
from ._vanishing import vanishing


# Checked where annotations are.
@runtime_checkable
class HasVectorField(Protocol):
    """The part of a system that an event uses."""

    @property
    def vector_field(self) -> Callable[[Scalar, State], State]:
        """dy/dt as a function of time and state."""
        ...


# A flag of the runs that stays absent where no event has it.
def _as_flag(x: Any) -> Any:
    return None if x is None or x is False else jnp.asarray(x) if isinstance(x, bool) else x


# States of this number take about a gigabyte: a larger number is a mistake.
MOST_SAMPLES = 10**7


@final
class Event(HashedModule):
    """An event where a condition passes through zero; by default it stops the run.

    - `condition`: a function (t, y) that returns a scalar for each run, (*runs,).
    - `direction`: 1 for a rise, -1 for a fall along the run, 0 for both.
    - `within`, s: longest time that a phase waits for the event.
    - `samples`: number of parts into which the time span is divided for the search. Two zeros in
      the same part are found if the samples around them bend towards zero; a narrower dip can be
      missed.
    - `touch`: in the unit of the condition. Stop where the condition touches zero instead of where
      it passes through, that is, at an extremum within this distance of zero. `direction` 1 stops
      at a minimum, -1 at a maximum. Without `touch`, rounding decides whether a touch is an event.
    - `at_start`: whether a zero at the start of the run, to rounding, is an event. By default it is
      not, because the previous run usually ended at this zero. Simultaneous events of the one that
      ends a run are marked in `Trajectory.happened`.
    - `terminal`: whether the event ends the run. With `False` the run continues, and
      `Trajectory.crossings` contains every zero, up to `capacity` of them. The search then divides
      the span at the save times, into at least `samples` parts.
    - `capacity`: greatest number of recorded zeros of a run, with `terminal=False`.
    - `then`: with `terminal=False`, a function (t, y) -> y, like `Phase.then`, that replaces the
      state at each zero, as for a bouncing ball. `Trajectory.crossings` then contains the states on
      both sides, and the run ends at the first zero beyond `capacity`. Simultaneous events, within
      the resolution of the located time, act in the listed order, each on the state left by the
      previous one; a terminal one ends the run after them. They are determined from the state
      before any jump: an event moved away from its zero by an earlier jump still acts, and one
      moved onto its zero does not.
    - `passed`: for `Phase.until`, whether the phase ends immediately if the run is beyond the zero
      at its start, for example below the opening height of a parachute. By default it waits for the
      next zero.

    Raises `InputError` for an invalid direction, a number of samples that is not from 2 to 1e7, a
    capacity that is not from 1 to 1e7, a `touch` or `within` that is not positive, a `then` of an
    event that ends the run, or `passed` without a direction or with a `touch`."""

    condition: Callable[[Scalar, State], Scalar]
    direction: int = eqx.field(static=True, default=0)
    within: Scalar | None = eqx.field(converter=as_optional_float, default=None)
    samples: int = eqx.field(static=True, default=128)
    touch: Scalar | None = eqx.field(converter=as_optional_float, default=None)
    at_start: bool = eqx.field(static=True, default=False)
    terminal: bool = eqx.field(static=True, default=True)
    capacity: int = eqx.field(static=True, default=64)
    then: Callable[[Scalar, State], State] | None = None
    passed: Bool[Array, "*#runs"] | None = eqx.field(converter=_as_flag, default=None)

    def __check_init__(self):
        check_types(self)
        if self.direction not in (-1, 0, 1):
            raise InputError(
                f"Event.direction is {self.direction}: it must be 1 (rise), -1 (fall) or 0 (both)."
            )
        _check_count("samples", self.samples, 2)
        _check_count("capacity", self.capacity, 1)
        if self.terminal and self.then is not None:
            raise InputError(
                "Event.then is given with terminal=True: the run continues after the jump, so "
                "terminal must be False."
            )
        if self.passed is not None and (self.direction == 0 or self.touch is not None):
            raise InputError(
                "Event.passed is given without a direction or with a touch: direction must be 1 or "
                "-1, because it defines the side beyond the zero."
            )
        check_positive("Event.within", self.within)
        check_positive("Event.touch", self.touch)

    def beyond(self, t: Scalar, y: State) -> Bool[Array, "*#runs"] | None:
        """The runs that are beyond the zero at the start `t`, s, of a phase, and end it there;
        `None` unless the event has `passed`."""
        if self.passed is None:
            return None
        return self.passed & (self.direction * self.condition(t, y) > 0.0)

    def value(self, system: HasVectorField, t: Scalar, y: State) -> Scalar:
        """The function that is zero at the event: the condition, or its rate for a touch."""
        if self.touch is None:
            return self.condition(t, y)
        rate = system.vector_field(t, y)
        return jax.jvp(self.condition, (t, y), (jnp.ones_like(t), rate))[1]

    def slope(self, system: HasVectorField, t: Scalar, y: State) -> tuple[Scalar, Scalar]:
        """The `value` and its rate along the motion, 1/s times its unit."""
        return self.slope_along(system, t, y, system.vector_field(t, y))

    def slope_along(
        self, system: HasVectorField, t: Scalar, y: State, rate: State
    ) -> tuple[Scalar, Scalar]:
        """`slope` for a known `rate` of the state."""
        return jax.jvp(lambda t, y: self.value(system, t, y), (t, y), (jnp.ones_like(t), rate))


def _check_count(name: str, value: int, least: int) -> None:
    """Raise `InputError` unless it is a whole number from `least` to `MOST_SAMPLES`."""
    if not isinstance(value, int | np.integer) or not least <= value <= MOST_SAMPLES:
        raise InputError(f"Event.{name} is {value}: it must be a whole number from {least} to 1e7.")


def closures_of_events(events: tuple[Event, ...], t: Scalar, y: State) -> tuple[Event, ...]:
    """The events with the traced arrays that their conditions close over as leaves, so that a loss
    function can differentiate with respect to them.

    `t` and `y` are a time of each run, s, and a state; only their shapes are used."""

    def closed(event: Event) -> Event:
        constants = jax.make_jaxpr(event.condition)(t, y).consts
        # Other conditions stay as they are, because a converted one takes states of one shape only.
        if not any(isinstance(x, Tracer) for x in constants):
            return event
        condition = eqx.filter_closure_convert(event.condition, t, y)
        return eqx.tree_at(lambda e: e.condition, event, condition)

    return tuple(map(closed, events))


@final
class _Field(eqx.Module):
    """A vector field with all of its arrays as leaves, also those that its functions close over: a
    derivative rule sees leaves only."""

    rate: Callable[[Scalar, State], State]

    def vector_field(self, t: Scalar, y: State) -> State:
        """dy/dt, with the runs of the state."""
        # Constants have become numbers of NumPy, which may be shared by all runs.
        return jax.tree.map(lambda f, x: jnp.broadcast_to(f, x.shape), self.rate(t, y), y)


def newton_correct(
    system: AbstractSystem,
    events: tuple[Event, ...],
    which: Array,
    t: Scalar,
    y: State,
    *,
    located: bool = False,
) -> tuple[Scalar, State]:
    """Time and state at the event, corrected by one Newton step along the motion; their
    first and second derivatives are those of the event.

    **Arguments**

    - `which`: the index of the event of each run, -1 for none, (*runs,).
    - `located`: whether the state is at the event already. Then it is unchanged."""
    t = jnp.broadcast_to(t, which.shape)
    field = _Field(eqx.filter_closure_convert(system.vector_field, t, y))
    return _corrected(t, y, which, field, closures_of_events(events, t, y), located)


def _vector_field(system: _Field, t: Scalar, y: State) -> State:
    return system.vector_field(t, y)


@eqx.filter_custom_jvp
def _rate(t: Scalar, y: State, system: _Field) -> State:
    """dy/dt, for a single run in one kernel."""
    if t.ndim:
        return system.vector_field(t, y)
    arrays, static = eqx.partition((system, t, y), eqx.is_array)
    return in_one_kernel(lambda arrays: _vector_field(*eqx.combine(arrays, static)), arrays)


@_rate.def_jvp
def _rate_jvp(primals: PyTree, tangents: PyTree) -> tuple[PyTree, PyTree]:
    (t, y, system), (of_t, of_y, of_system) = primals, tangents
    return eqx.filter_jvp(_vector_field, (system, t, y), (of_system, of_t, of_y))


@eqx.filter_custom_jvp
def _corrected(
    t: Scalar, y: State, which: Array, system: _Field, events: tuple[Event, ...], located: bool
) -> tuple[Scalar, State]:
    if located:
        return t, y
    rate = _rate(t, y, system)
    delay = jnp.zeros_like(t)
    for number, event in enumerate(events):
        g, slope = event.slope_along(system, t, y, rate)
        hit = (which == number) & (slope != 0.0)
        delay = jnp.where(hit, -g / jnp.where(hit, slope, 1.0), delay)
    return t + delay, jax.tree.map(lambda x, k: x + k * delay, y, rate)


@_corrected.def_jvp
def _corrected_jvp(primals: PyTree, tangents: PyTree) -> tuple[PyTree, PyTree]:
    """The event from a state that moves by dy, at a time that moves by dt, with parameters p:

    delta = dy - f dt + d (f_t dt + f_y dy + f_p dp)
    dt_e = -(g_y delta + g_p dp)/(g_t + g_y f),   dy_e = delta + f dt_e

    d is the time from the state to the event: zero, but its derivative is that of the event."""
    t, y, which, system, events, _ = primals
    of_t, of_y, _, of_system, of_events, _ = tangents
    # The function calls itself, so that derivatives of higher order are right, too.
    te, ye = _corrected(*primals)
    rate = _rate(te, ye, system)
    dt = jnp.zeros_like(t) if of_t is None else of_t
    arrays, static = eqx.partition(((system, te, ye), (of_system, of_t, of_y)), eqx.is_array)

    def drift(delay: Scalar, arrays: PyTree) -> State:
        _, change = eqx.filter_jvp(_vector_field, *eqx.combine(arrays, static))
        return jax.tree.map(lambda c: c * delay, whole(change, y))

    delta = jax.tree.map(
        lambda d, k, c: d - k * dt + c,
        whole(of_y, y),
        rate,
        vanishing(drift, te - t, arrays, like=y),
    )
    dte = dt
    for number, event in enumerate(events):
        # At the fixed time of the event, where only the state and the parameters vary.
        _, dg = eqx.filter_jvp(
            lambda e, s, y: e.value(s, te, y),
            (event, system, ye),
            (None if of_events is None else of_events[number], of_system, delta),
        )
        # None of a condition on the time alone, which no state and no parameter moves.
        dg = whole(dg, t)
        _, slope = event.slope_along(system, te, ye, rate)
        hit = (which == number) & (slope != 0.0)
        dte = jnp.where(hit, -dg / jnp.where(hit, slope, 1.0), dte)
    dye = jax.tree.map(lambda d, k: d + k * dte, delta, rate)
    return (te, ye), (dte, dye)


def whole(tangent: PyTree, like: State) -> State:
    """The tangent with zeros where nothing moves: an array that is not differentiated has none."""
    leaves, structure = jax.tree.flatten(like)
    if tangent is None:
        return structure.unflatten([jnp.zeros_like(x) for x in leaves])
    given = zip(leaves, structure.flatten_up_to(tangent), strict=True)
    return structure.unflatten([jnp.zeros_like(x) if d is None else d for x, d in given])

"""Simultaneous events of a run: the order in which they act, and the zeros of the run after them.

Which events happen at the time of the first one is decided by the state before any of them acts.
They act in the order in which they are listed, each on the state that the one before left; then the
first of those that end the run does so.

The derivatives are those of events that happen one shortly after the other, in the listed order:
between two of them the run follows its vector field for a time that is zero, but has a derivative.
An event whose condition an earlier jump of the same time has moved away from zero, or turned, would
not happen later: it acts at the time of the jump before it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ..integration.event_search import FirstEvent
from ..integration.events import Event
from ..integration.simultaneous import Simultaneous, simultaneous_events


class PendingEvents(NamedTuple):
    """The events of the last time at which some of a run happened.

    - `events`: their conditions, before any of them acted; `waiting`: those that have yet to act.
    - `kept`: whether the conditions are what they were then, and `ahead`, whether the run leads
      through them as it did: of the state that the last event left."""

    events: Simultaneous
    waiting: Bool[Array, "events *#runs"]
    kept: Bool[Array, "events *#runs"]
    ahead: Bool[Array, "events *#runs"]

    @classmethod
    def none_yet(cls, events: tuple[Event, ...], like: Float[Array, "*runs"]) -> "PendingEvents":
        """None, for runs that begin; `like`: a number of each run."""
        zeros = jnp.zeros((len(events), *like.shape), like.dtype)
        no = jnp.zeros(zeros.shape, bool)
        return cls(Simultaneous(no, no, zeros, zeros, zeros), no, no, no)

    def start_known(self) -> Float[Array, "events *#runs"]:
        """The known state of the conditions where the run continues, as in `first_event`."""
        sign = jnp.where(self.events.zero, 1.0, -1.0).astype(self.events.values.dtype)
        return jnp.where(self.kept, sign * jnp.inf, 0.0)

    def updated(
        self,
        system: AbstractSystem,
        events: tuple[Event, ...],
        found: FirstEvent,
        start: tuple[Scalar, State],
        at: tuple[Scalar, State],
        run_axes: int,
    ) -> "PendingEvents":
        """The events that were `found` by runs from their `start` on, time and state; where some
        are waiting, or none was found, the present ones."""
        known = self.start_known()
        new = simultaneous_events(system, events, found, start, at, run_axes, known)
        yes = jnp.ones(new.happened.shape, bool)
        taken = (found.which >= 0) & ~jnp.any(self.waiting, axis=0)
        pending = PendingEvents(new, new.happened, yes, yes)
        # A condition may have the precision of the time or of the state.
        return jax.tree.map(lambda a, b: jnp.where(taken, a.astype(b.dtype), b), pending, self)

    def next_to_act(self, jumping: Bool[Array, "events *#runs"]) -> Int[Array, "*runs"]:
        """The number of the event that acts next, -1 for none: the first that is `jumping`, or else
        the first one."""
        first = jnp.where(jumping, self.waiting, False)
        order = jnp.where(jnp.any(first, axis=0), first, self.waiting)
        number = jnp.argmax(order, axis=0).astype(jnp.int32)
        return jnp.where(jnp.any(self.waiting, axis=0), number, -1)

    def after(
        self,
        acted: Bool[Array, "events *#runs"],
        system: AbstractSystem,
        events: tuple[Event, ...],
        t: Scalar,
        y: State,
    ) -> "PendingEvents":
        """The events after one has `acted`, which left the state `y` at the time `t`, s."""
        # These numbers only decide what acts next; derivatives come from the corrections.
        arrays = jax.tree.map(jax.lax.stop_gradient, (t, y))
        kept, ahead = [], []
        for number, event in enumerate(events):
            value, slope = event.slope(system, *arrays)
            before = self.events.slopes[number]
            kept.append(jnp.abs(value - self.events.values[number]) <= self.events.limits[number])
            # The quotient of two slopes of rounding size is not a derivative.
            least = float(jnp.finfo(slope.dtype).eps) ** 0.5
            ahead.append((slope * before > 0.0) & (jnp.abs(slope) > least * jnp.abs(before)))
        new = self._replace(
            waiting=self.waiting & ~acted, kept=jnp.stack(kept), ahead=jnp.stack(ahead)
        )
        jumped = jnp.any(acted, axis=0)
        return jax.tree.map(lambda a, b: jnp.where(jumped, a, b), new, self)

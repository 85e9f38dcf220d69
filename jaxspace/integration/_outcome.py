"""Outcome of an integration, assembled from the last state of its loop."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import State
from ._event_location import Location
from ._own_state import OwnLoop
from ._packed import Packing
from .loop import LoopSettings, LoopState


class Outcome(NamedTuple):
    """Outcome of an integration; `states` have the times on the first axis here.

    - `states`: at the save times, or the last one alone.
    - `max_local_error`, `out_of_steps`: of each run; the former in units of the tolerance.
    - `step_ends`, `step_states`: of the accepted steps, if requested.
    - `location`: of the first event of each run, if events are sought; the last of the `states` is
      the state there."""

    states: State
    max_local_error: Array
    out_of_steps: Array
    num_accepted: Array
    num_rejected: Array
    step_ends: Array | None
    step_states: State | None
    location: Location | None = None

    def unpacked(self, packing: Packing) -> "Outcome":
        """The outcome with states in place of the packed vectors of one run."""
        states, step_states, location = self.states, self.step_states, self.location
        if step_states is not None:
            step_states = jax.vmap(packing.state)(step_states)
        if location is not None:
            y0, y = packing.state(location.y0), packing.state(location.y)
            location = location._replace(y0=y0, y=y)
        states = jax.vmap(packing.state)(states)
        return self._replace(states=states, step_states=step_states, location=location)


def outcome_of(loop: LoopState, settings: LoopSettings) -> Outcome:
    """The outcome of runs with common steps."""
    location = loop.location
    finished = loop.t >= settings.end
    short = ~finished
    if location is not None:
        # Neither a run that waits at its event nor one that failed needs more steps.
        short = short & ~location.waiting & settings.tolerance.alive(loop.y)
    if loop.buffers.saved is None:
        # The state that was reached belongs to another time if the steps ran out.
        y = jax.tree.map(lambda x: jnp.where(finished, x, jnp.nan), loop.y)
        states = jax.tree.map(lambda x: x[None], y if location is None else location.ended(y))
    else:
        states = loop.buffers.saved.states
    return Outcome(
        states,
        loop.solver_state[1],
        loop.left_out | short,
        loop.num_accepted,
        loop.num_rejected,
        loop.buffers.ends_of(loop.num_accepted),
        loop.buffers.step_states,
        location,
    )


def own_outcome_of(loop: OwnLoop, settings: LoopSettings) -> Outcome:
    """The outcome of runs that each take their own steps, in regularised variables."""
    finished = loop.y.segment >= settings.end
    if loop.buffers.saved is None:
        states = jax.tree.map(lambda x: jnp.where(finished, x, jnp.nan)[None], loop.y)
    else:
        states = loop.buffers.saved.states
    alive = jnp.isfinite(loop.worst)
    return Outcome(
        states,
        loop.worst,
        loop.left_out | (~finished & alive & (loop.passes >= settings.max_steps)),
        loop.accepted,
        loop.rejected,
        loop.buffers.ends_of(loop.count),
        loop.buffers.step_states,
    )

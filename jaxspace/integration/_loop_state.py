"""The carry of the integration loop."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ._buffers import Buffers
from ._event_state import EventState
from ._loop_settings import LoopSettings
from ._tangents import TangentState


class LoopState(NamedTuple):
    """Carry of the loop. Times are normalised, those of each run or of all together.

    - `t`, `t_next`: the time reached, and the proposed end of the next step.
    - `carried`: carry of the method into the next step; `worst`: the largest local error of
      each run, in units of the tolerance.
    - `jumped`: whether the vector field jumped at `t`, so that the solver starts again.
    - `count`: number of the iterations in which a run moved; `going`: whether a run takes a further
      step.
    - `event_state`: of the first event of each run, where some are sought.
    - `tangents`: that control the steps, of a run that is differentiated.
    - `limiting`: number of the accepted steps that were limited by each run, where they share them;
      `left_out`: runs that used them up, and without which the others went on.
    - `outside`: whether a step of the run ended outside the range of its system; `None` where every
      state is inside.
    """

    t: Float[Array, "*runs"]
    t_next: Float[Array, "*runs"]
    y: State
    carried: PyTree
    worst: Float[Array, "*runs"]
    control: PyTree
    jumped: Bool[Array, "*runs"]
    accepted: Int[Array, "*runs"]
    rejected: Int[Array, "*runs"]
    count: Int[Array, ""]
    buffers: Buffers
    event_state: EventState | None
    tangents: TangentState | None
    limiting: Int[Array, "*runs"]
    left_out: Bool[Array, "*runs"]
    going: Bool[Array, "*runs"]
    outside: Bool[Array, "*runs"] | None = None

    def going_on(self, settings: LoopSettings) -> "LoopState":
        """Update of the runs that continue: those that have not reached their end, not failed, and
        do not wait at their event."""
        going = settings.tolerance.alive(self.y)
        if self.event_state is not None:
            going = going & ~self.event_state.waiting
        if self.t.ndim < going.ndim:
            going = jnp.any(going)
        left = self.accepted + self.rejected < settings.max_steps
        if settings.sharing is not None:
            layout = settings.layout(self.y, self.t)
            left = left & (self.count < jnp.where(settings.sharing, layout.limit, layout.rows))
        going = going & (self.t < settings.end) & left
        # Beyond its end no run starts again: a stage for it would be one for all.
        return self._replace(going=going, jumped=self.jumped & going)

    def unfinished(self) -> Bool[Array, ""]:
        """Whether a run makes a further step, or repeats the one that contains its event: up to the
        event, and once more for its tangents."""
        going = jnp.any(self.going)
        if self.event_state is None:
            return going
        going = going | jnp.any(self.event_state.again)
        if self.tangents is None:
            return going
        return going | jnp.any(self.event_state.met & ~self.tangents.ended)

    def short(self, settings: LoopSettings) -> Bool[Array, "*runs"]:
        """The runs that reached the maximum number of steps."""
        lacking = settings.tolerance.alive(self.y) & (self.t < settings.end)
        return lacking if self.event_state is None else lacking & ~self.event_state.waiting

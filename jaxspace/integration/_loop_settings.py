"""Settings of the loop of an integration."""

import dataclasses
from collections.abc import Callable
from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import State
from ..solvers.step_control import StepController
from ..solvers.tolerances import Tolerance
from ._buffers import Buffers, SavedStates
from ._event_state import TerminalEvents
from ._record import Recording, RecordLayout, check_memory
from ._rows import empty_buffer
from .layout import runs_of


@final
class LoopSettings(eqx.Module):
    """Settings of one integration in normalised time. Nothing in them is differentiated.

    - `method`: a solver that is bound to the run.
    - `lengths`: of the segments, as fractions of the run.
    - `longest_steps`: the longest step allowed in each segment, in normalised time.
    - `save_ts`: the normalised times at which states are saved; `None` saves the last one.
    - `reach`: normalised times between which all segments of nonzero length lie; `None` for the
      whole run.
    - `dense`: whether to return the ends of the steps, and the states there.
    - `terminal`: the events that end the runs.
    - `first_step`: as in `StepController`.
    - `fixed_step`: whether each segment is a step of the method, which is accepted in any case.
    - `together`: whether the runs share their times, as those of fixed steps do.
    - `derivative_control`: as in `Accuracy`.
    - `sharing`: whether the runs share their steps in this attempt, where the record of a first one
      was full."""

    method: diffrax.AbstractSolver
    tolerance: Tolerance
    lengths: Float[Array, "segments *#runs"]
    longest_steps: Float[Array, "segments *#runs"] | None
    save_ts: Float[Array, "times *#runs"] | None
    reach: tuple[Float[Array, "*#runs"], Float[Array, "*#runs"]] | None
    max_steps: int = eqx.field(static=True)
    dense: bool = eqx.field(static=True)
    terminal: TerminalEvents | None = None
    first_step: float | None = eqx.field(static=True, default=None)
    derivative_control: bool = eqx.field(static=True, default=False)
    fixed_step: bool = eqx.field(static=True, default=False)
    together: bool = eqx.field(static=True, default=False)
    sharing: Bool[Array, ""] | None = None

    @property
    def start(self) -> Float[Array, "*#runs"]:
        """The normalised time at which the run starts."""
        return jnp.zeros_like(self.end) if self.reach is None else self.reach[0]

    @property
    def end(self) -> Float[Array, "*#runs"]:
        """The normalised time at which the run ends."""
        if self.reach is not None:
            return self.reach[1]
        return jnp.asarray(self.lengths.shape[0], self.lengths.dtype)

    def clock(self, y: State) -> Float[Array, "*runs"]:
        """The start of each run like `y`; a single one where all of them share their times."""
        if self.together:
            return self.start
        return jnp.broadcast_to(self.start, runs_of(y, self.tolerance.run_axes))

    def controller(self) -> StepController:
        """The control of adaptive steps."""
        return StepController(self.tolerance, self.lengths, self.longest_steps, self.first_step)

    def buffers(self, y: State, clock: Array, step: Array | None) -> Buffers:
        """Empty buffers for states like `y` and times like `clock`, and for a derivative for
        recorded steps like `step`. Raises `InputError` where the memory does not suffice."""
        # Room for all steps that are allowed, because a compiled program cannot ask for more.
        limit = self.max_steps
        saved = ends = states = recording = None
        if self.save_ts is not None:
            saved = SavedStates.empty(self.save_ts, y, clock.shape)
        if self.dense:
            size = sum(x.size * x.dtype.itemsize for x in (clock, *jax.tree.leaves(y)))
            check_memory("the steps of the run", limit, size)
            ends = jnp.zeros((limit, *clock.shape), clock.dtype)
            states = empty_buffer(limit, y)
        if step is not None:
            shared = False if self.sharing is None else self.sharing
            recording = Recording.empty(self.layout(y, step), shared)
        return Buffers(saved, ends, states, recording)

    def layout(self, y: State, step: Array) -> RecordLayout:
        """The layout of a record of states like `y` and steps like `step`."""
        # Steps in regularised variables have several numbers each, and are few.
        short = not self.fixed_step and step.ndim == self.tolerance.run_axes
        return RecordLayout.of(y, step, self.max_steps, short=short)

    def shared(self, now: Bool[Array, ""]) -> "LoopSettings":
        """The settings of runs that share their steps `now`, or do not."""

        def of(x: Array | None, axes: int, reduction: Callable[..., Array]) -> Array | None:
            if x is None or x.ndim == axes:
                return x
            runs = tuple(range(axes, x.ndim))
            return jnp.where(now, reduction(x, axis=runs, keepdims=True), x)

        reach = self.reach
        if reach is not None:
            reach = of(reach[0], 0, jnp.min), of(reach[1], 0, jnp.max)
        return dataclasses.replace(
            self,
            lengths=of(self.lengths, 1, jnp.mean),
            longest_steps=of(self.longest_steps, 1, jnp.min),
            reach=reach,
            sharing=now,
        )

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
from ..solvers.error_tracking import ErrorTrackingSolver
from ..solvers.step_control import StepController, StepTo
from ..solvers.tolerances import Tolerance
from ._buffers import Buffers, SavedStates
from ._event_location import SoughtEvents
from ._record import Recording, RecordLayout, check_memory
from ._rows import empty_buffer


@final
class LoopSettings(eqx.Module):
    """Settings of one integration in normalised time. Nothing in them is differentiated.

    - `method`: a solver that is bound to the run.
    - `lengths`: of the segments, as fractions of the run.
    - `longest_steps`: the longest step allowed in each segment, in normalised time.
    - `save_ts`: the normalised times at which states are saved; `None` saves the last one.
    - `plan`: the nodes of steps that are fixed beforehand: of a fixed-step method, or those of
      diffrax's loop, chosen beforehand by this package's loop.
    - `reach`: normalised times between which all segments of nonzero length lie; `None` for the
      whole run.
    - `record_steps`, `dense`: whether to return the ends of the steps, and the states there.
    - `sought`: the events that end the runs.
    - `first_step`: as in `StepController`.
    - `together`: whether the runs share their times and steps, as those of a plan do.
    - `derivative_control`: as in `Accuracy`.
    - `sharing`: whether the runs share their steps in this attempt, where the record of a first one
      was full."""

    method: diffrax.AbstractSolver
    tolerance: Tolerance
    lengths: Float[Array, "segments *#runs"]
    longest_steps: Float[Array, "segments *#runs"] | None
    save_ts: Float[Array, "times *#runs"] | None
    plan: Float[Array, " nodes"] | None
    reach: tuple[Float[Array, "*#runs"], Float[Array, "*#runs"]] | None
    max_steps: int = eqx.field(static=True)
    record_steps: bool = eqx.field(static=True)
    dense: bool = eqx.field(static=True)
    sought: SoughtEvents | None = None
    first_step: float | None = eqx.field(static=True, default=None)
    derivative_control: bool = eqx.field(static=True, default=False)
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
        return jnp.broadcast_to(self.start, self.tolerance.alive(y).shape)

    def solver(self) -> ErrorTrackingSolver:
        """The method, with the largest local error of each run in its state."""
        return ErrorTrackingSolver(self.method, self.tolerance)

    def controller(self) -> StepController:
        """The control of adaptive steps."""
        return StepController(self.tolerance, self.lengths, self.longest_steps, self.first_step)

    def planned(self) -> StepTo:
        """The steps of the plan."""
        assert self.plan is not None
        return StepTo(self.plan.astype(self.lengths.dtype))

    def buffers(self, y: State, clock: Array, step: Array | None) -> Buffers:
        """Empty buffers for states like `y` and times like `clock`, and for a derivative for
        recorded steps like `step`. Raises `InputError` where the memory does not suffice."""
        # Room for all steps that are allowed, because a compiled program cannot ask for more.
        limit = self.max_steps
        saved = ends = states = recording = None
        if self.save_ts is not None:
            saved = SavedStates.empty(self.save_ts, y, clock.shape)
        if self.record_steps or self.dense:
            stored = (clock, *jax.tree.leaves(y)) if self.dense else (clock,)
            size = sum(x.size * x.dtype.itemsize for x in stored)
            check_memory("the steps of the run", limit, size)
            ends = jnp.zeros((limit, *clock.shape), clock.dtype)
            states = empty_buffer(limit, y) if self.dense else None
        if step is not None:
            shared = False if self.sharing is None else self.sharing
            recording = Recording.empty(self.layout(y, step), shared)
        return Buffers(saved, ends, states, recording)

    def layout(self, y: State, step: Array) -> RecordLayout:
        """The layout of a record of states like `y` and steps like `step`."""
        # Steps in regularised variables have several numbers each, and are few.
        short = step.shape == self.tolerance.alive(y).shape if self._is_free else False
        return RecordLayout.of(y, step, self.max_steps, short=short)

    @property
    def _is_free(self) -> bool:
        """Whether the steps are those of each run, and not planned or taken together."""
        return self.plan is None and not self.together

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

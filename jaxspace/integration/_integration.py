"""One integration as a tree of arrays, with the programs that its primitives compute.

The primitives are those of `_primitives.py`; the rules for mapped runs are in `_mapped_rules.py`.
"""

import dataclasses
import math
from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import State
from ..core.structure import shape_of
from ..core.tracing import count_operations
from ..solvers.protocol import rolled_stages, solver_traits
from ..solvers.step_control import FIRST_STEP
from ._individual_replay import IndividualReplay
from ._individual_state import IndividualState, record_of_iteration
from ._individual_steps import integrate_individual_steps
from ._loop import integrate_loop
from ._loop_settings import LoopSettings
from ._packed import Packing, packed
from ._record import Record, Recording
from ._replay import Replay
from ._tangents import Directions
from .field_trace import field_trace
from .normalised_time import ScaledVectorField
from .programs import Runs, rolls_stages
from .result import Outcome, outcome_of, outcome_of_individual_steps

# For the field and the initial state, a tree like each: whether an array is differentiated.
Moving: TypeAlias = tuple[PyTree[bool], PyTree[bool]]
# Likewise with the tangents of the arrays that are, and `None` for all others.
Tangents: TypeAlias = tuple[PyTree, PyTree]


@final
class Integration(eqx.Module):
    """A vector field, its initial state and the settings of the loop."""

    field: PyTree
    y0: State
    settings: LoopSettings

    def run(
        self, moving: Moving | None = None, *, rolled: bool = False
    ) -> tuple[Outcome, Record | None]:
        """The outcome, and the record of a run that is differentiated by what is `moving`.

        `rolled`: whether the stages of a single run are rolled, whatever its field."""
        field, y0, settings = self.field, self.y0, self.settings
        recorded = moving is not None
        assert not recorded or settings.terminal is None or settings.save_ts is None, (
            "states on the way to an event are differentiated along a second run"
        )
        # The type of the state decides which loop it belongs to.
        if isinstance(y0, IndividualState):
            loop = integrate_individual_steps(settings, field, y0, recorded=recorded)
            record = self._record(loop.buffers.recording, loop.count, None)
            return outcome_of_individual_steps(loop, settings), record
        rolled = self._is_alone if rolled else recorded and self._is_single
        # Many runs that are recorded are part of a derivative.
        if rolled or self._rolls_stages(derivative=recorded and not self._is_alone):
            settings = dataclasses.replace(settings, method=rolled_stages(settings.method))
        if rolls_stages(Runs.ONE, self.field_operations):
            # The estimate of the first step is another copy of the field.
            settings = dataclasses.replace(settings, first_step=settings.first_step or FIRST_STEP)
        directions = None
        # Fixed steps are not controlled.
        if moving is not None and settings.derivative_control and not settings.fixed_step:
            directions = Directions.of(field, y0, moving, settings.tolerance.run_axes)
        packing = self._packing
        if packing is not None:
            field, y0, settings = packed(packing, field, y0, settings)
            directions = directions and directions.packed(packing.vector)
        loop = integrate_loop(settings, field, y0, recorded=recorded, directions=directions)
        outcome = outcome_of(loop, settings)
        if packing is not None:
            outcome = outcome.unpacked(packing)
        ends = None if loop.event_state is None else loop.event_state.ends
        return outcome, self._record(loop.buffers.recording, loop.count, ends)

    def _record(
        self, recording: Recording | None, count: Array, ends: Array | None
    ) -> Record | None:
        """The record of `count` steps, whose runs have these `ends`."""
        if recording is None:
            return None
        y0 = self.y0
        own = isinstance(y0, IndividualState)
        step = record_of_iteration(y0.z[0], y0.z[0] > 0.0) if own else self.settings.clock(y0)
        layout = self.settings.layout(y0, step)
        ends = jnp.asarray(math.inf) if ends is None else ends
        return Record(layout, recording.numbers, recording.stride, count, ends, recording.shared)

    def with_tangents(self, given: Tangents) -> "Integration":
        """The tangents of field and initial state in a tree like this one; none of the settings."""
        # Not by its constructor: tangents may be missing, or flags in their place.
        parts = (*given, jax.tree.map(lambda _: None, self.settings))
        return eqx.tree_at(lambda run: (run.field, run.y0, run.settings), self, parts)

    def replay(self, record: Record, moving: PyTree[bool]) -> tuple[Replay, PyTree]:
        """The replay of a recorded run, and the differentiated part of its field."""
        part, fixed = eqx.partition(self.field, moving)
        if isinstance(self.y0, IndividualState):
            return IndividualReplay(self.settings, fixed, record, False, False), part
        rolled = self._rolls_stages(derivative=True)
        # The program of reverse mode then contains a step once.
        once = self._is_single or rolls_stages(Runs.DERIVATIVES, self.field_operations)
        return Replay(self.settings, fixed, record, rolled, once), part

    def forward(
        self, record: Record, given: Tangents, recorded: bool = False
    ) -> tuple[State, Array | None]:
        """The tangents of the saved states, and where they are `recorded` those of the numbers of
        the record."""
        d_part, d_y0 = given
        replay, part = self.replay(record, moving_in(self.field, d_part))
        d_y0 = jax.tree.map(lambda x, d: jnp.zeros_like(x) if d is None else d, self.y0, d_y0)
        return replay.jvp(part, self.y0, d_part, d_y0, recorded)

    def backward(self, record: Record, moving: Moving, cotangents: State) -> Tangents:
        """The cotangents of the differentiated arrays."""
        replay, part = self.replay(record, moving[0])
        of_part, of_state = replay.vjp(part, self.y0, cotangents)
        return of_part, eqx.filter(of_state, moving[1])

    def _rolls_stages(self, derivative: bool) -> bool:
        """Whether the stages of a run, or of a `derivative`, are rolled."""
        if self._is_alone:
            runs = Runs.DERIVATIVE_OF_ONE if derivative else Runs.ONE
        else:
            runs = Runs.DERIVATIVES if derivative else Runs.MANY
        return rolls_stages(runs, self.field_operations)

    @property
    def _is_single(self) -> bool:
        """Whether this is a single run of a field so large that every program of it should be
        small."""
        return self._is_alone and rolls_stages(Runs.ONE_RECORDED, self.field_operations)

    @property
    def _is_alone(self) -> bool:
        """Whether there is one run, with or without an axis of runs."""
        last = jax.tree.leaves(self.y0)[-1].shape
        return math.prod(last[len(last) - self.settings.tolerance.run_axes :]) == 1

    @property
    def _packing(self) -> Packing | None:
        """Layout of the packed state for a single run of a large field; `None` for other runs."""
        settings = self.settings
        single = settings.tolerance.run_axes == 0 and isinstance(self.field, ScaledVectorField)
        blocks = len(jax.tree.leaves(self.y0))
        if not single or blocks == 1 or not solver_traits(settings.method).linear:
            return None
        return Packing.of(self.y0) if rolls_stages(Runs.ONE, self.field_operations) else None

    @property
    def field_operations(self) -> int:
        """Number of operations in one evaluation of the vector field."""
        if isinstance(self.field, ScaledVectorField):
            t = jax.ShapeDtypeStruct((), self.settings.lengths.dtype)
            return field_trace(self.field.system, t, self.y0).operations
        rate = eqx.filter_make_jaxpr(lambda run: run.field(run.settings.clock(run.y0), run.y0))
        return count_operations(rate(jax.tree.map(shape_of, self))[0].jaxpr)


def moving_in(values: PyTree, tangents: PyTree) -> PyTree[bool]:
    """Whether each of the values has a tangent, where `None` stands for one that is zero."""
    return jax.tree.map(lambda _, d: d is not None, values, tangents)

"""One integration as a function of flat arrays, which the primitives of `_primitives.py` compute.

JAX passes flat arrays to a primitive. A `Problem` holds the rest, and turns arrays into the field,
the initial state and the settings of an integration, and results into arrays.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import TypeAlias, TypeVar, cast, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import ClosedJaxpr  # pyright: ignore
from jaxtyping import Array, PyTree

from ..core import State
from ..core.structure import shape_of
from ..core.tracing import count_operations
from ..solvers.protocol import small_program, solver_traits
from ..solvers.step_control import FIRST_STEP
from ._loop import integrate_loop
from ._loop_settings import LoopSettings
from ._own_replay import OwnReplay
from ._own_state import OwnState, record_of_pass
from ._own_steps import integrate_own_steps
from ._packed import Packing, packed
from ._record import Record, Recording
from ._replay import Replay
from ._tangents import Probes
from .field_trace import field_trace
from .normalised_time import ScaledVectorField
from .programs import Runs, is_small
from .result import outcome_of, own_outcome_of

Leaves: TypeAlias = Sequence[Array]
Moving: TypeAlias = tuple[int, ...]
Avals: TypeAlias = Sequence[ShapedArray | jax.ShapeDtypeStruct]
# Field, initial state and settings of an integration.
Parts: TypeAlias = tuple[PyTree, PyTree, LoopSettings]
T = TypeVar("T")
# Arrays of a record: its numbers, the stride of its states, the count of its steps, the ends of its
# runs, and whether these share their steps.
RECORD_ARRAYS = 5


def arguments_of(parts: PyTree) -> list[Array]:
    """The arrays of field, initial state and settings: the arguments of the primitives."""
    leaves = jax.tree.leaves(eqx.filter(parts, eqx.is_array))
    # A function may close over an array of NumPy, as traces hold their constants.
    return [x if isinstance(x, jax.Array) else jnp.asarray(x) for x in leaves]


@final
class Problem:
    """The static part of an integration; its arrays are the arguments of the primitives.

    A problem is compared by identity, and traces each of its programs once."""

    def __init__(self, parts: Parts):
        arrays, self.static = eqx.partition(parts, eqx.is_array)
        leaves, self.structure = jax.tree.flatten(arrays)
        # Only the shapes are stored here, because the arguments of the primitives are tracers. Weak
        # types are preserved: a parameter given as a Python number takes the precision of the
        # state.
        self.avals = [shape_of(x) for x in leaves]
        field, y0, _ = parts
        self.num_field = len(arguments_of(field))
        # Saved states have as many arrays as one state, and come first in an outcome.
        self.num_states = len(arguments_of(y0))
        self._records: dict[Moving, ClosedJaxpr] = {}

    def parts(self, args: Sequence[PyTree]) -> Parts:
        """Field, initial state and settings from the arguments."""
        return eqx.combine(jax.tree.unflatten(self.structure, args), self.static)

    # The programs, as functions of flat arguments.

    def solve(
        self,
        *args: Array,
        recorded: bool = False,
        small: bool = False,
        moving: Moving = (),
    ) -> list[Array]:
        """The arrays of the outcome; of one that is `recorded`, then those of its record.

        `moving`: the arguments by which a recorded run is differentiated.
        `small`: whether the steps of a single run are a small program, whatever its field."""
        field, y0, settings = self.parts(args)
        assert not recorded or settings.sought is None or settings.save_ts is None, (
            "states on the way to an event are differentiated along a second run"
        )
        # The type of the state decides which loop it belongs to.
        if isinstance(y0, OwnState):
            own = integrate_own_steps(settings, field, y0, recorded=recorded)
            recorded_steps = _arrays_of(own.buffers.recording, own.count, None)
            return [*jax.tree.leaves(own_outcome_of(own, settings)), *recorded_steps]
        small = self._is_alone(settings) if small else recorded and self._is_single(settings)
        if small or self._is_small(settings, derivative=False):
            settings = dataclasses.replace(settings, method=small_program(settings.method))
        if is_small(Runs.ONE, self.field_operations):
            # The estimate of the first step is another copy of the field.
            settings = dataclasses.replace(settings, first_step=settings.first_step or FIRST_STEP)
        probes = None
        # Steps of a plan are not controlled.
        if settings.derivative_control and settings.plan is None:
            probes = Probes.of(field, y0, moving, settings.tolerance.run_axes)
        packing = self._packing(field, y0, settings)
        if packing is not None:
            field, y0, settings = packed(packing, field, y0, settings)
            probes = probes and probes.packed(packing.vector)
        loop = integrate_loop(settings, field, y0, recorded=recorded, probes=probes)
        outcome = outcome_of(loop, settings)
        if packing is not None:
            outcome = outcome.unpacked(packing)
        ends = None if loop.location is None else loop.location.ends
        recorded_steps = _arrays_of(loop.buffers.recording, loop.count, ends)
        return [*jax.tree.leaves(outcome), *recorded_steps]

    @functools.cached_property
    def solve_jaxpr(self) -> ClosedJaxpr:
        """The traced `solve`."""
        return jax.make_jaxpr(self.solve)(*self.avals)

    def record_jaxpr(self, moving: Moving) -> ClosedJaxpr:
        """The traced `solve` of a run that is recorded, and differentiated by some arguments."""
        if moving not in self._records:
            solve = functools.partial(self.solve, recorded=True, moving=moving)
            self._records[moving] = jax.make_jaxpr(solve)(*self.avals)
        return self._records[moving]

    def _is_small(self, settings: LoopSettings, derivative: bool) -> bool:
        """Whether the steps of a run, or of a `derivative`, are a small program."""
        if self._is_alone(settings):
            runs = Runs.DERIVATIVE_OF_ONE if derivative else Runs.ONE
        else:
            runs = Runs.DERIVATIVES if derivative else Runs.MANY
        return is_small(runs, self.field_operations)

    def _is_single(self, settings: LoopSettings) -> bool:
        """Whether this is a single run of a field so large that every program of it should be
        small."""
        return self._is_alone(settings) and is_small(Runs.ONE_RECORDED, self.field_operations)

    def _is_alone(self, settings: LoopSettings) -> bool:
        """Whether there is one run, with or without an axis of runs."""
        last = self.avals[self.num_field + self.num_states - 1].shape
        return math.prod(last[len(last) - settings.tolerance.run_axes :]) == 1

    def _packing(self, field: PyTree, y0: State, settings: LoopSettings) -> Packing | None:
        """Layout of the packed state for a single run of a large field; `None` for other runs."""
        single = settings.tolerance.run_axes == 0 and isinstance(field, ScaledVectorField)
        if not single or len(jax.tree.leaves(y0)) == 1 or not solver_traits(settings.method).linear:
            return None
        return Packing.of(y0) if is_small(Runs.ONE, self.field_operations) else None

    @functools.cached_property
    def field_operations(self) -> int:
        """Number of operations in one evaluation of the vector field."""
        field, y0, settings = self.parts(self.avals)
        if isinstance(field, ScaledVectorField):
            t = jax.ShapeDtypeStruct((), settings.lengths.dtype)
            return field_trace(field.system, t, y0).operations

        def rate(*args: Array) -> State:
            field, y0, settings = self.parts(args)
            return field(settings.clock(y0), y0)

        return count_operations(jax.make_jaxpr(rate)(*self.avals).jaxpr)

    @property
    def outcome_avals(self) -> Avals:
        """Shapes of the arrays of the outcome."""
        return cast(Avals, self.solve_jaxpr.out_avals)

    def record_avals(self, moving: Moving) -> Avals:
        """Shapes of the arrays of the record."""
        return cast(Avals, self.record_jaxpr(moving).out_avals[len(self.outcome_avals) :])

    def split_record(self, results: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        """Split the result of a recorded `solve` into the outcome and the record."""
        n = len(results) - RECORD_ARRAYS
        return list(results[:n]), list(results[n:])

    def split(self, values: Sequence[T]) -> tuple[list[T], list[T], list[T]]:
        """Arguments of `along` or `back`: those of the problem, the record's, and the rest."""
        n = len(self.avals)
        m = n + RECORD_ARRAYS
        return list(values[:n]), list(values[n:m]), list(values[m:])

    def _replay(self, args: Leaves, record: Leaves, moving: Moving) -> tuple[Replay, PyTree, State]:
        """The replay, the differentiated part of the field, the initial state, and which of its
        blocks are differentiated."""
        field_args = list(args[: self.num_field])
        moves = [k for k in moving if k < self.num_field]
        part = [field_args[k] if k in moves else None for k in range(self.num_field)]
        rest = [None if k in moves else field_args[k] for k in range(self.num_field)]
        padding = [None] * (len(args) - self.num_field)

        def tree(leaves: Sequence[Array | None]) -> PyTree:
            return jax.tree.unflatten(self.structure, [*leaves, *padding])[0]

        _, y0, settings = self.parts(args)
        fixed = eqx.combine(tree(rest), self.static[0])
        own = isinstance(y0, OwnState)
        step = record_of_pass(y0.z[0], y0.z[0] > 0.0) if own else settings.clock(y0)
        steps = Record(settings.layout(y0, step), *record)
        if own:
            return OwnReplay(settings, fixed, steps, False, False), tree(part), y0
        small = self._is_small(settings, derivative=True)
        # The program of reverse mode then holds a step once.
        once = self._is_single(settings) or is_small(Runs.DERIVATIVES, self.field_operations)
        return Replay(settings, fixed, steps, small, once), tree(part), y0

    def forward(
        self, args: Leaves, record: Leaves, moving: Moving, tangents: Leaves, recorded: bool = False
    ) -> list[Array]:
        """The tangents of the saved states, and where they are `recorded` those of the numbers of
        the record."""
        replay, part, y0 = self._replay(args, record, moving)
        given = dict(zip(moving, tangents, strict=True))
        leaves, structure = jax.tree.flatten(part)
        d_part = [given[k] for k in moving if k < self.num_field]
        assert len(leaves) == len(d_part)
        state, state_tree = jax.tree.flatten(y0)
        d_state = [given.get(self.num_field + k, jnp.zeros_like(x)) for k, x in enumerate(state)]
        result = replay.jvp(
            part,
            y0,
            jax.tree.unflatten(structure, d_part),
            jax.tree.unflatten(state_tree, d_state),
            recorded,
        )
        return jax.tree.leaves(result)

    def backward(
        self, args: Leaves, record: Leaves, moving: Moving, cotangents: Leaves
    ) -> list[Array]:
        """The cotangents of the differentiated arguments."""
        replay, part, y0 = self._replay(args, record, moving)
        structure = jax.tree.structure(y0)
        of_part, of_state = replay.vjp(part, y0, jax.tree.unflatten(structure, cotangents))
        state = jax.tree.leaves(of_state)
        of_field = [k for k in moving if k < self.num_field]
        result = dict(zip(of_field, jax.tree.leaves(of_part), strict=True))
        result |= {self.num_field + k: x for k, x in enumerate(state)}
        return [result[k] for k in moving]


def _arrays_of(recording: Recording | None, count: Array, ends: Array | None) -> list[Array]:
    """The arrays of a record of `count` steps, whose runs have these `ends`; none where nothing was
    recorded."""
    if recording is None:
        return []
    if ends is None:
        # No event. Not a constant, because the rules for derivatives expect traced numbers.
        ends = jnp.where(count >= 0, jnp.inf, 0.0)
    return [recording.numbers, recording.stride, count, ends, recording.shared]

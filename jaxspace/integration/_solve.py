"""One integration as a primitive of JAX: both modes of differentiation, and mapped runs.

The number of steps depends on the input, so that JAX can transpose no loop over them. Instead, the
rule for derivatives records the steps, and the tangent is a primitive of its own, `along`: linear
in the tangents, computed forwards along the record, and backwards when it is transposed (`back`).

    solve    (field, y0)                  -> outcome
    record   (field, y0)                  -> outcome, record
    along    (field, y0), record, (dp)    -> dy             linear in dp
    back     (field, y0), record, (y*)    -> p*             the transpose of along

All derivatives but reverse mode over these two follow: JAX differentiates the loops of `along` and
`back` forwards.

A mapped integration (`jax.vmap`) does not run JAX's own map, in which every run takes the steps of
the slowest and the vector field computes with the components innermost. Its batching rule adds an
axis of runs to the layout and calls the batch path, in blocks. It recomputes the record there, so
that no residual depends on how runs were grouped.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias, cast, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun  # pyright: ignore
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, PyTree

from ..core import InputError, State
from ._loop import LoopSettings, LoopState, integrate_loop
from ._mapping import add_run_axis, over_blocks
from ._replay import Record, Replay
from ._selection import shape_of

Leaves: TypeAlias = Sequence[Array]
# A derivative that is zero by structure, and not by value, is marked by JAX as such.
Tangents: TypeAlias = Sequence[Array | ad.Zero]
# Which axis of each argument is mapped; `None` for one that is not.
Dims: TypeAlias = Sequence[int | None]
Batched: TypeAlias = tuple[list[Array], list[int | None]]
Moving: TypeAlias = tuple[int, ...]
Aval: TypeAlias = ShapedArray
Avals: TypeAlias = Sequence[ShapedArray | jax.ShapeDtypeStruct]
# A derivative of a derivative, of what is fixed and of the tangents.
Derivative: TypeAlias = Callable[[Leaves, Leaves], list[Array]]
# Field, initial state and settings of an integration.
Parts: TypeAlias = tuple[PyTree, PyTree, LoopSettings]

REVERSE_OF_DERIVATIVE = (
    "Reverse mode of a derivative of a run is not available: take jax.jacfwd(jax.grad(f)), which "
    "is jax.hessian(f), or jax.jacfwd(jax.jacfwd(f))."
)


class Outcome(NamedTuple):
    """What an integration leaves; times lead in `states` here.

    - `states`: at the save times, or the last one alone.
    - `max_local_error`: of each run, in units of the tolerance.
    - `step_ends`, `step_states`: of the accepted steps, where asked for."""

    states: State
    max_local_error: Array
    out_of_steps: Array
    num_accepted: Array
    num_rejected: Array
    step_ends: Array | None
    step_states: State | None


def _outcome(loop: LoopState, settings: LoopSettings) -> Outcome:
    finished = loop.t >= settings.end
    if loop.saved is None:
        # The state that was reached belongs to another time if the steps ran out.
        states = jax.tree.map(lambda x: jnp.where(finished, x, jnp.nan)[None], loop.y)
    else:
        states = loop.saved.states
    asked = settings.record_steps or settings.dense
    ends = loop.step_ends if asked else None
    if ends is not None:
        # Beyond the last accepted step the buffer is uninitialised.
        ends = jnp.where(jnp.arange(ends.shape[0]) < loop.num_accepted, ends, jnp.inf)
    return Outcome(
        states,
        loop.solver_state[1],
        ~finished,
        loop.num_accepted,
        loop.num_rejected,
        ends,
        loop.step_states,
    )


@final
class Problem:
    """The static part of an integration; its arrays are the arguments of the primitives.

    A problem is compared by identity, and traces each of its programs once."""

    def __init__(self, parts: Parts):
        arrays, self.static = eqx.partition(parts, eqx.is_array)
        self.leaves, self.structure = jax.tree.flatten(arrays)
        # Weak types stay: a parameter given as a Python number takes the precision of the state.
        self.avals = [shape_of(x) for x in self.leaves]
        # The arguments of the primitives are tracers; only their shapes may stay here.
        field, y0, settings = parts
        self.num_field = len(jax.tree.leaves(eqx.filter(field, eqx.is_array)))
        self.num_state = len(jax.tree.leaves(eqx.filter(y0, eqx.is_array)))

    @classmethod
    def of(cls, *parts: PyTree) -> tuple["Problem", list[Array]]:
        """The problem of a field, an initial state and settings, and its arguments."""
        problem = cls(parts)
        leaves = problem.leaves
        del problem.leaves
        return problem, leaves

    def parts(self, args: Sequence[PyTree]) -> Parts:
        """Field, initial state and settings from the arguments."""
        return eqx.combine(jax.tree.unflatten(self.structure, args), self.static)

    # The programs, as functions of flat arguments.

    def solve(self, *args: Array) -> list[Array]:
        """The arrays of the outcome."""
        field, y0, settings = self.parts(args)
        return jax.tree.leaves(_outcome(integrate_loop(settings, field, y0), settings))

    def record(self, *args: Array) -> list[Array]:
        """The arrays of the outcome, then those of the record."""
        field, y0, settings = self.parts(args)
        loop = integrate_loop(settings, field, y0, checkpointed=True)
        return jax.tree.leaves((_outcome(loop, settings), Record.of(loop)))

    @functools.cached_property
    def solve_jaxpr(self) -> ClosedJaxpr:
        """The traced `solve`."""
        return jax.make_jaxpr(self.solve)(*self.avals)

    @functools.cached_property
    def record_jaxpr(self) -> ClosedJaxpr:
        """The traced `record`."""
        return jax.make_jaxpr(self.record)(*self.avals)

    @property
    def outcome_avals(self) -> Avals:
        """Shapes of the arrays of the outcome."""
        return cast(Avals, self.solve_jaxpr.out_avals)

    @property
    def record_avals(self) -> Avals:
        """Shapes of the arrays of the record."""
        return cast(Avals, self.record_jaxpr.out_avals[len(self.outcome_avals) :])

    @property
    def num_states(self) -> int:
        """How many arrays the saved states have; they come first in an outcome."""
        return self.num_state

    def _replay(self, args: Leaves, record: Leaves, moving: Moving) -> tuple[Replay, PyTree, State]:
        """The replay, the moving part of the field, the initial state, and which of it moves."""
        field_args = list(args[: self.num_field])
        moves = [k for k in moving if k < self.num_field]
        part = [field_args[k] if k in moves else None for k in range(self.num_field)]
        rest = [None if k in moves else field_args[k] for k in range(self.num_field)]
        padding = [None] * (len(args) - self.num_field)

        def tree(leaves: Sequence[Array | None]) -> PyTree:
            return jax.tree.unflatten(self.structure, [*leaves, *padding])[0]

        _, y0, settings = self.parts(args)
        fixed = eqx.combine(tree(rest), self.static[0])
        replay = Replay(settings, fixed, _record(record, y0))
        return replay, tree(part), y0

    def forward(
        self,
        args: Leaves,
        record: Leaves,
        moving: Moving,
        tangents: Leaves,
    ) -> list[Array]:
        """The tangents of the saved states."""
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
        )
        return jax.tree.leaves(result)

    def backward(
        self,
        args: Leaves,
        record: Leaves,
        moving: Moving,
        cotangents: Leaves,
    ) -> list[Array]:
        """The cotangents of the arguments that move."""
        replay, part, y0 = self._replay(args, record, moving)
        structure = jax.tree.structure(y0)
        of_part, of_state = replay.vjp(part, y0, jax.tree.unflatten(structure, cotangents))
        state = jax.tree.leaves(of_state)
        of_field = [k for k in moving if k < self.num_field]
        found = dict(zip(of_field, jax.tree.leaves(of_part), strict=True))
        found |= {self.num_field + k: x for k, x in enumerate(state)}
        return [found[k] for k in moving]


def _record(leaves: Sequence[Array], y0: State) -> Record:
    """The record from its arrays."""
    structure = jax.tree.structure(y0)
    *first, stride, count = leaves
    return Record(first[0], jax.tree.unflatten(structure, first[1:]), stride, count)


def _split(problem: Problem, values: Sequence[Any]) -> tuple[list[Any], list[Any], list[Any]]:
    """Arguments of `along` or `back`: those of the problem, the record's, and the rest."""
    n = len(problem.avals)
    m = 3 + problem.num_state
    return list(values[:n]), list(values[n : n + m]), list(values[n + m :])


def _columns(function: Callable[..., list[Array]], columns: int) -> Callable[..., list[Array]]:
    """The function of a list, mapped over leading axes of its arrays."""
    for _ in range(columns):
        function = jax.vmap(function)
    return function


# The four programs as functions of all arguments, with static parameters.


def _solve(*args: Array, problem: Problem) -> list[Array]:
    return jaxpr_as_fun(problem.solve_jaxpr)(*args)


def _record_program(*args: Array, problem: Problem) -> list[Array]:
    return jaxpr_as_fun(problem.record_jaxpr)(*args)


def _along(*values: Array, problem: Problem, moving: Moving, columns: int) -> list[Array]:
    args, record, tangents = _split(problem, values)
    function = _columns(lambda t: problem.forward(args, record, moving, t), columns)
    return function(tangents)


def _back(*values: Array, problem: Problem, moving: Moving, columns: int) -> list[Array]:
    args, record, cotangents = _split(problem, values)
    function = _columns(lambda c: problem.backward(args, record, moving, c), columns)
    return function(cotangents)


def _no_transpose(*values: Array, function: Callable[..., list[Array]], fixed: int) -> list[Array]:
    return function(values[:fixed], values[fixed:])


def _primitive(
    name: str, function: Callable[..., list[Array]], shapes: Callable[..., Avals]
) -> Primitive:
    primitive = Primitive(name)
    primitive.multiple_results = True
    primitive.def_impl(function)
    primitive.def_abstract_eval(shapes)
    mlir.register_lowering(primitive, mlir.lower_fun(function, multiple_results=True))
    return primitive


def _array_avals(shapes: Avals) -> Avals:
    return [ShapedArray(x.shape, x.dtype) for x in shapes]


def _with_columns(shapes: Avals, values: Avals, columns: int) -> Avals:
    lead = values[0].shape[:columns] if columns else ()
    return [ShapedArray((*lead, *x.shape), x.dtype) for x in shapes]


def _along_avals(*values: Aval, problem: Problem, moving: Moving, columns: int) -> Avals:
    _, _, tangents = _split(problem, values)
    return _with_columns(problem.outcome_avals[: problem.num_states], tangents, columns)


def _back_avals(*values: Aval, problem: Problem, moving: Moving, columns: int) -> Avals:
    args, _, cotangents = _split(problem, values)
    return _with_columns([args[k] for k in moving], cotangents, columns)


solve_p = _primitive("integrate", _solve, lambda *a, problem: problem.solve_jaxpr.out_avals)
record_p = _primitive(
    "integrate_recorded", _record_program, lambda *a, problem: problem.record_jaxpr.out_avals
)
along_p = _primitive("tangent_along_steps", _along, _along_avals)
back_p = _primitive("cotangent_along_steps", _back, _back_avals)
no_transpose_p = _primitive(
    "derivative_along_steps",
    _no_transpose,
    lambda *a, function, fixed: _array_avals(
        jax.eval_shape(lambda *x: function(x[:fixed], x[fixed:]), *a)
    ),
)


# Derivatives.


def _moving(tangents: Tangents) -> Moving:
    """Which arguments have a derivative that is not zero by structure."""
    return tuple(
        k
        for k, t in enumerate(tangents)
        if not isinstance(t, ad.Zero) and jnp.issubdtype(t.dtype, jnp.floating)
    )


def _zeros(values: Leaves) -> list[ad.Zero]:
    return [ad.Zero(jax.typeof(x).to_tangent_aval()) for x in values]


def _solve_jvp(primals: Leaves, tangents: Tangents, *, problem: Problem) -> tuple[Leaves, Tangents]:
    moving = _moving(tangents)
    if not moving:
        outs = solve_p.bind(*primals, problem=problem)
        return outs, _zeros(outs)
    found = record_p.bind(*primals, problem=problem)
    record = found[-(3 + problem.num_state) :]
    outs = found[: len(found) - len(record)]
    given = [tangents[k] for k in moving]
    along = along_p.bind(*primals, *record, *given, problem=problem, moving=moving, columns=0)
    return outs, [*along, *_zeros(outs[problem.num_states :])]


ad.primitive_jvps[solve_p] = _solve_jvp


def _record_jvp(
    primals: Leaves, tangents: Tangents, *, problem: Problem
) -> tuple[Leaves, Tangents]:
    # Of second order: the states of the record move as well, and JAX follows them by itself.
    tangents = [ad.instantiate_zeros(t) for t in tangents]
    moving = [k for k, x in enumerate(primals) if jnp.issubdtype(x.dtype, jnp.floating)]

    def of(*some: Array) -> list[Array]:
        args = list(primals)
        for k, x in zip(moving, some, strict=True):
            args[k] = x
        return problem.record(*args)

    outs, d_outs = jax.jvp(
        of, tuple(primals[k] for k in moving), tuple(tangents[k] for k in moving)
    )
    return outs, [
        d if jnp.issubdtype(x.dtype, jnp.floating) else ad.Zero(jax.typeof(x).to_tangent_aval())
        for x, d in zip(outs, d_outs, strict=True)
    ]


ad.primitive_jvps[record_p] = _record_jvp


def _linear_jvp(primitive: Primitive, program: Callable[..., list[Array]]) -> None:
    """The JVP rule of a primitive that is linear in its last arguments."""

    def rule(primals: Leaves, tangents: Tangents, **params: Any) -> Any:
        problem = params["problem"]
        args, record, last = _split(problem, primals)
        d_args, d_record, d_last = _split(problem, tangents)
        outs = primitive.bind(*primals, **params)
        d_last = [ad.instantiate_zeros(t) for t in d_last]
        d_outs = primitive.bind(*args, *record, *d_last, **params)
        residuals = [*args, *record]
        moves = _moving([*d_args, *d_record])
        if moves:
            given = [[*d_args, *d_record][k] for k in moves]

            def change(fixed: Leaves, given: Leaves) -> list[Array]:
                residuals, last = fixed[: len(args) + len(record)], fixed[len(args) + len(record) :]

                def of(*some: Array) -> list[Array]:
                    every = list(residuals)
                    for k, x in zip(moves, some, strict=True):
                        every[k] = x
                    return program(*every, *last, **params)

                return jax.jvp(of, tuple(residuals[k] for k in moves), tuple(given))[1]

            fixed = [*residuals, *last]
            more = no_transpose_p.bind(*fixed, *given, function=change, fixed=len(fixed))
            d_outs = [a + b for a, b in zip(d_outs, more, strict=True)]
        return outs, d_outs

    ad.primitive_jvps[primitive] = rule


_linear_jvp(along_p, _along)
_linear_jvp(back_p, _back)


def _transpose(
    primitive: Primitive, shapes: Callable[..., Avals]
) -> Callable[..., list[Array | None]]:
    """The transpose of a primitive that is linear in its last arguments, as another one."""

    def rule(cotangents: Tangents, *values: Any, **params: Any) -> list[Any]:
        problem = params["problem"]
        args, record, last = _split(problem, values)
        outs = shapes(args, last, **params)
        cotangents = [
            jnp.zeros(s.shape, s.dtype) if type(c) is ad.Zero else c
            for c, s in zip(cotangents, outs, strict=True)
        ]
        found = primitive.bind(*args, *record, *cotangents, **params)
        return [None] * (len(args) + len(record)) + list(found)

    return rule


def _shapes_along(
    args: Leaves,
    last: Sequence[ad.UndefinedPrimal],
    *,
    problem: Problem,
    moving: Moving,
    columns: int,
) -> Avals:
    avals = [x.aval for x in last]
    return _with_columns(problem.outcome_avals[: problem.num_states], avals, columns)


def _shapes_back(
    args: Leaves,
    last: Sequence[ad.UndefinedPrimal],
    *,
    problem: Problem,
    moving: Moving,
    columns: int,
) -> Avals:
    avals = [x.aval for x in last]
    return _with_columns([jax.typeof(args[k]) for k in moving], avals, columns)


ad.primitive_transposes[along_p] = _transpose(back_p, _shapes_along)
ad.primitive_transposes[back_p] = _transpose(along_p, _shapes_back)


def _refuse_transpose(cotangents: Tangents, *values: Any, **params: Any) -> list[Any]:
    del cotangents, values, params
    raise InputError(REVERSE_OF_DERIVATIVE)


def _no_transpose_jvp(
    primals: Leaves, tangents: Tangents, *, function: Derivative, fixed: int
) -> tuple[Leaves, Leaves]:
    tangents = [ad.instantiate_zeros(t) for t in tangents]
    moving = [k for k, x in enumerate(primals) if jnp.issubdtype(x.dtype, jnp.floating)]

    def of(*some: Array) -> list[Array]:
        every = list(primals)
        for k, x in zip(moving, some, strict=True):
            every[k] = x
        return function(every[:fixed], every[fixed:])

    return jax.jvp(of, tuple(primals[k] for k in moving), tuple(tangents[k] for k in moving))


def _no_transpose_batch(values: Leaves, dims: Dims, *, function: Derivative, fixed: int) -> Batched:
    outs = jax.vmap(lambda *x: function(x[:fixed], x[fixed:]), in_axes=tuple(dims))(*values)
    return outs, [0] * len(outs)


ad.primitive_transposes[no_transpose_p] = _refuse_transpose
ad.primitive_jvps[no_transpose_p] = _no_transpose_jvp
batching.primitive_batchers[no_transpose_p] = _no_transpose_batch


# Mapped runs.


def _size(values: Leaves, dims: Dims) -> int:
    return next(x.shape[d] for x, d in zip(values, dims, strict=True) if d is not None)


def _solve_batch(values: Leaves, dims: Dims, *, problem: Problem) -> Batched:
    size = _size(values, dims)
    mapped = add_run_axis(problem.parts, values, dims, size, flags=None)
    if mapped is None:
        axes = tuple(dims)
        outs = jax.vmap(lambda *a: problem.solve(*a), in_axes=axes)(*values)
        return outs, [0] * len(outs)

    def block(parts: Parts) -> list[Array]:
        inner, args = Problem.of(*parts)
        return solve_p.bind(*args, problem=inner)

    ranks = [x.ndim for x in problem.outcome_avals]
    outs = over_blocks(block, mapped, size, ranks)
    return outs, [x.ndim - 1 for x in outs]


def _record_batch(values: Leaves, dims: Dims, *, problem: Problem) -> Batched:
    outs, out_dims = _solve_batch(values, dims, problem=problem)
    # The record of a mapped run is computed where it is used: nothing reads this one.
    empty = [jnp.zeros(x.shape, x.dtype) for x in problem.record_avals]
    return [*outs, *empty], [*out_dims, *[None] * len(empty)]


def _columns_first(values: Leaves, dims: Dims, size: int) -> list[Array]:
    """The arrays with the mapped axis first, where they have none a new one."""
    return [
        jnp.moveaxis(x, d, 0) if d is not None else jnp.broadcast_to(x, (size, *x.shape))
        for x, d in zip(values, dims, strict=True)
    ]


def _linear_batch(primitive: Primitive, program: str) -> None:
    """The batching rule of `along` or of `back`."""

    def rule(
        values: Leaves, dims: Dims, *, problem: Problem, moving: Moving, columns: int
    ) -> Batched:
        args, record, last = _split(problem, values)
        arg_dims, _, last_dims = _split(problem, dims)
        size = _size(values, dims)
        static = dict(problem=problem, moving=moving)
        num_results = problem.num_states if primitive is along_p else len(moving)
        if not any(d is not None for d in arg_dims):
            # Several tangents of one run, as in a Jacobian.
            last = _columns_first(last, last_dims, size)
            outs = primitive.bind(*args, *record, *last, **static, columns=columns + 1)
            return outs, [0] * len(outs)
        # Every run has its own derivative with respect to what moves.
        flags = [k in moving for k in range(len(args))]
        mapped = add_run_axis(problem.parts, args, arg_dims, size, flags=flags)
        if mapped is None:
            axes = (*arg_dims, *last_dims)

            def one(*x: Array) -> list[Array]:
                args, last = x[: len(arg_dims)], x[len(arg_dims) :]
                found = problem.record(*args)[-(3 + problem.num_state) :]
                run = getattr(problem, program)
                return _columns(lambda t: run(args, found, moving, t), columns)(list(last))

            outs = jax.vmap(one, in_axes=axes)(*args, *last)
            return outs, [0] * len(outs)
        last = [
            jnp.moveaxis(x, d, -1)
            if d is not None
            else jnp.broadcast_to(x[..., None], (*x.shape, size))
            for x, d in zip(last, last_dims, strict=True)
        ]

        def block(parts: Parts, last: Leaves) -> list[Array]:
            inner, args = Problem.of(*parts)
            found = record_p.bind(*args, problem=inner)[-(3 + inner.num_state) :]
            return primitive.bind(
                *args, *found, *last, problem=inner, moving=moving, columns=columns
            )

        # Every result carries the runs already.
        outs = over_blocks(block, mapped, size, [-1] * num_results, last)
        return outs, [x.ndim - 1 for x in outs]

    batching.primitive_batchers[primitive] = rule


batching.primitive_batchers[solve_p] = _solve_batch
batching.primitive_batchers[record_p] = _record_batch
_linear_batch(along_p, "forward")
_linear_batch(back_p, "backward")


def solve(field: PyTree, y0: State, settings: LoopSettings) -> Outcome:
    """Integrate `field` from `y0`, differentiable in both modes with respect to either.

    **Arguments**

    - `field`: a `ScaledVectorField`, or its hoisted form.
    - `y0`: the initial state, components first and runs last.
    - `settings`: method, step control, save times; without derivatives.

    **Returns** the `Outcome`."""
    settings = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, settings
    )
    problem, args = Problem.of(field, y0, settings)
    leaves = solve_p.bind(*args, problem=problem)
    asked = settings.record_steps or settings.dense
    shape = (y0, 0, 0, 0, 0, 0 if asked else None, y0 if settings.dense else None)
    return Outcome(*jax.tree.unflatten(jax.tree.structure(shape), leaves))

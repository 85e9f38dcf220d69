"""The JAX primitives of an integration: their programs, the shapes of their results, and the rules
by which JAX differentiates and transposes them.

The rules are registered with JAX when this file is imported.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive, jaxpr_as_fun  # pyright: ignore
from jax.interpreters import ad, mlir
from jaxtyping import Array, ArrayLike

from ..core import InputError
from ._problem import Avals, Leaves, Moving, Problem

Program: TypeAlias = Callable[..., list[Array]]
# JAX marks a derivative that is zero by structure, and not only by value.
Tangents: TypeAlias = Sequence[Array | ad.Zero]
# In a transpose, the arguments in which the primitive is linear have shapes and no values.
Unknown: TypeAlias = ArrayLike | ad.UndefinedPrimal
Transposed: TypeAlias = Callable[..., list[Array | None]]

REVERSE_OF_DERIVATIVE = (
    "Reverse mode of a derivative of a run is not available: take jax.jacfwd(jax.grad(f)), which "
    "is jax.hessian(f), or jax.jacfwd(jax.jacfwd(f))."
)


def map_columns(function: Program, columns: int) -> Program:
    """The function of a list, mapped over leading axes of its arrays."""
    for _ in range(columns):
        function = jax.vmap(function)
    return function


# The four programs as functions of all arguments, with static parameters.


def _solve(*args: Array, problem: Problem) -> list[Array]:
    return jaxpr_as_fun(problem.solve_jaxpr)(*args)


def _record(*args: Array, problem: Problem, moving: Moving) -> list[Array]:
    return jaxpr_as_fun(problem.record_jaxpr(moving))(*args)


def along(*values: Array, problem: Problem, moving: Moving, columns: int) -> list[Array]:
    """The tangents of the saved states, for tangents with `columns` as their leading axes."""
    args, record, tangents = problem.split(values)
    function = map_columns(lambda t: problem.forward(args, record, moving, t), columns)
    return function(tangents)


def back(*values: Array, problem: Problem, moving: Moving, columns: int) -> list[Array]:
    """The cotangents of the arguments that move, for cotangents with leading axes."""
    args, record, cotangents = problem.split(values)
    function = map_columns(lambda c: problem.backward(args, record, moving, c), columns)
    return function(cotangents)


def _derivative(*values: Array, function: Program, shapes: Avals) -> list[Array]:
    del shapes
    return function(*values)


def _primitive(name: str, function: Program, shapes: Callable[..., Avals]) -> Primitive:
    primitive = Primitive(name)
    primitive.multiple_results = True
    primitive.def_impl(function)
    primitive.def_abstract_eval(shapes)
    mlir.register_lowering(primitive, mlir.lower_fun(function, multiple_results=True))
    return primitive


def _with_columns(shapes: Avals, values: Avals, columns: int) -> Avals:
    """The shapes behind the leading axes of the `values`."""
    lead = values[0].shape[:columns] if columns else ()
    return [ShapedArray((*lead, *x.shape), x.dtype) for x in shapes]


def _along_avals(*values: ShapedArray, problem: Problem, moving: Moving, columns: int) -> Avals:
    """The shapes of the results of `along`."""
    _, _, tangents = problem.split(values)
    return _with_columns(problem.outcome_avals[: problem.num_states], tangents, columns)


def _back_avals(*values: ShapedArray, problem: Problem, moving: Moving, columns: int) -> Avals:
    """The shapes of the results of `back`."""
    args, _, cotangents = problem.split(values)
    return _with_columns([args[k] for k in moving], cotangents, columns)


def _derivative_avals(*values: ShapedArray, function: Program, shapes: Avals) -> Avals:
    # Those of the program that is differentiated: traced for them, it would be traced twice.
    del function
    return _with_columns(shapes, values, 0)


solve_p = _primitive("integrate", _solve, lambda *a, problem: problem.solve_jaxpr.out_avals)
record_p = _primitive(
    "integrate_recorded",
    _record,
    lambda *a, problem, moving: problem.record_jaxpr(moving).out_avals,
)
along_p = _primitive("tangent_along_steps", along, _along_avals)
back_p = _primitive("cotangent_along_steps", back, _back_avals)
# A separate primitive only so that its transpose can be refused with a helpful sentence.
derivative_p = _primitive("derivative_along_steps", _derivative, _derivative_avals)


def _moving(tangents: Tangents) -> Moving:
    """Numbers of the arguments whose derivative is not zero by structure."""
    return tuple(
        k
        for k, t in enumerate(tangents)
        if not isinstance(t, ad.Zero) and jnp.issubdtype(t.dtype, jnp.floating)
    )


def _zeros(values: Leaves) -> list[ad.Zero]:
    return [ad.Zero(jax.typeof(x).to_tangent_aval()) for x in values]


def _jvp_in(
    function: Program, values: Leaves, moving: Sequence[int], tangents: Leaves
) -> tuple[list[Array], list[Array]]:
    """`function(*values)`, and its tangent for the `tangents` of those values that have one."""

    def of(*some: Array) -> list[Array]:
        every = list(values)
        for k, x in zip(moving, some, strict=True):
            every[k] = x
        return function(*every)

    return jax.jvp(of, tuple(values[k] for k in moving), tuple(tangents))


def _solve_jvp(primals: Leaves, tangents: Tangents, *, problem: Problem) -> tuple[Leaves, Tangents]:
    # JAX does not ask for a derivative that is zero.
    moving = _moving(tangents)
    outs, record = problem.split_record(record_p.bind(*primals, problem=problem, moving=moving))
    given = [tangents[k] for k in moving]
    along = along_p.bind(*primals, *record, *given, problem=problem, moving=moving, columns=0)
    return outs, [*along, *_zeros(outs[problem.num_states :])]


def _record_jvp(
    primals: Leaves, tangents: Tangents, *, problem: Problem, moving: Moving
) -> tuple[Leaves, Tangents]:
    # Second-order rule: the recorded states move as well. The run is a small part of the work, but
    # written out most of the program.
    values = problem.solve(*primals, recorded=True, small=True, moving=moving)
    moving = _moving(tangents)
    outs, record = problem.split_record(values)
    given = [ad.instantiate_zeros(tangents[k]) for k in moving]
    *saved, numbers = problem.forward(primals, record, moving, given, recorded=True)
    rest = _zeros(outs[problem.num_states :])
    return values, [*saved, *rest, numbers, *_zeros(record[1:])]


def _linear_jvp(primitive: Primitive, program: Program) -> Callable[..., tuple[Leaves, Tangents]]:
    """The JVP rule of a primitive that is linear in its last arguments."""

    def rule(primals: Leaves, tangents: Tangents, **params: Any) -> tuple[Leaves, Tangents]:
        args, record, last = params["problem"].split(primals)
        d_args, d_record, d_last = params["problem"].split(tangents)
        outs = primitive.bind(*primals, **params)
        d_outs: Tangents = _zeros(outs)
        # Not for the fixed cotangents of a Hessian: it would be a program that computes zeros.
        if not all(isinstance(t, ad.Zero) for t in d_last):
            whole = [ad.instantiate_zeros(t) for t in d_last]
            d_outs = primitive.bind(*args, *record, *whole, **params)
        # A derivative of the derivative, by the arguments in which the primitive is not linear.
        moves = _moving([*d_args, *d_record])
        if moves:
            given = [[*d_args, *d_record][k] for k in moves]

            def change(*values: Array) -> list[Array]:
                fixed, given = values[: len(primals)], values[len(primals) :]
                return _jvp_in(lambda *x: program(*x, **params), fixed, moves, given)[1]

            shapes = tuple(map(jax.typeof, outs))
            more = derivative_p.bind(*primals, *given, function=change, shapes=shapes)
            d_outs = [ad.add_tangents(a, b) for a, b in zip(d_outs, more, strict=True)]
        return outs, d_outs

    return rule


def _transpose(primitive: Primitive, shapes: Callable[..., Avals]) -> Transposed:
    """The transpose, another `primitive`, of one that is linear in its last arguments.

    `shapes` are those of the results of the one that is transposed."""

    def aval(x: Unknown) -> ShapedArray:
        return x.aval if isinstance(x, ad.UndefinedPrimal) else jax.typeof(x)

    def rule(cotangents: Tangents, *values: Unknown, **params: Any) -> list[Array | None]:
        args, record, _ = params["problem"].split(values)
        cotangents = [
            jnp.zeros(s.shape, s.dtype) if type(c) is ad.Zero else c
            for c, s in zip(cotangents, shapes(*map(aval, values), **params), strict=True)
        ]
        result = primitive.bind(*args, *record, *cotangents, **params)
        return [*[None] * (len(args) + len(record)), *result]

    return rule


def _derivative_jvp(
    primals: Leaves, tangents: Tangents, *, function: Program, shapes: Avals
) -> tuple[Leaves, Leaves]:
    """By JAX's own rules."""
    del shapes
    # Counters have no derivative that `jax.jvp` would take.
    moving = [k for k, x in enumerate(primals) if jnp.issubdtype(x.dtype, jnp.floating)]
    given = [ad.instantiate_zeros(tangents[k]) for k in moving]
    return _jvp_in(function, primals, moving, given)


def _refuse_transpose(cotangents: Tangents, *values: Unknown, **params: Any) -> list[Array | None]:
    del cotangents, values, params
    raise InputError(REVERSE_OF_DERIVATIVE)


ad.primitive_jvps[solve_p] = _solve_jvp
ad.primitive_jvps[record_p] = _record_jvp
ad.primitive_jvps[along_p] = _linear_jvp(along_p, along)
ad.primitive_jvps[back_p] = _linear_jvp(back_p, back)
ad.primitive_jvps[derivative_p] = _derivative_jvp
ad.primitive_transposes[along_p] = _transpose(back_p, _along_avals)
ad.primitive_transposes[back_p] = _transpose(along_p, _back_avals)
ad.primitive_transposes[derivative_p] = _refuse_transpose

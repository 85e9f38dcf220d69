"""The JAX primitives of an integration: their programs, and the shapes of their results."""

from collections.abc import Callable
from typing import TypeAlias

import jax
from jax.core import ShapedArray
from jax.extend.core import Primitive, jaxpr_as_fun  # pyright: ignore
from jax.interpreters import mlir
from jaxtyping import Array

from ._problem import Avals, Moving, Problem

Program: TypeAlias = Callable[..., list[Array]]


def map_columns(function: Program, columns: int) -> Program:
    """The function of a list, mapped over leading axes of its arrays."""
    for _ in range(columns):
        function = jax.vmap(function)
    return function


# The four programs as functions of all arguments, with static parameters.


def _solve(*args: Array, problem: Problem) -> list[Array]:
    return jaxpr_as_fun(problem.solve_jaxpr)(*args)


def _record(*args: Array, problem: Problem) -> list[Array]:
    return jaxpr_as_fun(problem.record_jaxpr)(*args)


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


def along_avals(*values: ShapedArray, problem: Problem, moving: Moving, columns: int) -> Avals:
    """The shapes of the results of `along`."""
    _, _, tangents = problem.split(values)
    return _with_columns(problem.outcome_avals[: problem.num_states], tangents, columns)


def back_avals(*values: ShapedArray, problem: Problem, moving: Moving, columns: int) -> Avals:
    """The shapes of the results of `back`."""
    args, _, cotangents = problem.split(values)
    return _with_columns([args[k] for k in moving], cotangents, columns)


def _derivative_avals(*values: ShapedArray, function: Program, shapes: Avals) -> Avals:
    # Those of the program that is differentiated: traced for them, it would be traced twice.
    del function
    return _with_columns(shapes, values, 0)


solve_p = _primitive("integrate", _solve, lambda *a, problem: problem.solve_jaxpr.out_avals)
record_p = _primitive(
    "integrate_recorded", _record, lambda *a, problem: problem.record_jaxpr.out_avals
)
along_p = _primitive("tangent_along_steps", along, along_avals)
back_p = _primitive("cotangent_along_steps", back, back_avals)
# A separate primitive only so that its transpose can be refused with a helpful sentence.
derivative_p = _primitive("derivative_along_steps", _derivative, _derivative_avals)

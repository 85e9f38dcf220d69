"""The JAX primitives of an integration: their programs, the shapes of their results, and the rules
by which JAX differentiates and transposes them.

Arguments and results are trees, by the functions of equinox for its own primitives: `None` stands
for a derivative that is zero by structure. The rules are registered with JAX when this file is
imported.
"""

import functools
from collections.abc import Callable
from typing import Protocol, TypeAlias, cast, runtime_checkable

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, mlir
from jaxtyping import PyTree

from ..core import InputError, State
from ._integration import Integration, Moving, Tangents, moving_in
from ._record import Record
from .result import Outcome

Program: TypeAlias = Callable[..., PyTree]
# Of a primitive, or a tree for each of them.
Arguments: TypeAlias = tuple[PyTree, ...]

REVERSE_OF_DERIVATIVE = (
    "Reverse mode of a derivative of a run is not available: take jax.jacfwd(jax.grad(f)), which "
    "is jax.hessian(f), or jax.jacfwd(jax.jacfwd(f))."
)
bind = eqxi.filter_primitive_bind


@runtime_checkable
class Traced(Protocol):
    """The traced program of a run, with the shapes of its results."""

    out_struct: PyTree

    def __call__(self, run: Integration) -> tuple[Outcome, Record | None]: ...


def traced(run: Integration, moving: Moving | None = None) -> Traced:
    """Trace a run; one that is differentiated, by what is `moving`."""
    program = eqx.filter_closure_convert(functools.partial(Integration.run, moving=moving), run)
    return cast(Traced, program)


def _solved(run: Integration, program: Traced) -> Outcome:
    """The outcome of a run, by its traced program."""
    return jax.tree.map(jnp.asarray, program(run)[0])


def _recorded(run: Integration, moving: Moving, program: Traced) -> tuple[Outcome, Record]:
    """The outcome and the record of a run, by its traced program."""
    # A result that is known is a number in a traced program.
    return jax.tree.map(jnp.asarray, program(run))


def map_columns(function: Program, columns: int) -> Program:
    """The function of a tree, mapped over leading axes of its arrays."""
    for _ in range(columns):
        function = jax.vmap(function)
    return function


def tangent(run: Integration, record: Record, given: Tangents, columns: int) -> State:
    """The tangents of the saved states, for tangents with `columns` as their leading axes."""
    return map_columns(lambda given: run.forward(record, given)[0], columns)(given)


def cotangent(
    run: Integration, record: Record, cotangents: State, columns: int, moving: Moving
) -> Tangents:
    """The cotangents of the arrays that move, for cotangents with leading axes."""
    return map_columns(lambda c: run.backward(record, moving, c), columns)(cotangents)


def _tangent_shapes(run: Integration, record: Record, given: PyTree, columns: int) -> PyTree:
    save_ts = run.settings.save_ts
    rows = 1 if save_ts is None else save_ts.shape[0]
    lead = jax.tree.leaves(given)[0].shape[:columns]
    return jax.tree.map(lambda x: ShapedArray((*lead, rows, *x.shape), x.dtype), run.y0)


def _cotangent_shapes(
    run: Integration, record: Record, cotangents: PyTree, columns: int, moving: Moving
) -> PyTree:
    lead = jax.tree.leaves(cotangents)[0].shape[:columns]
    of = eqx.filter((run.field, run.y0), moving)
    return jax.tree.map(lambda x: ShapedArray((*lead, *x.shape), x.dtype), of)


def _derivative(function: Program, values: PyTree, given: PyTree, like: PyTree) -> PyTree:
    return function(values, given)


def _shaped(struct: PyTree) -> PyTree:
    return jax.tree.map(lambda x: ShapedArray(x.shape, x.dtype), struct)


def _primitive(name: str, program: Program, shapes: Program) -> Primitive:
    primitive = Primitive(name)
    primitive.multiple_results = True
    function = eqxi.filter_primitive_def(program)
    primitive.def_impl(function)
    primitive.def_abstract_eval(eqxi.filter_primitive_def(shapes))
    mlir.register_lowering(primitive, mlir.lower_fun(function, multiple_results=True))
    return primitive


solve_p = _primitive("integrate", _solved, lambda _, program: _shaped(program.out_struct[0]))
record_p = _primitive(
    "integrate_recorded", _recorded, lambda run, moving, program: _shaped(program.out_struct)
)
tangent_p = _primitive("tangent_along_steps", tangent, _tangent_shapes)
cotangent_p = _primitive("cotangent_along_steps", cotangent, _cotangent_shapes)
# A separate primitive only so that its transpose can be refused with a helpful sentence.
derivative_p = _primitive("derivative_along_steps", _derivative, lambda f, v, g, like: like)


def _none(tree: PyTree) -> PyTree:
    """The tangents of a tree that has none."""
    return jax.tree.map(lambda _: None, tree)


def _jvp_of(function: Program, values: PyTree, given: PyTree) -> tuple[PyTree, PyTree]:
    """`function(values)`, and its tangent for those that are `given`."""
    moving, fixed = eqx.partition(values, moving_in(values, given))
    return jax.jvp(lambda moving: function(eqx.combine(moving, fixed)), (moving,), (given,))


def _tangents_of(run: Integration, tangents: PyTree) -> tuple[Tangents, Moving]:
    """The tangents of field and initial state, and which arrays have one."""
    # Those of the settings are zero, and counters have none.
    given = eqx.filter((tangents.field, tangents.y0), eqx.is_inexact_array)
    return given, moving_in((run.field, run.y0), given)


@eqxi.filter_primitive_jvp
def _solve_jvp(primals: Arguments, tangents: Arguments) -> tuple[Outcome, Outcome]:
    run, _ = primals
    given, moving = _tangents_of(run, tangents[0])
    outcome, record = bind(record_p, run, moving, traced(run, moving))
    states = bind(tangent_p, run, record, given, 0)
    return outcome, _none(outcome)._replace(states=states)


@eqxi.filter_primitive_jvp
def _record_jvp(primals: Arguments, tangents: Arguments) -> tuple[PyTree, PyTree]:
    # Second-order rule: the recorded states move as well. The run is a small part of the work, but
    # written out most of the program.
    run, moving, _ = primals
    outcome, record = run.run(moving, small=True)
    given, _ = _tangents_of(run, tangents[0])
    states, numbers = run.forward(record, given, recorded=True)
    d_record = eqx.tree_at(lambda r: r.numbers, _none(record), numbers, is_leaf=lambda x: x is None)
    return (outcome, record), (_none(outcome)._replace(states=states), d_record)


def _linear_jvp(primitive: Primitive, program: Program) -> Program:
    """The JVP rule of a primitive that is linear in its third argument."""

    @eqxi.filter_primitive_jvp
    def rule(primals: Arguments, tangents: Arguments) -> tuple[PyTree, PyTree]:
        run, record, last, *rest = primals
        outs = bind(primitive, *primals)
        d_outs = None
        # Not for the fixed cotangents of a Hessian: it would be a program that computes zeros.
        if jax.tree.leaves(tangents[2]):
            whole = jax.tree.map(eqxi.materialise_zeros, last, tangents[2])
            d_outs = bind(primitive, run, record, whole, *rest)
        # A derivative of the derivative, by the arguments in which the primitive is not linear.
        given = eqx.filter(tuple(tangents[:2]), eqx.is_inexact_array)
        if jax.tree.leaves(given):

            def change(values: PyTree, given: PyTree) -> PyTree:
                fixed, last = values
                return _jvp_of(lambda fixed: program(*fixed, last, *rest), fixed, given)[1]

            like = jax.tree.map(jax.typeof, outs)
            more = bind(derivative_p, change, ((run, record), last), given, like)
            d_outs = more if d_outs is None else jax.tree.map(jnp.add, d_outs, more)
        return outs, _none(outs) if d_outs is None else d_outs

    return rule


@eqxi.filter_primitive_jvp
def _derivative_jvp(primals: Arguments, tangents: Arguments) -> tuple[PyTree, PyTree]:
    """By JAX's own rules."""
    function, values, given, _ = primals
    # Counters have no derivative that `jax.jvp` would take.
    moves = eqx.filter(tuple(tangents[1:3]), eqx.is_inexact_array)
    return _jvp_of(lambda x: function(*x), (values, given), moves)


def _tangent_transpose(inputs: Arguments, cotangents: State) -> PyTree:
    run, record, given, columns = inputs
    moving = moving_in((run.field, run.y0), given)
    pulled = bind(cotangent_p, run, record, cotangents, columns, moving)
    return _none(run), _none(record), pulled, None


def _cotangent_transpose(inputs: Arguments, cotangents: Tangents) -> PyTree:
    run, record, _, columns, moving = inputs
    given = bind(tangent_p, run, record, cotangents, columns)
    return _none(run), _none(record), given, None, _none(moving)


def _refuse_transpose(inputs: Arguments, cotangents: PyTree) -> PyTree:
    raise InputError(REVERSE_OF_DERIVATIVE)


ad.primitive_jvps[solve_p] = _solve_jvp
ad.primitive_jvps[record_p] = _record_jvp
ad.primitive_jvps[tangent_p] = _linear_jvp(tangent_p, tangent)
ad.primitive_jvps[cotangent_p] = _linear_jvp(cotangent_p, cotangent)
ad.primitive_jvps[derivative_p] = _derivative_jvp
for primitive, transpose in (
    (tangent_p, _tangent_transpose),
    (cotangent_p, _cotangent_transpose),
    (derivative_p, _refuse_transpose),
):
    ad.primitive_transposes[primitive] = eqxi.filter_primitive_transpose(
        transpose, materialise_zeros=True
    )

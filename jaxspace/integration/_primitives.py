"""The JAX primitives of an integration: their programs, the shapes of their results, and the rules
by which JAX differentiates and transposes them.

Arguments and results are pytrees, using the functions of equinox for its primitives: `None` means a
structurally zero derivative. The rules are registered with JAX when this file is imported.
"""

from collections.abc import Callable
from typing import Protocol, TypeAlias, cast, runtime_checkable

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, mlir
from jaxtyping import Array, PyTree

from ..core import InputError, State
from ._integration import Moving, Tangents, moving_in
from ._mapped_integration import AnyIntegration, MappedIntegration
from ._record import Record
from .result import Outcome

Program: TypeAlias = Callable[..., PyTree]
# Of a primitive, or a tree for each of them.
Arguments: TypeAlias = tuple[PyTree, ...]

REVERSE_OF_DERIVATIVE = (
    "Reverse mode of a second derivative of a run is not available: use jax.jacfwd."
)
bind = eqxi.filter_primitive_bind


@runtime_checkable
class Traced(Protocol):
    """The traced program of a run, with the shapes of its results."""

    out_struct: PyTree

    def __call__(self, run: AnyIntegration) -> tuple[Outcome, Record | None]: ...


def traced(run: AnyIntegration, moving: Moving | None = None) -> Traced:
    """Trace a run; one that is differentiated, by what is `moving`."""
    program = eqx.filter_closure_convert(lambda run: run.run(moving), run)
    return cast(Traced, program)


def _solved(run: AnyIntegration, program: Traced) -> Outcome:
    """The outcome of a run, by its traced program."""
    return jax.tree.map(jnp.asarray, program(run)[0])


def _recorded(run: AnyIntegration, moving: Moving, program: Traced) -> tuple[Outcome, Record]:
    """The outcome and the record of a run, by its traced program."""
    # A result that is known is a number in a traced program.
    return jax.tree.map(jnp.asarray, program(run))


def map_columns(function: Program, columns: int) -> Program:
    """The function of a tree, mapped over leading axes of its arrays."""
    for _ in range(columns):
        function = jax.vmap(function)
    return function


def tangent(run: AnyIntegration, record: Record, given: Tangents, columns: int) -> State:
    """The tangents of the saved states, for tangents with `columns` as their leading axes."""
    return map_columns(lambda given: run.forward(record, given)[0], columns)(given)


def cotangent(
    run: AnyIntegration, record: Record, cotangents: State, columns: int, moving: Moving
) -> Tangents:
    """The cotangents of the arrays that move, for cotangents with leading axes."""
    return map_columns(lambda c: run.backward(record, moving, c), columns)(cotangents)


def _tangent_shapes(run: AnyIntegration, record: Record, given: PyTree, columns: int) -> PyTree:
    lead = jax.tree.leaves(given)[0].shape[:columns]
    saved = _saved_shapes(run)
    return jax.tree.map(lambda x: ShapedArray((*lead, *x.shape), x.dtype), saved)


def _saved_shapes(run: AnyIntegration) -> PyTree:
    """The shapes of the saved states."""
    if isinstance(run, MappedIntegration):
        lead, of = run.size, _saved_shapes(run.one)
    else:
        save_ts, of = run.settings.save_ts, run.y0
        lead = 1 if save_ts is None else save_ts.shape[0]
    return jax.tree.map(lambda x: jax.ShapeDtypeStruct((lead, *x.shape), x.dtype), of)


def _cotangent_shapes(
    run: AnyIntegration, record: Record, cotangents: PyTree, columns: int, moving: Moving
) -> PyTree:
    lead = jax.tree.leaves(cotangents)[0].shape[:columns]
    of = eqx.filter((run.field, run.y0), moving)
    return jax.tree.map(lambda x: ShapedArray((*lead, *x.shape), x.dtype), of)


def _derivative(
    function: Program, values: PyTree, given: PyTree, like: Program, back: Program | None
) -> PyTree:
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
# `function(values, given)`, linear in what is `given`, with results of the shapes `like()`. It is a
# primitive for its transpose, `back(values, given, cotangents)`; without one it is rejected.
derivative_p = _primitive("derivative_along_steps", _derivative, lambda f, v, g, like, back: like())


def _none(tree: PyTree) -> PyTree:
    """The tangents of a tree that has none."""
    return jax.tree.map(lambda _: None, tree)


def _zeros_of(tree: PyTree) -> PyTree:
    """Cotangents of zero for the linear inputs of a transpose, and none for others."""

    def leaf(x: ad.UndefinedPrimal | Array) -> Array | None:
        return jnp.zeros(x.aval.shape, x.aval.dtype) if ad.is_undefined_primal(x) else None

    return jax.tree.map(leaf, tree, is_leaf=ad.is_undefined_primal)


def _jvp_of(function: Program, values: PyTree, given: PyTree) -> tuple[PyTree, PyTree]:
    """`function(values)`, and its tangent for those that are `given`."""
    moving, fixed = eqx.partition(values, moving_in(values, given))
    return jax.jvp(lambda moving: function(eqx.combine(moving, fixed)), (moving,), (given,))


def _tangents_of(run: AnyIntegration, tangents: PyTree) -> tuple[Tangents, Moving]:
    """The tangents of field and initial state, and which arrays have one."""
    # Derivatives of the settings are zero, and counters have none.
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
    outcome, record = run.run(moving, rolled=True)
    given, moves = _tangents_of(run, tangents[0])

    def change(values: PyTree, given: PyTree) -> PyTree:
        run, record = values
        return run.forward(record, given, recorded=True)

    def back(values: PyTree, given: PyTree, cotangents: PyTree) -> PyTree:
        # Not by the numbers of the record: see `_hessian_product`.
        del given
        return bind(cotangent_p, *values, cotangents[0], 0, moves)

    shapes = (_tangent_shapes(run, record, given, 0), jax.typeof(record.numbers))
    states, numbers = bind(derivative_p, change, (run, record), given, lambda: shapes, back)
    d_record = eqx.tree_at(lambda r: r.numbers, _none(record), numbers, is_leaf=lambda x: x is None)
    return (outcome, record), (_none(outcome)._replace(states=states), d_record)


def _hessian_product(
    fixed: tuple[AnyIntegration, Record],
    direction: Tangents,
    cotangents: State,
    columns: int,
    moving: Moving,
) -> Tangents:
    """The cotangents of the arrays that are `moving`, from the derivative of `cotangent` along a
    `direction`, with the record as a function of the run.

        d/de cotangent(p + e a, y*) = d/dp (y* . tangent(p, a))

    This is the transpose of the derivatives of both: second derivatives are symmetric. It includes
    the contribution of the tangents of the record, which therefore have no cotangents."""
    run, record = fixed

    def one(direction: Tangents, cotangents: State) -> Tangents:
        _, numbers = run.forward(record, direction, recorded=True)
        d_record = eqx.tree_at(
            lambda r: r.numbers, _none(record), numbers, is_leaf=lambda x: x is None
        )
        given = (run.with_tangents(direction), d_record)
        return _jvp_of(lambda x: cotangent(x[0], x[1], cotangents, 0, moving), fixed, given)[1]

    every = map_columns(lambda pair: one(*pair), columns)((direction, cotangents))
    return jax.tree.map(lambda x: jnp.sum(x, tuple(range(columns))), every)


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

            def back(values: PyTree, given: PyTree, ends: PyTree) -> PyTree:
                fixed, last = values
                of_run, of_record = given
                # A tangent is paired with cotangents, and cotangents with a tangent.
                pair = (last, ends) if primitive is tangent_p else (ends, last)
                moves = moving_in((run.field, run.y0), (of_run.field, of_run.y0))
                result = _hessian_product(fixed, *pair, rest[0], moves)
                return run.with_tangents(result), _zeros_of(of_record)

            shapes = jax.tree.map(jax.typeof, outs)
            more = bind(derivative_p, change, ((run, record), last), given, lambda: shapes, back)
            d_outs = more if d_outs is None else jax.tree.map(jnp.add, d_outs, more)
        return outs, _none(outs) if d_outs is None else d_outs

    return rule


@eqxi.filter_primitive_jvp
def _derivative_jvp(primals: Arguments, tangents: Arguments) -> tuple[PyTree, PyTree]:
    """Using the rules of JAX."""
    function, *values, like, _ = primals
    # Counters have no derivative that `jax.jvp` would take.
    moves = eqx.filter(tuple(tangents[1:3]), eqx.is_inexact_array)

    def change(values: PyTree, given: PyTree) -> PyTree:
        return _jvp_of(lambda x: function(*x), values, given)[1]

    outs = bind(derivative_p, *primals)
    return outs, bind(derivative_p, change, tuple(values), moves, like, None)


def _tangent_transpose(inputs: Arguments, cotangents: State) -> PyTree:
    run, record, given, columns = inputs
    moving = moving_in((run.field, run.y0), given)
    pulled = bind(cotangent_p, run, record, cotangents, columns, moving)
    return _none(run), _none(record), pulled, None


def _cotangent_transpose(inputs: Arguments, cotangents: Tangents) -> PyTree:
    run, record, _, columns, moving = inputs
    given = bind(tangent_p, run, record, cotangents, columns)
    return _none(run), _none(record), given, None, _none(moving)


def _derivative_transpose(inputs: Arguments, cotangents: PyTree) -> PyTree:
    _, values, given, _, back = inputs
    if back is None:
        raise InputError(REVERSE_OF_DERIVATIVE)
    return None, _none(values), back(values, given, cotangents), None, None


def _registered(transpose: Program) -> Program:
    """The rule as JAX calls it."""
    rule = eqxi.filter_primitive_transpose(transpose, materialise_zeros=True)

    def of_arrays(cotangents: PyTree, *inputs: PyTree, **params: object) -> PyTree:
        # A known number may be a literal, which equinox does not take for an array.
        known = (x if ad.is_undefined_primal(x) else jnp.asarray(x) for x in inputs)
        return rule(cotangents, *known, **params)

    return of_arrays


ad.primitive_jvps[solve_p] = _solve_jvp
ad.primitive_jvps[record_p] = _record_jvp
ad.primitive_jvps[tangent_p] = _linear_jvp(tangent_p, tangent)
ad.primitive_jvps[cotangent_p] = _linear_jvp(cotangent_p, cotangent)
ad.primitive_jvps[derivative_p] = _derivative_jvp
for primitive, transpose in (
    (tangent_p, _tangent_transpose),
    (cotangent_p, _cotangent_transpose),
    (derivative_p, _derivative_transpose),
):
    ad.primitive_transposes[primitive] = _registered(transpose)

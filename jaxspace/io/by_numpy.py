"""Operations that are carried out once, by NumPy.

Outside of `jit`, JAX compiles a program for each operation and each shape. Compilation takes a
thousand times as long as the operation: reading a file or printing the table of a run would wait
for some hundred of them.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Trace, eval_context
from jax.extend.core import Jaxpr, Literal, Primitive, set_current_trace
from jax.extend.core.primitives import convert_element_type_p
from jax.typing import ArrayLike
from numpy.typing import DTypeLike

from ..core.stored import evaluates_operations

Params: TypeAlias = dict[str, Any]
Rule: TypeAlias = Callable[..., Any]
# Whole numbers of Python or of NumPy.
Indices: TypeAlias = Sequence[Any]
# An array of NumPy, or one of its numbers, which it makes of an array without axes: both have the
# methods that are used here, with other types.
Known: TypeAlias = Any


@contextlib.contextmanager
def by_numpy() -> Iterator[None]:
    """A context in which operations on known arrays are computed by NumPy, without a compiler.

    Operations without a NumPy rule, such as loops, are compiled as usual, as are functions under
    `jit` that contain one. Inside of a function that is traced nothing changes. Results agree with
    those of JAX within their rounding.

    For code that runs once: repeated code is faster when compiled."""
    with set_current_trace(_TRACE):
        yield


class _NumPyTrace(Trace):
    """Evaluates each operation at once, as the trace of JAX itself does."""

    def stage_value(self, val: ArrayLike, /) -> jax.Array:
        with eval_context():
            return val if isinstance(val, jax.Array) else jax.device_put(val)

    def process_primitive(
        self, primitive: Primitive, tracers: Sequence[ArrayLike], params: Params, /
    ) -> Any:
        with eval_context():
            if not (_has_rule(primitive, params) and all(map(_is_plain, tracers))):
                return primitive.bind(*tracers, **params)
            # Both sides of a `where` are computed, of which one may not exist.
            with np.errstate(all="ignore"):
                result = _result(primitive, [np.asarray(x) for x in tracers], params)
            if primitive.name in CALLS:
                weak = [getattr(x.aval, "weak_type", False) for x in _called(params)[0].outvars]
                return list(map(_array, result, weak))
            is_weak = bool(tracers) and all(getattr(x, "weak_type", True) for x in tracers)
            is_weak = params.get("weak_type", is_weak)
            return jax.tree.map(lambda x: _array(x, is_weak), result)

    def process_custom_jvp_call(self, primitive, fun, jvp, tracers, /, **options):
        del primitive, jvp, options
        with set_current_trace(self):
            return fun.call_wrapped(*tracers)

    def process_custom_vjp_call(self, primitive, fun, fwd, bwd, tracers, /, **options):
        del primitive, fwd, bwd, options
        with set_current_trace(self):
            return fun.call_wrapped(*tracers)


# A single one, because programs that are traced within it are cached by it.
_TRACE = _NumPyTrace()
evaluates_operations(_TRACE)


def _is_plain(x: ArrayLike) -> bool:
    """Whether NumPy can represent it, unlike a random key."""
    return not jnp.issubdtype(getattr(x, "dtype", float), jax.dtypes.extended)


def _array(x: Known, weak: bool) -> jax.Array:
    """The array of JAX, of a weak type if it shall be."""
    if not weak or x.dtype.kind == "b":
        return jax.device_put(x)
    if x.ndim == 0:
        return jax.device_put(x.item())
    return convert_element_type_p.bind(x, new_dtype=x.dtype, weak_type=True, sharding=None)


def _called(params: Params) -> tuple[Jaxpr, Sequence[ArrayLike]]:
    """The function that a call calls, and its constants."""
    inner = params["jaxpr"] if "jaxpr" in params else params["call_jaxpr"]
    # A checkpointed function has no constants.
    return getattr(inner, "jaxpr", inner), getattr(inner, "consts", ())


def _has_rule(primitive: Primitive, params: Params) -> bool:
    if primitive.name in ALONE:
        # The loop of an integration belongs to a program, unlike one of a few sums.
        return "jaxpr" not in params or _has_rules(_called(params)[0])
    if primitive.name not in CALLS:
        return primitive.name in RULES
    jaxpr, constants = _called(params)
    return _has_rules(jaxpr) and all(map(_is_plain, constants))


@functools.lru_cache(maxsize=4096)
def _has_rules(jaxpr: Jaxpr) -> bool:
    return all(_has_rule(one.primitive, one.params) for one in jaxpr.eqns)


def _result(primitive: Primitive, args: Sequence[Known], params: Params) -> Known:
    """The result of an operation: an array, or a list where it has several."""
    if primitive.name in ALONE:
        return jax.tree.map(np.asarray, primitive.bind(*args, **params))
    if primitive.name not in CALLS:
        return RULES[primitive.name](*args, **params)
    jaxpr, constants = _called(params)
    inputs = [*map(np.asarray, constants), *args]
    values = dict(zip([*jaxpr.constvars, *jaxpr.invars], inputs, strict=True))

    def value(x: Any) -> Known:
        return (
            np.asarray(x.val, getattr(x.aval, "dtype", None))
            if isinstance(x, Literal)
            else values[x]
        )

    for one in jaxpr.eqns:
        result = _result(one.primitive, [value(x) for x in one.invars], one.params)
        results = result if one.primitive.multiple_results else [result]
        values |= zip(one.outvars, results, strict=True)
    return [value(x) for x in jaxpr.outvars]


def _with_params(function: Callable[..., object]) -> Rule:
    """The rule of an operation whose parameters do not affect its values."""
    return lambda *args, **params: function(*args)


def _integer_pow(x: Known, *, y: int, **params: object) -> Known:
    return x**y


def _div(x: Known, y: Known, **params: object) -> Known:
    # That of whole numbers rounds towards zero.
    return x / y if x.dtype.kind in "fc" else (x - np.fmod(x, y)) // y


def _round(x: Known, *, rounding_method: int, **params: object) -> Known:
    if int(rounding_method):
        return np.round(x)
    whole = np.trunc(x)
    return whole + np.copysign(np.abs(x - whole) >= 0.5, x)


def _select_n(which: Known, *cases: Known, **params: object) -> Known:
    result = cases[0]
    for k, case in enumerate(cases[1:], 1):
        result = np.where(which == k, case, result)
    return result


def _convert(x: Known, *, new_dtype: DTypeLike, **params: object) -> Known:
    return x.astype(new_dtype)


def _broadcast(
    x: Known, *, shape: Indices, broadcast_dimensions: Indices, **params: object
) -> Known:
    whole = [1] * len(shape)
    for size, axis in zip(x.shape, broadcast_dimensions, strict=True):
        whole[axis] = size
    return np.broadcast_to(x.reshape(whole), shape)


def _iota(*, dtype: DTypeLike, shape: Indices, dimension: int, **params: object) -> Known:
    row = np.arange(shape[dimension], dtype=dtype)
    return _broadcast(row, shape=shape, broadcast_dimensions=(dimension,))


def _slice(
    x: Known,
    *,
    start_indices: Indices,
    limit_indices: Indices,
    strides: Indices | None,
    **params: object,
) -> Known:
    return x[tuple(map(slice, start_indices, limit_indices, strides or (1,) * x.ndim))]


def _dynamic_slice(x: Known, *starts: Known, slice_sizes: Indices, **params: object) -> Known:
    # A start too far out is moved inwards.
    firsts = map(np.clip, starts, [0] * x.ndim, np.subtract(x.shape, slice_sizes))
    return x[tuple(slice(k, k + size) for k, size in zip(firsts, slice_sizes, strict=True))]


def _reduction(function: Callable[..., Known]) -> Rule:
    def rule(x: Known, *, axes: Indices, **params: object) -> Known:
        return function(x, axis=tuple(axes)).astype(x.dtype)

    return rule


def _argument(function: Callable[..., Known]) -> Rule:
    def rule(x: Known, *, axes: Indices, index_dtype: DTypeLike, **params: object) -> Known:
        return function(x, axis=axes[0]).astype(index_dtype)

    return rule


# Operations without a rule that are compiled by themselves, where the enclosing function is
# computed by NumPy.
ALONE = {"scan", "gather", "scatter", "sort", "dot_general"}
# By the names that jaxprs show, because not every version of JAX has all of them.
CALLS = {
    "jit", "pjit", "closed_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat2",
}  # fmt: skip
RULES: dict[str, Rule] = {
    **{name: _with_params(getattr(np, name)) for name in (
        "abs", "acos", "acosh", "add", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "ceil",
        "cos", "cosh", "exp", "exp2", "expm1", "floor", "log", "log1p", "nextafter", "sign", "sin",
        "sinh", "sqrt", "square", "tan", "tanh",
    )},
    **{name: _with_params(function) for name, function in {
        "add_any": np.add, "sub": np.subtract, "mul": np.multiply, "neg": np.negative,
        "rem": np.fmod, "max": np.maximum, "min": np.minimum, "is_finite": np.isfinite,
        "eq": np.equal, "ne": np.not_equal, "lt": np.less, "le": np.less_equal, "gt": np.greater,
        "ge": np.greater_equal, "and": np.bitwise_and, "or": np.bitwise_or,
        "xor": np.bitwise_xor, "not": np.invert, "shift_right_arithmetic": np.right_shift,
        "pow": lambda x, y: np.power(x, y).astype(x.dtype), "rsqrt": lambda x: 1.0 / np.sqrt(x),
        "clamp": lambda low, x, high: np.minimum(np.maximum(x, low), high),
        "copy": np.asarray, "stage": np.asarray,
    }.items()},
    "integer_pow": _integer_pow,
    "div": _div,
    "round": _round,
    "select_n": _select_n,
    "convert_element_type": _convert,
    "bitcast_convert_type": lambda x, *, new_dtype, **params: x.view(new_dtype),
    "broadcast_in_dim": _broadcast,
    "iota": _iota,
    "reshape": lambda x, *, new_sizes, **params: np.reshape(x, new_sizes),
    "squeeze": lambda x, *, dimensions, **params: np.squeeze(x, tuple(dimensions)),
    "transpose": lambda x, *, permutation, **params: np.transpose(x, permutation),
    "rev": lambda x, *, dimensions, **params: np.flip(x, dimensions),
    "concatenate": lambda *xs, dimension, **params: np.concatenate(xs, dimension),
    "stack": lambda *xs, axis, **params: np.stack(xs, axis),
    "unstack": lambda x, *, axis, **params: [*np.moveaxis(x, axis, 0)],
    "split": lambda x, *, sizes, axis, **params: np.split(x, np.cumsum(sizes)[:-1], axis),
    "slice": _slice,
    "dynamic_slice": _dynamic_slice,
    "reduce_sum": _reduction(np.sum),
    "reduce_prod": _reduction(np.prod),
    "reduce_max": _reduction(np.max),
    "reduce_min": _reduction(np.min),
    "reduce_and": _reduction(np.all),
    "reduce_or": _reduction(np.any),
    "argmax": _argument(np.argmax),
    "argmin": _argument(np.argmin),
    "square_root": _with_params(np.sqrt),
    "inverse_sqrt": lambda x, *, power: (1.0 / np.sqrt(x)) ** power,
    "barrier": lambda *xs, **params: [*xs],
}  # fmt: skip

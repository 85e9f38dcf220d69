"""A jaxpr evaluated by NumPy, in its own precision and without a compiler: for many functions that
are evaluated once each.

Numbers below the normal ones become zero, as XLA on a CPU makes them."""

import operator

import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

TINY = {np.dtype(kind): np.finfo(kind).tiny for kind in (np.float32, np.float64)}


def evaluate(closed, args):
    """The outputs of a closed jaxpr for such arrays."""
    with np.errstate(all="ignore"):
        return _run(closed.jaxpr, closed.consts, [np.asarray(x) for x in args])


def _flushed(x):
    x = np.asarray(x)
    tiny = TINY.get(x.dtype)
    return x if tiny is None else np.where(np.abs(x) < tiny, x.dtype.type(0), x)


def _run(jaxpr, consts, args):
    values = {}

    def read(atom):
        return np.asarray(atom.val, atom.aval.dtype) if isinstance(atom, Literal) else values[atom]

    values.update(zip(jaxpr.constvars, map(np.asarray, consts), strict=True))
    values.update(zip(jaxpr.invars, args, strict=True))
    for equation in jaxpr.eqns:
        found = _apply(equation, [read(atom) for atom in equation.invars])
        values.update(zip(equation.outvars, found, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _apply(equation, args):
    name, params = equation.primitive.name, equation.params
    if name in ELEMENTWISE:
        # NumPy raises a power of a float32 to a whole number in float64.
        found = ELEMENTWISE[name](*args)
        return [_flushed(found.astype(equation.outvars[0].aval.dtype, copy=False))]
    if name in SPECIAL:
        return [_flushed(x) for x in SPECIAL[name](equation, *args)]
    root = getattr(params.get("_prim"), "solve_jaxpr", None)
    if root is not None:
        # A root with a rule for its derivatives: its iteration comes first.
        return _run(root.jaxpr, root.consts, args[: len(root.jaxpr.invars)])
    keys = "call_jaxpr", "jaxpr", "fun_jaxpr", "call"
    inner = next((params[key] for key in keys if params.get(key) is not None), None)
    if inner is not None:
        closed = hasattr(inner, "consts")
        return _run(inner.jaxpr if closed else inner, inner.consts if closed else (), args)
    # The others by JAX, one at a time.
    found = equation.primitive.bind(*map(jnp.asarray, args), **params)
    found = found if equation.primitive.multiple_results else [found]
    return [np.asarray(x) for x in found]


def _divide(a, b):
    if np.issubdtype(a.dtype, np.inexact):
        return np.divide(a, b)
    return np.trunc(np.divide(a, b)).astype(a.dtype)


ELEMENTWISE = {
    "add": np.add,
    "add_any": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": _divide,
    "rem": np.fmod,
    "neg": np.negative,
    "abs": np.abs,
    "sign": np.sign,
    "max": np.maximum,
    "min": np.minimum,
    "sqrt": np.sqrt,
    "square_root": np.sqrt,
    "rsqrt": lambda x: 1 / np.sqrt(x),
    "square": np.square,
    "cbrt": np.cbrt,
    "exp": np.exp,
    "expm1": np.expm1,
    "log": np.log,
    "log1p": np.log1p,
    "exp2": np.exp2,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "asinh": np.arcsinh,
    "acosh": np.arccosh,
    "atanh": np.arctanh,
    "pow": np.power,
    "floor": np.floor,
    "ceil": np.ceil,
    "is_finite": np.isfinite,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "and": operator.and_,
    "or": operator.or_,
    "not": operator.invert,
    "stop_gradient": lambda x: x,
    "copy": lambda x: x,
}


def _broadcast(equation, x, *_):
    shape = equation.outvars[0].aval.shape
    view = [1] * len(shape)
    for size, place in zip(x.shape, equation.params["broadcast_dimensions"], strict=True):
        view[place] = size
    return [np.broadcast_to(x.reshape(view), shape)]


def _select(equation, which, *cases):
    del equation
    if which.ndim == 0:
        return [cases[int(which)]]
    return [np.choose(which.astype(int), cases)]


def _while(equation, *args):
    params = equation.params
    cond, body = params["cond_jaxpr"], params["body_jaxpr"]
    held, kept = params["cond_nconsts"], params["body_nconsts"]
    for_cond, for_body, carry = args[:held], args[held : held + kept], list(args[held + kept :])
    while np.all(_run(cond.jaxpr, cond.consts, [*for_cond, *carry])[0]):
        carry = _run(body.jaxpr, body.consts, [*for_body, *carry])
    return carry


def _scan(equation, *args):
    params = equation.params
    inner, length = params["jaxpr"], params["length"]
    if "num_consts" in params:
        held, carried = params["num_consts"], params["num_carry"]
    else:
        # Since JAX 0.11.
        held, carried = (len(part) for part in params["ft_in"].unpack()[:2])
    consts, carry, rows = args[:held], list(args[held : held + carried]), args[held + carried :]
    saved = {}
    for k in range(length)[::-1] if params["reverse"] else range(length):
        found = _run(inner.jaxpr, inner.consts, [*consts, *carry, *(x[k] for x in rows)])
        carry, saved[k] = found[:carried], found[carried:]
    count = len(equation.outvars) - carried
    return [*carry, *(np.stack([saved[k][i] for k in range(length)]) for i in range(count))]


def _cond(equation, index, *args):
    branches = equation.params["branches"]
    branch = branches[int(np.clip(index, 0, len(branches) - 1))]
    return _run(branch.jaxpr, branch.consts, args)


def _reduce(function):
    return lambda equation, x: [function(x, axis=tuple(equation.params["axes"]))]


def _integer_pow(equation, x):
    power = equation.params["y"]
    found = np.ones_like(x)
    for _ in range(abs(power)):
        found = _flushed(found * x)
    return [found if power >= 0 else 1 / found]


def _inverse_sqrt(equation, x):
    found = root = 1 / np.sqrt(x)
    for _ in range(equation.params["power"] - 1):
        found = _flushed(found * root)
    return [found]


def _dot_general(equation, a, b):
    (over_a, over_b), (along_a, along_b) = equation.params["dimension_numbers"]
    of_a = list(range(a.ndim))
    of_b = [a.ndim + k for k in range(b.ndim)]
    for x, y in [*zip(over_a, over_b, strict=True), *zip(along_a, along_b, strict=True)]:
        of_b[y] = of_a[x]
    free = [k for k in range(a.ndim) if k not in (*over_a, *along_a)]
    others = [of_b[k] for k in range(b.ndim) if k not in (*over_b, *along_b)]
    return [np.einsum(a, of_a, b, of_b, [*along_a, *free, *others])]


def _slice(equation, x):
    params = equation.params
    strides = params["strides"] or (1,) * x.ndim
    ends = zip(params["start_indices"], params["limit_indices"], strides, strict=True)
    return [x[tuple(slice(*three) for three in ends)]]


def _shaped(equation, x, *_):
    return [x.reshape(equation.outvars[0].aval.shape)]


def _same(equation, *args):
    del equation
    return list(args)


SPECIAL = {
    "broadcast_in_dim": _broadcast,
    "select_n": _select,
    "while": _while,
    "scan": _scan,
    "cond": _cond,
    "reduce_sum": _reduce(np.sum),
    "reduce_prod": _reduce(np.prod),
    "reduce_max": _reduce(np.max),
    "reduce_min": _reduce(np.min),
    "reduce_or": _reduce(np.any),
    "reduce_and": _reduce(np.all),
    "integer_pow": _integer_pow,
    "inverse_sqrt": _inverse_sqrt,
    "dot_general": _dot_general,
    "slice": _slice,
    "reshape": _shaped,
    "squeeze": _shaped,
    "expand_dims": _shaped,
    "barrier": _same,
    "optimization_barrier": _same,
    "clamp": lambda _, low, x, high: [np.minimum(np.maximum(x, low), high)],
    "transpose": lambda equation, x: [np.transpose(x, equation.params["permutation"])],
    "concatenate": lambda equation, *x: [np.concatenate(x, axis=equation.params["dimension"])],
    "split": lambda equation, x: np.split(
        x, np.cumsum(equation.params["sizes"])[:-1], axis=equation.params["axis"]
    ),
    "convert_element_type": lambda equation, x: [x.astype(equation.params["new_dtype"])],
}

"""Any of our functions in mpmath: an interpreter of its jaxpr, with numbers of any precision.

What it sees: every rounding, cancellation and overflow of the formulas. What it cannot see: the
truncation of a series, a quadrature or a fixed number of iterations, which it repeats, and a
constant that is wrong. For these there are the twins of `twins.py`."""

import operator

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal
from mpmath import mp, mpf


def evaluate(closed, inputs):
    """The outputs of a closed jaxpr, as arrays of numbers of mpmath, for such inputs."""
    return _run(closed.jaxpr, closed.consts, [_exact(x) for x in inputs])


def traced(function, example):
    """The jaxpr of a function of one array."""
    return jax.make_jaxpr(function)(jnp.asarray(example))


def _exact(x):
    """An array whose floating-point numbers are those of mpmath, exactly."""
    x = np.asarray(x)
    if x.dtype == object:
        return x
    if jnp.issubdtype(x.dtype, jnp.floating):
        out = np.empty(x.shape, object)
        out[...] = np.vectorize(mpf, otypes=[object])(x) if x.size else x
        return out
    return x


def _run(jaxpr, consts, args):
    values = {}

    def read(atom):
        return _exact(atom.val) if isinstance(atom, Literal) else values[atom]

    values.update(zip(jaxpr.constvars, map(_exact, consts), strict=True))
    values.update(zip(jaxpr.invars, args, strict=True))
    for equation in jaxpr.eqns:
        found = _apply(equation, [read(atom) for atom in equation.invars])
        values.update(zip(equation.outvars, found, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _apply(equation, args):
    name, params = equation.primitive.name, equation.params
    if name in ELEMENTWISE:
        return [_elementwise(ELEMENTWISE[name], *args)]
    if name in SPECIAL:
        return SPECIAL[name](params, *args)
    if params.get("name") in NAMED:
        return [_elementwise(function, *args) for function in NAMED[params["name"]]]
    if params.get("name") == "expm":
        # Truncated for the precision of the machine.
        return [_expm(*args)]
    if params.get("name") == "solve":
        return [_solve(*args)]
    root = getattr(params.get("_prim"), "solve_jaxpr", None)
    if root is not None:
        # A root with a rule for its derivatives: its iteration comes first.
        return _run(root.jaxpr, root.consts, args[: len(root.jaxpr.invars)])
    if type(params.get("_prim")).__name__ == "SearchSorted":
        return [_place_in(*args, params["_prim"])]
    names = "call_jaxpr", "jaxpr", "fun_jaxpr", "call"
    inner = next((params[key] for key in names if params.get(key) is not None), None)
    if inner is not None:
        closed = hasattr(inner, "consts")
        return _run(inner.jaxpr if closed else inner, inner.consts if closed else (), args)
    return _moved(equation, args)


def _elementwise(function, *args):
    shapes = {np.shape(x) for x in args}
    shape = np.broadcast_shapes(*shapes)
    if len(shapes) > 1:
        args = [np.broadcast_to(x, shape) for x in args]
    flat = [np.reshape(x, -1) for x in args]
    found = [function(*numbers) for numbers in zip(*flat, strict=True)]
    kind = object if not found or isinstance(found[0], mpf) else None
    out = np.empty(len(found), kind or type(found[0]))
    out[:] = found
    return out.reshape(shape)


def _place_in(ascending, x, search):
    """How many of the `ascending` numbers are below each `x`, or not above it."""
    assert search.dimension == 0 and search.batch_dims == 0
    steps = np.reshape(ascending, (-1, *(1,) * np.ndim(x)))
    below = steps <= x if search.side == "right" else steps < x
    return np.sum(np.asarray(below, bool), axis=0).astype(search.out_aval.dtype)


def _unstack(params, x):
    return [np.asarray(part) for part in np.moveaxis(np.asarray(x), params["axis"], 0)]


def _moved(equation, args):
    """A primitive that only moves numbers: done on positions in a list of all arguments."""
    args = [np.asarray(x) for x in args]
    moves = [x.dtype == object or x.dtype == bool for x in args]
    if not any(moves):
        return [np.asarray(x) for x in _bind(equation, [jnp.asarray(x) for x in args])]
    if equation.primitive.name not in MOVES:
        raise NotImplementedError(f"mp_trace does not know {equation.primitive.name}.")
    numbers = [x.reshape(-1) for x, move in zip(args, moves, strict=True) if move]
    numbers = numbers[0] if len(numbers) == 1 else np.concatenate(numbers)
    if id(equation) in PLACES:
        return [numbers[x] for x in PLACES[id(equation)]]
    positions, count = [], 0
    for atom, x, move in zip(equation.invars, args, moves, strict=True):
        if move:
            positions.append(jnp.asarray(count + np.arange(x.size).reshape(x.shape)))
            count += x.size
        else:
            # An index.
            positions.append(jnp.asarray(x, atom.aval.dtype))
    places = [np.asarray(x) for x in _bind(equation, positions)]
    if all(moves):
        # The equation is kept, so that no other one takes its number.
        PLACES[id(equation)] = places
        KEPT.append(equation)
    return [numbers[x] for x in places]


PLACES, KEPT = {}, []


def _bind(equation, args):
    found = equation.primitive.bind(*args, **equation.params)
    return found if equation.primitive.multiple_results else [found]


def _finite(x):
    return mp.isfinite(x)


def _divide(a, b):
    if not isinstance(a, mpf):
        return int(a) // int(b)
    if b == 0:
        return mp.nan if a == 0 or mp.isnan(a) else mp.inf * mp.sign(a)
    return a / b


def _root(x):
    return mp.nan if mp.isnan(x) or x < 0 else mp.sqrt(x)


def _log(x):
    if mp.isnan(x) or x < 0:
        return mp.nan
    return mp.log(x) if x else -mp.inf


def _power(x, y):
    if x == 0 and y < 0:
        return mp.inf
    found = x**y
    return found if isinstance(found, mpf) else mp.nan


def _number(x, y, better):
    """The greater or the smaller, and what is no number where one is."""
    if isinstance(x, mpf) and (mp.isnan(x) or mp.isnan(y)):
        return mp.nan
    return x if better(x, y) else y


def _inverse(function):
    return lambda x: function(x) if abs(x) <= 1 else mp.nan


def _round(x):
    return mp.nint(x) if mp.isfinite(x) else x


ELEMENTWISE = {
    "add": operator.add,
    "add_any": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": _divide,
    "rem": operator.mod,
    "neg": operator.neg,
    "abs": abs,
    "sign": lambda x: mp.sign(x) if isinstance(x, mpf) else int(np.sign(x)),
    "max": lambda x, y: _number(x, y, operator.ge),
    "min": lambda x, y: _number(x, y, operator.le),
    "sqrt": _root,
    "square_root": _root,
    "rsqrt": lambda x: _divide(mpf(1), _root(x)),
    "square": lambda x: x * x,
    "cbrt": lambda x: mp.sign(x) * mp.cbrt(abs(x)),
    "exp": mp.exp,
    "expm1": mp.expm1,
    "log": _log,
    "log1p": lambda x: _log(1 + x),
    "log2": lambda x: _log(x) / mp.log(2),
    "exp2": lambda x: mpf(2) ** x,
    "sin": mp.sin,
    "cos": mp.cos,
    "tan": mp.tan,
    "asin": _inverse(mp.asin),
    "acos": _inverse(mp.acos),
    "atan": mp.atan,
    "atan2": mp.atan2,
    "sinh": mp.sinh,
    "cosh": mp.cosh,
    "tanh": mp.tanh,
    "asinh": mp.asinh,
    "atanh": lambda x: mp.atanh(x) if abs(x) < 1 else mp.nan,
    "pow": _power,
    "floor": mp.floor,
    "ceil": mp.ceil,
    "round": _round,
    "is_finite": _finite,
    "lt": lambda x, y: bool(x < y),
    "le": lambda x, y: bool(x <= y),
    "gt": lambda x, y: bool(x > y),
    "ge": lambda x, y: bool(x >= y),
    "eq": lambda x, y: bool(x == y),
    "ne": lambda x, y: bool(x != y),
    "and": lambda x, y: x & y,
    "or": lambda x, y: x | y,
    "not": lambda x: not x if isinstance(x, bool | np.bool_) else ~x,
    "stop_gradient": lambda x: x,
    "copy": lambda x: x,
    # Only of units, which any number near them is.
    "reduce_precision": lambda x: x,
}


NAMED = {
    # Numbers of mpmath have no bits to look at.
    "signbit": (lambda x: bool(x < 0),),
    # A polynomial whose coefficients are rounded.
    "sinc": (mp.sincpi,),
    # Polynomials of the floor, whose truncation is seen so.
    "_sincos": (mp.sin, mp.cos),
    "_atan2": (mp.atan2,),
}
# What only moves numbers.
MOVES = set(
    """broadcast_in_dim concatenate dynamic_slice dynamic_update_slice expand_dims gather iota
    pad reshape rev scatter select_and_gather_add slice split squeeze stack tile
    transpose""".split()
)


def _while(params, *args):
    cond, body = params["cond_jaxpr"], params["body_jaxpr"]
    held, kept = params["cond_nconsts"], params["body_nconsts"]
    for_cond, for_body, carry = args[:held], args[held : held + kept], list(args[held + kept :])
    while bool(_run(cond.jaxpr, cond.consts, [*for_cond, *carry])[0]):
        carry = _run(body.jaxpr, body.consts, [*for_body, *carry])
    return carry


def _scan(params, *args):
    inner, length = params["jaxpr"], params["length"]
    if "num_consts" in params:
        held, carried = params["num_consts"], params["num_carry"]
    else:
        # Since JAX 0.11.
        held, carried = (len(part) for part in params["ft_in"].unpack()[:2])
    consts, carry, rows = args[:held], list(args[held : held + carried]), args[held + carried :]
    order = range(length)[::-1] if params["reverse"] else range(length)
    saved = {}
    for k in order:
        found = _run(inner.jaxpr, inner.consts, [*consts, *carry, *(x[k] for x in rows)])
        carry, saved[k] = found[:carried], found[carried:]
    stacked = [np.stack([saved[k][i] for k in range(length)]) for i in range(len(saved.get(0, ())))]
    return [*carry, *stacked]


def _cond(params, index, *args):
    branch = params["branches"][int(index)]
    return _run(branch.jaxpr, branch.consts, args)


def _select(params, which, *cases):
    del params
    return [_elementwise(lambda k, *x: x[int(k)], which, *cases)]


def _reduce(function, start):
    def reduced(params, x):
        axes = tuple(params["axes"])
        flat = np.moveaxis(np.asarray(x), axes, range(len(axes)))
        shape = flat.shape[len(axes) :]
        total = _elementwise(lambda *_: start, np.zeros(shape, bool))
        for part in flat.reshape(-1, *shape):
            total = _elementwise(function, total, part)
        return [total]

    return reduced


def _convert(params, x):
    kind = params["new_dtype"]
    if jnp.issubdtype(kind, jnp.floating):
        return [x if np.asarray(x).dtype == object else _exact(np.asarray(x, float))]
    return [np.asarray(_elementwise(int, x)).astype(kind)]


def _sort(params, *args):
    order = np.argsort(np.asarray(args[0]), axis=params["dimension"], kind="stable")
    return [np.take_along_axis(np.asarray(x), order, axis=params["dimension"]) for x in args]


def _dot_general(params, a, b):
    summed, batch = params["dimension_numbers"]
    both = []
    for x, over, along in zip((np.asarray(a), np.asarray(b)), summed, batch, strict=True):
        free = [k for k in range(x.ndim) if k not in (*over, *along)]
        order = x.transpose(*along, *free, *over)
        sizes = [[x.shape[k] for k in axes] for axes in (along, free, over)]
        both.append((order.reshape([int(np.prod(size)) for size in sizes]), sizes))
    (left, (shared, rows, _)), (right, (_, columns, _)) = both
    product = np.matmul(left, np.swapaxes(right, 1, 2))
    return [product.reshape((*shared, *rows, *columns))]


def _eigh(params, a):
    """Of symmetric matrices one at a time; the vectors first."""
    assert np.ndim(a) == 2
    values, vectors = mp.eigsy(mp.matrix(a.tolist()))
    rows = [[vectors[i, k] for k in range(len(values))] for i in range(len(values))]
    return [np.array(rows, object), np.array(list(values), object)]


def _expm(a):
    """Of matrices on the last two axes."""
    a = np.asarray(a, object)
    found = [mp.expm(mp.matrix(m.tolist())).tolist() for m in a.reshape(-1, *a.shape[-2:])]
    return np.array(found, object).reshape(a.shape)


def _solve(a, b):
    """Of one matrix, for a vector or the columns of a matrix; no number where it is singular."""
    a, b = np.asarray(a), np.asarray(b)
    assert a.ndim == 2 and b.ndim <= 2
    columns = [mp.matrix(column.tolist()) for column in b.reshape(len(b), -1).T]
    try:
        found = [list(mp.lu_solve(mp.matrix(a.tolist()), column)) for column in columns]
    except ZeroDivisionError:
        found = [[mp.nan] * len(b) for _ in columns]
    return np.array(found, object).T.reshape(b.shape)


def _best(function):
    def found(params, x):
        return [np.asarray(function(np.asarray(x), axis=params["axes"][0]))]

    return found


SPECIAL = {
    "unstack": _unstack,
    "reduce_min": _reduce(lambda a, b: _number(a, b, operator.le), mp.inf),
    "while": _while,
    "scan": _scan,
    "cond": _cond,
    "select_n": _select,
    "integer_pow": lambda params, x: [_elementwise(lambda a: a ** params["y"], x)],
    "reduce_sum": _reduce(operator.add, mpf(0)),
    "reduce_prod": _reduce(operator.mul, mpf(1)),
    "reduce_max": _reduce(lambda a, b: _number(a, b, operator.ge), -mp.inf),
    "reduce_or": _reduce(lambda a, b: bool(a or b), False),
    "reduce_and": _reduce(lambda a, b: bool(a and b), True),
    "convert_element_type": _convert,
    "barrier": lambda params, *x: list(x),
    "inverse_sqrt": lambda params, x: [
        _elementwise(lambda a: _divide(mpf(1), _root(a)) ** params["power"], x)
    ],
    "sort": _sort,
    "cumsum": lambda params, x: [np.cumsum(x, axis=params["axis"])],
    "eigh": _eigh,
    "dot_general": _dot_general,
    "argmax": _best(np.argmax),
    "argmin": _best(np.argmin),
    "clamp": lambda params, low, x, high: [
        _elementwise(lambda a, b, c: min(max(a, b), c), low, x, high)
    ],
}

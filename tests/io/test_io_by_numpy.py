"""Operations by NumPy: the results of JAX, without a program."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend.core import subjaxprs

from jaxspace.core.barrier import barrier
from jaxspace.core.safe import end_sqrt, safe_atan2, safe_sqrt
from jaxspace.core.square_roots import inverse_sqrt, sqrt
from jaxspace.io.by_numpy import ALONE, RULES, by_numpy

X = np.array([[0.3, -1.2, 2.5], [0.9, 0.1, -0.4]])
UNIT = X / 3.0
WHOLE = np.array([7, -7, 3, -2])

FUNCTIONS = {
    "sums": lambda x: (x + x[0], x - 2.0, -x, x * x, jnp.sum(x), jnp.sum(x, 0), jnp.prod(x, 1)),
    "roots": lambda x: (jnp.sqrt(jnp.abs(x)), jnp.cbrt(x), lax.rsqrt(jnp.abs(x)), x**3, x**-2),
    "powers": lambda x: (jnp.abs(x) ** 1.7, jnp.abs(x) ** x, jnp.square(x), jnp.exp2(x)),
    "exponentials": lambda x: (jnp.exp(x), jnp.expm1(x), jnp.log(jnp.abs(x)), jnp.log1p(x * x)),
    "angles": lambda x: (jnp.sin(x), jnp.cos(x), jnp.tan(x), jnp.arctan2(x[0], x[1])),
    "their inverses": lambda x: (jnp.arcsin(x / 3.0), jnp.arccos(x / 3.0), jnp.arctan(x)),
    "hyperbolic": lambda x: (jnp.sinh(x), jnp.cosh(x), jnp.tanh(x), jnp.arcsinh(x)),
    "the inverses": lambda x: (jnp.arctanh(x / 3.0), jnp.arccosh(1.0 + x * x)),
    "whole numbers": lambda x: (jnp.floor(x), jnp.ceil(x), jnp.round(2.0 * x), jnp.sign(x)),
    "halves": lambda x: (lax.round(x - x + 2.5), lax.round(x - x - 0.5), jnp.round(x - x + 2.5)),
    "remainders": lambda x: (lax.rem(x, x[0, 0]), x % 0.7, jnp.nextafter(x, 9.0)),
    "quotients": lambda x: (lax.div(WHOLE, 2), jnp.asarray(WHOLE) // 2, x / x[1]),
    "orders": lambda x: (x < 0.5, x <= 0.3, x > 0.5, x >= 0.3, x == 0.3, x != 0.3),
    "flags": lambda x: ((x > 0) & (x < 1), (x > 2) | (x < 0), ~(x > 0), (x > 0) ^ (x > 1)),
    "extremes": lambda x: (jnp.max(x), jnp.min(x, 1), jnp.maximum(x, 0.2), jnp.minimum(x, 0.2)),
    "places": lambda x: (jnp.argmax(x), jnp.argmin(x, 1), jnp.all(x > 0), jnp.any(x > 2, 0)),
    "choices": lambda x: (jnp.where(x > 0, x, 1.0), lax.clamp(-1.0, x, 1.0), jnp.isfinite(x)),
    "cases": lambda x: lax.select_n(jnp.array([0, 2, 1]), x[0], x[1], 2.0 * x[0]),
    "shapes": lambda x: (x.T, x.reshape(3, 2), x[:, None], jnp.broadcast_to(x[0], (4, 3)), x[::-1]),
    "parts": lambda x: (x[0, 1], x[1:, ::2], jnp.split(x, 3, 1), jnp.moveaxis(x, 0, 1), [*x]),
    "wholes": lambda x: (
        jnp.stack([x, x], 1),
        jnp.concatenate([x, x[:1]]),
        lax.iota(float, 3),
        lax.broadcasted_iota(int, (2, 3), 1),
        jnp.copy(x),
    ),
    "types": lambda x: (x.astype(int), x.astype(jnp.float32), (x > 0).astype(float), jnp.eye(2)),
    "a late start": lambda x: lax.dynamic_slice(x, (1, 2), (1, 2)),
    "own functions": lambda x: (
        safe_sqrt(x * x),
        safe_atan2(x[0], x[1]),
        barrier(x),
        (sqrt(jnp.abs(x)), inverse_sqrt(jnp.abs(x), 3)),
    ),
    "at an end": lambda x: end_sqrt(lambda a: a * a, x),
    "a loop": lambda x: lax.while_loop(lambda a: a < 5.0, lambda a: 2.0 * a, x[0, 0]),
    "a sum on the way": lambda x: lax.scan(lambda a, b: (a + b, a * b), x[0], x),
    "alone": lambda x: (x[jnp.array([1, 0])], jnp.sort(x), x @ x.T, x.at[0, 1].set(5.0)),
    "a map": lambda x: jax.vmap(lambda a: jnp.sin(a) * a[0])(x),
    "slopes": lambda x: (
        jax.grad(lambda a: jnp.sum(safe_sqrt(a * a)))(x),
        jax.jvp(jnp.sin, (x,), (x,)),
    ),
    "again": lambda x: jax.checkpoint(lambda a: jnp.cos(a) * a)(x),
    "draws": lambda x: jax.random.normal(jax.random.key(1), x.shape),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_results_are_those_of_jax(name):
    function = FUNCTIONS[name]
    expected = jax.jit(function)(jnp.asarray(X))
    with by_numpy():
        # Operation by operation, and as a function that is traced first.
        found = [function(jnp.asarray(X)), jax.jit(function)(jnp.asarray(X))]
    for result in found:
        assert jax.tree.structure(result) == jax.tree.structure(expected)
        for a, b in zip(jax.tree.leaves(result), jax.tree.leaves(expected), strict=True):
            assert isinstance(a, jax.Array)
            assert (a.dtype, a.shape, a.weak_type) == (b.dtype, b.shape, b.weak_type)
            # A few roundings, of which NumPy and XLA have different ones in sines and powers, and
            # XLA of JAX 0.10 thirty in an inverse hyperbolic tangent.
            np.testing.assert_allclose(a, b, rtol=1e-14 if a.dtype == float else 4e-7, atol=1e-15)


def test_single_precision_stays():
    with by_numpy():
        x = jnp.float32(0.3)
        for y in (
            x * 2.0,
            jnp.abs(x) ** 1.7,
            lax.rsqrt(x),
            jnp.sum(x[None]),
            jnp.clip(x, 0.0, 1.0),
        ):
            assert y.dtype == jnp.float32


def names(jaxpr) -> set[str]:
    """The names of the operations of a traced function, and of those that it calls."""
    inner = map(names, subjaxprs(jaxpr))
    return {one.primitive.name for one in jaxpr.eqns}.union(*inner)


def test_every_rule_is_compared():
    traced = [names(jax.make_jaxpr(f)(jnp.asarray(X)).jaxpr) for f in FUNCTIONS.values()]
    # "stage" turns numbers of Python into arrays, outside of traced functions alone; JAX 0.10 does
    # not have "unstack".
    assert set(RULES) | ALONE <= set().union(*traced) | {"stage", "unstack"}


COMPILED = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, duration_secs, **kwargs: (
        COMPILED.append(duration_secs) if event.endswith("backend_compile_duration") else None
    )
)


def test_nothing_is_compiled_and_nothing_warned_of():
    x = jnp.asarray(X)
    COMPILED.clear()
    with by_numpy(), warnings.catch_warnings(action="error"):
        y = jnp.where(x > 0.0, jnp.log(x), 1.0 / (x - x))
    assert not COMPILED
    assert np.isfinite(y[X > 0.0]).all()

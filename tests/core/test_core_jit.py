"""A function under `jit` that costs little to call does what `equinox.filter_jit` does."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.core.jit import quick_jit


def scaled(x, factor, power, names):
    y = {name: factor * x**power for name in names}
    y["checked"] = eqx.error_if(x, x < 0.0, "x is negative")
    return y, power, names


def test_it_returns_what_the_function_returns():
    call = quick_jit(scaled)
    given = jnp.arange(3.0), np.float64(2.0), 3, ("a", "b")
    y, power, names = call(*given)
    exact, *rest = eqx.filter_jit(scaled)(*given)
    assert (power, names) == tuple(rest) and y.keys() == exact.keys()
    assert all(np.array_equal(y[name], exact[name]) for name in y)
    slope = jax.grad(lambda x: call(x, 2.0, 3, ("a",))[0]["a"])(2.0)
    assert slope == 2.0 * 3.0 * 2.0**2


def test_a_program_is_compiled_once_for_the_same_kinds_of_arguments():
    traces = []

    def counted(x, power):
        traces.append(power)
        return x**power

    call = quick_jit(counted)
    for x, power in ((1.0, 2), (2.0, 2), (3.0, 3)):
        assert call(jnp.asarray(x), power) == x**power
    assert traces == [2, 3]


def test_an_error_of_the_program_is_the_sentence_of_equinox():
    with pytest.raises(eqx.EquinoxRuntimeError, match="x is negative"):
        quick_jit(scaled)(jnp.asarray(-1.0), 2.0, 3, ())

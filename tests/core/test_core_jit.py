"""A function under `jit` that costs little to call does what `equinox.filter_jit` does."""

import gc
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.core import jit as core_jit
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


def executables():
    """The number of compiled programs in the process, without those that await the collector."""
    gc.collect()
    return len(jax.devices()[0].client.live_executables())


@pytest.mark.parametrize("kind", ["a function as argument", "a function under jit", "shapes"])
def test_a_limited_number_of_programs_is_kept(kind, monkeypatch):
    # Of each new function there would be another program for ever.
    monkeypatch.setattr(core_jit, "KEPT", 3)
    call = core_jit.quick_jit(lambda f, x: f(x))
    # Those of functions that are made for each use share their programs: here with no other test.
    monkeypatch.setattr(core_jit, "_CALLS", {})
    x = jnp.ones(())
    before = None
    for k in range(12):
        if kind == "a function as argument":
            assert call(lambda x, k=k: x + k, x) == 1.0 + k
        elif kind == "a function under jit":
            assert core_jit.compiled(lambda x, k=k: x + k)(x) == 1.0 + k
        else:
            assert call(np.sum, np.ones(k + 1)) == k + 1
        before = executables() if k == 3 else before
    assert executables() <= before + 3


def test_the_programs_called_last_are_kept(monkeypatch):
    monkeypatch.setattr(core_jit, "KEPT", 2)
    traces = []

    def counted(x, power):
        traces.append(power)
        return x**power

    call = core_jit.quick_jit(counted)
    for power in (2, 3, 2, 4, 2, 3):
        call(jnp.asarray(1.0), power)
    assert traces == [2, 3, 4, 3]


def test_functions_with_the_same_structure_share_a_program():
    traces = []

    class Scaled(eqx.Module):
        factor: jax.Array

        def __call__(self, x):
            traces.append(x)
            return self.factor * x

    for factor in (2.0, 3.0):
        assert core_jit.compiled(Scaled(jnp.asarray(factor)))(jnp.asarray(5.0)) == 5.0 * factor
    assert len(traces) == 1


def test_the_programs_of_the_package_are_those_that_are_limited():
    package = Path(core_jit.__file__).parents[1]
    users = [p.name for p in package.rglob("*.py") if "filter_jit(" in p.read_text()]
    assert users == ["jit.py"]

"""The reciprocal root: its error, its ends, its derivatives, and the form that is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

from jaxspace.core.inverse_sqrt import inverse_sqrt

POWERS = 1, 2, 3, 5
EVERY_POWER = jax.jit(lambda x: [inverse_sqrt(x, n) for n in POWERS])


def last_places(found: np.ndarray, x: np.ndarray, power: int) -> float:
    """The greatest error, in units in the last place of the value."""
    with mp.workdps(50):
        exact = [mpf(float(a)) ** (mpf(-power) / 2) for a in x]
        pairs = zip(found, exact, strict=True)
        return max(abs(float((mpf(float(f)) - e) / mpf(float(np.spacing(f))))) for f, e in pairs)


def numbers(dtype: type) -> np.ndarray:
    """Numbers between two powers of four, which repeat; few ones of every other size."""
    g = np.random.default_rng(1)
    apart = 60 if dtype == np.float64 else 7
    size = np.exp2(g.uniform(-apart, apart, 200))
    return np.concatenate([g.uniform(1.0, 4.0, 800), size]).astype(dtype)


@pytest.mark.parametrize(
    ("dtype", "bounds"),
    [
        # A root and a quotient, each rounded correctly: a half and a whole unit. A power has three
        # roundings more for each factor, of half a unit to a whole one.
        (np.float64, {1: 1.5, 2: 5.0, 3: 8.0, 5: 14.0}),
        # By the instruction of the processor and the compiler's Newton step: two units for a root.
        (np.float32, {1: 2.0, 2: 6.0, 3: 10.0, 5: 18.0}),
    ],
)
def test_error_in_last_places(dtype, bounds):
    x = numbers(dtype)
    for power, found in zip(POWERS, EVERY_POWER(x), strict=True):
        assert found.dtype == dtype
        assert last_places(np.asarray(found), x, power) <= bounds[power]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_ends_are_those_of_the_quotient(dtype):
    tiny, huge = np.finfo(dtype).tiny, np.finfo(dtype).max
    # Compiled programs treat subnormal numbers as zero.
    x = np.array([0.0, np.inf, -1.0, np.nan, 0.25 * tiny, 4.0 * tiny, 0.25 * huge], dtype)
    expected = [np.inf, 0.0, np.nan, np.nan, np.inf]
    found = np.asarray(EVERY_POWER(x)[0])
    np.testing.assert_array_equal(found[:5], np.array(expected, dtype))
    np.testing.assert_allclose(found[5:], 1.0 / np.sqrt(x[5:]), rtol=3.0 * np.finfo(dtype).eps)


def test_derivatives_of_both_modes():
    x = jnp.array([1e-3, 0.7, 9.0])
    for power in POWERS:
        n = -0.5 * power
        first = [
            jax.vmap(d(lambda x, k=power: inverse_sqrt(x, k)))(x) for d in (jax.jacfwd, jax.grad)
        ]
        second = jax.vmap(jax.grad(jax.jacfwd(lambda x, k=power: inverse_sqrt(x, k))))(x)
        # Products of a few roundings.
        for found in first:
            np.testing.assert_allclose(found, n * x ** (n - 1.0), rtol=1e-14)
        np.testing.assert_allclose(second, n * (n - 1.0) * x ** (n - 2.0), rtol=1e-14)


def test_derivatives_at_the_ends():
    ends = jnp.array([0.0, jnp.inf])
    for derivative in (jax.jacfwd, jax.grad):
        np.testing.assert_array_equal(jax.vmap(derivative(inverse_sqrt))(ends), [-jnp.inf, 0.0])


def test_whole_numbers_and_numbers_of_python():
    assert inverse_sqrt(4) == 0.5
    assert inverse_sqrt(4.0, 3) == 0.125
    # Weak, as the quotient is.
    assert (inverse_sqrt(4.0) * jnp.float32(1.0)).dtype == jnp.float32


def compiled(function, x) -> str:
    """The optimised program, which tests are otherwise compiled without."""
    options = {"xla_backend_optimization_level": 2, "xla_llvm_disable_expensive_passes": False}
    return jax.jit(function).lower(x).compile(compiler_options=options).as_text() or ""


def test_the_compiler_keeps_the_quotient():
    x = jnp.ones(8)
    if jax.default_backend() != "cpu":
        pytest.skip("the quotient is for processors")
    # What is kept away: the compiler takes its own function for a plain quotient.
    assert " rsqrt(" in compiled(lambda x: 2.0 / jnp.sqrt(x), x)
    for power in POWERS:
        assert " rsqrt(" not in compiled(lambda x, k=power: 2.0 * inverse_sqrt(x, k), x)
    assert " rsqrt(" in compiled(inverse_sqrt, x.astype(jnp.float32))


def test_other_devices_take_their_instruction():
    text = jax.jit(inverse_sqrt).trace(jnp.ones(8)).lower(lowering_platforms=("cuda",)).as_text()
    assert "stablehlo.rsqrt" in text and "divide" not in text

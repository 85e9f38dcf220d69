"""Square roots: their errors, their ends, their derivatives, and the form that is compiled."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from more_systems import MORE
from mpmath import mp, mpf
from systems import SAMPLES

from jaxspace.core import square_roots
from jaxspace.core.square_roots import inverse_sqrt, sqrt
from jaxspace.simulation import Accuracy, simulate, simulate_batch
from jaxspace.solvers import DOP853, RKN1210

POWERS = 1, 2, 3, 5
# What the compiler makes of a quotient by a root in double precision.
SLOW = re.compile(r" = f64\[\S* rsqrt\(")
on_cpu = pytest.mark.skipif(jax.default_backend() != "cpu", reason="of processors")


@pytest.fixture
def without_instruction(monkeypatch):
    """Programs as for a processor without AVX-512, whatever this one has."""
    monkeypatch.setattr(square_roots, "has_instruction", lambda: False)


@pytest.fixture(params=["a quotient", "an instruction"])
def every_power(request, monkeypatch):
    """A program of all powers in this form."""
    monkeypatch.setattr(square_roots, "has_instruction", lambda: request.param != "a quotient")
    return jax.jit(lambda x: [inverse_sqrt(x, n) for n in POWERS])


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


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_error_in_last_places(every_power, dtype):
    x = numbers(dtype)
    for power, found in zip(POWERS, every_power(x), strict=True):
        assert found.dtype == dtype
        # By the instruction and the compiler's Newton step two units for a root. A power has two
        # roundings more for each factor, of half a unit to a whole one.
        bound = 4 * power - 2
        if dtype == np.float64 and not square_roots.has_instruction():
            # A root and a quotient, each rounded correctly: a half and a whole unit.
            bound = 3 * power - 1 if power > 1 else 1.5
        assert last_places(np.asarray(found), x, power) <= bound


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_ends_are_those_of_the_quotient(every_power, dtype):
    tiny, huge = np.finfo(dtype).tiny, np.finfo(dtype).max
    # Compiled programs treat subnormal numbers as zero.
    x = np.array([0.0, np.inf, -1.0, np.nan, 0.25 * tiny, 4.0 * tiny, 0.25 * huge], dtype)
    expected = [np.inf, 0.0, np.nan, np.nan, np.inf]
    found = np.asarray(every_power(x)[0])
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
        np.testing.assert_array_equal(jax.vmap(derivative(sqrt))(ends), [jnp.inf, 0.0])


def test_the_root_is_that_of_jax():
    x = jnp.array([0.0, 1e-300, 2.0, 3e5, jnp.inf, -1.0, jnp.nan])
    np.testing.assert_array_equal(sqrt(x), jnp.sqrt(x))
    x = x[1:4]
    for order in (lambda f: f, lambda f: jax.vmap(jax.grad(f)), lambda f: jax.vmap(jax.hessian(f))):
        # A few roundings of the products.
        np.testing.assert_allclose(order(sqrt)(x), order(jnp.sqrt)(x), rtol=1e-14)


def test_whole_numbers_and_numbers_of_python():
    assert inverse_sqrt(4) == 0.5
    assert inverse_sqrt(4.0, 3) == 0.125
    # Weak, as the quotient is.
    assert (inverse_sqrt(4.0) * jnp.float32(1.0)).dtype == jnp.float32


def compiled(function, *args) -> str:
    """The optimised program."""
    return jax.jit(function).lower(*args).compile().as_text() or ""


@on_cpu
@pytest.mark.usefixtures("without_instruction")
def test_the_compiler_keeps_the_quotient():
    x = jnp.ones(8)
    # What is kept away: the compiler takes its own function for a plain quotient.
    assert SLOW.search(compiled(lambda x: 2.0 / jnp.sqrt(x), x))
    for power in POWERS:
        assert not SLOW.search(compiled(lambda x, k=power: 2.0 * inverse_sqrt(x, k), x))
    assert not SLOW.search(compiled(lambda x: x / sqrt(x + 1.0), x))
    assert not SLOW.search(compiled(lambda x: jax.vjp(sqrt, x)[1](x), x))
    single = compiled(lambda x: (x / sqrt(x + 1.0), inverse_sqrt(x)), x.astype(jnp.float32))
    assert single.count(" rsqrt(") == 2


def test_other_devices_take_their_instruction():
    trace = jax.jit(lambda x: inverse_sqrt(x) + sqrt(x)).trace(jnp.ones(8))
    text = trace.lower(lowering_platforms=("cuda",)).as_text()
    assert "stablehlo.rsqrt" in text and "divide" not in text and "abs" not in text


@on_cpu
@pytest.mark.parametrize("isa", ["SSE4_2", "AVX2"])
def test_the_compiler_can_be_told_to_do_without(monkeypatch, isa):
    monkeypatch.setenv("XLA_FLAGS", f"--xla_cpu_max_isa={isa} --xla_dump_to=")
    assert not square_roots.has_instruction.__wrapped__()


@on_cpu
def test_with_avx_512_the_compiler_has_its_way(monkeypatch):
    monkeypatch.setattr(square_roots, "has_instruction", lambda: True)
    assert SLOW.search(compiled(inverse_sqrt, jnp.ones(8)))
    assert SLOW.search(compiled(lambda x: 2.0 / sqrt(x), jnp.ones(8)))


PROGRAMS = {
    "Kepler": ("two_body", Accuracy(1e-9), 1),
    "a run": ("oblate_orbit", Accuracy(1e-9, method=DOP853()), 1),
    "a batch": ("oblate_orbit", Accuracy(1e-9, method=RKN1210()), 3),
    "a rocket": ("tabulated_rocket", Accuracy(1e-6), 1),
    "a rigid body": ("torqued_satellite", Accuracy(1e-9, method=DOP853()), 3),
}


@on_cpu
@pytest.mark.usefixtures("without_instruction")
@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_hold_no_slow_root(name):
    sample, accuracy, runs = PROGRAMS[name]
    sample = next(s for s in SAMPLES + MORE if s.name == sample)
    ts = jnp.array([0.0, sample.span])

    def end(y):
        if runs == 1:
            return simulate(sample.system, y, ts, accuracy=accuracy).final
        return simulate_batch(sample.system, y, ts, accuracy=accuracy).final

    state = sample.state
    if runs > 1:
        state = jax.tree.map(lambda x: jnp.stack([x] * runs, axis=-1), state)
    assert not SLOW.search(compiled(end, state))


@on_cpu
@pytest.mark.usefixtures("without_instruction")
@pytest.mark.sweep
def test_no_system_has_a_slow_root():
    for sample in SAMPLES + MORE:
        arrays, rest = eqx.partition(sample.system, eqx.is_array)

        def rate(arrays, y, rest=rest):
            system = eqx.combine(arrays, rest)
            return system.vector_field(0.1, y), system.invariants(0.1, y)

        assert not SLOW.search(compiled(rate, arrays, sample.state)), sample.name

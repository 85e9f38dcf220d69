"""The core: vector algebra, functions without NaN, checks of input, the interface of a system."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jaxspace import core
from jaxspace.core.text import in_words

components = st.floats(-1e3, 1e3, allow_subnormal=False)
vectors = arrays(float, 3, elements=components)
RUNS = ((), (4,), (2, 3))


def derivatives(f, x):
    """Value, first and second derivative of a scalar function at many points, and the first one by
    reverse mode again."""
    first = jax.jacfwd(f)
    return jax.jit(jax.vmap(lambda z: (f(z), first(z), jax.jacfwd(first)(z), jax.jacrev(f)(z))))(x)


@given(vectors, vectors)
def test_products_agree_with_numpy(a, b):
    # One rounding per product of numbers up to 1e3.
    np.testing.assert_allclose(
        core.vectors.dot(jnp.array(a), jnp.array(b)), a @ b, rtol=1e-14, atol=1e-9
    )
    np.testing.assert_allclose(
        core.vectors.cross(jnp.array(a), jnp.array(b)), np.cross(a, b), rtol=1e-14, atol=1e-9
    )


@pytest.mark.parametrize("runs", RUNS)
def test_runs_trail(runs, key):
    a, b = jax.random.normal(key, (2, 3, *runs))
    m = jax.random.normal(key, (3, 3, *runs)) + 3.0 * jnp.eye(3).reshape(3, 3, *(1,) * len(runs))
    np.testing.assert_allclose(core.vectors.cross(a, b), np.cross(a, b, axis=0), atol=1e-14)
    np.testing.assert_allclose(core.vectors.norm(a), np.linalg.norm(a, axis=0), rtol=1e-14)
    np.testing.assert_allclose(
        core.vectors.matvec(m, a), np.einsum("ij...,j...->i...", m, a), atol=1e-13
    )
    # The condition number of these matrices is below 1e3.
    np.testing.assert_allclose(core.vectors.matvec(m, core.vectors.solve3(m, a)), a, atol=1e-12)
    assert core.vectors.axis(1, a[0]).shape == a.shape
    np.testing.assert_allclose(core.vectors.norm(core.vectors.unit(a)), np.ones(runs), rtol=1e-15)


def test_zero_vector_has_no_nan():
    zero = jnp.zeros(3)
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_array_equal(mode(core.vectors.norm)(zero), np.zeros(3))
        assert np.isfinite(mode(core.vectors.unit)(zero)).all()
    np.testing.assert_array_equal(core.vectors.unit(zero), np.zeros(3))


def test_norm_derivative_is_the_direction():
    a = jnp.array([2.0, -3.0, 6.0])
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(mode(core.vectors.norm)(a), a / 7.0, rtol=1e-15)


def test_derivatives_of_the_direction():
    """u_i,j = P_ij / |a| with P = I - u u; u_i,jk = -(P_ij u_k + P_ik u_j + P_jk u_i) / |a|^2, and
    the second derivative of the length is the first one of the direction."""
    a = jnp.array([2.0, -3.0, 6.0])
    u = a / 7.0
    across = np.eye(3) - np.outer(u, u)
    axes = ("ij,k->ijk", "ik,j->ijk", "jk,i->ijk")
    second = -sum(np.einsum(text, across, u) for text in axes) / 49.0
    for mode in (jax.jacfwd, jax.jacrev):
        first = mode(core.vectors.unit)
        np.testing.assert_allclose(first(a), across / 7.0, rtol=1e-14)
        np.testing.assert_allclose(jax.jacfwd(mode(core.vectors.norm))(a), across / 7.0, rtol=1e-14)
        np.testing.assert_allclose(jax.jacfwd(first)(a), second, rtol=1e-13)


@pytest.mark.parametrize("power", [1, 2, 3, 5])
def test_powers_of_the_inverse_length(power):
    # d |a|^-n = -n |a|^-(n+2) a . da; |a| = 7, a few roundings.
    a = jnp.array([2.0, -3.0, 6.0])
    np.testing.assert_allclose(core.vectors.inverse_norm(a, power), 7.0**-power, rtol=1e-15)
    for mode in (jax.jacfwd, jax.jacrev):
        found = mode(lambda x: core.vectors.inverse_norm(x, power))(a)
        np.testing.assert_allclose(found, -power * a / 7.0 ** (power + 2), rtol=2e-15)
        again = jax.jacfwd(mode(lambda x: core.vectors.inverse_norm(x, power)))(a)
        second = power * ((power + 2) * np.outer(a, a) / 49.0 - np.eye(3)) / 7.0 ** (power + 2)
        np.testing.assert_allclose(again, second, atol=1e-14 * np.abs(second).max())


def test_scalar_times_vector():
    s, a, by_s, by_a = (
        jnp.array([2.0, -1.0]),
        jnp.arange(6.0).reshape(3, 2),
        jnp.array([3.0, 5.0]),
        jnp.ones((3, 2)),
    )
    np.testing.assert_array_equal(core.vectors.scale(s, a), s * a)
    np.testing.assert_array_equal(
        jax.jvp(core.vectors.scale, (s, a), (by_s, by_a))[1], by_s * a + s * by_a
    )
    np.testing.assert_array_equal(
        jax.jvp(lambda s: core.vectors.scale(s, a), (s,), (by_s,))[1], by_s * a
    )
    np.testing.assert_array_equal(
        jax.jvp(lambda a: core.vectors.scale(s, a), (a,), (by_a,))[1], s * by_a
    )
    of_s, of_a = jax.vjp(core.vectors.scale, s, a)[1](by_a)
    np.testing.assert_array_equal(of_s, a.sum(axis=0))
    np.testing.assert_array_equal(of_a, s * by_a)


def test_safe_functions_at_their_singular_points():
    for mode in (jax.jacfwd, jax.jacrev):
        assert (
            core.safe.safe_sqrt(jnp.array(0.0)) == 0.0
            and mode(core.safe.safe_sqrt)(jnp.array(0.0)) == 0.0
        )
        assert np.isfinite(mode(lambda x: core.safe.safe_divide(1.0 + x, x))(jnp.array(0.0)))
        both = mode(lambda p: core.safe.safe_atan2(p[0], p[1]))
        np.testing.assert_array_equal(both(jnp.zeros(2)), np.zeros(2))
        # d atan2(y, x) = (x dy - y dx) / r^2, here with r = 5.
        np.testing.assert_allclose(
            both(jnp.array([3.0, -4.0])), np.array([-4.0, -3.0]) / 25.0, rtol=1e-15
        )
        np.testing.assert_allclose(mode(core.safe.safe_sqrt)(jnp.array(4.0)), 0.25, rtol=1e-15)
    assert core.safe.safe_divide(jnp.array(3.0), jnp.array(0.0)) == 0.0
    assert np.isnan(core.safe.safe_sqrt(jnp.array(-1.0))), (
        "a negative square is an error of the caller: it must show"
    )
    assert core.safe.safe_atan2(jnp.array(0.0), jnp.array(-1.0)) == np.pi


@pytest.mark.parametrize("name", ["phi1", "phi2", "sinc_squared"])
def test_removable_singularities_against_many_digits(name):
    mp = pytest.importorskip("mpmath")
    closed = {
        "phi1": lambda z: mp.hyp1f1(1, 2, z),
        "phi2": lambda z: mp.hyp1f1(1, 3, z) / 2,
        "sinc_squared": lambda z: mp.hyp0f1(mp.mpf(3) / 2, -z / 4),
    }[name]
    points = [0.0, 1e-300, 1e-9, -1e-9, 1e-3, 0.0999999, -0.0999999, 0.1, -0.1, 0.5, -2.0, 10.0]
    with mp.workdps(60):
        want = np.array([[float(mp.diff(closed, mp.mpf(x), n)) for x in points] for n in range(3)])
    value, first, second, reverse = derivatives(getattr(core.safe, name), jnp.array(points))
    # An angle of three radians carries a rounding error of 1e-16; outside of the series, which ends
    # at 0.1, a closed form loses a digit per derivative.
    np.testing.assert_allclose(value, want[0], rtol=2e-15, atol=1e-16)
    np.testing.assert_allclose(first, want[1], rtol=1e-13)
    np.testing.assert_allclose(second, want[2], rtol=2e-11)
    np.testing.assert_allclose(reverse, want[1], rtol=1e-13)


@pytest.mark.parametrize("f", [core.safe.phi1, core.safe.sinc_squared, core.safe.safe_sqrt])
def test_single_precision_stays_single(f):
    assert f(jnp.array(0.3, jnp.float32)).dtype == jnp.float32


def test_as_float_keeps_weak_numbers_weak():
    assert (
        core.types.as_float(2).weak_type
        and core.types.as_float(True).weak_type
        and core.types.as_float(2.5).weak_type
    )
    assert (core.types.as_float(2) * jnp.ones(3, jnp.float32)).dtype == jnp.float32
    assert core.types.as_float([1, 2, 3]).dtype == jnp.zeros(()).dtype
    assert core.types.as_float(np.arange(3)).dtype == jnp.zeros(()).dtype
    assert core.types.as_float([[1.0, 2.0], [3.0, 4.0]]).shape == (2, 2)
    assert core.types.as_float(np.float32(1.0)).dtype == jnp.float32
    assert core.types.as_optional_float(None) is None
    placeholder = object()
    assert core.types.as_float(placeholder) is placeholder


@pytest.mark.parametrize(
    ("check", "bad", "sentence"),
    [
        (core.checks.check_positive, 0.0, "TwoBody.mu is 0: it must be positive and finite."),
        (core.checks.check_positive, -2.5, "TwoBody.mu is -2.5: it must be positive and finite."),
        (
            core.checks.check_positive,
            float("inf"),
            "TwoBody.mu is inf: it must be positive and finite.",
        ),
        (
            core.checks.check_non_negative,
            float("nan"),
            "TwoBody.mu is nan: it must be zero or positive, and finite.",
        ),
        (
            core.checks.check_finite,
            np.array([1.0, np.nan]),
            "TwoBody.mu is [ 1. nan]: it must be finite.",
        ),
    ],
)
def test_error_sentence_names_field_value_and_rule(check, bad, sentence):
    with pytest.raises(core.InputError) as error:
        check("TwoBody.mu", bad)
    assert str(error.value) == sentence


def test_checks_pass_what_is_allowed_or_unknown():
    core.checks.check_positive("x", jnp.array([1.0, 2.0]))
    core.checks.check_non_negative("x", 0.0)
    core.checks.check_finite("x", -1)
    for check in (
        core.checks.check_positive,
        core.checks.check_non_negative,
        core.checks.check_finite,
    ):
        check("x", None)
        check("x", object())
        jax.jit(lambda x, check=check: check("x", x))(-jnp.inf)
        jax.eval_shape(lambda x, check=check: check("x", x), -jnp.inf)


def test_known():
    assert (
        core.checks.is_concrete(1)
        and core.checks.is_concrete(1.0)
        and core.checks.is_concrete(jnp.ones(2))
        and core.checks.is_concrete(np.float32(1.0))
    )
    assert not core.checks.is_concrete(None) and not core.checks.is_concrete("1")


class Oscillator(core.AbstractSystem):
    """x'' = -x."""

    def vector_field(self, t, y):
        return {"x": y["v"], "v": -y["x"]}

    def invariants(self, t, y):
        return {"energy": 0.5 * (y["x"] ** 2 + y["v"] ** 2)}

    def closed_form(self):
        return OscillatorMotion()


class OscillatorMotion(core.AbstractClosedForm):
    def flow(self, duration, y):
        c, s = jnp.cos(duration), jnp.sin(duration)
        return {"x": c * y["x"] + s * y["v"], "v": c * y["v"] - s * y["x"]}


def test_a_system_has_to_answer_every_question():
    class Silent(core.AbstractSystem):
        def vector_field(self, t, y):
            return y

    with pytest.raises(TypeError, match="invariants"):
        Silent()
    assert isinstance(Oscillator(), core.AbstractSystem)


def test_a_flow_is_tangent_to_its_vector_field():
    y = {"x": jnp.array(0.3), "v": jnp.array(-1.2)}
    _, rate = jax.jvp(
        lambda d: Oscillator().closed_form().flow(d, y), (jnp.array(0.0),), (jnp.array(1.0),)
    )
    assert eqx.tree_equal(rate, Oscillator().vector_field(0.0, y), rtol=1e-15)


@pytest.mark.parametrize("everywhere", [False, True])
def test_a_barrier_beside_constants(everywhere):
    """Of its tangents one is a constant, as that of x is zero along y: in reverse mode of forward
    mode and the other way round, x^2 y^3 by y and then by both."""

    @jax.custom_jvp
    def held(x, y):
        return core.barrier.barrier((x, y), everywhere=everywhere)

    # Zeros by value, as they come out of a rule for derivatives.
    held.defjvp(lambda primals, tangents: (held(*primals), core.barrier.barrier(tangents)))

    def product(x, y):
        x, y = held(x, y)
        return x * x * y**3

    def rate(x, y):
        return jax.jvp(lambda y: product(x, y), (y,), (jnp.ones_like(y),))[1]

    x, y = jnp.array(3.0), jnp.array(2.0)
    slope = jax.grad(rate, (0, 1))(x, y)
    np.testing.assert_allclose(slope, [2.0 * 3.0 * 3.0 * 4.0, 9.0 * 6.0 * 2.0], rtol=1e-15)
    _, slope = jax.jvp(lambda y: jax.grad(product, (0, 1))(x, y), (y,), (jnp.ones_like(y),))
    np.testing.assert_allclose(slope, [2.0 * 3.0 * 3.0 * 4.0, 9.0 * 6.0 * 2.0], rtol=1e-15)
    batched = jax.vmap(rate, (None, 0))(x, jnp.array([2.0, 1.0]))
    np.testing.assert_allclose(batched, [9.0 * 12.0, 9.0 * 3.0], rtol=1e-15)
    # One barrier holds both together.
    assert jax.jit(held).lower(x, y).as_text().count("optimization_barrier") == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("apoapsis_altitude", "apoapsis altitude"),
        ("final.mass", "mass at the end"),
        ("final.position.2", "position z at the end"),
        ("final.parts.wheels.0", "parts wheels x at the end"),
        ("effects.thrust.burn_time", "effects.thrust.burn time"),
    ],
)
def test_names_of_quantities_in_words(name, words):
    assert in_words(name) == words

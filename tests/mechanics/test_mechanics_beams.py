"""Beams of two spans and assumed modes: exact roots of other formulas, conditions at the ends and
at the pin, and closed forms of Ritz's sums."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace.core import InputError
from jaxspace.mechanics.beams import assumed_modes, beam_roots, beam_shape

ENDS = ("clamped-free", "free-free", "clamped-clamped", "clamped-pinned", "pinned-pinned")


def test_two_equal_spans_on_pins():
    """Antisymmetric modes are those of one span on pins, symmetric ones those of a clamped one."""
    pinned, clamped = beam_roots("pinned-pinned", 3), beam_roots("clamped-pinned", 3)
    both = np.sort(np.concatenate([2.0 * pinned, 2.0 * clamped]))
    # Halved to the last bit, of a determinant right to its rounding.
    assert_allclose(beam_roots("pinned-pinned", 6, 0.5), both, rtol=1e-14)
    # Half of a free beam on its middle: clamped by symmetry, or the beam itself with a node there.
    halves = np.concatenate([2.0 * beam_roots("clamped-free", 2), beam_roots("free-free", 4)[1::2]])
    assert_allclose(beam_roots("free-free", 4, 0.5), np.sort(halves), rtol=1e-14)


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("pin", [0.3, 0.85])
def test_a_pin_lifts_each_root_to_that_of_the_sum_over_the_free_modes(ends, pin):
    """9.12-P7: sum phi_i(c)^2/(b_i^4 - b^4) = 0, with the rigid motions of a free beam."""
    free = beam_roots(ends, 200)
    found = beam_roots(ends, 5, pin)
    at = np.sin(free * pin) * np.sqrt(2.0)
    if ends != "pinned-pinned":
        at = np.array([beam_shape(ends, b, jnp.asarray(pin)) for b in free])
    rigid = (1.0 + 12.0 * (pin - 0.5) ** 2) * (ends == "free-free")

    def total(b):
        # The modes left out add sum 1/b_i^4, of the mean square 1: below 1e-8 of the first ones.
        return np.sum(at**2 / (free**4 - b[:, None] ** 4), axis=1) - rigid / b**4

    # Between the roots of the beam without its pin, and where the rising sum vanishes.
    lowest = np.concatenate([[0.0] * (ends == "free-free"), free])[:5]
    assert np.all(found > lowest) and np.all(
        found < np.append(lowest[1:], free[4 + (lowest[0] > 0)])
    )
    assert np.all(total(found * (1.0 - 1e-5)) < 0.0) and np.all(total(found * (1.0 + 1e-5)) > 0.0)


@pytest.mark.parametrize("ends", ENDS)
def test_the_shape_of_two_spans(ends):
    """At the pin no deflection, one slope and one moment; at the ends what they say; the equation
    of the beam; the mean square 1."""
    pin, (low, high) = 0.37, beam_roots(ends, 40, 0.37)[[1, 39]]
    nodes, weights = np.polynomial.legendre.leggauss(60)
    for b in (low, high):
        beside = jnp.array([0.0, pin, np.nextafter(pin, 1.0), 1.0])
        y = np.array([beam_shape(ends, b, beside, k, pin) / b**k for k in range(4)])
        # Each is a sum of waves of the size 1, with the argument b x.
        assert_allclose(y[0, 1:3], 0.0, atol=1e-14 * b)
        assert_allclose(y[:3, 1], y[:3, 2], atol=1e-13 * b)
        zero = {"clamped": (0, 1), "free": (2, 3), "pinned": (0, 2)}
        for end, place in zip(ends.split("-"), (0, -1), strict=True):
            assert_allclose(y[list(zero[end]), place], 0.0, atol=1e-13 * b)
    halves = 0.5 * pin * (nodes + 1.0), pin + 0.5 * (1.0 - pin) * (nodes + 1.0)
    squares = [
        np.sum(weights * np.asarray(beam_shape(ends, low, jnp.asarray(x), 0, pin)) ** 2)
        for x in halves
    ]
    assert_allclose(0.5 * (pin * squares[0] + (1.0 - pin) * squares[1]), 1.0, rtol=1e-13)
    # The slope is the derivative, in both modes and through the pin.
    for mode in (jax.jacfwd, jax.jacrev):
        slope = jax.vmap(mode(lambda x: beam_shape(ends, low, x, 0, pin)))(
            jnp.array([0.2, pin, 0.9])
        )
        assert_allclose(
            slope, beam_shape(ends, low, jnp.array([0.2, pin, 0.9]), 1, pin), rtol=1e-12
        )


def test_a_pin_stands_between_the_ends():
    for place in (0.0, 1.0, -0.2, float("nan")):
        with pytest.raises(InputError, match="support is"):
            beam_roots("free-free", 1, place)
        with pytest.raises(InputError, match="support is"):
            beam_shape("free-free", 4.0, jnp.zeros(()), 0, place)


def powers(x):
    return jnp.stack([x**2, x**3])


@jax.jit
def cantilever(given):
    return assumed_modes(powers, *given)


def test_assumed_modes_of_a_cantilever():
    """9.12-P6 with x^2 and x^3: z^2/1260 - 34/35 z + 12 = 0, z = w^2 mu L^4/EI; above the exact
    ones, and by 1 % and 58 %."""
    L, EI, mu = 2.0, np.array([300.0, 450.0]), 1.5
    z = np.sort(np.roots([1.0 / 1260.0, -34.0 / 35.0, 12.0]))
    expected = np.sqrt(z[:, None] * EI / mu) / L**2
    w, shares = cantilever((L, jnp.asarray(EI), mu))
    # The small root is the difference of terms 40 times its size.
    assert_allclose(w, expected, rtol=1e-12)
    exact = beam_roots("clamped-free", 2) ** 2 * np.sqrt(300.0 / mu) / L**2
    assert np.all(w[:, 0] > exact) and w[0, 0] < 1.01 * exact[0]
    # Unit modal mass: q' M q = 1 with M = mu L (1/5, 1/6; 1/6, 1/7).
    M = mu * L * np.array([[1 / 5, 1 / 6], [1 / 6, 1 / 7]])
    for k in range(2):
        assert_allclose(shares[..., k].T @ M @ shares[..., k], np.eye(2), atol=1e-11)

    @jax.jit
    def slopes(x):
        first = lambda x: assumed_modes(powers, *x)[0][0]  # noqa: E731
        return jax.jacfwd(first)(x), jax.jacrev(first)(x)

    # w is a power of each: L^-2, EI^(1/2), mu^(-1/2).
    x = jnp.array([L, 300.0, mu])
    for found in slopes(x):
        assert_allclose(found * x / expected[0, 0], [-2.0, 0.5, -0.5], rtol=1e-11)


def test_assumed_modes_of_a_beam_that_tapers():
    """A wedge with EI = x^3, mu = x, free at its point and clamped at x = 1: one shape (1 - x)^2
    has w^2 = (4/4)/(1/30) = 30, above 5.315^2, of Kirchhoff's exact mode."""
    w, _ = assumed_modes(lambda x: ((1.0 - x) ** 2)[None], 1.0, lambda x: x**3, lambda x: x)
    assert_allclose(w, [np.sqrt(30.0)], rtol=1e-13)
    both, _ = assumed_modes(
        lambda x: jnp.stack([(1.0 - x) ** 2, (1.0 - x) ** 2 * x]), 1.0, lambda x: x**3, lambda x: x
    )
    assert 5.315 < both[0] < 5.32 < w[0]
    with pytest.raises(InputError, match="shapes"):
        assumed_modes(lambda x: x**2, 1.0, 1.0, 1.0)

"""Variational problems solved by direct minimisation, against their closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace.mechanics import Lagrangian
from jaxspace.mechanics.variational import action, brachistochrone, hanging_chain
from jaxspace.optimization import Criterion, minimise

G, W, TIME = 9.8, 2.0, 1.1  # TIME is below pi / W: the action is least
DISTANCE, DROP, SPAN, LENGTH = 0.5, 1.0, 2.0, 2.4


def even(c, x):
    """sum c_k x^(2 k)"""
    return jnp.polyval(c[::-1], x * x)


def quadrature(function, start, end):
    x, weights = np.polynomial.legendre.leggauss(40)
    x = 0.5 * (start + end) + 0.5 * (end - start) * x
    return 0.5 * (end - start) * jnp.sum(weights * jax.vmap(function)(jnp.asarray(x)))


def slope(function, x):
    return jax.jvp(function, (x,), (jnp.ones_like(x),))


def oscillator(sign):
    return Lagrangian(lambda t, q, v, p: 0.5 * (v[0] ** 2 - sign * W * W * q[0] ** 2), ("x",))


def swing(c, t):
    """From 0.3 to -0.2."""
    return (0.3 - 0.5 * t / TIME + t * (TIME - t) * jnp.polyval(c, t))[None]


def free_end(c, t):
    """From 1, to any value."""
    return (1.0 + t * jnp.polyval(c, t))[None]


def descent(c):
    """x over s, with the drop s^2: a cycloid's x is odd in s, from s^3 on; its time is smooth."""

    def x(s):
        # The first coefficient brings it to the end.
        return s**3 * (DISTANCE - jnp.sum(c) + even(jnp.concatenate([jnp.zeros(1), c]), s))

    def rate(s):
        _, along = slope(x, s)
        return jnp.sqrt((along**2 + (2.0 * DROP * s) ** 2) / (2.0 * G * DROP * s * s))

    return quadrature(rate, 0.0, 1.0)


def chain(c):
    """Potential energy and length of y = (x^2 - d^2/4) sum c_k x^2k."""

    def along(x):
        y, bend = slope(lambda x: (x * x - 0.25 * SPAN**2) * even(c, x), x)
        stretch = jnp.sqrt(1.0 + bend * bend)
        return jnp.stack([y * stretch, stretch])

    x, weights = np.polynomial.legendre.leggauss(40)
    values = jax.vmap(along)(jnp.asarray(0.5 * SPAN * x))
    return 0.5 * SPAN * jnp.sum(weights[:, None] * values, axis=0)


def problem(x):
    """All four at once: they share no unknown, so that each is at its own minimum."""
    energy, length = chain(x["chain"])
    parts = {
        "swing": action(oscillator(1.0), lambda t: swing(x["swing"], t), 0.0, TIME, 1),
        "free": action(oscillator(-1.0), lambda t: free_end(x["free"], t), 0.0, TIME, 1),
        "time": descent(x["descent"]),
        "energy": energy,
    }
    total = sum(parts.values(), start=jnp.zeros(()))
    return Criterion(total, (length - LENGTH)[None], report=parts)


@pytest.mark.sweep
def test_direct_minimisation_finds_the_closed_forms():
    start = {
        "swing": jnp.zeros(8),
        "free": jnp.zeros(8),
        "descent": jnp.zeros(8),
        "chain": jnp.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0]),
    }
    found = minimise(problem, start, exact_hessian=True, tolerance=1e-10)
    assert found.converged, found.sentence()
    x, parts = found.x, found.criterion.report
    t = jnp.linspace(0.0, TIME, 7)
    # What minimises is flat: the search leaves the root of what it leaves of the objective.
    # Hamilton's principle: the motion between two places.
    exact = (0.3 * jnp.sin(W * (TIME - t)) - 0.2 * jnp.sin(W * t)) / jnp.sin(W * TIME)
    assert_allclose(swing(x["swing"], t)[0], exact, atol=1e-8)
    # A free end has no momentum: cosh(w (T - t)) / cosh(w T).
    exact = jnp.cosh(W * (TIME - t)) / jnp.cosh(W * TIME)
    assert_allclose(free_end(x["free"], t)[0], exact, atol=1e-6)
    assert_allclose(parts["time"], brachistochrone(DISTANCE, DROP, G)[2], rtol=1e-7)
    # The chain, with its sag and energy.
    a, sag = hanging_chain(SPAN, LENGTH)
    assert_allclose(0.25 * SPAN**2 * x["chain"][0], sag, rtol=1e-4)
    top = a * jnp.cosh(0.5 * SPAN / a)
    energy = quadrature(
        lambda x: (a * jnp.cosh(x / a) - top) * jnp.cosh(x / a), -0.5 * SPAN, 0.5 * SPAN
    )
    assert_allclose(parts["energy"], energy, rtol=1e-8)

"""Products with a number that is zero, and whose derivative is not, beside plain products."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.integration._vanishing import vanishing


def moment(number, args):
    """Of the number, linear in `v` and not in `a`."""
    a, v = args["a"], args["v"]
    return {"sum": number * jnp.sum(jnp.exp(a) * v), "each": number * jnp.sin(a) * v**1}


def plain(x, product=moment):
    """Numbers that move with x, of which the first factor is zero at x = 2."""
    a, v = jnp.array([0.3, -0.2]) * x, jnp.array([1.0, 2.0]) * x**2
    result = product(x**2 - 2.0 * x, {"a": a, "v": v})
    return result["sum"] + jnp.sum(result["each"] ** 2 + result["each"])


def held(x):
    return plain(x, lambda number, args: vanishing(moment, number, args, moment(number, args)))


DERIVATIVES = {
    "value": lambda f: f,
    "forwards": lambda f: jax.jacfwd(f),
    "backwards": jax.grad,
    "forwards of backwards": lambda f: jax.jacfwd(jax.grad(f)),
    "backwards of forwards": lambda f: jax.grad(jax.jacfwd(f)),
    "backwards of backwards": lambda f: jax.grad(jax.grad(f)),
    "third": lambda f: jax.jacfwd(jax.jacfwd(jax.grad(f))),
}


@pytest.mark.parametrize("kind", DERIVATIVES)
@pytest.mark.parametrize("compiled", [False, True])
def test_its_derivatives_are_those_of_the_product(kind, compiled):
    derivative = DERIVATIVES[kind]
    # Both take the same operations, in another order: a few roundings.
    ours, theirs = derivative(held), derivative(plain)
    if compiled:
        ours = jax.jit(ours)
    np.testing.assert_allclose(ours(2.0), theirs(2.0), rtol=1e-14)
    # Mapped over x that are all zeros of the first factor.
    x = jnp.array([2.0, 0.0])
    np.testing.assert_allclose(jax.vmap(ours)(x), [theirs(2.0), theirs(0.0)], rtol=1e-14)


def linear(t):
    """The derivative of the product along t, which is linear in it."""

    def along(number, args):
        a, t = args
        return number * jax.jvp(jnp.exp, (a,), (t,))[1]

    return vanishing(along, jnp.zeros(()), (jnp.array([0.1, 0.2]), t), like=t)


def test_its_value_and_first_derivative_hold_nothing_of_the_factor():
    for function in (linear, jax.grad(lambda t: jnp.sum(linear(t)))):
        compiled = jax.jit(function).lower(jnp.ones(2)).as_text()
        assert "exponential" not in compiled
        np.testing.assert_array_equal(jax.jit(function)(jnp.ones(2)), 0.0)


def test_it_is_linear_where_the_product_is():
    """Backwards through a linear argument, and then forwards through the number."""

    def pulled(number):
        def product(number, args):
            a, t = args
            return number * jnp.exp(a) * t

        pull = jax.linear_transpose(
            lambda t: vanishing(product, number, (jnp.array([0.1, 0.2]), t), like=t), jnp.ones(2)
        )
        return pull(jnp.array([1.0, 3.0]))[0]

    np.testing.assert_array_equal(pulled(0.0), 0.0)
    np.testing.assert_allclose(jax.jacfwd(pulled)(0.0), np.exp([0.1, 0.2]) * [1.0, 3.0], rtol=1e-15)

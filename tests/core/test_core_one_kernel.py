"""Functions as one kernel."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.core.one_kernel import in_one_kernel


def roots(x, y):
    return jnp.sqrt(x) + y, x < y


def together(x, y):
    return in_one_kernel(roots, x, y)


def loops(function, *args) -> int:
    return jax.jit(function).lower(*args).as_text().count("stablehlo.while")


def test_a_function_is_one_loop_of_one_pass():
    assert loops(together, 4.0, 1.0) == 1
    for result in (jax.jit(together)(4.0, 1.0), together(4.0, 1.0)):
        assert (float(result[0]), bool(result[1])) == (3.0, False)


def test_trees_of_arrays_go_through():
    def each(args):
        return in_one_kernel(lambda args: {"sum": args[0] + args[1]["b"]}, args)

    given = jnp.array([1.0, 2.0]), {"b": 3.0}
    assert loops(each, given) == 1
    np.testing.assert_array_equal(jax.jit(each)(given)["sum"], [4.0, 5.0])


def test_mapped_runs_are_the_function_itself():
    x = jnp.array([1.0, 4.0, 9.0])
    mapped = jax.vmap(together, (0, None))
    assert loops(mapped, x, 1.0) == 0
    result = jax.jit(mapped)(x, 1.0)
    np.testing.assert_array_equal(result[0], [2.0, 3.0, 4.0])
    np.testing.assert_array_equal(result[1], [False, False, False])


def test_a_function_with_a_rule_is_differentiated_in_both_modes():
    @jax.custom_jvp
    def root(x):
        return in_one_kernel(jnp.sqrt, x)

    @root.defjvp
    def _(primals, tangents):
        value = root(*primals)
        return value, tangents[0] / (2.0 * value)

    for derivative in (jax.grad(root), jax.jacfwd(root)):
        assert float(jax.jit(derivative)(4.0)) == 0.25
    assert float(jax.jit(jax.grad(jax.grad(root)))(4.0)) == -1.0 / 32.0

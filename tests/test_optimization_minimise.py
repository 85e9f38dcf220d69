"""Constrained descent on problems with known answers."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.optimization import Criterion, minimise


def test_free_minimum_of_a_curved_valley():
    found = jax.jit(
        lambda x: minimise(
            lambda x: Criterion(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2), x
        )
    )(jnp.asarray([-1.2, 1.0]))
    assert found.converged
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-8)


def test_multipliers():
    """Nearest point of the line x + y = 2 to (2, 1), with x <= 1 binding and y <= 5 idle; the
    Lagrangian is stationary."""

    def problem(p):
        x, y = p["x"], p["y"]
        return Criterion(
            (x - 2.0) ** 2 + (y - 1.0) ** 2,
            x + y - 2.0,
            jnp.stack([1.0 - x, 5.0 - y]),
            report=x * y,
        )

    found = jax.jit(lambda p: minimise(problem, p))({"x": jnp.asarray(-3.0), "y": jnp.asarray(4.0)})
    assert found.converged
    np.testing.assert_allclose([found.x["x"], found.x["y"]], [1.0, 1.0], atol=1e-8)
    np.testing.assert_allclose(found.multipliers.equal_zero, 0.0, atol=1e-7)
    np.testing.assert_allclose(found.multipliers.non_negative, [2.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(found.criterion.report, 1.0, atol=1e-8)


def test_infeasible_problem_says_so():
    found = jax.jit(lambda x: minimise(lambda x: Criterion(x * x, x * x + 1.0), x, max_rounds=5))(
        jnp.asarray(0.5)
    )
    assert not found.converged
    assert found.violation > 0.9

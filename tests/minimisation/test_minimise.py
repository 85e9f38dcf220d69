"""Constrained descent on problems with known answers."""

import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxspace import simulate
from jaxspace.core import AbstractSystem, InputError, Table
from jaxspace.minimisation import Criterion, StopReason, minimise
from jaxspace.simulation import Accuracy
from jaxspace.solvers import Tsit5

NODES = jnp.linspace(0.0, 6.0, 31)


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
    found = jax.jit(lambda x: minimise(lambda x: Criterion(x * x, x * x + 1.0), x))(
        jnp.asarray(0.5)
    )
    assert not found.converged
    assert found.violation > 0.9


class Controlled(AbstractSystem):
    """x'' = u(t)."""

    control: Callable[[Array], Array]

    def vector_field(self, t, y):
        return jnp.stack([y[1], self.control(t)])

    def invariants(self, t, y):
        return {}


@pytest.mark.parametrize("kind", ["Table", pytest.param("interp", marks=pytest.mark.sweep)])
def test_a_gradient_over_kinks_that_are_no_breaks_is_found(kind):
    """From a control of zero, where the steps are long, by nodes that they pass over."""

    def objective(u):
        control = Table(NODES, u) if kind == "Table" else lambda t: jnp.interp(t, NODES, u)
        ts = jnp.array([0.0, 6.0])
        accuracy = Accuracy(method=Tsit5())
        y0 = jnp.array([1.0, 0.0])
        end = simulate(Controlled(control), y0, ts, accuracy=accuracy, throw=False).final
        return end[0] ** 2 + end[1] ** 2

    with warnings.catch_warnings():
        # The kinks are warned of before the run, too.
        warnings.simplefilter("ignore")
        # Under `jit` the search ends before it begins; without, it is refused.
        found = jax.jit(lambda u: minimise(lambda u: Criterion(objective(u)), u))(jnp.zeros(31))
    error = found.gradient_error
    if kind == "Table":
        # The objective is a square, of which a difference is exact but for rounding and the
        # tolerance of the runs.
        assert error < 1e-6
    else:
        assert error > 1e-3 and int(found.reason) == StopReason.WRONG_GRADIENT
        assert "was not started" in found.sentence()


def test_a_wrong_gradient_is_refused():
    """A custom derivative that is wrong by a tenth: (2.2 - 2) / 2.2. Under `jit` the result holds
    it."""

    @jax.custom_jvp
    def square(x):
        return jnp.sum(x * x)

    square.defjvp(lambda p, t: (square(*p), 2.2 * jnp.sum(p[0] * t[0])))

    def descend(x, check=True):
        return minimise(
            lambda x: Criterion(square(x)), x, max_steps=3, check_gradient=check
        ).gradient_error

    start = jnp.array([1.0, -2.0, 0.3])
    with pytest.raises(InputError, match=r"by a relative 0.09, .*core.Table or Spline"):
        descend(start)
    np.testing.assert_allclose(jax.jit(descend)(start), 1.0 / 11.0, rtol=1e-8)
    assert descend(start, check=False) == 0.0

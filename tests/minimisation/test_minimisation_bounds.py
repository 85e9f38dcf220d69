"""Convex problems beside bounds and corners, at all scales: the minimum, and gradients that are
judged beside singularities. Values from the optimality conditions, or from Hock and Schittkowski,
Test Examples for Nonlinear Programming Codes, 1981."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxspace.core import InputError
from jaxspace.minimisation import Criterion, StopReason, minimise
from jaxspace.minimisation._quadratic import Programme, solve_programme

FREE = jnp.inf


def against(x):
    """The minimum at -1/2 and on the bound of x_1, without pressing against it."""
    return x[0] ** 2 + x[0] + x[1] ** 2


def rosenbrock(x):
    return 100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2


# An objective, its start, bounds, and least value.
CASES = {
    "on a bound": (against, [0.5, 0.5], ([-FREE, 0.0], [FREE, 1.0]), -0.25),
    "from a bound": (against, [0.5, 0.0], ([-FREE, 0.0], [FREE, 1.0]), -0.25),
    "linear": (lambda x: x[0] - 2.0 * x[1], [1.0, 0.0], ([0.0, 0.0], [1.0, 1.0]), -2.0),
    "flat": (lambda x: (x[0] + x[1]) ** 2, [1.0, 2.0], ([-1.0, -1.0], [5.0, 5.0]), 0.0),
    "fourth power": (lambda x: x[0] ** 4 + x[1], [1.0, 0.5], ([0.0, 0.0], [2.0, 1.0]), 0.0),
    "outside": (lambda x: jnp.exp(x[0]) - 2.0 * x[0] + x[1] ** 2, [1e6, -3.0],
                ([-FREE, 0.0], [1.0, 2.0]), 2.0 - 2.0 * np.log(2.0)),
    "HS 1": (rosenbrock, [-2.0, 1.0], ([-FREE, -1.5], [FREE, FREE]), 0.0),
    "HS 2": (rosenbrock, [-2.0, 1.0], ([-FREE, 1.5], [FREE, FREE]), 0.0504261879),
    "HS 3": (lambda x: x[1] + 1e-5 * (x[1] - x[0]) ** 2, [10.0, 1.0],
             ([-FREE, 0.0], [FREE, FREE]), 0.0),
    "HS 4": (lambda x: (x[0] + 1.0) ** 3 / 3.0 + x[1], [1.125, 0.125],
             ([1.0, 0.0], [FREE, FREE]), 8.0 / 3.0),
    "HS 5": (lambda x: jnp.sin(x[0] + x[1]) + (x[0] - x[1]) ** 2 - 1.5 * x[0] + 2.5 * x[1] + 1.0,
             [0.0, 0.0], ([-1.5, -3.0], [4.0, 3.0]), -np.sqrt(3.0) / 2.0 - np.pi / 3.0),
    # Of x - log(x) the slope changes within any probe that is not much nearer than the bound.
    "logarithm": (lambda x: x[0] - jnp.log(x[0]) + x[1] ** 2, [1e-6, 0.0],
                  ([0.0, 0.0], [FREE, 1.0]), 1.0),
    "root": (lambda x: x[0] - jnp.sqrt(x[0]) + x[1], [1e-5, 0.5], ([0.0, 0.0], [1.0, 1.0]), -0.25),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_minimum_beside_bounds(name):
    objective, start, bounds, least = CASES[name]
    low, high = (jnp.array(x) for x in bounds)
    found = minimise(lambda x: Criterion(objective(x)), jnp.array(start), bounds=(low, high))
    assert found.converged, found.sentence()
    # Of the size of the objective: a scaled gradient of 1e-9 leaves less than that of it.
    np.testing.assert_allclose(found.criterion.objective, least, rtol=1e-6, atol=1e-8)
    assert np.all((low <= found.x) & (found.x <= high))


@pytest.mark.parametrize("size", [1e-8, 1e-4, 1e4, 1e8])
def test_the_minimum_on_a_bound_at_every_scale(size):
    """Of the objective, of the unknowns, and beside a constant whose rounding hides the curvature
    near the minimum."""
    bounds = jnp.array([-2.0, 0.0]), jnp.array([2.0, 1.0])
    start = jnp.array([0.5, 0.5])
    for objective, unit in (
        (lambda x: size * against(x), 1.0),
        (lambda x: against(x / size), size),
        (lambda x: size + against(x), 1.0),
    ):
        limits = tuple(unit * x for x in bounds)
        problem = lambda x, f=objective: Criterion(f(x))  # noqa: E731
        found = minimise(problem, unit * start, bounds=limits)
        assert found.converged, found.sentence()
        np.testing.assert_allclose(found.x / unit, [-0.5, 0.0], atol=1e-7)


def test_a_programme_whose_multiplier_and_slack_vanish_together():
    """Minimise z^2/2 for z >= 0 and y >= z: both multipliers are zero, to rounding and not to its
    square root."""
    eye = jnp.eye(2)
    rows = jnp.concatenate([eye, -eye, jnp.array([[-1.0, 1.0]])])
    programme = Programme(eye, jnp.zeros(2), rows, jnp.array([0.0, 0.0, 1.0, 1.0, 0.0]))
    z, nu = solve_programme(programme, jnp.array([0.5, 0.5]))
    np.testing.assert_allclose(z, 0.0, atol=1e-13)
    np.testing.assert_allclose(nu, 0.0, atol=1e-13)


@pytest.mark.parametrize("optimiser", ["sqp", optax.lbfgs()], ids=["sqp", "lbfgs"])
def test_a_right_gradient_beside_a_singularity_begins(optimiser):
    """Without bounds the farther probes are not even numbers."""
    found = minimise(
        lambda x: Criterion(x[0] - jnp.log(x[0])), jnp.array([1e-6]), optimiser=optimiser
    )
    assert int(found.reason) != StopReason.WRONG_GRADIENT and float(found.gradient_error) < 1e-3


def test_a_wrong_gradient_beside_a_singularity_is_refused():
    @jax.custom_jvp
    def log(x):
        return jnp.log(x)

    log.defjvp(lambda x, dx: (jnp.log(x[0]), 1.1 * dx[0] / x[0]))
    with pytest.raises(
        InputError, match="differs from finite differences of the objective by a relative 0.09"
    ):
        minimise(lambda x: Criterion(x[0] - log(x[0])), jnp.array([1e-6]))


@pytest.mark.parametrize(
    ("objective", "named"),
    [
        (lambda x: jnp.sum(jax.lax.stop_gradient(x) ** 2), "x\\[0\\], x\\[1\\]"),
        (lambda x: x[0] ** 2 + 2.0 * jax.lax.stop_gradient(x[1]) ** 2, "x\\[1\\]"),
        (lambda x: x[0] + jnp.floor(1e9 * x[1]) / 1e9, "x\\[1\\]"),
    ],
    ids=["all", "one", "floor"],
)
def test_a_gradient_that_is_cut_is_said_to_be(objective, named):
    with pytest.raises(
        InputError, match=f"derivative with respect to {named} is exactly zero.*stop_gradient"
    ):
        minimise(lambda x: Criterion(objective(x)), jnp.array([1.0, 2.0]))


def test_a_kink_at_the_start_is_the_reason():
    """One that only the farther differences pass is none."""
    with pytest.raises(
        InputError, match="the objective has a kink or a jump within .* pass a limit of an unknown"
    ):
        minimise(lambda x: Criterion(jnp.abs(x[0] - 1.0) + x[1] ** 2), jnp.array([1.0, 2.0]))
    found = minimise(
        lambda x: Criterion((jnp.minimum(x[0], 1.0001) - 0.5) ** 2 + x[1] ** 2), jnp.ones(2)
    )
    assert found.converged and float(found.objective) < 1e-12


def test_a_derivative_that_is_cut_in_part_is_the_reason():
    with pytest.raises(InputError, match="is smooth there, so that part of its derivative is miss"):
        minimise(
            lambda x: Criterion(x[0] ** 2 + 0.1 * x[1] * jax.lax.stop_gradient(x[0])),
            jnp.array([1.0, 2.0]),
        )


def test_a_search_that_ends_at_the_rounding_of_its_objective_says_so():
    """The gradient has an error of fixed size, as that of a sum of large terms that cancel."""

    @jax.custom_jvp
    def noisy(x):
        return 1e6 + jnp.sum((x - 0.3) ** 2)

    def jvp(x, dx):
        error = 1e-6 * jnp.sign(jnp.sin(1e12 * x[0]))
        return noisy(x[0]), jnp.sum((2.0 * (x[0] - 0.3) + error) * dx[0])

    noisy.defjvp(jvp)
    found = minimise(lambda x: Criterion(noisy(x)), jnp.array([1.0, 2.0, 5.0]), tolerance=1e-13)
    assert found.converged and int(found.reason) == StopReason.ROUNDED
    assert "to the rounding error of the objective" in found.sentence()
    np.testing.assert_allclose(found.x, 0.3, atol=1e-5)

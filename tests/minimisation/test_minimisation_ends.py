"""How searches end that find no optimum, and where they must not claim one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.core import InputError
from jaxspace.minimisation import Criterion, StopReason, minimise, minimise_from


def hole(x):
    """A bowl about zero, NaN or infinite to the right of 0.5; without a slope there."""
    return jnp.where(x[0] > 0.5, jnp.nan, x[0])


ABOVE = jnp.ones(2)
NOT_FINITE = [
    (lambda x: Criterion(x @ x + 0.0 * hole(x), x[0], ABOVE), "The objective is nan at the start"),
    (
        lambda x: Criterion(jnp.where(x[0] > 0.5, jnp.inf, x @ x), x[0], ABOVE),
        "The objective is inf",
    ),
    (lambda x: Criterion(x @ x, hole(x), ABOVE), "equal_zero is nan"),
    (lambda x: Criterion(x @ x, x[0], jnp.stack([x[1], hole(x)])), "non_negative[1] is nan"),
    # Finite, with an infinite slope: the root of zero.
    (
        lambda x: Criterion(jnp.sqrt(x[0] - 1.0) + x[1] ** 2, x[0], ABOVE),
        "A derivative of the objective",
    ),
]


def test_what_is_not_finite_is_no_optimum():
    # One program for all problems.
    @jax.jit
    def searched(number):
        problems = [problem for problem, _ in NOT_FINITE]
        return minimise(lambda x: jax.lax.switch(number, problems, x), jnp.ones(2))

    ends = [(searched(k), said) for k, (_, said) in enumerate(NOT_FINITE)]
    # And a search that is not compiled as a whole, without constraints.
    problem = lambda x: Criterion(jnp.sqrt(x[0] - 1.0) + x[1] ** 2)  # noqa: E731
    ends.append((minimise(problem, jnp.ones(2)), NOT_FINITE[-1][1]))
    for found, said in ends:
        assert not found.converged and int(found.reason) == StopReason.NOT_FINITE
        assert said in found.sentence() and int(found.steps) == 0


def test_the_best_of_several_starts_is_finite():
    """Of starts that do not converge in two steps, that outside the domain counts as the worst,
    although it violates nothing."""

    def problem(x):
        outside = x[0] > 2.0
        return Criterion(jnp.where(outside, jnp.inf, x[0] ** 4), jnp.where(outside, 0.0, x[1] ** 3))

    starts = jnp.array([[3.0, 1.0], [1.0, 1.0]])
    best, every = minimise_from(problem, starts, max_steps=2)
    assert not np.any(every.converged) and int(every.reason[0]) == StopReason.NOT_FINITE
    assert np.isfinite(best.criterion.objective)


def test_a_far_optimum_needs_a_small_slope():
    """Of large unknowns a small slope is no rounding: at the start it is 4e-9. Where the minimum
    has no curvature, each judgement by the scale at its place leads closer."""
    found = minimise(lambda x: Criterion((x[0] / 1e9 - 1.0) ** 4), jnp.array([0.5]))
    assert found.converged
    np.testing.assert_allclose(found.x, 1e9, rtol=1e-3)
    # 1e-6 - 1/x, by half: in float32 a projection by differences of x ends at 6000.
    flat = minimise(
        lambda x: Criterion(x[0] / 1e6 - jnp.log(x[0])),
        jnp.array([0.5], jnp.float32),
        tolerance=1e-5,
    )
    assert flat.converged and 0.5 * (1.0 / flat.x[0] - 1e-6) < 1.01e-5


def test_an_objective_without_bound_says_so():
    """By few steps; with a constraint that the run away must not make infeasible."""
    found = minimise(lambda x: Criterion(jnp.sum(x)), 4.0 * jnp.ones(2))
    assert not found.converged and int(found.reason) == StopReason.UNBOUNDED
    assert "unbounded below. Give bounds" in found.sentence() and int(found.steps) < 40
    held = minimise(lambda x: Criterion(x[1] ** 2 - x[0], x[1] - 1.0), jnp.array([1.0, 0.5]))
    assert int(held.reason) == StopReason.UNBOUNDED


@jax.custom_jvp
def wrong_square(x):
    return x @ x


wrong_square.defjvp(lambda p, t: (wrong_square(*p), 3.0 * p[0] @ t[0]))
BOX = (jnp.array([0.0, -1.0]), jnp.array([2.0, 1.0]))


def test_the_gradient_at_a_bound_is_probed_within():
    """Beyond the bound at which it begins, the objective is another one; within it is 0 at (1, 0).
    A gradient that is wrong there is refused all the same."""

    def problem(x):
        return Criterion(jnp.where(x[0] < 0.0, 9.0, (x[0] - 1.0) ** 2) + x[1] ** 2)

    start = jnp.array([0.0, 0.5])
    found = minimise(problem, start, bounds=BOX)
    assert found.converged
    np.testing.assert_allclose(found.x, [1.0, 0.0], atol=1e-8)
    with pytest.raises(InputError, match="differences of the objective by a relative 0.3"):
        minimise(lambda x: Criterion(wrong_square(x)), start, bounds=BOX)
    # A power that has no second derivative at the bound is not known well enough to be refused.
    root = minimise(lambda x: Criterion((x[0] ** 1.5 - 1.0) ** 2 + x[1] ** 2), start, bounds=BOX)
    assert root.converged


def test_a_wrong_gradient_is_named():
    """Half too large, 1/3 of what is claimed, and of the second inequality."""

    def problem(x):
        return Criterion(jnp.sum(x - 1.0) ** 2, None, jnp.stack([x[0], wrong_square(x)]))

    with pytest.raises(InputError, match=r"differences of non_negative\[1\] by a relative 0.3"):
        minimise(problem, jnp.array([1.0, 0.2]))
    # Under `jit` the result says it.
    found = jax.jit(lambda x: minimise(problem, x))(jnp.array([1.0, 0.2]))
    assert (
        "disagrees with finite differences of non_negative[1]: the search was not"
        in found.sentence()
    )


# Of one start it is refused above.
@pytest.mark.sweep
def test_of_several_starts_a_wrong_gradient_is_refused():
    starts = jnp.array([[1.0, 2.0], [3.0, -1.0]])
    with pytest.raises(InputError, match="differences of the objective by a relative 0.3"):
        minimise_from(lambda x: Criterion(wrong_square(x)), starts)
    best, _ = minimise_from(lambda x: Criterion(wrong_square(x)), starts, check_gradient=False)
    assert int(best.reason) != StopReason.WRONG_GRADIENT


def bowl(x):
    return Criterion(jnp.sum(jnp.stack([jnp.sum((v - 3.0) ** 2) for v in jax.tree.leaves(x)])))


def bare(name, value):
    """A criterion with a part that its types do not allow, which only the tests check."""
    made = Criterion(jnp.ones(()))
    object.__setattr__(made, name, value)
    return made


def constrained(x):
    return Criterion(x @ x, x[0] - 1.0, x)


@pytest.mark.parametrize(
    ("problem", "start", "options", "said"),
    [
        (bowl, jnp.array([1, 2]), {}, "start is of type int"),
        (bowl, {"x": 1.0, "n": 2}, {}, r"start\['n'\] is of type int"),
        (bowl, {}, {}, "start contains no numbers"),
        (bowl, jnp.zeros(0), {}, "start contains no numbers"),
        (lambda x: x @ x, jnp.ones(2), {}, r"an array of shape \(\): it must return a Criterion"),
        (
            lambda x: bare("objective", x),
            jnp.ones(1),
            {},
            r"objective of shape \(1,\): it must be one",
        ),
        (lambda x: bare("equal_zero", [x[0]]), jnp.ones(2), {}, "equal_zero as a list: it must be"),
        (lambda x: bare("objective", None), jnp.ones(2), {}, "objective as a NoneType"),
        (bowl, jnp.ones(2), {"max_steps": 0}, "max_steps is 0: it must be at least 1"),
        (bowl, jnp.ones(2), {"scale": jnp.array([1.0, 0.0])}, "scales must be positive and finite"),
        (bowl, jnp.ones(2), {"scale": 1.0}, r"scale has the shape \(\): it must be \(2,\)"),
        (bowl, {"a": 1.0}, {"scale": 1.0}, "scale must have the structure of the start"),
    ],
)
def test_what_cannot_be_searched_is_refused_by_name(problem, start, options, said):
    with pytest.raises(InputError, match=said):
        minimise(problem, start, **options)


def test_python_floats_are_unknowns():
    found = minimise(bowl, {"a": 1.0}, bounds=({"a": 0.0}, {"a": 2.0}))
    assert found.converged
    np.testing.assert_allclose(found.x["a"], 2.0, atol=1e-8)


def test_a_search_goes_on_with_its_own_constraints_alone():
    begun = minimise(constrained, jnp.array([3.0, 2.0]), max_steps=1)
    with pytest.raises(InputError, match="of another problem"):
        minimise(lambda x: Criterion(x @ x, None, x), begun)

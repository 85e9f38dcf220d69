"""Searches by optimisers of optax, against closed forms and against the loops of optax's manual."""

import functools
import signal

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxspace.core import InputError
from jaxspace.minimisation import Criterion, StopReason, minimise, minimise_from
from jaxspace.optimization.optimisers import NAMES, lbfgs, named_optimiser

HALVING = optax.scale_by_backtracking_linesearch(25, decrease_factor=0.5)
BACKTRACKING = optax.lbfgs(linesearch=HALVING)
PLATEAU = optax.contrib.reduce_on_plateau(factor=0.5, patience=50, rtol=0.0, atol=1e-12)
OPTIMISERS = {
    "sgd": optax.sgd(0.05),
    "adam": optax.adam(0.03),
    # Which needs the unknowns.
    "adamw": optax.adamw(0.03, weight_decay=0.0),
    "lbfgs": optax.lbfgs(),
    "lbfgs by backtracking": BACKTRACKING,
    "clipped": optax.chain(optax.clip_by_global_norm(1.0), optax.adam(0.03)),
    "plateau": optax.chain(optax.adam(0.03), PLATEAU),
    "schedule-free": optax.contrib.schedule_free_sgd(0.05),
    # Each part of the tree by its own.
    "parts": optax.multi_transform(
        {"slow": optax.adam(0.03), "fast": optax.sgd(0.05)}, {"x": "slow", "z": "fast"}
    ),
}
SWEPT = ("adamw", "clipped", "plateau", "lbfgs by backtracking", "parts")


def mixed(p):
    """An equality, an inequality and a bound that bind: x = (23, -12, 11)/11, z = 1."""
    x, z = p["x"], p["z"]
    cost = (x[0] - 3.0) ** 2 + 10.0 * (x[1] + 1.0) ** 2 + (x[2] - 2.0) ** 2 + (z - 2.0) ** 2
    return Criterion(cost, x[0] + x[1] - 1.0, 1.0 - x[2])


START = {"x": jnp.zeros(3), "z": jnp.asarray(0.0)}
BOUNDS = (
    {"x": jnp.full(3, -9.0), "z": jnp.asarray(-1.0)},
    {"x": jnp.full(3, 9.0), "z": jnp.asarray(1.0)},
)
SCALE = jax.tree.map(jnp.ones_like, START)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.sweep if n in SWEPT else ()) for n in OPTIMISERS]
)
def test_an_equality_an_inequality_and_a_bound(name):
    found = jax.jit(
        lambda p: minimise(
            mixed,
            p,
            optimiser=OPTIMISERS[name],
            bounds=BOUNDS,
            scale=SCALE,
            tolerance=1e-5,
            max_steps=6000,
        )
    )(START)
    assert found.converged and int(found.left_out) == 0, found.sentence()
    # The curvature is 2, the scale of the objective 20: a scaled gradient of 1e-5 is 1e-4 of x.
    np.testing.assert_allclose(found.x["x"], [23 / 11, -12 / 11, 1.0], atol=1e-4)
    np.testing.assert_allclose(found.x["z"], 1.0, atol=1e-4)
    assert found.x["z"] <= 1.0
    # 2 (3 - 23/11), 2 (2 - 1), and the slope 2 (1 - 2) of z.
    np.testing.assert_allclose(found.multipliers.equal_zero, 20 / 11, atol=1e-3)
    np.testing.assert_allclose(found.multipliers.non_negative, 2.0, atol=1e-3)
    np.testing.assert_allclose(found.bound_multipliers["z"], -2.0, atol=1e-3)
    np.testing.assert_allclose(found.bound_multipliers["x"], 0.0, atol=1e-3)


CURVATURES = np.array([1.0, 0.5, 0.1])


def quadratic(x):
    """Its largest slope at zero is 1, so that the scaled problem is the problem itself."""
    return 0.5 * jnp.sum(CURVATURES * (x - 1.0) ** 2)


def by_hand(optimiser, steps):
    """The loop of optax's manual."""
    made = optax.with_extra_args_support(optimiser)
    slope = jax.value_and_grad(quadratic)

    def step(carry, _):
        x, state = carry
        value, g = slope(x)
        updates, state = made.update(g, state, x, value=value, grad=g, value_fn=quadratic)
        return (optax.apply_updates(x, updates), state), None

    with jax.numpy_dtype_promotion("standard"):
        return jax.lax.scan(step, (jnp.zeros(3), made.init(jnp.zeros(3))), None, steps)[0]


@pytest.mark.parametrize("name", ["adam", "lbfgs", "schedule-free"])
def test_a_search_without_constraints_is_optax_own_loop(name):
    """Step by step; of a schedule-free optimiser the result is at its evaluation parameters, where
    these are better: with a rate of 3, about which its other ones leap."""
    free = optax.contrib.schedule_free_sgd(3.0)
    optimiser, steps = free if name == "schedule-free" else OPTIMISERS[name], 4
    x, state = jax.jit(by_hand, static_argnums=(0, 1))(optimiser, steps)
    if name == "schedule-free":
        x = optax.contrib.schedule_free_eval_params(state, x)
    # Without the check, the first evaluation is at the start.
    search = jax.jit(
        lambda x: minimise(
            lambda x: Criterion(quadratic(x)),
            x,
            optimiser=optimiser,
            max_steps=steps,
            check_gradient=False,
        )
    )
    found = search(jnp.zeros(3))
    # Both round alike but for the order of sums, which some steps of a line search enlarge.
    np.testing.assert_allclose(found.x, x, rtol=1e-12)
    assert int(found.steps) == steps and int(found.reason) == StopReason.STEP_LIMIT


def test_a_rate_is_in_sizes_of_the_unknowns():
    """Adam's first step has its rate as length: a hundredth of the size, be it 1e6 or 1e-3."""
    size = jnp.array([1e6, 1e-3])

    def far(x):
        return Criterion(jnp.sum((x / size - 1.0) ** 2))

    found = minimise(
        far, jnp.zeros(2), optimiser=optax.adam(1e-2), scale=size, max_steps=1, tolerance=1e-12
    )
    np.testing.assert_allclose(found.x / size, 1e-2, rtol=1e-6)


def test_the_best_point_is_returned_and_not_the_last():
    """A valley that is four times as steep on its far side: from 1 the steps lead to -1/5, 19/25,
    -19/125 and 361/625, because the rate is 6/5 of the near curvature."""

    def valley(x):
        return Criterion(jnp.where(x[0] > 0.0, 4.0, 1.0) * x[0] ** 2)

    found = jax.jit(lambda x: minimise(valley, x, optimiser=optax.sgd(1.2), max_steps=4))(
        jnp.array([-1.0])
    )
    np.testing.assert_allclose(found.history[-1, 0], (361 / 625) ** 2, rtol=1e-12)
    np.testing.assert_allclose(found.x, 19 / 125, rtol=1e-12)


def test_a_schedule_that_decays_to_nothing_is_no_convergence():
    decaying = optax.sgd(optax.linear_schedule(1e-2, 0.0, 20))
    found = jax.jit(
        lambda x: minimise(lambda x: Criterion(quadratic(x)), x, optimiser=decaying, max_steps=500)
    )(jnp.zeros(3))
    assert not found.converged and int(found.reason) == StopReason.NO_PROGRESS
    assert int(found.steps) < 60 and found.x[2] < 0.1


def test_steps_that_are_not_finite_are_left_out_and_counted():
    """-ln x + x from 0.05: the first steps lead below zero, where it is NaN."""

    @functools.partial(jax.jit, static_argnums=1)
    def searched(x, name):
        return minimise(
            lambda x: Criterion(x[0] - jnp.log(x[0])),
            x,
            optimiser=OPTIMISERS[name],
            tolerance=1e-6,
            max_steps=2000,
        )

    found = searched(jnp.array([4.0]), "sgd")
    assert found.converged and int(found.left_out) == 0
    leaping = jax.jit(
        lambda x: minimise(
            lambda x: Criterion(x[0] - jnp.log(x[0])),
            x,
            optimiser=optax.sgd(5.0),
            tolerance=1e-6,
            max_steps=200,
        )
    )(jnp.array([4.0]))
    assert int(leaping.left_out) > 0 and np.isfinite(leaping.criterion.objective)
    np.testing.assert_array_equal(np.isfinite(leaping.history[: int(leaping.steps)]), True)
    assert f"{int(leaping.left_out)} steps skipped" in leaping.sentence()
    # The line search turns back by itself.
    np.testing.assert_allclose(searched(jnp.array([0.05]), "lbfgs").x, 1.0, atol=1e-5)


def test_hard_ends_say_what_they_are():
    """One program: targets that contradict each other, a fall without bound, a kink, and a start
    on a bound, from which the minimum lies within."""
    problems = [
        lambda x: Criterion(x @ x, x @ x + 1.0),
        lambda x: Criterion(x[0] + 0.0 * x[1], jnp.zeros(())),
        lambda x: Criterion(jnp.sum(jnp.abs(x - 1.0 / 3.0)), jnp.zeros(())),
    ]

    @jax.jit
    def searched(k, start):
        return minimise(
            lambda x: jax.lax.switch(k, problems, x),
            start,
            optimiser=lbfgs(),
            tolerance=1e-6,
            max_steps=400,
        )

    ends = [searched(k, jnp.array([0.5, 0.2])) for k in range(3)]
    assert not any(bool(end.converged) for end in ends)
    assert int(ends[0].reason) == StopReason.INFEASIBLE
    np.testing.assert_allclose(ends[0].x, 0.0, atol=1e-6)
    assert int(ends[1].reason) == StopReason.UNBOUNDED
    np.testing.assert_allclose(ends[2].x, 1.0 / 3.0, atol=1e-6)


@pytest.mark.parametrize("name", ["adam", "lbfgs"])
def test_a_start_on_a_bound(name):
    found = jax.jit(
        lambda x: minimise(
            lambda x: Criterion(jnp.sum((x - jnp.array([0.5, 3.0])) ** 2)),
            x,
            optimiser=OPTIMISERS[name],
            bounds=(0.0, 2.0),
            tolerance=1e-6,
            max_steps=2000,
        )
    )(jnp.array([0.0, 0.0]))
    assert found.converged
    np.testing.assert_allclose(found.x, [0.5, 2.0], atol=1e-5)


@jax.custom_jvp
def wrong_square(x):
    return x @ x


wrong_square.defjvp(lambda p, t: (wrong_square(*p), 3.0 * p[0] @ t[0]))


def test_a_wrong_gradient_is_refused():
    with pytest.raises(InputError, match="differences of the objective by a relative 0.3"):
        minimise(
            lambda x: Criterion(wrong_square(x)),
            jnp.array([1.0, -2.0]),
            optimiser=OPTIMISERS["adam"],
        )


def line(x):
    return Criterion((x[0] - 3.0) ** 2 + 10.0 * (x[1] + 1.0) ** 2, x[0] + x[1] - 1.0)


def test_several_starts_and_batches():
    """Under `vmap`, and the best of several starts."""
    starts = jnp.array([[0.0, 5.0, -7.0], [0.0, -4.0, 2.0]])
    best, every = minimise_from(
        line, starts, optimiser=OPTIMISERS["sgd"], tolerance=1e-6, max_steps=4000
    )
    assert bool(jnp.all(every.converged))
    np.testing.assert_allclose(best.x, [23 / 11, -12 / 11], atol=1e-5)


# Three searches whose steps are watched, each compiled anew.
@pytest.mark.sweep
def test_progress_an_interruption_and_a_continuation():
    """Steps are reported as they are taken; Ctrl-C keeps them, and the search goes on with the
    moments of its optimiser: both parts together are the search at once."""
    rows = []

    def watched(*row):
        rows.append(row)
        if len(rows) == 30:
            signal.raise_signal(signal.SIGINT)

    asked = {"optimiser": OPTIMISERS["adam"], "tolerance": 1e-6, "max_steps": 3000}
    begun = minimise(line, jnp.zeros(2), progress=watched, **asked)
    assert int(begun.reason) == StopReason.INTERRUPTED and "Interrupted" in begun.sentence()
    assert [row[0] for row in rows] == list(range(1, len(rows) + 1))
    on = minimise(line, begun, **asked)
    whole = minimise(line, jnp.zeros(2), **asked)
    assert on.converged and int(on.steps) == int(whole.steps)
    np.testing.assert_allclose(on.x, whole.x, rtol=1e-9)
    taken = ~np.isnan(np.asarray(on.history[:, 0]))
    assert np.sum(taken) == int(whole.steps)
    with pytest.raises(InputError, match="of another problem or optimiser"):
        minimise(line, begun)


def test_float32_and_strict_promotion():
    """optax mixes widths of integers, which a caller's strict promotion would refuse."""
    with jax.numpy_dtype_promotion("strict"):
        found = jax.jit(
            lambda x: minimise(line, x, optimiser=lbfgs(), tolerance=1e-4, check_gradient=False)
        )(jnp.zeros(2, jnp.float32))
    assert found.converged and found.x.dtype == jnp.float32
    np.testing.assert_allclose(found.x, [23 / 11, -12 / 11], atol=1e-3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"optimiser": "adam"}, r"optimiser is 'adam': it must be 'sqp' or an optimiser of optax"),
        ({"optimiser": 0.01}, "optimiser is a float: it must be 'sqp' or an optimiser of optax"),
        (
            {
                "optimiser": optax.adam,
            },
            "optimiser is a function",
        ),
        (
            {"optimiser": lbfgs(), "exact_hessian": True},
            "exact_hessian is given with an optax optimiser",
        ),
    ],
)
def test_what_is_no_optimiser_is_refused(options, said):
    with pytest.raises(InputError, match=said):
        minimise(line, jnp.zeros(2), **options)


def test_names():
    with pytest.raises(InputError, match=r"one of sqp, lbfgs, .*Did you mean adam\?"):
        named_optimiser("adan")
    with pytest.raises(InputError, match="rate is 0.1: lbfgs chooses its own step length"):
        named_optimiser("lbfgs", 0.1)
    with pytest.raises(InputError, match="rate is -1: it must be positive"):
        named_optimiser("adam", -1.0)
    assert named_optimiser("sqp") == "sqp"
    made = [named_optimiser(name) for name in NAMES[1:]]
    assert all(isinstance(x, optax.GradientTransformation) for x in made)

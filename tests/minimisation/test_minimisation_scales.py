"""Minima far below the slopes at the start, which must not set the tolerance."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from scipy.optimize import minimize

from jaxspace.minimisation import Criterion, StopReason, minimise

# Objectives of x, a and b, and their minimisers.
FAMILY = [
    (lambda x, a, b: a * x - b * jnp.log(x), lambda a, b: b / a),
    (lambda x, a, b: a * x + b / x, lambda a, b: np.sqrt(b / a)),
    (lambda x, a, b: a * x + b / x**3, lambda a, b: (3.0 * b / a) ** 0.25),
    (lambda x, a, b: jnp.exp(a * x) - b * x, lambda a, b: np.log(b / a) / a),
]
LOGARITHM, INVERSE, CUBE, EXPONENTIAL = range(4)
CASES = np.array(
    [(LOGARITHM, 10.0**k, 1.0, 1.0) for k in range(-9, 10, 3)]
    # In units of 1e-8.
    + [(LOGARITHM, x, 1e8, 1.0) for x in (1e-9, 3e-8, 1e-6)]
    + [(INVERSE, x, 1.0, 1.0) for x in (1e-6, 1e-3, 1.0, 1e3)]
    + [(INVERSE, x, 1e-3, 1e3) for x in (1e-6, 1.0, 1e3)]
    + [(INVERSE, x, 1.0, 1e-16) for x in (1e-6, 1.0, 1e3)]
    + [(INVERSE, 1e-6, 1e6, 1e-6), (INVERSE, 1.0, 1e-12, 1e-12)]
    + [(CUBE, x, 1.0, 1.0) for x in (1e-3, 1e-1, 1e4)]
    + [(EXPONENTIAL, x, 1.0, 2.0) for x in (-5.0, 30.0, 100.0)]
    + [(EXPONENTIAL, 3.0, 10.0, 2.0)]
).T


@pytest.mark.parametrize(
    ("optimiser", "exact"),
    [("sqp", False), pytest.param("sqp", True, marks=pytest.mark.sweep), (optax.lbfgs(), False)],
    ids=["sqp", "exact", "lbfgs"],
)
def test_minima_below_steep_starts(optimiser, exact):
    """A gradient of 1e-9 in units of the slope at the start, up to 3e43, says nothing."""
    functions = [f for f, _ in FAMILY]

    def searched(kind, start, a, b):
        low = jnp.where(kind == EXPONENTIAL, -jnp.inf, 0.0)
        found = minimise(
            lambda x: Criterion(jax.lax.switch(kind, functions, x[0], a, b)),
            start[None],
            bounds=(low[None], jnp.array([jnp.inf])),
            max_steps=300,
            optimiser=optimiser,
            exact_hessian=exact,
        )
        return found.x[0], found.criterion.objective, found.converged

    kinds = CASES[0].astype(int)
    x, objective, converged = jax.jit(jax.vmap(searched))(kinds, *jnp.asarray(CASES[1:]))
    assert np.all(converged), CASES[:, ~converged]
    for k, case in enumerate(CASES.T):
        function, minimiser = FAMILY[kinds[k]]
        best = minimiser(*case[2:])
        # A hundred tolerances of the larger of the minimiser and the start.
        np.testing.assert_allclose(x[k], best, rtol=2e-7, atol=1e-7 * abs(case[1]), err_msg=case)
        least = function(best, *case[2:])
        np.testing.assert_allclose(objective[k], least, rtol=1e-10, err_msg=case)


def test_several_unknowns_from_slopes_of_every_size():
    found = minimise(
        lambda x: Criterion(jnp.sum(x - jnp.log(x))),
        jnp.array([1e-9, 1e-6, 1e-3, 1.0]),
        bounds=(0.0, None),
    )
    assert found.converged
    np.testing.assert_allclose(found.x, 1.0, rtol=1e-7)


NODES, ACCELERATION, GRAVITY, SPEED, HEIGHT = 12, 62.0, 9.8, 7800.0, 2e5


def missed(angles, time):
    """Velocity and height beyond those of the target orbit, relative to them."""
    share = (jnp.arange(240.0) + 0.5) / 240.0
    angle = jnp.interp(share, jnp.linspace(0.0, 1.0, NODES), angles)
    across = jnp.mean(ACCELERATION * jnp.cos(angle)) * time
    up = ACCELERATION * jnp.sin(angle) - GRAVITY
    height = jnp.mean(up * (1.0 - share)) * time**2
    return jnp.stack([across / SPEED - 1.0, jnp.mean(up) * time / SPEED, height / HEIGHT - 1.0])


def test_least_time_steering_from_several_starts():
    """Steering by twelve angles ends at the time that SLSQP of SciPy finds, whatever the start."""
    random = np.random.default_rng(0).uniform(-1.0, 1.4, NODES)
    starts = (np.zeros(NODES), np.full(NODES, 0.5), np.linspace(1.2, -0.5, NODES), random)

    @jax.jit
    def searched(angles):
        unit = jnp.array([SPEED, SPEED, HEIGHT])
        start = {"angles": angles, "time": jnp.asarray(200.0)}
        return minimise(
            lambda x: Criterion(x["time"], unit * missed(x["angles"], x["time"])), start
        )

    split = lambda z: missed(z[:-1], 100.0 * z[-1])  # noqa: E731
    values, slopes = jax.jit(split), jax.jit(jax.jacfwd(split))
    last = np.eye(NODES + 1)[-1]
    reference = minimize(
        lambda z: z[-1],
        np.append(starts[0], 2.0),
        jac=lambda z: last,
        constraints={"type": "eq", "fun": values, "jac": slopes},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 300},
    )
    assert reference.success
    for start in starts:
        found = searched(start)
        assert found.converged, found.sentence()
        assert int(found.reason) in (StopReason.CONVERGED, StopReason.ROUNDED)
        np.testing.assert_allclose(found.x["time"], 100.0 * reference.x[-1], rtol=1e-10)


def test_few_steps_along_curved_constraints_are_refused():
    """Full steps along the curved constraints of the steering raise the exact penalty (Maratos):
    they are accepted nevertheless, because the next step removes the violation. Refused steps
    repeat the row before. SLSQP of SciPy takes 49 steps on average to a larger gradient."""
    starts = np.random.default_rng(0).uniform(-1.0, 1.4, (8, NODES))

    @jax.jit
    @jax.vmap
    def searched(angles):
        unit = jnp.array([SPEED, SPEED, HEIGHT])
        start = {"angles": angles, "time": jnp.asarray(200.0)}
        found = minimise(
            lambda x: Criterion(x["time"], unit * missed(x["angles"], x["time"])), start
        )
        return found.converged, found.steps, found.history[:, :2]

    converged, steps, rows = jax.tree.map(np.asarray, searched(jnp.asarray(starts)))
    assert np.all(converged)
    refused = np.sum(np.all(rows[:, 1:] == rows[:, :-1], axis=2))
    assert refused < 0.1 * np.sum(steps)
    assert np.mean(steps) < 80.0


@pytest.mark.parametrize("start", [(0.0, 0.0), (1e-6, 1e-6), (2.0, -1.0)], ids=str)
@pytest.mark.parametrize("kind", ["equal_zero", "non_negative"])
def test_constraints_of_any_steepness(kind, start):
    """The least sum on the unit circle, with the constraint in units from 1e-8 to 1e12 of the
    objective, also from its centre, where the constraint has no slope."""

    @jax.jit
    @jax.vmap
    def searched(unit):
        return minimise(
            lambda x: Criterion(x[0] + x[1], **{kind: unit * (1.0 - x @ x)}), jnp.array(start)
        )

    units = 10.0 ** np.arange(-8.0, 13.0)
    found = searched(jnp.asarray(units))
    assert np.all(found.converged)
    np.testing.assert_allclose(found.x, -np.sqrt(0.5), rtol=1e-8)
    # Violations and multipliers are those in the units of the problem.
    assert np.all(found.violation <= 1e-9 * units)
    sign = -1.0 if kind == "non_negative" else 1.0
    multipliers = sign * units * getattr(found.multipliers, kind)
    np.testing.assert_allclose(multipliers, -np.sqrt(0.5), rtol=1e-7)

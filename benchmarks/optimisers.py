"""Thirty problems of Hock and Schittkowski (1981) and the five ascents and transfers of
`examples/known_optima`: optima found, steps, evaluations of the problem and CPU time including
compilation, by `minimise` with SQP and with L-BFGS of optax, by SLSQP and trust-constr of SciPy,
and by slsqp-jax and Ipopt if these are installed; and whether the optimisation works inside
`jax.jit` and `jax.vmap`.

Found is an optimum whose objective and constraints are right to 1e-6, and to 1e-5 of a published
optimum. SciPy and Ipopt are given the compiled objective and constraints with their derivatives, of
an ascent in the scaled unknowns of `minimise`. A method is as good at a problem as its defaults:
tolerance 1e-9, for an ascent that of its example, at most 500 steps."""

import functools
import importlib
import importlib.util
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import scipy.optimize

from jaxspace.core.tracing import is_traced
from jaxspace.optimization import Criterion, minimise
from jaxspace.optimization.optimisers import named_optimiser

from .optimum_problems import CLOSE, FREE, KNOWN, PROBLEMS, TOLERANCE, Problem, known

MOST = 500


class SearchEnd(NamedTuple):
    """Where a method ended, its steps, and how often it evaluated the problem."""

    x: Any
    steps: Any
    evaluations: int


def sides(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest value of each unknown."""
    bounds = problem.bounds or [FREE] * len(problem.start)
    low, high = (
        np.array([side * np.inf if b[k] is None else b[k] for b in bounds])
        for k, side in enumerate((-1.0, 1.0))
    )
    return low, high


def ours(problem: Problem, method: str) -> SearchEnd:
    """By `minimise`, with the optimiser of this name."""
    calls = []

    def criterion(x):
        jax.debug.callback(lambda: calls.append(1))
        return Criterion(
            problem.f(x),
            None if problem.equal is None else jnp.stack(problem.equal(x)),
            None if problem.above is None else jnp.stack(problem.above(x)),
        )

    found = minimise(
        criterion,
        jnp.array(problem.start),
        optimiser=named_optimiser(method),
        bounds=None if problem.bounds is None else sides(problem),
        tolerance=problem.tolerance,
        max_steps=MOST,
        scale=jnp.ones(len(problem.start)) if problem.scaled else None,
    )
    jax.effects_barrier()
    return SearchEnd(found.x, found.steps, len(calls))


def compiled(problem: Problem) -> tuple[Callable, Callable, list[dict[str, Any]]]:
    """Objective, gradient, and the constraints with their Jacobians, as SciPy takes them."""
    sides = [("eq", problem.equal), ("ineq", problem.above)]
    constraints = []
    for kind, function in sides:
        if function is not None:
            values = jax.jit(lambda x, function=function: jnp.stack(function(x)))
            constraints.append({"type": kind, "fun": values, "jac": jax.jit(jax.jacfwd(values))})
    return jax.jit(problem.f), jax.jit(jax.grad(problem.f)), constraints


def scipys(problem: Problem, method: str) -> SearchEnd:
    """By SciPy, or by Ipopt, which is called like it."""
    f, slope, constraints = compiled(problem)
    options: dict[str, Any] = {"maxiter": MOST}
    given: Any = constraints
    if method == "trust-constr":
        options |= {"gtol": problem.tolerance, "xtol": 1e-12}
        given = [
            scipy.optimize.NonlinearConstraint(
                c["fun"], 0.0, 0.0 if c["type"] == "eq" else np.inf, jac=c["jac"]
            )
            for c in constraints
        ]
    elif method == "SLSQP":
        options |= {"ftol": TOLERANCE}
    start = np.array(problem.start)
    arguments = {"jac": slope, "bounds": problem.bounds, "constraints": given}
    if method == "Ipopt":
        import cyipopt

        options |= {"tol": problem.tolerance, "print_level": 0, "sb": "yes"}
        found = cyipopt.minimize_ipopt(f, start, options=options, **arguments)
    else:
        found = scipy.optimize.minimize(f, start, method=method, options=options, **arguments)
    return SearchEnd(found.x, found.nit, found.nfev)


def slsqp_jax(problem: Problem, method: str) -> SearchEnd:
    """By slsqp-jax, called like SciPy; in a compiled program by its solver alone, for that call
    scales a problem by the numbers of its start."""
    import slsqp_jax as library

    del method
    if is_traced(problem.start):
        return _compiled_slsqp(problem, library)
    _, _, constraints = compiled(problem)
    found = library.minimize_like_scipy(
        problem.f,
        jnp.array(problem.start),
        bounds=problem.bounds,
        constraints=constraints,
        options={"max_steps": MOST, "rtol": problem.tolerance, "atol": problem.tolerance},
    )
    # It counts no evaluations.
    return SearchEnd(found.value, found.stats["num_steps"], -1)


def _compiled_slsqp(problem: Problem, library: Any) -> SearchEnd:
    def stacked(function: Callable | None) -> Callable | None:
        return None if function is None else lambda x, args: jnp.stack(function(x))

    def count(function: Callable | None) -> int:
        return 0 if function is None else len(function(jnp.zeros(problem.start.shape)))

    tolerance = library.ToleranceConfig(
        rtol=problem.tolerance, atol=problem.tolerance, max_steps=MOST
    )
    solver = library.SLSQP(
        config=library.SLSQPConfig(tolerance=tolerance),
        eq_constraint_fn=stacked(problem.equal),
        ineq_constraint_fn=stacked(problem.above),
        n_eq_constraints=count(problem.equal),
        n_ineq_constraints=count(problem.above),
        bounds=np.stack(sides(problem), axis=1),
    )
    found = optimistix.minimise(
        lambda x, args: problem.f(x), solver, problem.start, max_steps=MOST, throw=False
    )
    return SearchEnd(found.value, found.stats["num_steps"], -1)


METHODS: dict[str, tuple[Callable[[Problem, str], SearchEnd], str]] = {
    "ours": (ours, "sqp"),
    "ours, optax.lbfgs": (ours, "lbfgs"),
    "SciPy, SLSQP": (scipys, "SLSQP"),
    "SciPy, trust-constr": (scipys, "trust-constr"),
    "Ipopt, limited memory": (scipys, "Ipopt"),
    "slsqp-jax": (slsqp_jax, "slsqp_jax"),
}
NEEDED = {"slsqp-jax": "slsqp_jax", "Ipopt, limited memory": "cyipopt"}


def is_optimum(problem: Problem, x: np.ndarray) -> bool:
    """Whether this is the optimum, to `CLOSE` in the objective and in every constraint."""
    violations = [0.0]
    if problem.equal is not None:
        violations += [abs(float(c)) for c in problem.equal(jnp.asarray(x))]
    if problem.above is not None:
        violations += [-float(d) for d in problem.above(jnp.asarray(x))]
    for value, (low, high) in zip(x, problem.bounds or [FREE] * len(x), strict=True):
        violations += [] if low is None else [low - value]
        violations += [] if high is None else [value - high]
    off = abs(float((problem.of or problem.f)(jnp.asarray(x))) - problem.best)
    # A small optimum counts by itself, that of an example by its digits.
    size = abs(problem.best) if problem.of else max(1.0, abs(problem.best))
    return off <= problem.close * size and max(violations) <= CLOSE


@functools.cache
def is_transformed(name: str) -> bool:
    """Whether a method finds the optimum of number 71, which has bounds and both kinds of
    constraints, from three starts at once inside of a compiled program."""
    search, method = METHODS[name]
    (problem,) = (problem for problem in PROBLEMS if problem.number == 71)

    def end(start: jax.Array) -> jax.Array:
        return search(problem._replace(start=start), method).x

    first = jnp.array(problem.start)
    # From the corner of the bounds towards their middle.
    starts = first + jnp.array([[0.0], [0.1], [0.2]]) * (3.0 - first)
    try:
        ends = jax.jit(jax.vmap(end))(starts)
    # Each library refuses a traced start by an error of its own.
    except Exception as error:
        print(name, "under jit and vmap", type(error).__name__)
        return False
    return all(is_optimum(problem, np.asarray(x)) for x in ends)


COLLECTIONS: dict[str, Callable[[], tuple[Problem, ...]]] = {
    "thirty problems": lambda: PROBLEMS,
    "five ascents": lambda: tuple(map(known, KNOWN)),
}


def row_of(name: str, problems: tuple[Problem, ...]) -> dict:
    """How many optima a method finds, and what that takes."""
    search, method = METHODS[name]
    missed, steps, evaluations, seconds = [], [], [], 0.0
    for problem in problems:
        started = time.process_time()
        try:
            found = search(problem, method)
        # Whatever a library raises, it has not found the optimum.
        except Exception as error:
            print(name, problem.number, type(error).__name__, error)
            missed.append(problem.number)
            continue
        seconds += time.process_time() - started
        steps.append(int(found.steps))
        evaluations.append(int(found.evaluations))
        if not is_optimum(problem, np.asarray(found.x)):
            missed.append(problem.number)
    counted = bool(evaluations) and min(evaluations) >= 0
    return {
        "found": f"{len(problems) - len(missed)} of {len(problems)}",
        "missed": ", ".join(map(str, missed)),
        "median_steps": float(np.median(steps)) if steps else None,
        "median_evaluations": float(np.median(evaluations)) if counted else None,
        "cpu_seconds": seconds,
        "under_jit_and_vmap": "yes" if is_transformed(name) else "no",
    }


def measure() -> dict:
    """A row for each method and collection."""
    rows = {}
    for title, problems in COLLECTIONS.items():
        for name in METHODS:
            if name in NEEDED and importlib.util.find_spec(NEEDED[name]) is None:
                continue
            rows[f"{name}, {title}"] = row_of(name, problems())
            print(name, title, rows[f"{name}, {title}"], flush=True)
    return rows

"""Thirty problems of Hock and Schittkowski (1981) and the five ascents and transfers of
`examples/known_optima`: optima found, steps, evaluations of the problem and processor seconds with
compilation, by `minimise` with quadratic programmes and with L-BFGS of optax, by SLSQP and
trust-constr of SciPy; by slsqp-jax and Ipopt where these are installed; and whether a search works
inside of `jax.jit` and `jax.vmap`.

Found is an optimum whose objective and constraints are right to 1e-6, and to 1e-5 of a published
optimum. SciPy and Ipopt are given the compiled objective and constraints with their derivatives, of
an ascent in the scaled unknowns of `minimise`. A method is as good at a problem as its defaults:
tolerance 1e-9, for an ascent that of its example, at most 500 steps."""

import functools
import importlib
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import scipy.optimize
from jax.flatten_util import ravel_pytree

from jaxspace.core.tracing import is_traced
from jaxspace.optimization import Criterion, minimise
from jaxspace.optimization.optimisers import named_optimiser

FREE = (None, None)
TOLERANCE, MOST, CLOSE = 1e-9, 500, 1e-6


class Problem(NamedTuple):
    """A problem by its number in the collection, or its name: objective, constraints c = 0 and
    d >= 0, start, least objective, bounds of each unknown; the tolerance of the search, the
    number `of` the optimum that is `best` to `close`, where that is not the objective, and whether
    the unknowns are in their sizes."""

    number: int | str
    f: Callable
    start: Any
    best: float
    equal: Callable | None = None
    above: Callable | None = None
    bounds: list | None = None
    tolerance: float = TOLERANCE
    of: Callable | None = None
    close: float = CLOSE
    scaled: bool = False


def rosenbrock(x):
    return 100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2


def of_78(x):
    return x @ x - 10.0, x[1] * x[2] - 5.0 * x[3] * x[4], x[0] ** 3 + x[1] ** 3 + 1.0


def of_100(x):
    squares = 127.0 - 2.0 * x[0] ** 2 - 3.0 * x[1] ** 4 - x[2] - 4.0 * x[3] ** 2 - 5.0 * x[4]
    return (
        squares,
        282.0 - 7.0 * x[0] - 3.0 * x[1] - 10.0 * x[2] ** 2 - x[3] + x[4],
        196.0 - 23.0 * x[0] - x[1] ** 2 - 6.0 * x[5] ** 2 + 8.0 * x[6],
        -4.0 * x[0] ** 2
        - x[1] ** 2
        + 3.0 * x[0] * x[1]
        - 2.0 * x[2] ** 2
        - 5.0 * x[5]
        + 11.0 * x[6],
    )


def rosen_suzuki(x):
    a, b, c, d = x
    return (
        8.0 - x @ x - a + b - c + d,
        10.0 - a**2 - 2.0 * b**2 - c**2 - 2.0 * d**2 + a + d,
        5.0 - 2.0 * a**2 - b**2 - c**2 - 2.0 * a + b + d,
    )


def f_77(x):
    return (
        (x[0] - 1.0) ** 2
        + (x[0] - x[1]) ** 2
        + (x[2] - 1.0) ** 2
        + (x[3] - 1.0) ** 4
        + (x[4] - 1.0) ** 6
    )


def f_100(x):
    a, b, c, d, e, g, h = x
    first = (a - 10.0) ** 2 + 5.0 * (b - 12.0) ** 2 + c**4 + 3.0 * (d - 11.0) ** 2 + 10.0 * e**6
    return first + 7.0 * g**2 + h**4 - 4.0 * g * h - 10.0 * g - 8.0 * h


ABOVE_0 = (0.0, None)
PROBLEMS = (
    Problem(1, rosenbrock, [-2.0, 1.0], 0.0, bounds=[FREE, (-1.5, None)]),
    Problem(
        5,
        lambda x: jnp.sin(x[0] + x[1]) + (x[0] - x[1]) ** 2 - 1.5 * x[0] + 2.5 * x[1] + 1.0,
        [0.0, 0.0],
        -np.sqrt(3.0) / 2.0 - np.pi / 3.0,
        bounds=[(-1.5, 4.0), (-3.0, 3.0)],
    ),
    Problem(6, lambda x: (1 - x[0]) ** 2, [-1.2, 1.0], 0.0, lambda x: (10.0 * (x[1] - x[0] ** 2),)),
    Problem(
        7,
        lambda x: jnp.log(1.0 + x[0] ** 2) - x[1],
        [2.0, 2.0],
        -np.sqrt(3.0),
        lambda x: ((1.0 + x[0] ** 2) ** 2 + x[1] ** 2 - 4.0,),
    ),
    Problem(
        10,
        lambda x: x[0] - x[1],
        [-10.0, 10.0],
        -1.0,
        above=lambda x: (-3.0 * x[0] ** 2 + 2.0 * x[0] * x[1] - x[1] ** 2 + 1.0,),
    ),
    Problem(
        11,
        lambda x: (x[0] - 5.0) ** 2 + x[1] ** 2 - 25.0,
        [4.9, 0.1],
        -8.498464223,
        above=lambda x: (x[1] - x[0] ** 2,),
    ),
    Problem(
        12,
        lambda x: 0.5 * x[0] ** 2 + x[1] ** 2 - x[0] * x[1] - 7.0 * x[0] - 7.0 * x[1],
        [0.0, 0.0],
        -30.0,
        above=lambda x: (25.0 - 4.0 * x[0] ** 2 - x[1] ** 2,),
    ),
    Problem(
        13,
        lambda x: (x[0] - 2.0) ** 2 + x[1] ** 2,
        [-2.0, -2.0],
        1.0,
        above=lambda x: ((1.0 - x[0]) ** 3 - x[1],),
        bounds=[ABOVE_0] * 2,
    ),
    Problem(
        14,
        lambda x: (x[0] - 2.0) ** 2 + (x[1] - 1.0) ** 2,
        [2.0, 2.0],
        9.0 - 2.875 * np.sqrt(7.0),
        lambda x: (x[0] - 2.0 * x[1] + 1.0,),
        lambda x: (1.0 - 0.25 * x[0] ** 2 - x[1] ** 2,),
    ),
    Problem(
        18,
        lambda x: 0.01 * x[0] ** 2 + x[1] ** 2,
        [2.0, 2.0],
        5.0,
        above=lambda x: (x[0] * x[1] - 25.0, x @ x - 25.0),
        bounds=[(2.0, 50.0), (0.0, 50.0)],
    ),
    Problem(
        19,
        lambda x: (x[0] - 10.0) ** 3 + (x[1] - 20.0) ** 3,
        [20.1, 5.84],
        -6961.81387558,
        above=lambda x: (
            (x[0] - 5.0) ** 2 + (x[1] - 5.0) ** 2 - 100.0,
            82.81 - (x[1] - 5.0) ** 2 - (x[0] - 6.0) ** 2,
        ),
        bounds=[(13.0, 100.0), (0.0, 100.0)],
    ),
    Problem(
        22,
        lambda x: (x[0] - 2.0) ** 2 + (x[1] - 1.0) ** 2,
        [2.0, 2.0],
        1.0,
        above=lambda x: (2.0 - x[0] - x[1], x[1] - x[0] ** 2),
    ),
    Problem(
        24,
        lambda x: ((x[0] - 3.0) ** 2 - 9.0) * x[1] ** 3 / (27.0 * np.sqrt(3.0)),
        [1.0, 0.5],
        -1.0,
        above=lambda x: (
            x[0] / np.sqrt(3.0) - x[1],
            x[0] + np.sqrt(3.0) * x[1],
            6.0 - x[0] - np.sqrt(3.0) * x[1],
        ),
        bounds=[ABOVE_0] * 2,
    ),
    Problem(
        26,
        lambda x: (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 4,
        [-2.6, 2.0, 2.0],
        0.0,
        lambda x: ((1.0 + x[1] ** 2) * x[0] + x[2] ** 4 - 3.0,),
    ),
    Problem(
        27,
        lambda x: 0.01 * (x[0] - 1.0) ** 2 + (x[1] - x[0] ** 2) ** 2,
        [2.0, 2.0, 2.0],
        0.04,
        lambda x: (x[0] + x[2] ** 2 + 1.0,),
    ),
    Problem(
        28,
        lambda x: (x[0] + x[1]) ** 2 + (x[1] + x[2]) ** 2,
        [-4.0, 1.0, 1.0],
        0.0,
        lambda x: (x[0] + 2.0 * x[1] + 3.0 * x[2] - 1.0,),
    ),
    Problem(
        29,
        lambda x: -x[0] * x[1] * x[2],
        [1.0, 1.0, 1.0],
        -16.0 * np.sqrt(2.0),
        above=lambda x: (48.0 - x[0] ** 2 - 2.0 * x[1] ** 2 - 4.0 * x[2] ** 2,),
    ),
    Problem(
        34,
        lambda x: -x[0],
        [0.0, 1.05, 2.9],
        -np.log(np.log(10.0)),
        above=lambda x: (x[1] - jnp.exp(x[0]), x[2] - jnp.exp(x[1])),
        bounds=[(0.0, 100.0), (0.0, 100.0), (0.0, 10.0)],
    ),
    Problem(
        35,
        lambda x: (
            9.0
            - 8.0 * x[0]
            - 6.0 * x[1]
            - 4.0 * x[2]
            + 2.0 * (x[0] ** 2 + x[1] ** 2 + x[0] * x[1] + x[0] * x[2])
            + x[2] ** 2
        ),
        [0.5, 0.5, 0.5],
        1.0 / 9.0,
        above=lambda x: (3.0 - x[0] - x[1] - 2.0 * x[2],),
        bounds=[ABOVE_0] * 3,
    ),
    Problem(
        39,
        lambda x: -x[0],
        [2.0] * 4,
        -1.0,
        lambda x: (x[1] - x[0] ** 3 - x[2] ** 2, x[0] ** 2 - x[1] - x[3] ** 2),
    ),
    Problem(
        40,
        lambda x: -x[0] * x[1] * x[2] * x[3],
        [0.8] * 4,
        -0.25,
        lambda x: (x[0] ** 3 + x[1] ** 2 - 1.0, x[0] ** 2 * x[3] - x[2], x[3] ** 2 - x[1]),
    ),
    Problem(
        43,
        lambda x: x @ x + x[2] ** 2 - 5.0 * x[0] - 5.0 * x[1] - 21.0 * x[2] + 7.0 * x[3],
        [0.0] * 4,
        -44.0,
        above=rosen_suzuki,
    ),
    Problem(
        46,
        lambda x: (x[0] - x[1]) ** 2 + (x[2] - 1.0) ** 2 + (x[3] - 1.0) ** 4 + (x[4] - 1.0) ** 6,
        [np.sqrt(0.5), 1.75, 0.5, 2.0, 2.0],
        0.0,
        lambda x: (
            x[0] ** 2 * x[3] + jnp.sin(x[3] - x[4]) - 1.0,
            x[1] + x[2] ** 4 * x[3] ** 2 - 2.0,
        ),
    ),
    Problem(
        64,
        lambda x: jnp.sum(jnp.array([5.0, 20.0, 10.0]) * x + jnp.array([5e4, 7.2e4, 1.44e5]) / x),
        [1.0] * 3,
        6299.842428,
        above=lambda x: (1.0 - 4.0 / x[0] - 32.0 / x[1] - 120.0 / x[2],),
        bounds=[(1e-5, None)] * 3,
    ),
    Problem(
        65,
        lambda x: (x[0] - x[1]) ** 2 + (x[0] + x[1] - 10.0) ** 2 / 9.0 + (x[2] - 5.0) ** 2,
        [-5.0, 5.0, 0.0],
        0.9535288567,
        above=lambda x: (48.0 - x @ x,),
        bounds=[(-4.5, 4.5), (-4.5, 4.5), (-5.0, 5.0)],
    ),
    Problem(
        71,
        lambda x: x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
        [1.0, 5.0, 5.0, 1.0],
        17.0140173,
        lambda x: (x @ x - 40.0,),
        lambda x: (x[0] * x[1] * x[2] * x[3] - 25.0,),
        [(1.0, 5.0)] * 4,
    ),
    Problem(
        77,
        f_77,
        [2.0] * 5,
        0.24150513,
        lambda x: (
            x[0] ** 2 * x[3] + jnp.sin(x[3] - x[4]) - 2.0 * np.sqrt(2.0),
            x[1] + x[2] ** 4 * x[3] ** 2 - 8.0 - np.sqrt(2.0),
        ),
    ),
    Problem(78, jnp.prod, [-2.0, 1.5, 2.0, -1.0, -1.0], -2.91970041, of_78),
    Problem(
        80,
        lambda x: jnp.exp(jnp.prod(x)),
        [-2.0, 2.0, 2.0, -1.0, -1.0],
        0.0539498478,
        of_78,
        bounds=[(-2.3, 2.3)] * 2 + [(-3.2, 3.2)] * 3,
    ),
    Problem(100, f_100, [1.0, 2.0, 0.0, 4.0, 0.0, 1.0, 1.0], 680.6300573, above=of_100),
)


KNOWN = ("linear_tangent", "goddard", "transfer", "delta_iii", "three_stages")
CONSTANTS = ("PUBLISHED", "HOHMANN", "REFERENCE")


def known(name: str) -> Problem:
    """The problem of an example, in its scaled unknowns."""
    folder = str(Path(__file__).parents[1] / "examples" / "known_optima")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    module: Any = importlib.import_module(name)
    asked: dict[str, Any] = {}
    # What the example hands to its search.
    module.minimise = lambda problem, start, **options: asked.update(options, start=start)
    module.search()
    start, unravel = ravel_pytree(asked["start"])
    size = ravel_pytree(asked["scale"])[0] if "scale" in asked else jnp.ones_like(start)
    sides = [ravel_pytree(side)[0] / size for side in asked.get("bounds", ())]
    first = jax.eval_shape(module.problem, asked["start"])

    def criterion(z: Any) -> Any:
        return module.problem(unravel(size * z))

    def optimum(z: Any) -> float:
        x = unravel(size * z)
        return module.optimum(SimpleNamespace(x=x, criterion=module.problem(x)))

    return Problem(
        name,
        lambda z: criterion(z).objective,
        [float(z) for z in start / size],
        next(getattr(module, constant) for constant in CONSTANTS if hasattr(module, constant)),
        None if first.equal_zero is None else lambda z: jnp.atleast_1d(criterion(z).equal_zero),
        None if first.non_negative is None else lambda z: criterion(z).non_negative,
        [
            tuple(x if np.isfinite(x) else None for x in map(float, pair))
            for pair in zip(*sides, strict=True)
        ]
        or None,
        asked["tolerance"],
        optimum,
        1e-5,
        "scale" in asked,
    )


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

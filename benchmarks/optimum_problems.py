"""The problems of `optimisers.py`: thirty of Hock and Schittkowski, Test Examples for Nonlinear
Programming Codes (1981), by their numbers, and the five ascents and transfers of
`examples/known_optima`."""

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

FREE = (None, None)
TOLERANCE, CLOSE = 1e-9, 1e-6


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

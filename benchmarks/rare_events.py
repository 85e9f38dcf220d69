"""Coverage of the intervals of rare events of known probability: by both methods, over 20 seeds.

`covered` counts the 95 % intervals that contain the truth, `marked` those that are marked as not
reliable. The width is the upper limit over the lower one, for a probability near one those of its
complement. Widths, runs and processor seconds are medians of a call, without the first one, which
compiles. The truths are closed forms of the normal and chi-squared distributions, sums over the
values of a list, and for the four branches a quadrature.
"""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import chi2, norm

from jaxspace import Mission, Phase
from jaxspace.core import AbstractClosedForm, AbstractSystem, Scalar
from jaxspace.dispersion import Campaign, Discrete, Normal, Samples
from jaxspace.dispersion.rare import rare_event

SEEDS, RUNS, FEW_RUNS = 20, 10_000, 2_000


class Place(eqx.Module):
    """A number that stays as it is."""

    x: Scalar


@final
class Rest(AbstractClosedForm):
    """Nothing moves."""

    def flow(self, duration, y):
        return y


@final
class Still(AbstractSystem):
    """x' = 0, in closed form: the output is a function of the inputs alone."""

    def vector_field(self, t, y):
        return Place(jnp.zeros_like(y.x))

    def invariants(self, t, y):
        return {"x": y.x}

    def closed_form(self):
        return Rest()


class Problem(NamedTuple):
    """P(y > limit) for an output y of the inputs, (n, runs), in the order of their names."""

    output: Callable[[Array], Array]
    inputs: list[Any]
    limit: float
    truth: float
    runs: int = RUNS

    def campaign(self) -> Campaign:
        """The campaign with these inputs."""
        names = [f"x{k:02}" for k in range(len(self.inputs))]

        def build(samples):
            return Mission([Phase(Still(), 1.0)]), Place(samples[names[0]])

        def outputs(result, samples):
            return {"y": self.output(jnp.stack([samples[name] for name in names]))}

        return Campaign(build, dict(zip(names, self.inputs, strict=True)), outputs)


def normals(n: int, deviation: float = 1.0) -> list[Any]:
    """Independent normal inputs with the mean zero."""
    return [Normal(0.0, deviation)] * n


def total(x: Array) -> Array:
    """The sum of the inputs."""
    return jnp.sum(x, axis=0)


def linear(n: int, p: float, output: Callable[[Array], Array] = total) -> Problem:
    """A sum of n normal numbers of variance one in all."""
    return Problem(output, normals(n, n**-0.5), float(norm.isf(p)), p)


def measured(p: float) -> Problem:
    """A list of 60 measured values with half of the variance, and ten normal numbers."""
    values = np.random.default_rng(0).standard_normal(60)
    values = (values - values.mean()) / values.std() * math.sqrt(0.5)

    def chance(limit: float) -> float:
        return float(norm.sf((limit - values) / math.sqrt(0.5)).mean())

    limit = float(brentq(lambda x: chance(x) / p - 1.0, 2.0, 9.0))
    return Problem(total, [Samples(values), *normals(10, math.sqrt(0.05))], limit, p)


def listed() -> Problem:
    """A list with a rare value, and a normal number."""
    values, weights = np.array([0.0, 1.0, 3.0]), np.array([0.9, 0.099, 0.001])
    truth = float(norm.sf(5.5 - values) @ weights)
    return Problem(total, [Discrete(values, weights), *normals(1)], 5.5, truth)


def cube(n: int, p: float) -> Problem:
    """The greatest miss in n directions: 2 n equal design points."""
    limit = float(norm.isf(-np.expm1(np.log1p(-p) / n) / 2.0))
    return Problem(lambda x: jnp.max(jnp.abs(x), axis=0), normals(n), limit, p)


def ball(n: int, p: float) -> Problem:
    """The distance from the mean in n directions, all of which lead to a violation."""
    limit = float(np.sqrt(chi2.isf(p, n)))
    return Problem(lambda x: jnp.linalg.norm(x, axis=0), normals(n), limit, p)


def branches(x: Array) -> Array:
    """Four limits about the origin, each met above zero."""
    along, across = (x[0] + x[1]) / math.sqrt(2.0), x[0] - x[1]
    near = 3.0 + 0.1 * across**2
    far = 7.0 / math.sqrt(2.0)
    parts = jnp.stack([near - along, near + along, far - across, far + across])
    return -jnp.min(parts, axis=0)


def of_branches() -> float:
    """The probability of a violation of one of the four, over v = (a - b) / sqrt(2)."""
    inside = quad(lambda v: 2.0 * norm.pdf(v) * norm.sf(3.0 + 0.2 * v * v), -3.5, 3.5)[0]
    return inside + 2.0 * float(norm.sf(3.5))


def series() -> Problem:
    """A system that fails where one of four independent parts does."""
    limits = np.array([3.0, 3.3, 3.6, 3.9])
    truth = -math.expm1(float(np.log1p(-norm.sf(limits)).sum()))
    return Problem(lambda x: jnp.max(x - limits[:, None], axis=0), normals(4), 0.0, truth)


def rounded(x: Array) -> Array:
    """The sum, rounded down to a quarter: its derivatives are zero."""
    return 0.25 * jnp.floor(4.0 * total(x))


def without_derivatives(n: int) -> Problem:
    """A rounded sum of n normal numbers."""
    return Problem(rounded, normals(n, n**-0.5), 4.0 - 0.1, float(norm.sf(4.0)), RUNS // 2)


def problems() -> dict[str, Problem]:
    """The problems by name."""
    return {
        "linear, 2 inputs, 1e-6": linear(2, 1e-6),
        "60 measured values and 10 normal inputs, 1e-5": measured(1e-5),
        "a list and a normal input": listed(),
        "probability near one, 1 - 1e-5": linear(2, 1.0 - 1e-5),
        "above -3 deviations": linear(2, float(norm.sf(-3.0))),
        "20 equal design points, 1e-5": cube(10, 1e-5),
        "six-input ball, 1e-5": ball(6, 1e-5),
        "four branches": Problem(branches, normals(2), 0.0, of_branches()),
        "four branches, few runs": Problem(branches, normals(2), 0.0, of_branches(), FEW_RUNS),
        "series system": series(),
        "without derivatives, 30 inputs": without_derivatives(30),
    }


def row(problem: Problem, method: str) -> dict:
    """Coverage, width and cost of one method."""
    campaign, found, seconds = problem.campaign(), [], []
    for seed in range(SEEDS):
        started = time.process_time()
        found.append(
            rare_event(
                campaign, "y", above=problem.limit, runs=problem.runs, method=method, seed=seed
            )
        )
        seconds.append(time.process_time() - started)
    low, high = np.array([(f.low, f.high) for f in found]).T
    # A probability near one has a rare complement.
    rare = (low, high) if problem.truth < 0.5 else (1.0 - high, 1.0 - low)
    with np.errstate(divide="ignore"):
        widths = rare[1] / rare[0]
    return {
        "probability": problem.truth,
        "covered": f"{sum(f.low <= problem.truth <= f.high for f in found)} of {SEEDS}",
        "marked": sum(not f.reliable for f in found),
        "width": float(np.median(widths)),
        "runs": int(np.median([f.runs for f in found])),
        "processor_seconds": float(np.median(seconds[1:])),
    }


def measure() -> dict:
    """A row for every problem and method."""
    return {
        f"{name}: {method}": row(problem, method)
        for name, problem in problems().items()
        for method in ("importance", "subset")
    }

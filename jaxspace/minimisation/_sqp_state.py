"""State of a search by quadratic programmes (`_sqp.py`): its fields, its start and its end."""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ._gradient_check import GRADIENT_TOLERANCE, PROBES, Probes, probes

# Steps without a gain beyond rounding after which a search ends, and the largest gradient at which
# it is then at its minimum, in square roots of a rounding.
MOST_STILL, NEAR_ROUNDING = 6, 60.0
# Number of accepted points that are remembered.
MOST_PAST = 4


class Values(NamedTuple):
    """Objective f, constraints c and d, derivatives g, J and K; the `report` of the caller."""

    f: Float[Array, ""]
    c: Float[Array, " equal"]
    d: Float[Array, " inequal"]
    g: Float[Array, " n"]
    J: Float[Array, "equal n"]
    K: Float[Array, "inequal n"]
    report: Any

    def sound(self) -> Bool[Array, ""]:
        """Whether all numbers and all derivatives are finite."""
        parts = (self.f, self.c, self.d, self.g, self.J, self.K)
        return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in parts if x.size]))

    def grown(self, f: Array, c: Array, d: Array) -> "Values":
        """The values with larger weights, by these factors."""
        rows = (f * self.g, c[:, None] * self.J, d[:, None] * self.K)
        return Values(f * self.f, c * self.c, d * self.d, *rows, self.report)


class Pending(NamedTuple):
    """A step p whose end point is not evaluated yet, and the multipliers of its programme."""

    p: Float[Array, " n"]
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    solved: Bool[Array, ""]


class SqpState(NamedTuple):
    """State of the search between two steps.

    - `y`, `nu`: multipliers of c and d.
    - `shift`: second-order correction of (c, d).
    - `still`: steps in sequence whose predicted gain is rounding, and which do not reduce the
      gradient.
    - `past`: objective, penalty and gradient at the last accepted points, the latest first.
    - `weight`, `size`: scales of (f, c, d) and of the unknowns.
    - `rows`: history.
    - `start`: unknowns at the start; `judged`: whether the convergence is confirmed by the scales
      here (`_local_scale.py`); `displaced`: whether `trial` is the point that decides it;
      `judgements`: how often the weights have grown.
    - `calls`: number of the next evaluation. Below zero it probes the gradient; zero is the start.
    - `probed`: values at the probes; `level`: reductions of their distance; `unclear`: whether they
      must come nearer; `wrong`: the error of the gradient against their differences; `worst`: the
      row of (f, c, d) where it is largest.
    - `taken`: steps of this search; `steps`: also those of the searches that it continues;
      `left_out`: those to a place whose numbers are not finite; `refused`: the report of the last
      of these."""

    x: Float[Array, " n"]
    at: Values
    B: Float[Array, "n n"]
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    rho: Float[Array, ""]
    radius: Float[Array, ""]
    shift: tuple[Float[Array, " equal"], Float[Array, " inequal"]]
    corrected: Bool[Array, ""]
    hopeless: Bool[Array, ""]
    still: Int[Array, ""]
    past: Float[Array, "places 3"]
    gradient: Float[Array, ""]
    violation: Float[Array, ""]
    taken: Int[Array, ""]
    rows: Float[Array, "steps 3"]
    trial: Float[Array, " n"]
    pending: Pending
    weight: Float[Array, " all"]
    start: Float[Array, " n"]
    judged: Bool[Array, ""]
    displaced: Bool[Array, ""]
    judgements: Int[Array, ""]
    calls: Int[Array, ""]
    probed: Float[Array, "4 all"]
    level: Int[Array, ""]
    unclear: Bool[Array, ""]
    wrong: Float[Array, ""]
    worst: Int[Array, ""]
    size: Float[Array, " n"]
    steps: Int[Array, ""]
    left_out: Int[Array, ""]
    refused: Any

    def resumed(self, rows: Array) -> "SqpState":
        """The state from which the search continues, with space for further `rows`."""
        # A step pending at its end is evaluated first.
        return self._replace(rows=rows, taken=jnp.asarray(0))


class Evaluation(NamedTuple):
    """An evaluation of the problem: values of f, c and d together, their Jacobian, the report."""

    values: Float[Array, " all"]
    jacobian: Float[Array, "all n"]
    report: Any


class Limits(NamedTuple):
    """Bounds of the scaled unknowns, which may be infinite, the tolerance for the projected
    gradient of the Lagrangian and the violation, both scaled, and the largest size of the
    unknowns."""

    lower: Float[Array, " n"]
    upper: Float[Array, " n"]
    tolerance: Float[Array, ""]
    farthest: Float[Array, ""]


def probes_of(x: Float[Array, " n"], limits: Limits, level: Int[Array, ""] | int = 0) -> Probes:
    """The probes of the gradient about a start, after so many reductions of their distance."""
    return probes(x, jnp.ones_like(x), limits.lower, limits.upper, level)


def begin(
    x: Float[Array, " n"],
    size: Float[Array, " n"],
    me: int,
    mi: int,
    report: PyTree,
    max_steps: int,
    check: bool,
    limits: Limits,
) -> SqpState:
    """The state before the first evaluation.

    **Arguments**

    - `x`: scaled unknowns at the start; `size`: their scales.
    - `me`, `mi`: numbers of equalities and inequalities.
    - `report`: a tree of the shapes of the report of the problem.
    - `check`: whether the gradient is compared with differences first."""
    n = x.size
    rows = 1 + me + mi
    zeros = functools.partial(jnp.zeros, dtype=x.dtype)
    at = Values(zeros(()), zeros(me), zeros(mi), zeros(n), zeros((me, n)), zeros((mi, n)), report)
    one = jnp.ones((), x.dtype)
    no = jnp.asarray(False)
    calls = jnp.asarray(-PROBES if check else 0)
    probed = probes_of(x, limits)
    return SqpState(
        x, at, jnp.eye(n, dtype=x.dtype), zeros(me), zeros(mi), 10.0 * one, one,
        (zeros(me), zeros(mi)), no, no, jnp.asarray(0), zeros((MOST_PAST, 3)),
        jnp.inf * one, jnp.inf * one, jnp.asarray(0), jnp.full((max_steps, 3), jnp.nan, x.dtype),
        x + probed.shares[0] * probed.direction if check else x,
        Pending(zeros(n), zeros(me), zeros(mi), no), jnp.ones(rows, x.dtype),
        x, no, no, jnp.asarray(0), calls,
        zeros((PROBES, rows)), jnp.asarray(0), no, zeros(()), jnp.asarray(0), size,
        jnp.asarray(0), jnp.asarray(0), report,
    )  # fmt: skip


def unfinished(s: SqpState, limits: Limits) -> Bool[Array, ""]:
    """Whether the search needs another evaluation."""
    sound = (s.wrong <= GRADIENT_TOLERANCE) & s.at.sound()
    goes_on = (
        ~(met(s, limits) & s.judged)
        & ~s.hopeless
        & ~at_rounding(s, limits)
        & (s.taken < s.rows.shape[0])
        & ~stalled(s)
        & sound
    )
    return (s.calls <= 0) | (s.displaced & sound) | (goes_on & ~diverged(s, limits))


def stalled(s: SqpState) -> Bool[Array, ""]:
    """Whether a step within the radius changes only the last two digits of the scaled unknowns."""
    return s.radius <= 1e2 * jnp.finfo(s.x.dtype).eps


def met(s: SqpState, limits: Limits) -> Bool[Array, ""]:
    """Whether gradient and violation meet the tolerance with the weights of the search."""
    return (s.gradient <= limits.tolerance) & (s.violation <= limits.tolerance)


def at_rounding(s: SqpState, limits: Limits) -> Bool[Array, ""]:
    """Whether the search is at the minimum as far as the rounding of the objective shows it.

    Several steps of different lengths would gain no more than that, and none of them reduces the
    gradient, which is then about the square root of the rounding."""
    small = s.gradient <= NEAR_ROUNDING * jnp.sqrt(jnp.finfo(s.x.dtype).eps)
    return (s.still >= MOST_STILL) & small & (s.violation <= limits.tolerance)


def diverged(s: SqpState, limits: Limits) -> Bool[Array, ""]:
    """Whether the unknowns are beyond `farthest`: the search diverges."""
    return jnp.max(jnp.abs(s.x)) > limits.farthest

"""Objective and constraints of an optimisation problem, and its minimum."""

import enum
from collections.abc import Sequence
from typing import Any, TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import InputError
from ..core.checks import is_concrete
from ..core.listed import no_method
from ..core.printing import printed
from ..core.structure import HashedModule

Point: TypeAlias = PyTree[Float[Array, "..."]]


@final
@printed()
class Criterion(eqx.Module):
    """Objective and constraints of a problem at a point.

    - `objective`: the minimised value.
    - `equal_zero`, `non_negative`: the constraints c and d, arrays, or `None` where there are none.
    - `report`: further values that the caller needs at the minimum.
    """

    objective: Float[Array, ""]
    equal_zero: Float[Array, "..."] | None = None
    non_negative: Float[Array, "..."] | None = None
    report: PyTree = None


class StopReason(enum.IntEnum):
    """Why a search ended."""

    CONVERGED = 0
    STEP_LIMIT = 1
    INFEASIBLE = 2
    NO_PROGRESS = 3
    NOT_FINITE = 4
    WRONG_GRADIENT = 5
    INTERRUPTED = 6
    UNBOUNDED = 7
    ROUNDED = 8


SENTENCES = {
    StopReason.CONVERGED: "Converged after {steps} steps: {numbers}.",
    StopReason.ROUNDED: (
        "Converged after {steps} steps to the rounding error of the objective, without reaching "
        "the tolerance{asked} of the gradient: {numbers}."
    ),
    StopReason.STEP_LIMIT: (
        "Stopped at the maximum number of steps, {steps}, without reaching the tolerance{asked}: "
        "{numbers}. Increase max_steps{wider}, or start closer."
    ),
    StopReason.INFEASIBLE: (
        "The constraints cannot be satisfied from this start: at the least violation found, "
        "{unmet}."
    ),
    StopReason.NO_PROGRESS: (
        "No step improves the result further, and the tolerance{asked} is not reached: {numbers}. "
        "Improve the scaling{wider}, or use a larger tolerance."
    ),
    StopReason.NOT_FINITE: "{infinite}{where}, and no step leads to a finite value.",
    StopReason.WRONG_GRADIENT: (
        "The gradient at the start disagrees with finite differences of {wrong}: the search was "
        "not started."
    ),
    StopReason.UNBOUNDED: (
        "The unknowns are {farthest:.0e} times their scale after {steps} steps, where the "
        "objective is {objective:.3g}: it may be unbounded below. Give bounds, or a larger scale "
        "if the optimum is far away."
    ),
    StopReason.INTERRUPTED: "Interrupted after {steps} steps: {numbers}.",
}


# The reasons at which another scale may help.
SHORT_OF_IT = (StopReason.STEP_LIMIT, StopReason.INFEASIBLE, StopReason.NO_PROGRESS)
# Quotient of the sizes of two unknowns from which on a search may stop early.
UNEVEN = 1e3
# How many of the constraints that are not met a sentence names.
MOST_NAMED = 4
# A constraint whose scaled violation is below this part of the largest one counts as met.
MET = 1e-6
# In sizes of the unknowns. A descent that doubles each step gets there after about 35 steps.
FARTHEST = 1e10


def farthest(z: Float[Array, " n"], most: float = FARTHEST) -> Float[Array, ""]:
    """Largest size of the scaled unknowns of a search that starts at z.

    Beyond it the objective most likely has no minimum, and steps of unit size are lost in
    rounding."""
    most = min(most, 1.0 / float(jnp.finfo(z.dtype).eps))
    return most * jnp.maximum(1.0, jnp.max(jnp.abs(z)))


def stop_reason(
    finite: Bool[Array, ""],
    converged: Bool[Array, ""],
    limited: Bool[Array, ""],
    infeasible: Bool[Array, ""],
    diverged: Bool[Array, ""],
) -> Int[Array, ""]:
    """The reason why the search ended, where several may apply.

    - `infeasible`: the constraints are violated, and no step reduces that (`_infeasibility.py`).
    - `diverged`: the unknowns are beyond `farthest`."""
    # Later lines override those above: numbers that are not finite override every other reason.
    reason = jnp.where(limited, StopReason.STEP_LIMIT, StopReason.NO_PROGRESS)
    # It overrides the limit of steps, because more of them would not help.
    reason = jnp.where(infeasible, StopReason.INFEASIBLE, reason)
    reason = jnp.where(diverged, StopReason.UNBOUNDED, reason)
    reason = jnp.where(converged, StopReason.CONVERGED, reason)
    return jnp.where(finite, reason, StopReason.NOT_FINITE).astype(int)


@final
@printed(reason=StopReason)
class Minimum(HashedModule):
    """The result of `minimise`.

    - `x`: the minimum.
    - `criterion`: the criterion at `x`; `objective` is the value of its objective.
    - `multipliers`: lambda and nu at the positions of c and d, with 1 for f: grad f + lambda . grad
      c
      - nu . grad d = 0. For an infeasible problem they are meaningless weights of the search.
    - `gradient`: the largest component of that sum in the scaled unknowns, which is compared with
      the tolerance.
    - `violation`: the largest violation of a constraint, in the unit of that constraint.
    - `steps`: of all descents.
    - `converged`: whether gradient and violation reached the tolerance, or the gradient is as small
      as the rounding of the objective allows (`StopReason.ROUNDED`).
    - `gradient_error`: the relative difference between the gradient and finite differences at the
      start; zero if not checked. Above 1e-3 the gradient is wrong.
    - `reason`: why the search ended, a `StopReason`; `sentence()` explains it.
    - `bound_multipliers`: the derivative of the objective with respect to each active bound, at the
      position of its unknown in x; about zero elsewhere.
    - `history`: objective, scaled violation and scaled gradient after each step, (rows, 3), NaN for
      steps not taken.
    - `left_out`: number of steps skipped because they led to values that are not finite.
    - `refused`: the criterion at the last skipped step; zeros if there was none.
    - `search`: the state of the search, from which `minimise` can continue.
    - `tolerance`: the tolerance of the scaled gradient and violation.
    """

    x: Point
    criterion: Criterion
    multipliers: Criterion
    gradient: Float[Array, ""]
    violation: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]
    gradient_error: Float[Array, ""]
    reason: Int[Array, ""]
    bound_multipliers: Point
    history: Float[Array, "rows 3"]
    left_out: Int[Array, ""]
    search: PyTree = None
    refused: Criterion | None = None
    tolerance: Float[Array, ""] | None = None

    @property
    def objective(self) -> Float[Array, ""]:
        """The value of the objective at `x`."""
        return self.criterion.objective

    def plot(self, title: str = "") -> Any:
        """A figure of the history, with matplotlib. Raises `ImportError` without it."""
        from ..plots import convergence_figure

        return convergence_figure(self.history, title)

    def sentence(self, unmet: Sequence[str] | None = None) -> str:
        """A message why the search ended; for a search that did not reach the tolerance it includes
        the violated constraints and a remedy. For a concrete result of one run. - `unmet`: a clause
        for each violated constraint, instead of its number.

        Raises `InputError` for several runs, or under `jit`."""
        if not is_concrete(self.reason) or self.reason.ndim > 0:
            raise InputError("Minimum.sentence describes a single concrete run: select one.")
        numbers = f"gradient {float(self.gradient):.1e}, violation {float(self.violation):.1e}"
        if int(self.left_out):
            numbers += f", {int(self.left_out)} steps skipped because not finite"
        if unmet is None:
            equal, above = self.unmet
            unmet = [
                *_named("equal_zero", self.criterion.equal_zero, equal, "0"),
                *_named("non_negative", self.criterion.non_negative, above, "at least 0"),
            ]
        short = self.gradient.dtype == jnp.float32
        reason = StopReason(int(self.reason))
        helps = self._sizes() if reason in SHORT_OF_IT else ""
        sentence = SENTENCES[reason].format(
            numbers=", ".join([numbers, listed(unmet)]) if unmet else numbers,
            steps=int(self.steps),
            objective=float(self.criterion.objective),
            farthest=self._farthest(),
            unmet=listed(unmet),
            wrong=worst_number(self),
            infinite=self._infinite(),
            where=f" after {int(self.steps)} steps" if int(self.steps) else " at the start",
            asked="" if self.tolerance is None else f" {float(self.tolerance):.1e}",
            wider=", compute in float64 (jaxspace.enable_x64)" if short else "",
        )
        return f"{sentence} {helps}" if helps else sentence

    @property
    @no_method
    def unread(self) -> tuple[str, ...]:
        """The unknowns with respect to which the derivative that differs most from finite
        differences is exactly zero at the start or end of the search, for a concrete result of one
        run."""
        if self.search is None:
            return ()
        at = self.search.at
        row = np.concatenate([at.g[None], at.J, at.K])[int(self.search.worst)]
        return tuple(np.array(self._names())[row == 0.0].tolist())

    def _names(self) -> list[str]:
        """The name of each unknown."""
        return [
            (jax.tree_util.keystr(path, simple=True, separator=".") or "x") + index
            for path, leaf in jax.tree_util.tree_flatten_with_path(self.x)[0]
            for index in ([f"[{k}]" for k in range(leaf.size)] if leaf.ndim else [""])
        ]

    def _sizes(self) -> str:
        """Advice about unknowns with unit scale next to much larger ones; empty where there are
        none."""
        size = np.ravel(np.asarray(getattr(self.search, "size", 1.0)))
        largest = int(np.argmax(size))
        ones = np.flatnonzero(size == 1.0)
        if size[largest] < UNEVEN or not ones.size:
            return ""
        names = self._names()
        return (
            f"{names[ones[0]]} has the scale 1, because it starts near zero, and {names[largest]} "
            f"has {size[largest]:.3g}: pass typical changes with minimise(scale=...)."
        )

    def _farthest(self) -> float:
        """The largest of the unknowns, in its size."""
        x = np.concatenate([np.ravel(np.asarray(x)) for x in jax.tree.leaves(self.x)])
        size = np.ones_like(x) if self.search is None else np.asarray(self.search.size)
        return float(np.max(np.abs(x / size)))

    def _infinite(self) -> str:
        """Clauses on the numbers that are not finite; or a note that a derivative is not."""
        criterion = self.criterion
        parts = [("The objective", "", criterion.objective)]
        parts += [
            ("", "equal_zero", criterion.equal_zero),
            ("", "non_negative", criterion.non_negative),
        ]
        clauses = []
        for title, name, values in parts:
            if values is None:
                continue
            for place, x in zip(_places(values), np.ravel(np.asarray(values)), strict=True):
                if not np.isfinite(x):
                    clauses.append(f"{title or name + place} is {x:g}")
        return listed(clauses) or "A derivative of the objective or of a constraint is not finite"

    @property
    def influence(self) -> Point:
        """The largest derivative of objective and constraints with respect to each unknown, scaled
        as in the search; zero for an unknown without influence there. For one run.

        Raises `InputError` for a `Minimum` without the state of its search."""
        if self.search is None:
            raise InputError(
                "Minimum.influence requires the state of the search, which this Minimum does not "
                "contain."
            )
        at = self.search.at
        rows = jnp.abs(jnp.concatenate([at.g[None], at.J, at.K]))
        return ravel_pytree(self.x)[1](jnp.max(rows, axis=0))

    @property
    @no_method
    def unmet(self) -> tuple[Bool[np.ndarray, " equal"], Bool[np.ndarray, " inequal"]]:
        """The violated equalities and inequalities, flattened, for a concrete result of one run.

        No entry is true if the search converged or was not started."""
        parts = (self.criterion.equal_zero, self.criterion.non_negative)
        c, d = (np.zeros(0) if x is None else np.ravel(np.asarray(x)) for x in parts)
        # Violations in different units cannot be compared: the weights of the search scale them.
        weight = np.ones(c.size + d.size)
        if self.search is not None:
            weight = np.asarray(self.search.weight)[1:]
        missed = weight * np.concatenate([np.abs(c), np.maximum(-d, 0.0)])
        met = MET * np.nanmax(missed, initial=0.0)
        if int(self.reason) != StopReason.INFEASIBLE and self.tolerance is not None:
            met = max(met, float(self.tolerance))
        none = (StopReason.CONVERGED, StopReason.ROUNDED, StopReason.WRONG_GRADIENT)
        begun = int(self.reason) not in none
        # `~(missed <= met)` is true for NaN too: a constraint that is not finite is not met.
        flags = begun & ~(missed <= met)
        return flags[: c.size], flags[c.size :]


def worst_number(minimum: Minimum) -> str:
    """Name of the value whose gradient differs most from finite differences, for one run."""
    names = ["the objective"]
    for name in ("equal_zero", "non_negative"):
        values = getattr(minimum.criterion, name)
        names += [] if values is None else [name + place for place in _places(values)]
    return names[0] if minimum.search is None else names[int(minimum.search.worst)]


def _named(name: str, values: Array | None, flags: np.ndarray, asked: str) -> list[str]:
    """Each flagged constraint with its value and the value required."""
    if values is None:
        return []
    flat = np.ravel(np.asarray(values))
    rows = zip(_places(values), flat, flags, strict=True)
    return [f"{name}{place} is {x:.3g} where {asked} is required" for place, x, on in rows if on]


def _places(values: Array) -> list[str]:
    """The index of each entry of a flat array; empty for a number."""
    return [f"[{k}]" if np.ndim(values) else "" for k in range(np.size(values))]


def listed(clauses: Sequence[str]) -> str:
    """The first few of the clauses, and the number of the others."""
    more = len(clauses) - MOST_NAMED
    shown = ", ".join(clauses[:MOST_NAMED])
    return f"{shown}, and {more} more" if more > 0 else shown

"""The result of a search for the best design under dispersion."""

from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.tree_util import keystr, tree_leaves_with_path

from ..core.listed import Listed
from ..core.structure import HashedModule
from ..core.text import aligned
from ..minimisation import Criterion, Minimum
from ..minimisation.batch_descent import BatchMinimum
from ._runs import Design, Problem, RunsOfDesign, failures

# By less than this part of its size a quadratic programme moves an unknown that nothing depends on,
# towards the middle of its bounds.
DRIFT = 1e-6


@final
class DesignOptimum(HashedModule):
    """The best design that a search found, on the runs of the search.

    - `x`: the best design.
    - `start`: the initial design of the search.
    - `criterion`: objective and margins of the limits on these runs; for an objective to maximise,
      the negative.
    - `minimum`: the result of `minimise`, with multipliers and history; of `train_design` that of
      its steps.
    - `problem`: the minimised problem and its runs.
    - `seed`: of the random numbers of these runs.

    The runs of the search flatter their optimum: `assess_designs` has fresh ones."""

    x: Design
    start: Design
    criterion: Criterion
    minimum: Minimum | BatchMinimum
    problem: Problem
    seed: int = eqx.field(static=True)

    @property
    def objective(self) -> float:
        """The value of the objective on the runs of the search: the greatest of an objective to
        maximise, without the sign of `criterion`."""
        return self.problem.sign * float(self.criterion.objective)

    @property
    def converged(self) -> bool:
        """Whether the search met its tolerance."""
        return bool(self.minimum.converged)

    @property
    def runs(self) -> RunsOfDesign:
        """The outputs of the runs of the search for the design, (runs,)."""
        return jax.tree.map(np.asarray, self.criterion.report)

    @property
    def without_influence(self) -> tuple[str, ...]:
        """The names of the unknowns, or of numbers of them, that the search left at their start,
        where neither objective nor constraints depend on them."""
        parts = zip(
            tree_leaves_with_path(self.minimum.influence),
            jax.tree.leaves(self.x),
            jax.tree.leaves(self.start),
            jax.tree.leaves(self._sizes),
            strict=True,
        )
        # At an optimum between bounds the derivative may be zero by chance; there the search moved.
        return Listed(
            name_of(path, index)
            for (path, influence), x, start, size in parts
            for index, number in np.ndenumerate(np.asarray(influence))
            if number == 0.0
            and abs(x[index] - np.asarray(start)[index]) <= DRIFT * np.asarray(size)[index]
        )

    @property
    def _sizes(self) -> Design:
        """The scales of the unknowns in the search; zero where unavailable."""
        search = getattr(self.minimum, "search", None)
        flat, unravel = ravel_pytree(self.x)
        return unravel(jnp.asarray(getattr(search, "size", jnp.zeros_like(flat))))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Messages about failed runs, skipped steps, and unknowns without influence."""
        sentences = [failures(self.runs)]
        # The objective is infinite there, which a search takes for a step too far.
        if int(self.minimum.left_out):
            sentences.append(
                f"{int(self.minimum.left_out)} steps were skipped: for their designs more than a "
                f"fraction of {self.problem.may_fail:g} of the runs fail, or values are not finite."
            )
            sentences.append(self._at_the_last_of_them())
        if self.without_influence:
            names = ", ".join(self.without_influence)
            sentences.append(
                f"Neither objective nor constraints depend on {names}: omit it, or start where it "
                "has an influence."
            )
        return Listed(sentence for sentence in sentences if sentence)

    def _at_the_last_of_them(self) -> str:
        """Why runs failed at the last step that was left out; empty where it is not known."""
        # A search by batches has no such report: each of its steps has other runs.
        refused = getattr(self.minimum, "refused", None)
        failed = "" if refused is None else failures(refused.report)
        return f"At the last of them {failed}" if failed else ""

    def sentence(self) -> str:
        """Why the search ended, in words."""
        margins = self._margins
        minimum = self.minimum
        # A search by batches has no tolerance: whatever is beyond its limit is missed.
        missed = minimum.unmet[1] if isinstance(minimum, Minimum) else margins < 0.0
        unmet = [
            f"the {constraint.text()} is missed by {-margin:.3g}"
            for constraint, margin, flag in zip(
                self.problem.constraints, margins, missed, strict=True
            )
            if flag
        ]
        return self.minimum.sentence(unmet)

    def plot(self, title: str = "") -> Any:
        """A figure of the course of the search, with matplotlib. Raises `ImportError` without
        it."""
        from ..plots import convergence_figure

        # The search minimises: of what is to be greatest its history has the negative.
        history = self.minimum.history * jnp.asarray([self.problem.sign, 1.0, 1.0])
        return convergence_figure(history, title)

    @property
    def _margins(self) -> np.ndarray:
        margins = self.criterion.non_negative
        return np.zeros(0) if margins is None else np.asarray(margins)

    def __repr__(self) -> str:
        problem = self.problem
        rows = [(problem.objective.text(), f"{self.objective:.6g}")]
        for constraint, margin in zip(problem.constraints, self._margins, strict=True):
            # A margin is the distance from the limit, on the side that is allowed.
            sign = -1.0 if constraint.upper else 1.0
            rows.append((constraint.label(), f"{constraint.limit + sign * float(margin):.6g}"))
        for path, leaf in tree_leaves_with_path(self.x):
            name = name_of(path, ())
            rows.append((name, " ".join(f"{number:.6g}" for number in np.ravel(leaf))))
        count = self.runs.status.size
        # The nominal problem has a single run.
        title = f"Design on {count} runs of seed {self.seed}" if count > 1 else "Nominal design"
        lines = [f"  {line}" for line in aligned(rows).splitlines()]
        return "\n".join([title, *lines, *(f"  {x}" for x in (self.sentence(), *self.warnings))])


def name_of(path: Any, index: tuple[int, ...]) -> str:
    """The name of a number of a design."""
    # A design that is a single number has no path.
    name = keystr(path, simple=True, separator=".") or "x"
    return name + "".join(f"[{place}]" for place in index)

"""Step control for one run or many that share their steps.

The error of a step is measured for each run in units of the tolerance (`tolerances.py`). A shared
step is accepted if the error of the worst run is within the tolerance. A run that is no longer
finite does not count: its status reports it, and other runs are not affected.

Normalised time runs from 0 to the number of segments. A step never crosses a whole number, so that
no event there (a burnout, a kink of a table) is inside of a step.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4 (starting step,
control).
"""

from collections.abc import Callable
from typing import NamedTuple, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import Scalar, State
from ..core.barrier import barrier
from .tolerances import Tolerance

SAFETY = 0.8
SHRINK = 0.2
GROW = 8.0
# Fraction of a segment. A step this short is accepted with any error, which the status reports:
# shorter steps would only exhaust `max_steps`.
SMALLEST_STEP = 1e-10
# Fraction of a segment. A first step that is too long costs one or two rejections; one that is too
# short costs many steps until it has grown.
FIRST_STEP = 1e-2

VectorField = Callable[..., State]
Decision = tuple[
    Bool[Array, ""] | bool,
    Float[Array, ""],
    Float[Array, ""],
    Bool[Array, ""] | bool,
    PyTree,
    diffrax.RESULTS,
]
"""What `adapt_step_size` returns: whether the step is accepted, start and end of the next one,
whether the vector field may jump between them, the state of the controller, and the result."""


# Fraction of the worst error: a run with a larger error limits the step of the others.
LIMITING = 0.5


class StepControl(NamedTuple):
    """State of the control of shared steps.

    - `proposal`: the length of the next step, in normalised time.
    - `limiting`: number of the accepted steps that were limited by each run."""

    proposal: Float[Array, ""]
    limiting: Int[Array, "*runs"]


@final
class BatchStepController(diffrax.AbstractStepSizeController):
    """Steps as long as the worst of the runs allows, which end on every whole number.

    - `tolerance`: the allowed error of a step.
    - `lengths`: the relative lengths of the segments, so that a step keeps its length in time from
      one to the next.
    - `longest`: the longest step that is allowed in each segment, in normalised time.
    - `first_step`: the length from which the first step is found by trial, in normalised time, such
      as `FIRST_STEP`. This costs a step or two, and saves another copy of the vector field in the
      program; by default the first step is estimated.
    """

    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    longest: Float[Array, " segments"] | None = None
    first_step: float | None = None

    def wrap(self, direction: Int[Array, ""] | int) -> "BatchStepController":
        del direction
        return self

    def init(
        self,
        terms: diffrax.AbstractTerm,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        dt0: None,
        args: PyTree,
        func: VectorField,
        error_order: Scalar,
    ) -> tuple[Float[Array, ""], StepControl]:
        del t1, dt0

        def f(s: Array, y: State) -> State:
            return func(terms, s, y, args)

        if self.first_step is None:
            ds = self._starting_step(f, t0, y0, error_order)
        else:
            ds = jnp.full_like(t0, self.first_step)
        limiting = jnp.zeros(self.tolerance.alive(y0).shape, jnp.int32)
        return self._end_of_step(t0, ds), StepControl(ds, limiting)

    def adapt_step_size(
        self,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        y1_candidate: State,
        args: PyTree,
        y_error: State,
        error_order: Scalar,
        controller_state: StepControl,
        *,
        at_least: Float[Array, "*runs"] | None = None,
    ) -> Decision:
        """As diffrax has it; `at_least`: further errors of the runs, such as of their tangents, in
        units of the tolerance."""
        del args
        before, limiting = controller_state
        ds = t1 - t0
        errors = self.tolerance.error(y0, y1_candidate, y_error)
        # Without derivatives, because these hold the accepted steps fixed.
        errors = jax.lax.stop_gradient(jnp.where(self.tolerance.alive(y0), errors, 0.0))
        if at_least is not None:
            errors = jnp.maximum(errors, at_least)
        worst = jnp.max(errors)
        # In single precision, or after many segments, the rounding of the time is the limit.
        resolved = 16.0 * jnp.finfo(t0.dtype).eps * (1.0 + t0)
        smallest = jnp.maximum(SMALLEST_STEP, resolved).astype(t0.dtype)
        accept = (worst <= 1.0) | (ds <= 1.5 * smallest)
        factor = SAFETY * jnp.clip(worst, 1e-12, 1e12) ** (-1.0 / error_order)
        # A rejected step must become shorter, whatever its error estimate.
        most = jnp.where(accept, GROW, SAFETY)
        # A first step, which may be far too long, becomes as short as its error says.
        least = jnp.where(jnp.any(limiting > 0), SHRINK, 0.0)
        factor = jnp.clip(factor, least, most).astype(ds.dtype)
        proposal = ds * factor
        # A step that was shortened to land does not reduce the proposed length.
        was_cut = accept & (ds < before)
        proposal = jnp.where(was_cut, jnp.maximum(before, proposal), proposal)
        limiting = limiting + (accept & (errors >= LIMITING * worst)).astype(limiting.dtype)
        start = jnp.where(accept, t1, t0)
        landed = accept & (t1 == jnp.round(t1))
        # The same length in time in the next segment, but not shorter than a first step, because
        # the cause of short steps may have ended here.
        rescaled = proposal * self._of_segment(self.lengths, t0)
        rescaled = rescaled / self._of_segment(self.lengths, start)
        next_segment = jnp.maximum(rescaled, FIRST_STEP)
        proposal = jnp.where(landed, next_segment, jnp.maximum(proposal, smallest))
        end = self._end_of_step(start, proposal)
        state = StepControl(proposal, limiting)
        if self.tolerance.run_axes:
            # All that a step of many runs leaves is selected by them.
            accept, start, end, landed, state = barrier((accept, start, end, landed, state))
        return accept, start, end, landed, state, diffrax.RESULTS.successful

    def _end_of_step(self, s: Float[Array, ""], ds: Float[Array, ""]) -> Float[Array, ""]:
        """The end of a step of about `ds` from `s`, at most at the next whole number."""
        node = jnp.floor(s) + 1.0
        left = node - s
        if self.longest is not None:
            # Equal steps up to the node, none longer than allowed.
            count = jnp.ceil(left / self._of_segment(self.longest, s) - 1e-6)
            ds = jnp.minimum(ds, left / jnp.maximum(count, 1.0))
        # Two equal steps to the node are better than a long one and a very short one.
        short_of_node = s + jnp.where(ds > 0.5 * left, 0.5 * left, ds)
        return jnp.where(ds >= 0.999 * left, node, short_of_node)

    def _starting_step(
        self, f: VectorField, s: Float[Array, ""], y0: State, order: Scalar
    ) -> Float[Array, ""]:
        """The length of the first step (Hairer, Norsett, Wanner II.4), for the worst run."""
        tol = self.tolerance
        scale = jax.tree.map(tol.length, y0)
        d0 = tol.largest(y0, scale)
        alive = tol.alive(y0)

        def trial_length(f0: State) -> Float[Array, ""]:
            d1 = tol.largest(f0, scale)
            safe = jnp.where(d1 > 0.0, d1, 1.0)
            h0 = jnp.where((d0 < 1e-5) | (d1 < 1e-5), 1e-6, 0.01 * d0 / safe)
            # At rest, or in a segment of no length.
            h0 = jnp.where(d1 == 0.0, 1.0, h0)
            h0 = jnp.where(jnp.isfinite(h0) & alive, h0, 1.0)
            return jnp.minimum(jnp.min(h0), 1.0).astype(s.dtype)

        def evaluate(i: Array, before: tuple[Array, State, State]) -> tuple[Array, State, State]:
            h, _, k = before
            rate = f(s + h, jax.tree.map(lambda y, k: y + h.astype(y.dtype) * k, y0, k))
            return jnp.where(i == 0, trial_length(rate), h), k, rate

        # A loop, so that the program holds the vector field once: for the start, and for the end of
        # a step of Euler's method.
        still = jax.tree.map(jnp.zeros_like, y0)
        h0, f0, f1 = jax.lax.fori_loop(0, 2, evaluate, (jnp.zeros_like(s), still, still))
        d1 = tol.largest(f0, scale)
        d2 = tol.largest(jax.tree.map(jnp.subtract, f1, f0), scale) / h0
        d = jnp.maximum(d1, d2)
        # The root of the worst run only, because one for each run would cost as much as a stage.
        worst = jnp.max(jnp.where(jnp.isfinite(d) & alive, d, 0.0))
        h1 = jnp.where(
            worst <= 1e-15,
            jnp.maximum(1e-6, h0),
            (0.01 / jnp.where(worst > 0.0, worst, 1.0)) ** (1.0 / order),
        )
        ds = jnp.clip(jnp.minimum(100.0 * h0, h1), SMALLEST_STEP, 1.0)
        return jax.lax.stop_gradient(ds).astype(s.dtype)

    @staticmethod
    def _of_segment(values: Float[Array, " segments"], s: Float[Array, ""]) -> Float[Array, ""]:
        """The one of the `values` for the segment that begins at or contains `s`; the last one
        beyond the end."""
        if values.shape[0] == 1:
            return values[0]
        return values[jnp.clip(jnp.floor(s).astype(int), 0, values.shape[0] - 1)]


@final
class StepTo(diffrax.AbstractStepSizeController):
    """Steps that were fixed beforehand.

    Unlike diffrax's controller of this name it reports a jump at every whole number.

    - `plan`: start and ends of the steps in normalised time, with every whole number among them.
    """

    plan: Float[Array, " nodes"]

    def wrap(self, direction: Int[Array, ""] | int) -> "StepTo":
        del direction
        return self

    def init(
        self,
        terms: diffrax.AbstractTerm,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        dt0: None,
        args: PyTree,
        func: VectorField,
        error_order: Scalar | None,
    ) -> tuple[Float[Array, ""], Int[Array, ""]]:
        del terms, t0, t1, y0, dt0, args, func, error_order
        return self.plan[1], jnp.asarray(2)

    def adapt_step_size(
        self,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        y1_candidate: State,
        args: PyTree,
        y_error: State | None,
        error_order: Scalar | None,
        controller_state: Int[Array, ""],
    ) -> Decision:
        del t0, y0, y1_candidate, args, y_error, error_order
        landed = t1 == jnp.round(t1)
        end = self.plan[controller_state]
        return True, t1, end, landed, controller_state + 1, diffrax.RESULTS.successful

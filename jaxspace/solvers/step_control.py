"""Step control of each run.

The error of a step is measured for each run in units of the tolerance (`tolerances.py`). A run
accepts its step if the error is within the tolerance.

Normalised time runs from 0 to the number of segments. A step never crosses a whole number, so that
no event there (a burnout, a kink of a table) is inside of a step.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4 (starting step,
control).
"""

from collections.abc import Callable
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar, State
from ..core.barrier import barrier
from .tolerances import Tolerance

SAFETY = 0.8
SHRINK = 0.2
GROW = 8.0
# After a rejection: enough to correct its estimate, and too little to return to what was rejected.
GROW_AFTER_REJECTION = 1.5
# The error of the first step after a break determines the length of the next one.
BEHIND_BREAK = 100.0
# Fraction of a segment. A step this short is accepted with any error, which the status reports:
# shorter steps would only exhaust `max_steps`.
SMALLEST_STEP = 1e-10
# Fraction of a segment. A first step that is too long costs one or two rejections; one that is too
# short costs many steps until it has grown.
FIRST_STEP = 1e-2

VectorField = Callable[..., State]


class StepControl(NamedTuple):
    """State of the control of the steps of each run.

    - `proposal`: the length of the next step, in normalised time.
    - `begun`: whether a step has been accepted.
    - `rejected`: whether the step before was not."""

    proposal: Float[Array, "*runs"]
    begun: Bool[Array, "*runs"]
    rejected: Bool[Array, "*runs"]


class Following(NamedTuple):
    """The decision after a step of each run: whether it is accepted, start and end of the next one,
    whether the vector field may jump between them, and the state of the control."""

    accept: Bool[Array, "*runs"]
    start: Float[Array, "*runs"]
    end: Float[Array, "*runs"]
    jumped: Bool[Array, "*runs"]
    state: StepControl


@final
class StepController(eqx.Module):
    """Steps as long as the error of a run allows, which end on every whole number.

    All that it computes is of each run by itself, whose times are (*runs,).

    - `tolerance`: the allowed error of a step.
    - `lengths`: the relative lengths of the segments, of all runs or of each, so that the length of
      a step in time carries over from one to the next.
    - `longest`: the longest step that is allowed in each segment, in normalised time.
    - `first_step`: the length from which the first step is found by trial, in normalised time, such
      as `FIRST_STEP`. This costs a step or two, and saves another copy of the vector field in the
      program; by default the first step is estimated.
    """

    tolerance: Tolerance
    lengths: Float[Array, "segments *#runs"]
    longest: Float[Array, "segments *#runs"] | None = None
    first_step: float | None = eqx.field(static=True, default=None)

    def first(
        self, f: VectorField, s: Float[Array, "*runs"], y0: State, order: Scalar
    ) -> tuple[Float[Array, "*runs"], StepControl]:
        """The end of the first step from `s`, and the state of the control.

        `f(ds, y)` is the vector field a time `ds` after the start."""
        if self.first_step is None:
            ds = self._starting_step(f, s, y0, order)
        else:
            ds = jnp.full_like(s, self.first_step)
        no = jnp.zeros(s.shape, bool)
        return self._end_of_step(s, ds), StepControl(ds, no, no)

    def following(
        self,
        t0: Float[Array, "*#runs"],
        t1: Float[Array, "*#runs"],
        errors: Float[Array, "*runs"],
        order: Scalar,
        state: StepControl,
    ) -> Following:
        """The decision after a step from `t0` to `t1` with these `errors`, in units of the
        tolerance."""
        before, begun, rejected = state
        ds = t1 - t0
        # In single precision, or after many segments, the rounding of the time is the limit.
        resolved = 16.0 * jnp.finfo(t0.dtype).eps * (1.0 + t0)
        smallest = jnp.maximum(SMALLEST_STEP, resolved).astype(t0.dtype)
        accept = (errors <= 1.0) | (ds <= 1.5 * smallest)
        # Single precision is enough here, and a power in double precision costs as much as some
        # stages.
        size = jnp.clip(errors, 1e-12, 1e12).astype(jnp.float32)
        factor = SAFETY * jnp.exp(jnp.log(size) * (-1.0 / order)).astype(ds.dtype)
        # The cause of short steps before a break may have ended there.
        begins_segment = (t0 > 0.0) & (t0 == jnp.round(t0))
        # The cause of the rejection of a longer step, such as a kink, is still ahead. A first step,
        # which is found by trial, may have been shortened too far.
        grow = jnp.where(rejected & begun, GROW_AFTER_REJECTION, GROW)
        # A rejected step must become shorter, whatever its error estimate.
        most = jnp.where(accept, jnp.where(begins_segment, BEHIND_BREAK, grow), SAFETY)
        # A first step, which may be far too long, becomes as short as its error requires.
        least = jnp.where(begun, SHRINK, 0.0)
        factor = jnp.clip(factor, least, most).astype(ds.dtype)
        proposal = ds * factor
        # A step that was shortened to land does not reduce the proposed length.
        was_cut = accept & (ds < before)
        proposal = jnp.where(was_cut, jnp.maximum(before, proposal), proposal)
        start = jnp.where(accept, t1, t0)
        landed = accept & (t1 == jnp.round(t1))
        # The same length in time in the next segment, but not shorter than a first step, because
        # the cause of short steps may have ended here.
        rescaled = proposal
        if self.lengths.shape[0] > 1:
            rescaled = rescaled * of_segment(self.lengths, t0) / of_segment(self.lengths, start)
        next_segment = jnp.maximum(rescaled, FIRST_STEP)
        proposal = jnp.where(landed, next_segment, jnp.maximum(proposal, smallest))
        end = self._end_of_step(start, proposal)
        control = StepControl(proposal, begun | accept, ~accept)
        following = Following(accept, start, end, landed, control)
        # All that a step of many runs leaves is selected by them.
        return barrier(following) if self.tolerance.run_axes else following

    def _end_of_step(self, s: Float[Array, "*runs"], ds: Array) -> Float[Array, "*runs"]:
        """The end of a step of about `ds` from `s`, at most at the next whole number."""
        node = jnp.floor(s) + 1.0
        left = node - s
        if self.longest is not None:
            # Equal steps up to the node, none longer than allowed.
            count = jnp.ceil(left / of_segment(self.longest, s) - 1e-6)
            ds = jnp.minimum(ds, left / jnp.maximum(count, 1.0))
        # Two equal steps to the node are better than a long one and a very short one.
        short_of_node = s + jnp.where(ds > 0.5 * left, 0.5 * left, ds)
        return jnp.where(ds >= 0.999 * left, node, short_of_node)

    def _starting_step(
        self, f: VectorField, s: Float[Array, "*runs"], y0: State, order: Scalar
    ) -> Float[Array, "*runs"]:
        """The length of the first step (Hairer, Norsett, Wanner II.4)."""
        tol = self.tolerance
        scale = jax.tree.map(tol.length, y0)
        d0 = tol.worst(scale, scale)

        def trial_length(d1: Float[Array, "*runs"]) -> Float[Array, "*runs"]:
            safe = jnp.where(d1 > 0.0, d1, 1.0)
            h0 = jnp.where((d0 < 1e-5) | (d1 < 1e-5), 1e-6, 0.01 * d0 / safe)
            # At rest, or in a segment of no length.
            h0 = jnp.where(d1 == 0.0, 1.0, h0)
            h0 = jnp.where(jnp.isfinite(h0), h0, 1.0)
            return jnp.minimum(h0, 1.0).astype(s.dtype)

        def evaluate(i: Array, before: tuple[Array, State, State]) -> tuple[Array, State, State]:
            h, _, k = before
            rate = f(h, jax.tree.map(lambda y, k: y + h.astype(y.dtype) * k, y0, k))
            d1 = tol.worst(jax.tree.map(tol.length, rate), scale)
            return jnp.where(i == 0, trial_length(d1), h), k, rate

        # A loop, so that the program contains the vector field once: for the start, and for the end
        # of a step of Euler's method.
        still = jax.tree.map(jnp.zeros_like, y0)
        h0, f0, f1 = jax.lax.fori_loop(0, 2, evaluate, (jnp.zeros_like(s), still, still))
        d1 = tol.worst(jax.tree.map(tol.length, f0), scale)
        d2 = tol.worst(jax.tree.map(lambda a, b: tol.length(a - b), f1, f0), scale) / h0
        d = jnp.maximum(d1, d2)
        d = jnp.where(jnp.isfinite(d), d, 0.0)
        h1 = jnp.where(
            d <= 1e-15,
            jnp.maximum(1e-6, h0),
            (0.01 / jnp.where(d > 0.0, d, 1.0)) ** (1.0 / order),
        )
        ds = jnp.clip(jnp.minimum(100.0 * h0, h1), SMALLEST_STEP, 1.0)
        return jax.lax.stop_gradient(ds).astype(s.dtype)


def of_segment(values: Float[Array, "segments *#runs"], s: Float[Array, "*runs"]) -> Array:
    """The one of the `values` for the segment that begins at or contains `s`; the last one beyond
    the end."""
    if values.shape[0] == 1:
        return values[0]
    index = jnp.clip(jnp.floor(s).astype(int), 0, values.shape[0] - 1)
    if values.ndim == 1 or s.ndim == 0:
        return values[index]
    rows = jnp.broadcast_to(values, (values.shape[0], *s.shape))
    return jnp.take_along_axis(rows, index[None], axis=0, mode="promise_in_bounds")[0]

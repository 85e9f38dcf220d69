"""Sensitivity error control: step control by the derivatives of a run that is differentiated.

Steps chosen from the motion only resolve the motion only. Where it is at rest, or nearly a
polynomial, they become as long as the run, and a derivative along them is that of a few steps of
any accuracy: of a force that is zero, the derivative of a run without it. Some tangents are
therefore integrated together with the motion (`_tangents.py`), with errors of their own.

    |e_j|      estimate of the error that a step makes in d_j, of each block of the state
    |d_j|      largest size of the tangent so far, of each block

    |e_j| <= atol + rtol |d_j|

Along most motions the tangents need the steps that the motion needs. A first attempt therefore
chooses its steps from the motion only, and monitors the tangents at the third step, at every 24th
after it, and at each step that is `LONGER` than all those that are known to be resolved: by the
tangents, or by a motion that limits the step and moves every block of the state by `MOVED` of its
size or more. Between these steps the tangents rest. The run is repeated with the tangents in the
control of every step where

- the error of a tangent is more than `TRIGGER` times the allowed one, or `MOST_ERROR` of its size;
- a step was longer than those known to be resolved. An unknown error is not an error of zero;
- the vector field is so steep that the tangents have much larger errors than the motion.

The slope of a continuous vector field may be infinite, as that of sqrt|x| at zero. A step there
whose error e is small for the motion has an error of about e^(1/3) for the tangents, where a kink
leaves e^(1/2). Also monitored are therefore short steps: after a rejection, at the start of the run
or at the end of a segment, and those that are shortened to end at an event, without step control.
If the slope is infinite at the event itself, where the last stages of that step are evaluated, the
second run approaches the event until its steps are as short as `resting`, and the derivatives are
those of the event as seen from the start of the last step. Elsewhere the steps are shortened as far
as possible, and the run has missed the tolerance if its tangents are still not resolved.

A step limited by the motion is not sufficient evidence: at an equilibrium that is inexact due to
rounding, it is the growth of a rounding error that limits the steps once it is as large as the
tolerance. It is then resolved as little as the tangents, which grow as it does.
"""

from collections.abc import Callable
from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..solvers.protocol import bind, forward_mode, linear_errors, rolled_stages
from ..solvers.tolerances import Tolerance
from ..solvers.vector_field import ScaledField
from ._event_state import resting
from ._loop_state import LoopState
from ._tangents import Directions, Lengths, StepTaken, TangentState, lengths

SINCE, EVERY = 2, 24
"""The first of the steps that are monitored whatever their length, and the distance of those that
follow."""
LONGER, POWER = 1.25, 8
"""Factor by which a monitored step is longer than all resolved ones; and the power of the
length by which the errors in those up to this length are larger, which is that of DOP853."""
GROWING_ERROR, GROWING_LENGTH = 1e-3, 0.02
"""A step whose motion has a smaller error, in units of the tolerance, is followed by a longer one,
which is monitored in its place; unless it is longer than this fraction of a segment, at whose end
the growth ends."""
MOVED = 1e-2
"""Part of its size by which a block moves in a step that its motion resolves to a hundred
tolerances."""
USUAL, TRIGGER = 10.0, 30.0
"""Errors of a tangent, in units of the allowed error: that of tangents whose steps the motion
chooses well, and that at which the run is repeated. A tangent that a force drives grows with the
square of the time, and rests in the steps that are not monitored: the allowed error grows
accordingly."""
MOST_ERROR = 0.03
"""Error of a tangent relative to its size at which the run is repeated, at loose tolerances: after
a step that is too long the tangent itself is wrong, and as large as its error."""
MOST_SHORT = 1e-3
"""Error of a tangent relative to its size that counts after a step that is `resting`. A tangent
that is not finite after so short a step never is, and one that jumps there is off by as little."""
SHORTER, FIRST = 1.0 / 16.0, 1e-3
"""A step is monitored as a short one if it follows a rejection or ends a segment and is shorter
than this fraction of the longest step so far; the first step, if it is below this fraction of a
segment."""
STEEP = 2.0
"""Error of a tangent relative to its size, in units of the root of the tolerance, at which the run
is repeated because of a short step: about that of a kink."""


@final
class SensitivityControl(eqx.Module):
    """Step control by the tangents of `directions`.

    - `method`: that of the run, with rolled stages, because most steps do without it.
    - `term`: the vector field in the form of the method."""

    directions: Directions
    tolerance: Tolerance
    method: diffrax.AbstractSolver
    term: diffrax.AbstractTerm

    @classmethod
    def of(
        cls,
        directions: Directions,
        tolerance: Tolerance,
        method: diffrax.AbstractSolver,
        term: diffrax.AbstractTerm,
    ) -> "SensitivityControl":
        """The control of a run by this method."""
        # Nothing is saved within a step here.
        axes = tolerance.run_axes
        method = bind(rolled_stages(method), tolerance=tolerance, save_ts=None, run_axes=axes)
        return cls(directions, tolerance, linear_errors(forward_mode(method)), term)

    def monitor(
        self,
        field: ScaledField,
        step: StepTaken,
        going: Bool[Array, "*#runs"],
        at_event: Bool[Array, "*#runs"],
        state: TangentState,
    ) -> tuple[TangentState, Float[Array, "*runs"]]:
        """The tangents after this step, if it is accepted, and the errors by which they control it:
        zero in the first run, and for a step that the motion rejects or is not `going` on.

        `at_event`: whether the step is the one that ends at the event of its run."""
        # A run that has failed, or waits at its event, has no error.
        alive = self.tolerance.alive(step.y0)
        # In single precision the time may have double precision.
        duration = jnp.abs(field.duration(step.s, step.length)).astype(state.time.dtype)
        # Nothing happens in a segment of no duration, whose ends a derivative would part.
        good = going & alive & (duration != 0.0) & (step.motion <= 1.0)
        free = step.motion < GROWING_ERROR
        by_motion = ~free & self.tolerance.moved(step.y0, step.y1, MOVED)
        long = (duration > LONGER * state.resolved) & ~by_motion
        some = ((step.number % EVERY == SINCE) | long) & ~(free & (step.length < GROWING_LENGTH))
        due = good & (state.controlled | some)
        end = step.s + step.length
        short = jnp.where(
            state.longest > 0.0,
            (step.retried | (end == jnp.round(end))) & (duration < SHORTER * state.longest),
            step.length < FIRST,
        )
        # A step that is cut at the end of a segment is short as well, and mostly without an error.
        short = good & short & ~due & ~free
        steep = short | at_event & alive & (duration != 0.0)
        none = jnp.zeros_like(duration)
        taken, seen = jnp.where(good, duration, none), jnp.where(due, duration, none)
        state = state._replace(
            resolved=jnp.maximum(state.resolved, jnp.where(due | by_motion, taken, none)),
            longest=jnp.maximum(state.longest, taken),
            monitored=state.monitored + seen,
            time=state.time + taken,
        )

        # A loop of one iteration or none: of a condition the compiler does not know which arrays
        # are constant, and compiles twice what the effects compute from equal ones, such as the
        # air.
        def monitored(
            carry: tuple[Array, TangentState, Array],
        ) -> tuple[Array, TangentState, Array]:
            go, state, _ = carry
            return ~go, *self._monitored(field, step, due, steep, state)

        start = jnp.any(due | steep), state, jnp.zeros_like(step.motion)
        _, state, control = jax.lax.while_loop(lambda carry: carry[0], monitored, start)
        return state, control

    def _monitored(
        self,
        field: ScaledField,
        step: StepTaken,
        due: Bool[Array, "*runs"],
        steep: Bool[Array, "*runs"],
        state: TangentState,
    ) -> tuple[TangentState, Array]:
        """As `monitor`: in the steps that are `due`, and in those monitored as `steep` only."""
        tolerance = self.tolerance
        tangents, errors = self.directions.after(
            self.method, self.term, field, step, state.tangents
        )
        counts = (due | steep) & tolerance.alive(step.y1)
        sizes, errors = (
            jax.tree.map(lambda x: jnp.where(counts, x, 0.0), lengths(tolerance, d))
            for d in (tangents, errors)
        )
        sizes = jax.tree.map(jnp.maximum, state.sizes, sizes)
        ratios = self._ratios(errors, sizes)
        # A tangent that was finite, and is not after a long step, may be after a short one.
        ratios = jnp.where(jnp.isfinite(ratios), ratios, jnp.inf)
        large = jnp.isfinite(ratios) & (ratios > MOST_SHORT / tolerance.rtol)
        ratios = jnp.where((step.length > resting(step.s)) | large, ratios, 0.0)
        controlled = jax.vmap(tolerance.alive)(state.tangents) & counts & state.controlled
        control = jnp.max(jnp.where(controlled, ratios, 0.0), axis=0)
        errors = jax.tree.map(jnp.maximum, state.errors, errors)
        # Selected here and not with the state of the loop, because most steps do without it.
        taken = due & (control <= 1.0)
        worst = jnp.where(counts & steep, jnp.max(ratios, axis=0), 0.0).astype(state.steep.dtype)
        tangents, sizes, errors = jax.tree.map(
            lambda new, old: jnp.where(taken, new, old),
            (tangents, sizes, errors),
            (state.tangents, state.sizes, state.errors),
        )
        steepest = jnp.maximum(state.steep, worst)
        state = state._replace(tangents=tangents, sizes=sizes, errors=errors, steep=steepest)
        return state, control.astype(step.motion.dtype)

    def _ratios(self, errors: Lengths, sizes: Lengths) -> Float[Array, "directions *#runs"]:
        """The errors in units of the allowed error, of the worst block."""
        return jax.vmap(self.tolerance.worst)(errors, sizes)

    def run(self, start: LoopState, run: Callable[[LoopState], LoopState]) -> LoopState:
        """The loop at its end, by steps that resolve the tangents.

        **Arguments**

        - `start`: the loop before its first step.
        - `run`: takes all its steps."""
        begun = _tangents_of(start)

        def attempt(carry: tuple[LoopState, Array]) -> tuple[LoopState, Array]:
            before, repeat = carry
            # Built again here, because a selection after the loop would be needed for every array.
            tangents = begun._replace(controlled=repeat)
            buffers = before.buffers.again(start.buffers)
            loop = run(start._replace(buffers=buffers, tangents=tangents))
            return loop, ~repeat & self._triggered(loop)

        def unresolved(carry: tuple[LoopState, Array]) -> Array:
            loop, repeat = carry
            return jnp.any(repeat | (_tangents_of(loop).time < 0.0))

        # A negative time is that of a loop which has not run.
        not_run = begun._replace(time=begun.time - 1.0)
        first = start._replace(tangents=not_run), begun.controlled
        return jax.lax.while_loop(unresolved, attempt, first)[0]

    def _triggered(self, loop: LoopState) -> Bool[Array, "*runs"]:
        """Whether the steps of each run in a first attempt do not resolve its tangents."""
        state = _tangents_of(loop)
        some = state.monitored > 0.0
        part = jnp.where(some, state.time / jnp.where(some, state.monitored, 1.0), 1.0)
        some = state.resolved > 0.0
        longer = jnp.where(some, state.longest / jnp.where(some, state.resolved, 1.0), 1.0)
        grown = jax.tree.map(lambda x: x * (part * part).astype(x.dtype), state.sizes)
        most = jnp.maximum(MOST_ERROR / self.tolerance.rtol, USUAL)
        ratios = self._ratios(state.errors, grown)
        resolved = (
            # The times may have double precision where the state has single.
            jnp.all(ratios * (longer**POWER).astype(ratios.dtype) <= TRIGGER, axis=0)
            & jnp.all(self._ratios(state.errors, state.sizes) <= most, axis=0)
            & (state.longest <= LONGER * state.resolved)
            & (state.steep * jnp.sqrt(self.tolerance.rtol) <= STEEP)
        )
        return ~resolved


def _tangents_of(loop: LoopState) -> TangentState:
    """The tangents of a loop that is controlled by them."""
    assert loop.tangents is not None
    return loop.tangents

"""Step control by derivatives, in a run that is differentiated.

Steps that the motion alone chooses resolve the motion alone. Where it is at rest, or nearly a
polynomial, they become as long as the run, and a derivative along them is that of a few steps of
any accuracy: of a force that is zero, the derivative of a run without it. Some tangents are
therefore integrated beside the motion (`_tangents.py`), and have errors as it has.

    |e_j|      estimate of the error that a step makes in d_j, of each block of the state
    |d_j|      largest size of the tangent so far, of each block

    |e_j| <= atol + rtol |d_j|

Along most motions the tangents need the steps that the motion needs. A first run hence chooses its
steps by the motion alone, and looks at the tangents at the third of them, at every 24th after it,
and where the motion does not limit a step, which is then longer than those that it did limit and
those that were looked at. Between these places a probe rests. Only if an error is `ALARM` times
what is allowed, the run is repeated with the tangents in the control of every step.
"""

from collections.abc import Callable
from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..solvers.protocol import bind, forward_mode, linear_errors, small_program
from ..solvers.tolerances import Tolerance
from ..solvers.vector_field import ScaledField
from ._loop_state import LoopState
from ._tangents import Lengths, Probes, ProbeState, StepTaken, lengths

SINCE, EVERY = 2, 24
"""The first of the steps at which the tangents are looked at whatever the motion does, and the
distance of those that follow."""
FREE = 1e-3
"""Error of the motion, in units of the tolerance, that does not limit a step: steps of the ideal
length leave more."""
LONG = 0.02
"""Shortest of the steps that the motion does not limit at which the tangents are looked at, as a
fraction of a segment. Shorter ones are on their way to longer ones."""
LONGER = 1.1
"""How much longer than all before it such a step is. Steps of one length are limited by something
else, such as `Accuracy.max_step` or the nodes of a table."""
ALARM = 300.0
"""Error of a tangent, in units of what is allowed, at which the run is repeated. That of tangents
whose steps the motion chooses well is up to about ten."""
SHORT = 1e-8
"""Fraction of a segment. A tangent that is not finite after so short a step never is, and one that
jumps there is off by as little."""


@final
class TangentControl(eqx.Module):
    """Step control by the tangents of `probes`.

    - `method`: that of the run, as a small program, because most steps do without it.
    - `term`: the vector field as the method takes it."""

    probes: Probes
    tolerance: Tolerance
    method: diffrax.AbstractSolver
    term: diffrax.AbstractTerm

    @classmethod
    def of(
        cls,
        probes: Probes,
        tolerance: Tolerance,
        method: diffrax.AbstractSolver,
        term: diffrax.AbstractTerm,
    ) -> "TangentControl":
        """The control of a run by this method."""
        # Nothing is saved within a step here.
        axes = tolerance.run_axes
        method = bind(small_program(method), tolerance=tolerance, save_ts=None, run_axes=axes)
        return cls(probes, tolerance, linear_errors(forward_mode(method)), term)

    def look(
        self, field: ScaledField, step: StepTaken, going: Bool[Array, "*#runs"], state: ProbeState
    ) -> tuple[ProbeState, Float[Array, "*runs"]]:
        """The tangents after this step, if it is accepted, and the errors by which they control it:
        zero in the first run, and for a step that the motion rejects or is not `going` on."""
        # A run that has failed, or waits at its event, has no error.
        alive = self.tolerance.alive(step.y0)
        # In single precision the time may have double precision.
        duration = jnp.abs(field.duration(step.s, step.length)).astype(state.known.dtype)
        free = (step.motion < FREE) & (step.length > LONG)
        # The last steps of a segment are cut short, and free for that reason alone.
        some = (step.number % EVERY == SINCE) | free & (duration > LONGER * state.known)
        # Nothing happens in a segment of no duration, whose ends a derivative would part.
        good = going & alive & (duration != 0.0) & (step.motion <= 1.0)
        due = good & (state.always | some)
        known = due | good & (step.motion >= FREE)
        state = state._replace(
            known=jnp.where(known, jnp.maximum(state.known, duration), state.known)
        )

        # A loop of one pass or none: of a condition the compiler does not know which arrays are
        # constant, and compiles twice what the effects compute from equal ones, such as the air.
        def looked(carry: tuple[Array, ProbeState, Array]) -> tuple[Array, ProbeState, Array]:
            go, state, _ = carry
            return ~go, *self._looked(field, step, due, state)

        start = jnp.any(due), state, jnp.zeros_like(step.motion)
        _, state, control = jax.lax.while_loop(lambda carry: carry[0], looked, start)
        return state, control

    def _looked(
        self, field: ScaledField, step: StepTaken, due: Bool[Array, "*runs"], state: ProbeState
    ) -> tuple[ProbeState, Array]:
        tolerance = self.tolerance
        tangents, errors = self.probes.after(self.method, self.term, field, step, state.tangents)
        counts = due & tolerance.alive(step.y1)
        sizes, errors = (
            jax.tree.map(lambda x: jnp.where(counts, x, 0.0), lengths(tolerance, d))
            for d in (tangents, errors)
        )
        sizes = jax.tree.map(jnp.maximum, state.sizes, sizes)
        ratios = self._ratios(errors, sizes)
        # A tangent that was finite, and is not after a long step, may be after a short one.
        ratios = jnp.where(jnp.isfinite(ratios), ratios, jnp.inf)
        ratios = jnp.where(step.length > SHORT, ratios, 0.0)
        known = jax.vmap(tolerance.alive)(state.tangents) & counts & state.always
        control = jnp.max(jnp.where(known, ratios, 0.0), axis=0)
        errors = jax.tree.map(jnp.maximum, state.errors, errors)
        # Selected here and not beside the state of the loop, because most steps come without it.
        taken = due & (control <= 1.0)
        tangents, sizes, errors = jax.tree.map(
            lambda new, old: jnp.where(taken, new, old),
            (tangents, sizes, errors),
            (state.tangents, state.sizes, state.errors),
        )
        count = state.count + due.astype(int)
        state = state._replace(tangents=tangents, sizes=sizes, errors=errors, count=count)
        return state, control.astype(step.motion.dtype)

    def _ratios(self, errors: Lengths, sizes: Lengths) -> Float[Array, "probes *#runs"]:
        """The errors in units of what is allowed, of the worst block."""
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
            tangents = begun._replace(always=repeat)
            buffers = before.buffers.again(start.buffers)
            loop = run(start._replace(buffers=buffers, tangents=tangents))
            return loop, ~repeat & self._alarm(loop)

        def unresolved(carry: tuple[LoopState, Array]) -> Array:
            loop, repeat = carry
            return jnp.any(repeat | (_tangents_of(loop).count < 0))

        # A count below zero is that of a loop which has not run.
        unseen = begun._replace(count=begun.count - 1)
        first = start._replace(tangents=unseen), begun.always
        return jax.lax.while_loop(unresolved, attempt, first)[0]

    def _alarm(self, loop: LoopState) -> Bool[Array, "*runs"]:
        """Whether the steps of each run in a first attempt do not resolve its tangents."""
        state = _tangents_of(loop)
        # The tangents rest between the steps that were looked at.
        part = jnp.maximum(loop.accepted, 1) / jnp.maximum(state.count, 1)
        sizes = jax.tree.map(lambda x: x * part.astype(x.dtype), state.sizes)
        return ~jnp.all(self._ratios(state.errors, sizes) <= ALARM, axis=0)


def _tangents_of(loop: LoopState) -> ProbeState:
    """The tangents of a loop that is controlled by them."""
    assert loop.tangents is not None
    return loop.tangents

"""Step control by derivatives, in a run that is differentiated.

Steps that the motion alone chooses resolve the motion alone. Where it is at rest, or nearly a
polynomial, they become as long as the run, and a derivative along them is that of a few steps of
any accuracy: of a force that is zero, the derivative of a run without it. Some tangents are
therefore integrated beside the motion, and have errors as it has.

    d_j        tangent of the state along a direction of the inputs, for probe j = 1, 2, ...
    |e_j|      estimate of the error that a step makes in d_j, of each block of the state
    |d_j|      largest size of the tangent so far, of each block

    |e_j| <= atol + rtol |d_j|

Each array of the field that is differentiated has a probe of its own, so that a large tangent hides
no small one; of more than `MOST` arrays several share one. The blocks of the initial state share
one, because each block of the tangents has its own error. The direction is fixed and pseudo-random,
with each number changing by its own size, or by one where it is zero.

Along most motions the tangents need the steps that the motion needs. A first run hence chooses its
steps by the motion alone, and looks at the tangents at the third of them, at every 24th after it,
and where the motion does not limit a step, which is then longer than those that it did limit.
Between these places a probe rests. Only if an error is `ALARM` times what is allowed, the run is
repeated with the tangents in the control of every step.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ..solvers.protocol import bind, field_of_step, forward_mode, linear_errors, small_program
from ..solvers.runge_kutta import whole_error
from ..solvers.tolerances import Tolerance
from ..solvers.vector_field import ScaledField
from .normalised_time import field_of_part

MOST = 8
"""Largest number of probes."""
SINCE, EVERY = 2, 24
"""The first of the steps at which the tangents are looked at whatever the motion does, and the
distance of those that follow."""
FREE = 1e-3
"""Error of the motion, in units of the tolerance, that does not limit a step: steps of the ideal
length leave more."""
LONG = 0.02
"""Shortest of the steps that the motion does not limit at which the tangents are looked at, as a
fraction of a segment. Shorter ones are on their way to longer ones."""
MOST_FREE = 16
"""Number of such steps. More of them are limited by something else, such as `Accuracy.max_step`."""
ALARM = 300.0
"""Error of a tangent, in units of what is allowed, at which the run is repeated. That of tangents
whose steps the motion chooses well is up to about ten."""
SHORT = 1e-8
"""Fraction of a segment. A tangent that is not finite after so short a step never is, and one that
jumps there is off by as little."""

# A `LoopState`, whose module imports this one.
Loop: TypeAlias = Any
# The length of each block of the state, for each probe and run.
Lengths: TypeAlias = PyTree[Float[Array, "probes ..."]]


class ProbeState(NamedTuple):
    """The tangents of the probes at one place of a run.

    - `tangents`: of the state, with the probes on the first axis.
    - `sizes`, `errors`: the largest of the tangents and of their errors so far.
    - `limited`: the longest step that the motion has limited so far, s.
    - `count`: the number of steps of each run that were looked at.
    - `always`: whether every step of it is, and is controlled by it."""

    tangents: State
    sizes: Lengths
    errors: Lengths
    limited: Float[Array, "*runs"]
    count: Int[Array, "*runs"]
    always: Bool[Array, "*runs"]


@final
class Probes(eqx.Module):
    """The directions of the inputs along which the tangents of a run are followed.

    - `numbers`: of the arrays of the field that are differentiated.
    - `directions`: of these arrays, with the probes on the first axis.
    - `start`: of the initial state, likewise."""

    numbers: tuple[int, ...] = eqx.field(static=True)
    directions: list[Array]
    start: State

    @classmethod
    def of(
        cls, field: PyTree, y0: State, moving: tuple[PyTree[bool], PyTree[bool]], run_axes: int
    ) -> "Probes | None":
        """The probes of a run that is differentiated by what is `moving` in its field and its
        initial state; `None` where there is none with a number."""
        leaves = zip(*map(jax.tree.leaves, ((field, y0), moving)), strict=True)
        inputs, flags = zip(*((x, m) for x, m in leaves if eqx.is_array(x)), strict=True)
        blocks, structure = jax.tree.flatten(y0)
        num_field = len(inputs) - len(blocks)
        numbers = [k for k, x in enumerate(inputs) if flags[k] and x.size]
        if not numbers:
            return None
        # One number for all blocks of the state.
        names = [min(k, num_field) for k in numbers]
        number = {name: i % MOST for i, name in enumerate(dict.fromkeys(names))}
        probe = {k: number[name] for k, name in zip(numbers, names, strict=True)}
        count = min(len(number), MOST)

        def rows(k: int) -> Array:
            x = inputs[k]
            every = jnp.zeros((count, *x.shape), x.dtype)
            if k not in probe:
                return every
            axes = x.ndim - (run_axes if k >= num_field else 0)
            return every.at[probe[k]].set(_direction(x, axes, k))

        numbers = tuple(k for k in numbers if k < num_field)
        start = [rows(num_field + k) for k in range(len(blocks))]
        return cls(numbers, [rows(k) for k in numbers], jax.tree.unflatten(structure, start))

    def packed(self, vector: Callable[[State], Array]) -> "Probes":
        """The probes of a run whose state is a vector."""
        return Probes(self.numbers, self.directions, jax.vmap(vector)(self.start))

    def begin(self, tolerance: Tolerance) -> ProbeState:
        """The tangents before the first step."""
        sizes = _lengths(tolerance, self.start)
        none = jax.tree.map(jnp.zeros_like, sizes)
        always = jnp.zeros_like(jax.vmap(tolerance.alive)(self.start)[0])
        limited = jnp.zeros(always.shape)
        return ProbeState(self.start, sizes, none, limited, always.astype(int), always)

    def after(
        self,
        method: diffrax.AbstractSolver,
        term: diffrax.AbstractTerm,
        field: ScaledField,
        step: "StepTaken",
        tangents: State,
    ) -> tuple[State, State]:
        """The tangents after a step, and the estimates of their errors."""
        arrays, static = eqx.partition(field, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        t0, t1 = jnp.zeros_like(step.s, shape=()), jnp.ones_like(step.s, shape=())

        def of(moving: list[Array], y: State) -> tuple[State, State]:
            every = list(leaves)
            for k, x in zip(self.numbers, moving, strict=True):
                every[k] = x
            field = eqx.combine(jax.tree.unflatten(structure, every), static)
            field, _ = field_of_part(field, step.s, step.length)
            seen = field_of_step(method, field, t0, t1)
            state = method.init(term, t0, t1, y, seen)
            y1, error, *_ = method.step(term, t0, t1, y, seen, state, jnp.array(False))
            return y1, error

        moving = [leaves[k] for k in self.numbers]

        def along(probe: tuple[list[Array], State]) -> tuple[State, State]:
            y1, error = jax.jvp(of, (moving, step.y0), probe)[1]
            return y1, whole_error(error)

        # Along a single run together, which takes little more than one of them does. For many runs,
        # whose axis has to be the last one, that would take several times as long as one after the
        # other, in the layout of the motion.
        every = jax.vmap(along) if step.motion.ndim == 0 else partial(jax.lax.map, along)
        return every((self.directions, tangents))


class StepTaken(NamedTuple):
    """A step of each run: its start and its length in normalised time, the states at its ends, its
    error in units of the tolerance, and the number of the steps before it."""

    s: Float[Array, "*#runs"]
    length: Float[Array, "*#runs"]
    y0: State
    y1: State
    motion: Float[Array, "*runs"]
    number: Int[Array, "*#runs"]


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
        duration = jnp.abs(field.duration(step.s, step.length)).astype(state.limited.dtype)
        free = (step.motion < FREE) & (step.length > LONG) & (state.count < MOST_FREE)
        # The last steps of a segment are cut short, and free for that reason alone.
        some = (step.number % EVERY == SINCE) | free & (duration > state.limited)
        # Nothing happens in a segment of no duration, whose ends a derivative would part.
        good = going & alive & (duration != 0.0) & (step.motion <= 1.0)
        due = good & (state.always | some)
        limiting = good & (step.motion >= FREE)
        limited = jnp.where(limiting, jnp.maximum(state.limited, duration), state.limited)
        state = state._replace(limited=limited)

        def looked() -> tuple[ProbeState, Array]:
            return self._looked(field, step, due, state)

        def skipped() -> tuple[ProbeState, Array]:
            return state, jnp.zeros_like(step.motion)

        return jax.lax.cond(jnp.any(due), looked, skipped)

    def _looked(
        self, field: ScaledField, step: StepTaken, due: Bool[Array, "*runs"], state: ProbeState
    ) -> tuple[ProbeState, Array]:
        tolerance = self.tolerance
        tangents, errors = self.probes.after(self.method, self.term, field, step, state.tangents)
        counts = due & tolerance.alive(step.y1)
        sizes, errors = (
            jax.tree.map(lambda x: jnp.where(counts, x, 0.0), _lengths(tolerance, d))
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

    def run(self, start: Loop, run: Callable[[Loop], Loop]) -> Loop:
        """The loop at its end, by steps that resolve the tangents.

        **Arguments**

        - `start`: the loop before its first step.
        - `run`: takes all its steps."""

        def attempt(carry: tuple[Loop, Array]) -> tuple[Loop, Array]:
            before, repeat = carry
            # Built again here, because a selection after the loop would be needed for every array.
            tangents = start.tangents._replace(always=repeat)
            buffers = before.buffers.again(start.buffers)
            loop = run(start._replace(buffers=buffers, tangents=tangents))
            return loop, ~repeat & self._alarm(loop)

        def unresolved(carry: tuple[Loop, Array]) -> Array:
            loop, repeat = carry
            return jnp.any(repeat | (loop.tangents.count < 0))

        no = start.tangents.always
        before = start.tangents._replace(count=start.tangents.count - 1)
        first = start._replace(tangents=before), no
        return jax.lax.while_loop(unresolved, attempt, first)[0]

    def _alarm(self, loop: Loop) -> Bool[Array, "*runs"]:
        """Whether the steps of each run in a first attempt do not resolve its tangents."""
        state = loop.tangents
        # The tangents rest between the steps that were looked at.
        part = jnp.maximum(loop.accepted, 1) / jnp.maximum(state.count, 1)
        sizes = jax.tree.map(lambda x: x * part.astype(x.dtype), state.sizes)
        return ~jnp.all(self._ratios(state.errors, sizes) <= ALARM, axis=0)


def _lengths(tolerance: Tolerance, tangents: State) -> Lengths:
    """The length of each block of tangents."""
    return jax.tree.map(jax.vmap(tolerance.length), tangents)


def _direction(x: Array, axes: int, seed: int) -> Array:
    """A pseudo-random change of each number by about its size.

    A number that is zero changes as the largest one along the first `axes`, and where all are zero
    by about one."""
    size = jnp.where(jnp.isfinite(x), jnp.abs(x), 0.0)
    largest = jnp.max(size, axis=tuple(range(axes)), keepdims=True)
    size = jnp.where(size > 0.0, size, jnp.where(largest > 0.0, largest, 1.0))
    random, shape = np.random.default_rng(seed), x.shape[:axes]
    parts = np.asarray(random.uniform(0.5, 1.0, shape) * random.choice([-1.0, 1.0], shape))
    return size * parts.reshape((*shape, *(1,) * (x.ndim - axes))).astype(x.dtype)

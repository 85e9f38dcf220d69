"""A mission as a program that compiles in seconds: fixed steps of DOP853 whose stages are a loop.

    k_i = f(t + c_i h, y + h sum_j a_ij k_j)            y_1 = y + h sum_i b_i k_i

The program contains the vector field of a phase once, instead of once for each of twelve stages,
again for events and again for the record of steps. An optimisation compiles this program and its
derivative once, and returns within seconds. A step runs slower than that of `simulate_mission`, and
no tolerance controls it: `error` shows whether the steps were enough, and a run of the optimum by
`simulate_mission` confirms it.

Steps end on the `breaks` of the phases. A phase that ends at an event steps up to its zero, where
one Newton step carries the derivative.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 (DOP853).
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.printing import printed
from ..core.safe import safe_divide
from ..core.types import as_float
from ..integration.events import Event, newton_correct
from ..solvers import tableaus as tableau
from ..solvers.stages import combine, stages
from ._mission import Mission, Phase
from .legs import legs_of

# The largest number of reductions of the step to an event: about eight reach rounding.
SEARCH = 12

Step: TypeAlias = Callable[[Scalar, Scalar, Array], tuple[Array, Array]]
"""The state after a step and its error, from its time, length and initial state."""


class CompactPhase(NamedTuple):
    """A phase: the times of the ends of its steps, (steps + 1,), s, the states there, times behind
    the components, the state at its end `before` the jump, and whether its event happened."""

    ts: Float[Array, " times"]
    states: State
    before: State
    happened: Bool[Array, ""]


class CompactEnd(NamedTuple):
    """The end of a branch: the state after its last jump, and its time, s."""

    final: State
    end: Float[Array, ""]


@printed(end="s")
class CompactRun(NamedTuple):
    """Result of `simulate_compact`.

    - `final`, `end`: the state after the last jump, and its time, s.
    - `phases`: one `CompactPhase` for each phase, those of branches last.
    - `branches`: where each branch ends.
    - `error`: the sum of the error estimates of the steps, relative to the largest component of
      each part of the state; of fifth order, so that it exceeds the error."""

    final: State
    end: Float[Array, ""]
    phases: tuple[CompactPhase, ...]
    branches: tuple[CompactEnd, ...]
    error: Float[Array, ""]


def simulate_compact(
    mission: Mission, y0: State, t0: Scalar = 0.0, *, steps: int = 40
) -> CompactRun:
    """The run of a mission in fixed steps, with rolled stages, for optimisation.

    **Arguments**

    - `mission`, `y0`, `t0`: as in `simulate_mission`, of one run.
    - `steps`: of each phase, shared among the spans between its breaks, at least two each.

    **Returns** a `CompactRun`, differentiable in both modes.

    **Raises** `InputError` for fewer than one step, or an event that is a touch."""
    if steps < 1:
        raise InputError(f"simulate_compact got steps = {steps}: it must be at least 1.")
    error = jnp.zeros(())
    phases = []
    # Of each phase, at its end: the state before its jump, and after it.
    left, behind = [], []
    legs, _ = legs_of(mission)
    for leg in legs:
        at = CompactEnd(y0, as_float(t0))
        if leg.after is not None:
            at = (left if leg.parted else behind)[leg.after]
        y = at.final if leg.start is None else leg.start(at.end, at.final)
        run, t, y, more = _phase(leg.phase, at.end, y, steps)
        phases.append(run)
        error = error + more
        left.append(CompactEnd(y, t))
        then = leg.phase.then
        behind.append(CompactEnd(y if then is None else then(t, y), t))
    # The last phase of each line: that of the mission itself, then those of its branches.
    last = {leg.line: end for leg, end in zip(legs, behind, strict=True)}
    own, *branches = (last[line] for line in range(len(last)))
    return CompactRun(own.final, own.end, tuple(phases), tuple(branches), error)


def _ends(system: AbstractSystem, t0: Scalar, t1: Scalar, steps: int) -> Float[Array, " times"]:
    """Starts and ends of the steps, s: equal between two breaks."""
    breaks = system.breaks()
    inner = jnp.zeros((0,)) if breaks is None else jnp.clip(breaks, t0, t1)
    knots = jnp.concatenate([t0[None], jnp.sort(inner), t1[None]])
    each = max(2, -(-steps // (knots.size - 1)))
    shares = jnp.arange(each) / each
    inside = knots[:-1, None] + shares * (knots[1:] - knots[:-1])[:, None]
    return jnp.concatenate([inside.ravel(), t1[None]])


def _phase(
    phase: Phase, t0: Scalar, y0: State, steps: int
) -> tuple[CompactPhase, Scalar, State, Scalar]:
    """A phase, the time and the state at its end before the jump, and the error of its steps."""
    event = _event_of(phase)
    t1 = t0 + (phase.until if event is None else event.within)
    beyond = None if event is None else event.beyond(t0, y0)
    if beyond is not None:
        t1 = jnp.where(beyond, t0, t1)
    # Parts of the state that are constant in the phase are integrated with the others.
    v0, unravel = ravel_pytree(y0)
    system = phase.moving.started_at(t0)
    times = _ends(system, t0, t1, steps)
    step = _step_of(system, unravel)
    if event is None:
        v, (vs, wrongs) = _through(step, times, v0)
        happened = jnp.asarray(True)
        t = t1
        y = unravel(v)
    else:
        (t, v, happened), (times, vs, wrongs) = _until_event(event, step, unravel, times, v0)
        times = jnp.concatenate([t0[None], times])
        # No step goes beyond the last time, which several of them may share.
        ended = times >= t
        t, y = newton_correct(system, (event,), jnp.where(happened, 0, -1), t, unravel(v))
        # With the derivative of the end, of which what is greatest there depends.
        times = jnp.where(ended, t, times)
        if beyond is not None:
            happened = happened | beyond
        vs = jnp.where(ended[1:, None], ravel_pytree(y)[0], vs)
    states = jax.vmap(unravel, out_axes=-1)(jnp.concatenate([v0[None], vs]))
    sizes = _sizes(states, unravel(v0))
    error = jnp.sum(jnp.max(jnp.abs(wrongs) / sizes, axis=1))
    return CompactPhase(times, states, y, happened), t, y, error


def _event_of(phase: Phase) -> Event | None:
    """The event that ends a phase; `None` for a duration. Raises `InputError` for a touch, and for
    a closed loop."""
    event = phase.until if isinstance(phase.until, Event) else None
    if event is not None and event.touch is not None:
        raise InputError(
            f"Phase {phase.name!r} ends at a touch: simulate_compact supports crossings only."
        )
    if phase.system is not phase.moving:
        raise InputError(
            f"Phase {phase.name!r} is a closed loop: simulate_compact supports systems only."
        )
    return event


def _step_of(system: AbstractSystem, unravel: Callable[[Array], State]) -> Step:
    """A step of the system, of order 8, in states that are one vector."""

    def rate(t: Scalar, v: Array) -> Array:
        return ravel_pytree(system.vector_field(t, unravel(v)))[0]

    def step(t: Scalar, h: Scalar, v: Array) -> tuple[Array, Array]:
        ks = stages(rate, t, h, v, tableau.DOP853_C, tableau.DOP853_A, [], rolled=True)
        return combine(v, h, tableau.DOP853_B, ks), combine(None, h, tableau.DOP853_ERROR_5, ks)

    return step


def _through(step: Step, times: Array, v0: Array) -> tuple[Array, tuple[Array, Array]]:
    """The state behind the last of the steps between these times, those behind all of them,
    (steps, components), and their errors."""

    def advance(v: Array, span: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        v, wrong = step(span[0], span[1] - span[0], v)
        return v, (v, wrong)

    return lax.scan(advance, v0, (times[:-1], times[1:]))


def _sizes(states: State, like: State) -> Float[Array, " components"]:
    """The largest magnitude of each part of a state along a phase, for each of its components."""

    def leaf(x: Array, one: Array) -> Array:
        largest = jnp.max(jnp.abs(x))
        return jnp.broadcast_to(jnp.where(largest > 0.0, largest, 1.0), one.shape)

    return lax.stop_gradient(ravel_pytree(jax.tree.map(leaf, states, like))[0])


class _Search(NamedTuple):
    """State of the search for an event: time `t`, state `v` and condition `g` before it.

    - `number`: of the next step of the plan.
    - `hit`: whether the zero is bracketed. If so, `rest` is the length to a time beyond it, where
      the condition is `g1`; `ahead` and `past` are the weights of both ends, and `side` is the end
      that moved last."""

    t: Array
    v: Array
    g: Array
    number: Array
    hit: Array
    rest: Array
    g1: Array
    ahead: Array
    past: Array
    side: Array


def _until_event(
    event: Event, step: Step, unravel: Callable[[Array], State], ts: Array, v0: Array
) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
    """Steps up to the zero of the event's condition: time and state just before it and whether it
    was met; and times, states and errors of the steps.

    A step across the zero is shortened by regula falsi, until the state is just before it."""
    sign = float(event.direction)

    def passed(g: Scalar, g0: Scalar) -> Bool[Array, ""]:
        ahead = (g0 < 0.0) & (g >= 0.0), (g0 > 0.0) & (g <= 0.0)
        return ahead[0] if sign > 0 else ahead[1] if sign < 0 else ahead[0] | ahead[1]

    def advance(at: _Search, _: None) -> tuple[_Search, tuple[Array, Array, Array]]:
        full = ts[jnp.minimum(at.number + 1, ts.size - 1)] - at.t
        share = safe_divide(at.ahead * at.g, at.ahead * at.g - at.past * at.g1)
        # No derivative passes through the search: `newton_correct` gives that of the time.
        h = lax.stop_gradient(at.rest * share)
        h = jnp.where(at.hit, h, full)
        v1, wrong = step(at.t, h, at.v)
        g1 = event.condition(at.t + h, unravel(v1))
        across = passed(g1, at.g)
        # A place beyond the zero by a rounding is the zero: a secant that leads there, as where the
        # condition is linear, leads there again and leaves the state before it where it is.
        size = jnp.abs(at.g) + jnp.abs(at.g1)
        landed = across & (jnp.abs(g1) <= 16.0 * jnp.finfo(g1.dtype).eps * size)
        hit = at.hit | across
        across = across & ~landed
        keep = lambda new, old: jnp.where(across, old, new)  # noqa: E731
        first = across & ~at.hit
        # The weight of an end that stays twice is halved (Illinois), so that it does not stay for
        # ever.
        ahead = jnp.where(across & at.hit & (at.side < 0.0), 0.5 * at.ahead, 1.0)
        past = jnp.where(~across & at.hit & (at.side > 0.0), 0.5 * at.past, 1.0)
        new = _Search(
            t=keep(at.t + h, at.t),
            v=keep(v1, at.v),
            g=keep(g1, at.g),
            number=at.number + jnp.where(hit, 0, 1),
            hit=hit,
            # Nothing is left behind the zero itself.
            rest=jnp.where(landed, 0.0, jnp.where(across, h, at.rest - h)),
            g1=jnp.where(across, g1, at.g1),
            ahead=jnp.where(first, 1.0, ahead),
            past=jnp.where(first, 1.0, past),
            side=jnp.where(across, -1.0, 1.0),
        )
        # A step that is not taken has no error to count.
        return new, (new.t, new.v, keep(wrong, 0.0 * wrong))

    zero = jnp.zeros_like(ts[0])
    one = jnp.ones_like(ts[0])
    g = event.condition(ts[0], unravel(v0))
    none = jnp.asarray(0), jnp.asarray(False)
    start = _Search(ts[0], v0, g, *none, zero, g, one, one, zero)
    # The scan has a fixed length: a loop that ends at the event would have no reverse mode.
    last, saved = lax.scan(advance, start, None, length=ts.size - 1 + SEARCH)
    return (last.t, last.v, last.hit), saved

"""The integration loop: every run proceeds with individual steps to its individual end.

In an iteration each run makes one step, accepted or rejected, of individual length: the method
steps from 0 to 1, which every run maps to its time interval (`StepTimes`). A run therefore does not
depend on its neighbours. Runs by a fixed-step method share their times.

diffrax's own loop does the same work for one run. This one is traced once where diffrax's is traced
three times, which halves the first call, and it records the steps for derivatives (`_record.py`).
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..core import State
from ..solvers.vector_field import TERM, ScaledField, evaluate
from ._event_state import EventState
from ._iteration import advance
from ._loop_settings import LoopSettings
from ._loop_state import LoopState
from ._sensitivity_control import SensitivityControl
from ._tangents import Directions
from ._trial_step import carries, error_order
from .normalised_time import ScaledVectorField, field_of_part


def integrate_loop(
    settings: LoopSettings,
    field: ScaledField,
    y0: State,
    *,
    recorded: bool = False,
    directions: Directions | None = None,
) -> LoopState:
    """Integrate dy/dt = field(t, y) in normalised time, from `settings.start` to `settings.end`.

    **Arguments**

    - `settings`: method, step control, save times and limits.
    - `field`: the vector field, a `ScaledVectorField` or its hoisted form.
    - `y0`: the initial state, components first and runs last.
    - `recorded`: whether to record the steps for derivatives.
    - `directions`: the tangents that the steps should resolve.

    **Returns** the last `LoopState`. A run whose `t` is `settings.end` is complete. Another one has
    failed, or its steps ran out, which the caller reports in the status."""

    control = None
    if directions is not None:
        control = SensitivityControl.of(directions, settings.tolerance, settings.method, TERM)

    def run(
        settings: LoopSettings, before: LoopState | None, left_out: Array | None = None
    ) -> LoopState:
        def by_motion(loop: LoopState) -> LoopState:
            return jax.lax.while_loop(
                LoopState.unfinished, lambda loop: advance(settings, field, control, loop), loop
            )

        start = _start(settings, field, y0, recorded, control, left_out)
        if before is not None:
            start = start._replace(buffers=before.buffers.again(start.buffers))
        return by_motion(start) if control is None else control.run(start, by_motion)

    if recorded:
        layout = settings.layout(y0, settings.clock(y0))
        if layout.rows < layout.limit:
            own = settings.shared(jnp.array(False))
            shapes = jax.eval_shape(lambda: _start(own, field, y0, recorded, control))
            return _until_recorded(settings, layout.rows, shapes, run)
    return run(settings, None)


def _until_recorded(
    settings: LoopSettings,
    rows: int,
    shapes: PyTree,
    run: Callable[..., LoopState],
) -> LoopState:
    """The loop at its end: with steps of each run, and if they are more than these `rows` of the
    record, with steps that all runs share. When these are exhausted, the runs that shortened them
    are excluded."""

    def attempt(carry: tuple[LoopState, Array]) -> tuple[LoopState, Array]:
        before, number = carry
        # Slow is a run that shortened the common step at least half as often as the worst one. In
        # the first attempt every run had individual steps, and did not delay the others.
        slow = 2 * before.limiting >= jnp.maximum(jnp.max(before.limiting), 1)
        left_out = before.left_out | before.short(settings) & slow & (number > 1)
        return run(settings.shared(number > 0), before, left_out), number + 1

    def unfinished(carry: tuple[LoopState, Array]) -> Bool[Array, ""]:
        loop, number = carry
        full = (number > 1) | (loop.count >= rows)
        return (number == 0) | full & jnp.any(loop.short(settings))

    # Zeros, because the first attempt restarts the method: a loop needs only shapes of its carry.
    first = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    return jax.lax.while_loop(unfinished, attempt, (first, jnp.asarray(0)))[0]


def _start(
    settings: LoopSettings,
    field: ScaledField,
    y0: State,
    recorded: bool,
    control: SensitivityControl | None,
    left_out: Bool[Array, "*runs"] | None = None,
) -> LoopState:
    """The loop before its first step, with the buffers that it fills."""
    if left_out is not None:
        # NaN stops a run immediately, and its status reports the failure.
        y0 = jax.tree.map(lambda x: jnp.where(left_out, jnp.nan, x), y0)
    t, alive = settings.clock(y0), settings.tolerance.alive(y0)
    zero, one = jnp.zeros_like(t, shape=()), jnp.ones_like(t, shape=())
    t_next, steps = _first_step(settings, field, t, y0)
    none = jnp.broadcast_to(jnp.asarray(0), t.shape)
    event_state = None
    if settings.terminal is not None:
        event_state = EventState.none_yet(settings.terminal, t, y0, settings.tolerance)
    first = field_of_part(field, t, t_next - t)[0]
    start = LoopState(
        t=t,
        t_next=t_next,
        y=y0,
        carried=settings.method.init(TERM, zero, one, y0, first) if carries(settings) else None,
        # A run that starts with numbers that are not finite has no accuracy.
        worst=jnp.where(alive, 0.0, jnp.inf).astype(jax.tree.leaves(y0)[0].dtype),
        control=steps,
        jumped=jnp.zeros(t.shape, bool),
        accepted=none,
        rejected=none,
        count=jnp.asarray(0),
        buffers=settings.buffers(y0, t, t if recorded else None),
        event_state=event_state,
        tangents=None if control is None else control.directions.begin(settings.tolerance),
        limiting=jnp.zeros(alive.shape, jnp.int32),
        left_out=jnp.zeros_like(alive) if left_out is None else left_out,
        going=jnp.zeros(t.shape, bool),
        outside=_never_outside(field, t, y0, alive),
    )
    return start.going_on(settings)


def _never_outside(
    field: ScaledField, t: Array, y0: State, alive: Bool[Array, "*runs"]
) -> Bool[Array, "*runs"] | None:
    """False for each run, or `None` if no state is outside the range of the system. The start is
    not asked: a run may begin on the boundary. Nor is a field whose functions close over traced
    arrays, of which only the end is asked."""
    if not isinstance(field, ScaledVectorField):
        return None
    flag = jax.eval_shape(field.outside, t, y0)
    return None if flag is None else jnp.zeros_like(alive)


def _first_step(
    settings: LoopSettings, field: ScaledField, t: Array, y0: State
) -> tuple[Float[Array, "*runs"], PyTree]:
    """The end of the first step of each run, and the state of the step control."""
    if settings.fixed_step:
        return t + 1.0, None
    part = field_of_part(field, t, jnp.ones_like(t))[0]
    t_next, steps = settings.controller().first(
        partial(evaluate, TERM, args=part), t, y0, error_order(settings)
    )
    # A first guess may reach beyond the end of a short run.
    t_next = jnp.minimum(t_next, settings.end)
    sharing = settings.sharing
    if sharing is None:
        return t_next, steps
    # Runs that share their steps all take the shortest, or one of them would miss its tolerance.
    shortest = jnp.where(sharing, jnp.min(steps.proposal), steps.proposal)
    t_next = jnp.where(sharing, jnp.min(t_next), t_next)
    return t_next, steps._replace(proposal=shortest)

"""One integration on the clock of segments, differentiable without doubt about its steps: reverse
mode follows those taken."""

from typing import Any, NamedTuple, cast, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import State
from ..solvers import (
    BatchStepController,
    ErrorTrackingSolver,
    StepTo,
    Tolerance,
    bind,
    solver_traits,
)
from ._accuracy import Accuracy
from ._closures import closures_as_leaves
from ._loop import March, Record, march, room
from ._replay import Replay


@final
class Manner(eqx.Module):
    """How to integrate: to what accuracy, the relative `lengths` of the segments, the `longest`
    step that is allowed in each (on the clock), at which clock times states are kept (the end alone
    where they are `None`), the `plan` that fixes the steps beforehand, and whether to `record`
    those taken. Nothing in it is differentiated."""

    accuracy: Accuracy
    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    longest: Float[Array, " segments"] | None
    kept: Float[Array, " times"] | None
    plan: Float[Array, " nodes"] | None
    record: bool = eqx.field(static=True)

    @property
    def method(self) -> Any:
        """The method, with what it has to know of the run."""
        return bind(
            self.accuracy.method,
            tolerance=self.tolerance,
            save_ts=self.kept,
            run_axes=self.tolerance.run_axes,
        )

    @property
    def max_steps(self) -> int:
        """How many steps may be taken."""
        return (
            self.accuracy.max_steps
            if self.plan is None
            else min(self.plan.shape[0] - 1, self.accuracy.max_steps)
        )


class Course(NamedTuple):
    """What an integration leaves: the kept `states`, the largest local error of each run, whether
    the steps ran out, how many were accepted and rejected, and the clock at their ends (padded with
    infinity) where it was recorded."""

    states: State
    account: Array
    out_of_steps: Array
    accepted: Array
    rejected: Array
    ends: Array | None


def integrate(rate: Any, y0: State, manner: Manner) -> Course:
    """The course of dy/ds = rate(s, y) from s = 0 to the number of segments."""
    manner = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, manner
    )
    needs = solver_traits(manner.accuracy.method).needs
    rate = closures_as_leaves(rate, needs, jnp.zeros((), manner.lengths.dtype), y0)
    adjoint = manner.accuracy.adjoint
    if not solver_traits(manner.accuracy.method).replayable or not isinstance(
        adjoint, diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode
    ):
        return _by_diffrax(rate, y0, manner)
    if isinstance(adjoint, diffrax.ForwardMode):
        return _course(_march(rate, y0, manner), manner)
    return _replayed((rate, y0), manner)


@eqx.filter_jit
def _rate(s: Any, y: State, rate: Any) -> State:
    """The rate, traced once for all places of a program that ask for it."""
    return rate(s, y)


TERM: Any = diffrax.ODETerm(_rate)  # pyright: ignore[reportArgumentType]


def _parts(manner: Manner) -> tuple[ErrorTrackingSolver, Any, Array]:
    """The solver, the control of its steps, and the last clock time."""
    dtype, plan = manner.lengths.dtype, manner.plan
    adaptive = BatchStepController(manner.tolerance, manner.lengths, manner.longest)
    control = adaptive if plan is None else StepTo(plan.astype(dtype))
    return (
        ErrorTrackingSolver(manner.method, manner.tolerance),
        control,
        jnp.asarray(manner.lengths.shape[0], dtype),
    )


def _march(rate: Any, y0: State, manner: Manner, marked: bool = False) -> March:
    solver, control, last = _parts(manner)
    return march(
        solver, control, TERM, rate, y0, last, manner.max_steps, manner.kept, manner.record, marked
    )


def _course(m: March, manner: Manner) -> Course:
    states = jax.tree.map(lambda x: x[None], m.y) if manner.kept is None else m.states
    return Course(
        states,
        m.solver[1],
        m.s < manner.lengths.shape[0],
        m.accepted,
        m.rejected,
        _padded(m) if manner.record else None,
    )


def _padded(m: March) -> Array:
    """The ends of the steps, with infinity after them."""
    ends = cast(Array, m.ends)
    return jnp.where(jnp.arange(ends.shape[0]) < m.accepted, ends, jnp.inf)


def _by_diffrax(rate: Any, y0: State, manner: Manner) -> Course:
    """The course by diffrax's loop, for its other ways of differentiation and for methods that
    remember more than a state."""
    solver, control, last = _parts(manner)
    subs = [
        diffrax.SubSaveAt(t1=True) if manner.kept is None else diffrax.SubSaveAt(ts=manner.kept)
    ]
    if manner.record:
        subs.append(diffrax.SubSaveAt(steps=True, fn=lambda s, y, a: None))
    solution: Any = diffrax.diffeqsolve(
        TERM,
        solver,
        jnp.zeros_like(last),
        last,
        None,
        y0,
        rate,
        saveat=diffrax.SaveAt(subs=subs, solver_state=True),
        stepsize_controller=control,
        adjoint=manner.accuracy.adjoint,
        max_steps=manner.max_steps,
        throw=False,
    )
    return Course(
        solution.ys[0],
        solution.solver_state[1],
        solution.result == diffrax.RESULTS.max_steps_reached,
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"],
        solution.ts[1] if manner.record else None,
    )


@eqx.filter_custom_vjp
def _replayed(given: tuple[Any, State], manner: Manner) -> Course:
    return _course(_march(*given, manner), manner)


@_replayed.def_fwd
def _forwards(
    perturbed: Any, given: tuple[Any, State], manner: Manner
) -> tuple[Course, tuple[Record, State]]:
    del perturbed
    m = _march(*given, manner, marked=True)
    course = _course(m, manner)
    return course, (Record(cast(Array, m.ends), m.marks, m.every, m.accepted), course.states)


@_replayed.def_bwd
def _backwards(
    kept: tuple[Record, State],
    gradient: Course,
    perturbed: Any,
    given: tuple[Any, State],
    manner: Manner,
) -> Any:
    record, states = kept
    rate, y0 = given
    filled = jax.tree.map(
        lambda y, g: jnp.zeros_like(y) if g is None else g, states, gradient.states
    )
    moving, rest = eqx.partition(rate, perturbed[0])
    most = -(-manner.max_steps // room(y0, manner.max_steps))
    most = 1 << (most - 1).bit_length()
    return Replay(manner.method, TERM, rest, record, y0, manner.kept, most).pull_back(
        moving, filled
    )

"""One integration on the clock of segments, differentiable without doubt about its steps: reverse mode follows those taken."""

from typing import Any, NamedTuple, cast, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import State
from ..solvers import (
    RKN1210,
    Accounted,
    PlannedSteps,
    Regular,
    Regularised,
    Split,
    Splitting,
    Tolerance,
    WorstRunControl,
)
from ._accuracy import Accuracy
from ._reverse import Record, Replay, replayable, stride


@final
class Manner(eqx.Module):
    """How to integrate: to what accuracy, the relative `lengths` of the segments, at which clock times states are kept (the end
    alone where they are `None`), the `plan` that fixes the steps beforehand, and whether to `record` those taken. Nothing in it
    is differentiated."""

    accuracy: Accuracy
    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    kept: Float[Array, " times"] | None
    plan: Float[Array, " nodes"] | None
    record: bool = eqx.field(static=True)

    @property
    def method(self) -> Any:
        """The method; told where states within its steps will be asked for, if that makes a difference to it."""
        method = self.accuracy.method
        if not isinstance(method, RKN1210):
            return method
        return RKN1210(jnp.zeros((0,), self.lengths.dtype) if self.kept is None else self.kept)

    @property
    def max_steps(self) -> int:
        """How many steps may be taken."""
        return self.accuracy.max_steps if self.plan is None else min(self.plan.shape[0] - 1, self.accuracy.max_steps)


class Course(NamedTuple):
    """What an integration leaves: the kept `states`, the largest local error of each run, whether the steps ran out, how many
    were accepted and rejected, and the clock at their ends (padded with infinity) where it was recorded."""

    states: State
    account: Array
    out_of_steps: Array
    accepted: Array
    rejected: Array
    ends: Array | None


def integrate(rate: Any, y0: State, manner: Manner) -> Course:
    """The course of dy/ds = rate(s, y) from s = 0 to the number of segments."""
    manner = jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, manner)
    if replayable(manner.accuracy.method) and isinstance(manner.accuracy.adjoint, diffrax.RecursiveCheckpointAdjoint):
        return _replayed((_converted(rate, y0, manner), y0), manner)
    return _solve(rate, y0, manner)[0]


def _converted(rate: Any, y0: State, manner: Manner) -> Any:
    """The rate with all that it depends on as leaves; with its drift and kick, or its regular form, for a method that asks."""
    s = jnp.zeros((), manner.lengths.dtype)
    whole = eqx.filter_closure_convert(rate, s, y0)
    if isinstance(manner.accuracy.method, Splitting):
        return Split(whole, *(eqx.filter_closure_convert(part, s, s, y0) for part in (rate.drift, rate.kick)))
    if isinstance(manner.accuracy.method, Regularised):
        return _regular(rate, whole, s, y0)
    return whole


def _regular(rate: Any, whole: Any, s: Any, y0: State) -> Regular:
    z = jax.eval_shape(rate.enter, y0)
    push, span = jax.eval_shape(rate.push, s, s, z), jax.eval_shape(lambda z: z[-1], z)
    given = dict(enter=(y0,), leave=(z,), push=(s, s, z), slope=(z, push), remaining=(span, z), duration=(s, s))
    return Regular(whole, *(eqx.filter_closure_convert(getattr(rate, part), *args) for part, args in given.items()))


def _rate(s: Any, y: State, rate: Any) -> State:
    return rate(s, y)


TERM: Any = diffrax.ODETerm(_rate)  # pyright: ignore[reportArgumentType]


def _solve(rate: Any, y0: State, manner: Manner, every: int = 0) -> tuple[Course, State | None]:
    """The course with the ends of its steps, and the state after every `every` of them; without both for 0."""
    accuracy, dtype, plan = manner.accuracy, manner.lengths.dtype, manner.plan
    subs = [diffrax.SubSaveAt(t1=True) if manner.kept is None else diffrax.SubSaveAt(ts=manner.kept)]
    if every or manner.record:
        subs.append(diffrax.SubSaveAt(steps=True, fn=lambda s, y, a: None))
    if every:
        subs.append(diffrax.SubSaveAt(steps=every))
    adaptive = WorstRunControl(manner.tolerance, manner.lengths)
    solution: Any = diffrax.diffeqsolve(
        TERM,
        Accounted(manner.method, manner.tolerance),
        jnp.zeros((), dtype),
        jnp.asarray(manner.lengths.shape[0], dtype),
        None,
        y0,
        rate,
        saveat=diffrax.SaveAt(subs=subs, solver_state=True),
        stepsize_controller=adaptive if plan is None else PlannedSteps(plan.astype(dtype)),
        adjoint=accuracy.adjoint,
        max_steps=manner.max_steps,
        throw=False,
    )
    course = Course(
        solution.ys[0],
        solution.solver_state[1],
        solution.result == diffrax.RESULTS.max_steps_reached,
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"],
        solution.ts[1] if every or manner.record else None,
    )
    return course, solution.ys[2] if every else None


@eqx.filter_custom_vjp
def _replayed(given: tuple[Any, State], manner: Manner) -> Course:
    return _solve(*given, manner)[0]


@_replayed.def_fwd
def _forwards(perturbed: Any, given: tuple[Any, State], manner: Manner) -> tuple[Course, tuple[Record, State]]:
    del perturbed
    course, states = _solve(*given, manner, stride(given[1], manner.max_steps))
    record = Record(cast(Array, course.ends), states, course.accepted)
    return course if manner.record else course._replace(ends=None), (record, course.states)


@_replayed.def_bwd
def _backwards(kept: tuple[Record, State], gradient: Course, perturbed: Any, given: tuple[Any, State], manner: Manner) -> Any:
    record, states = kept
    rate, y0 = given
    filled = jax.tree.map(lambda y, g: jnp.zeros_like(y) if g is None else g, states, gradient.states)
    moving, rest = eqx.partition(rate, perturbed[0])
    every = stride(y0, manner.max_steps)
    return Replay(manner.method, TERM, rest, record, y0, manner.kept, every).pull_back(moving, filled)

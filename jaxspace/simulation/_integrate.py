"""One integration on the clock of segments, differentiable without doubt about its steps.

Reverse mode repeats parts of a run. Were the steps chosen anew then, a difference of one rounding could choose others, and the
derivative would belong to no run at all (seen: wrong by its own size, over a thousand steps). So the run that is about to be
differentiated in reverse keeps the ends of its accepted steps, and the repetition follows them."""

from typing import Any, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import State
from ..solvers import Accounted, PlannedSteps, Tolerance, WorstRunControl
from ._accuracy import Accuracy


@final
class Manner(eqx.Module):
    """How to integrate: to what accuracy, the relative `lengths` of the segments, and at which clock times states are kept (the
    end alone where they are `None`). Nothing in it is differentiated."""

    accuracy: Accuracy
    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    kept: Float[Array, " times"] | None


class Course(NamedTuple):
    """What an integration leaves: the kept `states`, the largest local error of each run, whether the steps ran out, how many
    were accepted and rejected, and the clock at their ends (padded with infinity) where it was recorded."""

    states: State
    account: Array
    out_of_steps: Array
    accepted: Array
    rejected: Array
    ends: Array | None


def integrate(rate: Any, y0: State, manner: Manner, plan: Array | None, record: bool) -> Course:
    """The course of dy/ds = rate(s, y) from s = 0 to the number of segments; `plan` fixes its steps, `record` keeps them."""
    if plan is None and not record and isinstance(manner.accuracy.adjoint, diffrax.RecursiveCheckpointAdjoint):
        converted = eqx.filter_closure_convert(rate, jnp.zeros((), manner.lengths.dtype), y0)
        return _replayable((converted, y0), jax.lax.stop_gradient(manner))
    return _solve(rate, y0, jax.lax.stop_gradient(manner), plan, record)


def _solve(rate: Any, y0: State, manner: Manner, plan: Array | None, record: bool) -> Course:
    accuracy, dtype = manner.accuracy, manner.lengths.dtype
    subs = [diffrax.SubSaveAt(t1=True) if manner.kept is None else diffrax.SubSaveAt(ts=manner.kept)]
    if record:
        subs.append(diffrax.SubSaveAt(steps=True, fn=lambda s, y, a: None))
    adaptive = WorstRunControl(manner.tolerance, manner.lengths)
    solution: Any = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda s, y, rate: rate(s, y)),  # pyright: ignore[reportArgumentType]
        Accounted(accuracy.method, manner.tolerance),  # pyright: ignore[reportArgumentType]
        jnp.zeros((), dtype),
        jnp.asarray(manner.lengths.shape[0], dtype),
        None,
        y0,
        rate,
        saveat=diffrax.SaveAt(subs=subs, solver_state=True),
        stepsize_controller=adaptive if plan is None else PlannedSteps(plan.astype(dtype)),
        adjoint=accuracy.adjoint,
        max_steps=accuracy.max_steps if plan is None else min(plan.shape[0] - 1, accuracy.max_steps),
        throw=False,
    )
    return Course(
        solution.ys[0],
        solution.solver_state[1],
        solution.result == diffrax.RESULTS.max_steps_reached,
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"],
        solution.ts[1] if record else None,
    )


@eqx.filter_custom_vjp
def _replayable(given: tuple[Any, State], manner: Manner) -> Course:
    rate, y0 = given
    return _solve(rate, y0, manner, None, False)


@_replayable.def_fwd
def _forwards(perturbed: Any, given: tuple[Any, State], manner: Manner) -> tuple[Course, Array]:
    del perturbed
    rate, y0 = given
    course = _solve(rate, y0, manner, None, True)
    assert course.ends is not None
    return course._replace(ends=None), jnp.concatenate([jnp.zeros((1,), course.ends.dtype), course.ends])


@_replayable.def_bwd
def _backwards(plan: Array, gradient: Course, perturbed: Any, given: tuple[Any, State], manner: Manner) -> Any:
    del perturbed
    states, pull_back = eqx.filter_vjp(lambda g: _solve(g[0], g[1], manner, plan, False).states, given)
    filled = jax.tree.map(
        lambda y, g: jnp.zeros_like(y) if g is None and y is not None else g, states, gradient.states, is_leaf=lambda x: x is None
    )
    return pull_back(filled)[0]

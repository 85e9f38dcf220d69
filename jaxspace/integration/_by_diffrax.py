"""An integration with diffrax's loop.

Its adjoints integrate again backwards, by another program, whose last digits are rounded
differently. If the error estimates chose the steps there as well, these would end at other times
than the steps of the run, and the derivatives would be wrong. The steps are therefore chosen once,
without derivatives, and passed to diffrax as a plan.
"""

import dataclasses
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import State
from ..solvers.vector_field import TERM
from ._loop import integrate_loop
from ._loop_settings import LoopSettings
from ._loop_state import LoopState
from .result import Outcome


def solve_by_diffrax(
    field: PyTree, y0: State, settings: LoopSettings, adjoint: diffrax.AbstractAdjoint | None
) -> Outcome:
    """The outcome of diffrax's loop, for its adjoints and for methods with an additional carry
    between steps."""
    chosen = None
    if settings.plan is None:
        chosen, nodes = _chosen_steps(field, y0, settings)
        settings = dataclasses.replace(settings, plan=nodes)
    saves = [
        diffrax.SubSaveAt(t1=True)
        if settings.save_ts is None
        else diffrax.SubSaveAt(ts=settings.save_ts)
    ]
    if settings.record_steps or settings.dense:
        saves.append(diffrax.SubSaveAt(steps=True))
    solution: Any = diffrax.diffeqsolve(
        TERM,
        settings.solver(),
        settings.start,
        settings.end,
        None,
        y0,
        field,
        saveat=diffrax.SaveAt(subs=saves, solver_state=True),
        stepsize_controller=settings.planned(),
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        max_steps=settings.max_steps,
        throw=False,
    )
    out_of_steps = solution.result == diffrax.RESULTS.max_steps_reached
    taken, rejected = (solution.stats[f"num_{how}_steps"] for how in ("accepted", "rejected"))
    if chosen is not None:
        out_of_steps = out_of_steps | (chosen.t < settings.end)
        # If the steps ran out, one more step of the plan reaches the end.
        taken, rejected = chosen.accepted, chosen.rejected
    # As in the loop of `solve`, a state that was not reached is NaN.
    states = jax.tree.map(lambda x: jnp.where(out_of_steps, jnp.nan, x), solution.ys[0])
    return Outcome(
        states,
        solution.solver_state[1],
        out_of_steps,
        taken,
        rejected,
        solution.ts[1] if len(saves) > 1 else None,
        solution.ys[1] if settings.dense else None,
        outside=None if chosen is None else chosen.outside,
    )


def _chosen_steps(
    field: PyTree, y0: State, settings: LoopSettings
) -> tuple[LoopState, Float[Array, " nodes"]]:
    """The loop after the steps that the tolerance requires, and their nodes in normalised time;
    without derivatives."""
    field, y0 = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, (field, y0)
    )
    # In diffrax's loop the runs share their steps.
    bare = dataclasses.replace(
        settings, save_ts=None, record_steps=True, dense=False, together=True
    )
    loop = integrate_loop(bare, field, y0)
    ends = loop.buffers.ends_of(loop.accepted)
    assert ends is not None
    nodes = jnp.where(jnp.isfinite(ends), ends, settings.end)
    return loop, jnp.concatenate([settings.start[None], nodes])

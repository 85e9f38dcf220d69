"""An integration by diffrax's own loop.

Its adjoints integrate again backwards, in a program of its own in which the last digits round
otherwise. If the error estimates chose the steps there as well, those would end at other times than
the steps that they stand for, and the derivatives would be wrong. So the steps are chosen once,
without derivatives, and diffrax takes them as a plan.
"""

import dataclasses
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ._loop import TERM, LoopSettings, integrate_loop
from ._outcome import Outcome


def solve_by_diffrax(
    field: PyTree,
    y0: State,
    settings: LoopSettings,
    adjoint: diffrax.AbstractAdjoint | None,
) -> Outcome:
    """The outcome by diffrax's loop: for its adjoints, and for methods that carry on more than a
    state from step to step."""
    num_rejected = exhausted = None
    if settings.plan is None:
        plan, num_rejected, exhausted = _chosen_steps(field, y0, settings)
        settings = dataclasses.replace(settings, plan=plan)
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
        stepsize_controller=settings.controller(),
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        max_steps=settings.max_steps,
        throw=False,
    )
    out_of_steps = solution.result == diffrax.RESULTS.max_steps_reached
    if exhausted is not None:
        out_of_steps = out_of_steps | exhausted
    # As the loop of `solve` leaves it: a state that was not reached is NaN.
    states = jax.tree.map(lambda x: jnp.where(out_of_steps, jnp.nan, x), solution.ys[0])
    return Outcome(
        states,
        solution.solver_state[1],
        out_of_steps,
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"] if num_rejected is None else num_rejected,
        solution.ts[1] if len(saves) > 1 else None,
        solution.ys[1] if settings.dense else None,
    )


def _chosen_steps(
    field: PyTree, y0: State, settings: LoopSettings
) -> tuple[Float[Array, " nodes"], Int[Array, ""], Bool[Array, ""]]:
    """The nodes of the steps that the tolerance calls for, how many were rejected, and whether they
    ran out. Without derivatives."""
    field, y0 = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, (field, y0)
    )
    bare = dataclasses.replace(
        settings, save_ts=None, record_steps=True, dense=False, restarts=False
    )
    loop = integrate_loop(bare, field, y0)
    assert loop.step_ends is not None
    taken = jnp.arange(settings.max_steps) < loop.num_accepted
    nodes = jnp.where(taken, loop.step_ends, settings.end)
    return (
        jnp.concatenate([settings.start[None], nodes]),
        loop.num_rejected,
        loop.t < settings.end,
    )

"""An integration by diffrax's own loop."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..core import State
from ._loop import TERM, LoopSettings
from ._outcome import Outcome


def solve_by_diffrax(
    field: PyTree,
    y0: State,
    settings: LoopSettings,
    adjoint: diffrax.AbstractAdjoint | None,
) -> Outcome:
    """The outcome by diffrax's loop: for its adjoints, and for methods that carry on more than a
    state from step to step."""
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
    # As the loop of `solve` leaves it: a state that was not reached is NaN.
    states = jax.tree.map(lambda x: jnp.where(out_of_steps, jnp.nan, x), solution.ys[0])
    return Outcome(
        states,
        solution.solver_state[1],
        out_of_steps,
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"],
        solution.ts[1] if len(saves) > 1 else None,
        solution.ys[1] if settings.dense else None,
    )

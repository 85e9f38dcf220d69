"""Whether the runs of a campaign have an exact part of their motion, and whether it turns so fast
that the steps would run out (`Accuracy.decoupled`).

The runs are traced, so that the nominal run decides for all."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from ..core.jit import jit_quickly
from ..core.status import Status
from ..core.stored import is_storing
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy
from ..integration.exact_part import exact, leaves_open, takes_many_steps
from ..simulation.legs import legs_of
from ..simulation.phases import longest
from ..simulation.runnable import AbstractRunnable
from ._interface import AbstractCampaign, jit_of_campaign


def _turns(campaign: AbstractCampaign) -> list[Array]:
    """Angles, rad, through which the exact parts of the phases turn in the nominal run."""
    mission, y0 = campaign.mission(campaign.nominal())
    result = []
    for leg in legs_of(mission)[0]:
        system = leg.phase.system
        decoupled = None if isinstance(system, AbstractRunnable) else system.decoupled()
        if decoupled is not None:
            result.append(jnp.max(decoupled.turns(longest(leg.phase.until), y0)))
    return result


# The compiler leaves out of the mission what the turns do not depend on.
_compiled_turns = jit_of_campaign(_turns, jit_quickly)


def _turns_of(campaign: AbstractCampaign) -> list[Array]:
    """The same, compiled; a campaign without an exact part compiles nothing, unless its program is
    loaded from a folder, which is quicker than to trace the mission."""
    if not is_storing() and not eqx.filter_eval_shape(_turns, campaign):
        return []
    return _compiled_turns(campaign)


def for_turns(campaign: AbstractCampaign, accuracy: Accuracy, status: ArrayLike) -> Accuracy | None:
    """The accuracy with which runs of this `status` are repeated, if steps ran out: with the exact
    part of the motion in closed form. `None` where that cures nothing."""
    out = np.any(np.asarray(status) == Status.MAX_STEPS)
    return exact(accuracy) if out and leaves_open(accuracy) and _turns_of(campaign) else None


def with_exact_parts(campaign: AbstractCampaign, accuracy: Accuracy) -> Accuracy:
    """The accuracy with its `decoupled` set where the nominal run rotates fast.

    Unchanged where it does not, and where the numbers of the campaign are unknown."""
    if is_traced(campaign) or not leaves_open(accuracy):
        return accuracy
    turns = [float(np.asarray(x)) for x in _turns_of(campaign)]
    return exact(accuracy) if turns and takes_many_steps(max(turns), accuracy) else accuracy

"""Whether the runs of a campaign have an exact part of their motion, and whether it turns so fast
that the steps would run out (`Accuracy.decoupled`).

The runs are traced, so that the nominal run decides for all."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy
from ..integration.compiling import QUICK
from ..integration.exact_part import takes_many_steps
from ..simulation.legs import legs_of
from ..simulation.phases import longest
from ..simulation.runnable import AbstractRunnable


def _turns(campaign: Any) -> list[Array]:
    """Angles, rad, through which the exact parts of the phases turn in the nominal run."""
    mission, y0 = campaign.mission(campaign.nominal())
    result = []
    for leg in legs_of(mission)[0]:
        phase: Any = leg.phase
        loop = isinstance(phase.system, AbstractRunnable)
        decoupled = None if loop else phase.system.decoupled()
        if decoupled is not None:
            result.append(jnp.max(decoupled.turns(longest(phase.until), y0)))
    return result


# The compiler leaves out of the mission what the turns do not depend on.
_turns_compiled = eqx.filter_jit(_turns, **QUICK)


def has_exact_part(campaign: Any, accuracy: Accuracy) -> bool:
    """Whether the campaign has an exact part, and the accuracy does not decide about it."""
    if accuracy.decoupled is not None or accuracy.method != "auto":
        return False
    return bool(eqx.filter_eval_shape(_turns, campaign))


def with_exact_parts(campaign: Any, accuracy: Accuracy) -> Accuracy:
    """The accuracy with its `decoupled` set where the nominal run turns fast.

    Unchanged where it does not, and where the numbers of the campaign are unknown."""
    if is_traced(campaign) or not has_exact_part(campaign, accuracy):
        return accuracy
    turns = max(float(np.asarray(x)) for x in _turns_compiled(campaign))
    if not takes_many_steps(turns, accuracy):
        return accuracy
    return dataclasses.replace(accuracy, decoupled=True)

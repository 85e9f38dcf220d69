"""Whether the exact part of a motion is computed by its closed form, and only the rest by steps.
This pays off where the turns of the exact part would use up many of the steps of a run.

    n = 1.2 (1e-9 / rtol)^(1/8) a >= N / 2

The closed form of a rotation takes longer to compile than a step, so that a slow rotation is
integrated with the rest.

    symbol  meaning                                            unit
    n, N    steps for the turns, most steps of a run           1
    a       turns of the exact part in the run                 rad

The factor is measured, on spinning bodies by DOP853, at tolerances from 3e-7 to 1e-12.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core import AbstractDecoupled, AbstractSystem, Scalar
from ..core.checks import is_concrete
from ..core.jit import jit_quickly
from ..core.structure import without_numbers
from .accuracy import Accuracy

STEPS_PER_RADIAN = 1.2
OF_TOLERANCE = 1e-9


def with_exact_part(
    accuracy: Accuracy, system: AbstractSystem, y: PyTree, times: Scalar
) -> Accuracy:
    """The accuracy with its `decoupled` decided for runs of a system.

    **Arguments**

    - `accuracy`: as the user gave it; a choice in it is respected.
    - `system`, `y`: the system, and a state that shows how fast the runs turn.
    - `times`: the duration of the runs, s, or their save times, (times, *runs).

    **Returns** the accuracy as it was if it has the choice already, or if the numbers are unknown
    (under `jit`, or in a derivative): the whole motion is then integrated."""
    if not leaves_open(accuracy) or not _has_exact_part(system):
        return accuracy
    if not is_concrete(times) or not all(map(is_concrete, jax.tree.leaves(y))):
        return accuracy
    decoupled = system.decoupled()
    assert decoupled is not None
    duration = np.asarray(times)
    if duration.ndim:
        duration = duration[-1] - duration[0]
    turns = np.asarray(_turns(decoupled, jnp.asarray(duration), y))
    turns = float(np.max(turns, initial=0.0))
    return dataclasses.replace(accuracy, decoupled=takes_many_steps(turns, accuracy))


# One program: alone, each of its operations would be another one.
@jit_quickly
def _turns(decoupled: AbstractDecoupled, duration: Scalar, y: PyTree) -> Scalar:
    """The angle, rad, through which the exact part of the motion turns."""
    return decoupled.turns(duration, y)


def leaves_open(accuracy: Accuracy) -> bool:
    """Whether the user leaves open how the exact part is computed."""
    return accuracy.decoupled is None and accuracy.method == "auto"


def exact(accuracy: Accuracy) -> Accuracy:
    """The accuracy that asks for the exact part of the motion in closed form, where the user leaves
    that open."""
    return dataclasses.replace(accuracy, decoupled=True) if leaves_open(accuracy) else accuracy


@without_numbers
def _has_exact_part(system: AbstractSystem) -> bool:
    return system.decoupled() is not None


def takes_many_steps(turns: float, accuracy: Accuracy) -> bool:
    """Whether this angle, rad, requires half of the maximum number of steps of a run with this
    accuracy."""
    # An unknown tolerance counts as the default one.
    known = is_concrete(accuracy.rtol)
    rtol = float(np.min(np.asarray(accuracy.rtol))) if known else OF_TOLERANCE
    steps = STEPS_PER_RADIAN * (OF_TOLERANCE / rtol) ** 0.125 * turns
    return steps >= 0.5 * accuracy.max_steps

"""How a run ended, in a number that fits a batch and a sentence that says what to do."""

import enum

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int


class Status(enum.IntEnum):
    """How a run ended. `sentence` says what happened and what to do; above `EVENT` something went
    wrong."""

    COMPLETED = 0
    EVENT = 1
    TOLERANCE_MISSED = 2
    MAX_STEPS = 3
    EVENT_MISSED = 4
    NOT_FINITE = 5

    @property
    def sentence(self) -> str:
        """What happened, and what to do about it."""
        return _SENTENCES[self]

    @property
    def good(self) -> bool:
        """Whether the result may be used as it is."""
        return self <= Status.EVENT


_SENTENCES = {
    Status.COMPLETED: "The run reached its end within the tolerance.",
    Status.EVENT: "The run stopped at its event, found to the tolerance.",
    Status.TOLERANCE_MISSED: "Some steps missed the tolerance: look for a collision or a singularity, or refine the step plan.",
    Status.MAX_STEPS: "The steps ran out: raise Accuracy.max_steps or max_step, loosen the tolerance, or look for a singularity.",
    Status.EVENT_MISSED: "The event of the phase did not happen within its limit: raise Event.within, or check the condition.",
    Status.NOT_FINITE: "The state left the finite numbers: check the initial state and the parameters of this run.",
}


def worst(first: Int[Array, "..."], second: Int[Array, "..."]) -> Int[Array, "..."]:
    """The status of two runs in sequence: the first trouble stays, otherwise the later word
    counts."""
    return jnp.where(first > Status.EVENT, first, second)


class SimulationError(RuntimeError):
    """A run did not end well; the message carries the sentence of its `Status`."""


def raise_if_bad(status: Array) -> None:
    """Raise `SimulationError` for the first bad one of the known statuses, with its sentence."""
    every = np.asarray(status).reshape(-1)
    bad = np.flatnonzero(every > Status.EVENT)
    if bad.size:
        which = (
            ""
            if every.size == 1
            else f"Run {bad[0]} ({bad.size} of {every.size} runs in trouble): "
        )
        raise SimulationError(which + Status(int(every[bad[0]])).sentence)


def judged(
    out_of_steps: Bool[Array, "..."], finite: Bool[Array, "..."], account: Array
) -> Int[Array, "..."]:
    """The status of runs from whether their steps ran out, whether they stayed finite, and their
    largest local error."""
    status = jnp.where(account > 1.0, Status.TOLERANCE_MISSED, Status.COMPLETED)
    status = jnp.where(finite, status, Status.NOT_FINITE)
    return jnp.where(out_of_steps & (status != Status.NOT_FINITE), Status.MAX_STEPS, status).astype(
        jnp.int32
    )

"""Status of a run: a number, one for each run of a batch, and an explanatory message with a
remedy."""

import contextlib
import enum
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int


class Status(enum.IntEnum):
    """Status of a finished run.

    `sentence` explains what happened and how to proceed. A status above `EVENT` is a failure: the
    states that the run did not reach are NaN. Below `COMPLETED` the states are there, and
    doubtful."""

    BELOW_GROUND = -1
    COMPLETED = 0
    EVENT = 1
    TOLERANCE_MISSED = 2
    MAX_STEPS = 3
    EVENT_MISSED = 4
    NOT_FINITE = 5
    REFUSED = 6
    EVENT_UNRESOLVED = 7
    CONDITION_NOT_FINITE = 8
    EVENTS_PILE_UP = 9
    OUTSIDE_MODEL = 10
    SAMPLES_TOO_FEW = 11
    RAISED = 12
    COMMAND_NOT_FINITE = 13
    TIME_UNRESOLVED = 14
    FINAL_ERROR_MISSED = 15

    @property
    def sentence(self) -> str:
        """Explanation of the status, and how to proceed."""
        return _SENTENCES[self]

    @property
    def good(self) -> bool:
        """Whether the run succeeded."""
        return self <= Status.EVENT


_SENTENCES = {
    Status.BELOW_GROUND: (
        "The run reached its end within the tolerance but passed below the surface of the planet: "
        "add a terminal event such as AtAltitude, or raise the orbit."
    ),
    Status.COMPLETED: "The run reached its end within the tolerance.",
    Status.EVENT: "The run stopped at a terminal event, located within the tolerance.",
    Status.TOLERANCE_MISSED: (
        "Some steps did not meet the tolerance: look for a collision or a singularity, or use more "
        "fixed steps."
    ),
    Status.MAX_STEPS: (
        "The maximum number of steps was reached: increase max_steps (in Python "
        "Accuracy.max_steps, in a scene file the key max_steps) or max_step, loosen the tolerance, "
        "or look for a singularity."
    ),
    Status.EVENT_MISSED: (
        "The event of the phase did not occur within its time limit: increase Event.within (in a "
        "scene file the key within of the phase), or check the condition."
    ),
    Status.NOT_FINITE: (
        "The state became NaN or infinite: check the initial state and the parameters of this run."
    ),
    Status.REFUSED: "A parameter is outside its allowed range, so the run was not started.",
    Status.EVENT_UNRESOLVED: (
        "The search for the time of an event did not converge: check that the condition is smooth "
        "around its zero."
    ),
    Status.CONDITION_NOT_FINITE: (
        "The condition of an event became NaN or infinite: it must be finite along the whole run."
    ),
    Status.EVENTS_PILE_UP: (
        "Events follow each other faster than the time resolution, like the last bounces of a "
        "ball: end the run earlier, or continue with a system at rest."
    ),
    Status.OUTSIDE_MODEL: (
        "The state left the model's range of validity, such as by a collision or a mass below the "
        "dry mass: add a terminal event that stops the run earlier."
    ),
    Status.SAMPLES_TOO_FEW: (
        "The condition of an event changes faster than it is sampled, so that zeros may be missed: "
        "increase Event.samples, or add save times."
    ),
    Status.RAISED: (
        "A function called by the run raised an error: replay this run to see the error."
    ),
    Status.COMMAND_NOT_FINITE: (
        "The controller returned a command that is NaN or infinite: check its parameters, its "
        "memory and its sensor readings in this run."
    ),
    Status.TIME_UNRESOLVED: (
        "The run is too short for the precision of its time: use a time origin close to the run."
    ),
    Status.FINAL_ERROR_MISSED: (
        "The run reached its end but not with the requested error: request a larger one, use "
        "float64, or declare the times at which forces jump, because no method resolves a "
        "discontinuity that it does not know."
    ),
}


class SimulationError(RuntimeError):
    """A run failed; the message contains the sentence of its `Status`."""


@contextlib.contextmanager
def sentence_alone() -> Iterator[None]:
    """In this context, convert the error of a program with a failed run to a `SimulationError`.

    JAX raises a separate error with the traceback of the call. It is caught where the library
    calls a program; a program compiled by the user raises it at the user's call."""
    try:
        yield
    # Which of the two is raised depends on how JAX calls the program.
    except (jax.errors.JaxRuntimeError, ValueError) as error:
        _, name, sentence = str(error).rpartition(f"{SimulationError.__name__}: ")
        if not name:
            raise
        raise SimulationError(sentence.strip()) from None


def combine_status(first: Int[Array, "..."], second: Int[Array, "..."]) -> Int[Array, "..."]:
    """The status of two runs in sequence: the first failure stays, else the second counts."""
    return jnp.where(first > Status.EVENT, first, second)


def time_unresolved(
    t0: Float[Array, "*#runs"], duration: Float[Array, "*#runs"], *, rounded: bool
) -> Bool[Array, "*#runs"]:
    """Whether a run from `t0`, s, has a `duration`, s, of fewer than sixteen numbers of the time.

    - `rounded`: whether the duration is the difference of two times. Then that of a run far from
      the epoch may be zero by rounding."""
    spacing = jnp.finfo(t0.dtype).eps * (jnp.abs(t0) + jnp.abs(duration))
    # Close to the epoch a run of no length is meant: a phase that is left out.
    meant = duration == 0.0
    if rounded:
        meant = meant & (spacing < 1.0)
    return (jnp.abs(duration) < 16.0 * spacing) & ~meant


def raise_on_failure(status: Array, where: Callable[[], str] | None = None) -> None:
    """Raise `SimulationError` for the first failure among concrete statuses, with its message.

    `where` is an additional message: the time and the state at which a single run failed."""
    every = np.asarray(status).reshape(-1)
    failures = every > Status.EVENT
    if not failures.any():
        return
    failed = np.flatnonzero(failures)
    which = ""
    if every.size > 1:
        which = f"Run {failed[0]} ({failed.size} of {every.size} runs failed): "
    sentence = which + Status(int(every[failed[0]])).sentence
    raise SimulationError(sentence if where is None else f"{sentence} {where()}".rstrip())


def status_from(
    out_of_steps: Bool[Array, "..."], finite: Bool[Array, "..."], max_local_error: Array
) -> Int[Array, "..."]:
    """The status of runs.

    **Arguments**

    - `out_of_steps`: whether the steps ran out before the end.
    - `finite`: whether the state stayed finite.
    - `max_local_error`: in units of the tolerance; up to 1 is within it."""
    # In the order in which one failure explains the others: NaN first, then the steps, then the
    # error.
    status = jnp.where(max_local_error > 1.0, Status.TOLERANCE_MISSED, Status.COMPLETED)
    status = jnp.where(out_of_steps, Status.MAX_STEPS, status)
    return jnp.where(finite, status, Status.NOT_FINITE).astype(jnp.int32)

"""The search for the first event of each run, outside every derivative.

The zero is bracketed on samples of the dense output and then closed in by Newton's method within
its bracket. A dip between the samples is examined, too: where the middle one of three samples of
one sign is nearest to zero, and so near that the second difference g_- - 2 g + g_+ might reach it,
the extremum is found by the secant of the slopes, and the search continues from the first place
beyond zero.

A zero at the start, to rounding, is the event at which the run before has ended. Nothing is
reported unchecked: a search that does not converge, a condition that is not finite and events that
follow each other faster than the time resolves have a status each.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..core import AbstractSystem, Scalar, State
from ._config import IntegrationConfig
from ._event_bracket import ConditionOnRun
from ._event_zero import ROUNDINGS, first_zero, rounding_change
from ._events import Event
from ._status import Status


class FoundEvents(NamedTuple):
    """What the search has found for each run.

    - `time`, `which`: of the first event: its time, s, and its number; the end of the run and -1
      where none happens.
    - `status`: `COMPLETED`, or why the search failed before that time.
    - `failed`: how long after the start, s, that was; infinite where the search did not fail.
    - `times`, `hits`, `sizes`: of each event its first time, s, whether it happens, and the largest
      condition among the samples."""

    time: Scalar
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    failed: Scalar
    times: list[Scalar]
    hits: list[Bool[Array, "*runs"]]
    sizes: list[Scalar]


def first_event(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    run_axes: int,
) -> FoundEvents:
    """The first event of each run between `t0` and `t1`, s. Not differentiable."""
    system, y0, t0, t1, events = jax.tree.map(_fixed, (system, y0, t0, t1, events))
    along = [ConditionOnRun(system, event, config, run_axes) for event in events]
    zeros = [first_zero(condition, y0, t0, t1) for condition in along]
    when = t1
    which = -jnp.ones(jnp.shape(t1), jnp.int32)
    for number, zero in enumerate(zeros):
        sooner = zero.hit & ((jnp.abs(zero.time - t0) < jnp.abs(when - t0)) | (which < 0))
        when = jnp.where(sooner, zero.time, when)
        which = jnp.where(sooner, number, which)
    status = jnp.full(jnp.shape(t1), Status.COMPLETED, jnp.int32)
    # What fails after the first event does not concern the run.
    earliest = jnp.abs(when - t0)
    failed = jnp.full_like(earliest, jnp.inf)
    for zero in zeros:
        sooner = zero.failed <= earliest
        earliest = jnp.where(sooner, zero.failed, earliest)
        failed = jnp.where(sooner, zero.failed, failed)
        status = jnp.where(sooner, zero.status, status)
    return FoundEvents(
        when,
        which,
        status,
        failed,
        [zero.time for zero in zeros],
        [zero.hit for zero in zeros],
        [zero.size for zero in zeros],
    )


def happened_together(
    system: AbstractSystem,
    events: tuple[Event, ...],
    found: FoundEvents,
    t0: Scalar,
    t: Scalar,
    y: State,
    run_axes: int,
) -> Bool[Array, "events *#runs"]:
    """Which of the events happen at the time `t`, s, of the first one, to rounding.

    All that a run from there on would take for a zero at its start are among them."""
    system, t0, t, y, events = jax.tree.map(_fixed, (system, t0, t, y, events))
    flags = []
    for number, (event, hit, size) in enumerate(zip(events, found.hits, found.sizes, strict=True)):
        value, slope = event.slope(system, t, y)
        change = rounding_change(event, system, t, y, run_axes)
        change = change + size + jnp.abs(slope) * jnp.maximum(jnp.abs(t), jnp.abs(t - t0))
        eps = float(jnp.finfo(value.dtype).eps)
        # Twice what counts as a zero at the start, so that none is lost between two runs.
        also = hit & (found.which >= 0) & (jnp.abs(value) <= 2.0 * ROUNDINGS * eps * change)
        flags.append((found.which == number) | also)
    return jnp.stack(flags)


# A system may hold functions among its leaves.
def _fixed(x: object) -> object:
    return jax.lax.stop_gradient(x) if eqx.is_array(x) else x

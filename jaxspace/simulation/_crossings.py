"""Every zero of a condition along a run that was simulated before."""

import dataclasses
from collections.abc import Callable

from ..core import Scalar, State
from ..integration.crossings import Crossings
from ..integration.events import Event
from ._batch_runs import run_systems
from ._runs import run_one_system
from .batch_layout import local_blocks, split_batch
from .checks import as_events, check_events
from .trajectory import Trajectory


def crossings(
    run: Trajectory,
    condition: Callable[[Scalar, State], Scalar] | Event,
    *,
    samples: int | None = None,
    capacity: int | None = None,
) -> Crossings:
    """Every zero of a condition along a run, or along each run of a batch.

    **Arguments**

    - `run`: from `simulate` or `simulate_batch`. It is integrated again, by the same method; an
      event with `terminal=False` in `simulate` saves this.
    - `condition`: a function (t, y) of time, s, and state, which returns one number for each run;
      or an `Event`, whose `direction`, `touch` and `at_start` then count.
    - `samples`: least number of parts of the run that are searched; by default `Event.samples`, or
      the number of save times if that is larger.
    - `capacity`: largest number of zeros; by default `Event.capacity`.

    **Returns** `Crossings`: times and states in the order of the run, their number, and whether
    they are complete. Differentiable in both modes with respect to all inputs of the run. Where the
    search or the run failed, they are those before the failure, and `status` gives the reason.

    **Raises** `InputError` for a condition that is not one number for each run, and for a run that
    jumps in place on its way, or had a controller."""
    run.check_repeatable("crossings")
    event = condition if isinstance(condition, Event) else Event(condition)
    event = dataclasses.replace(
        event,
        # Searched without effect on the run: an end or a jump at the event would make another run.
        terminal=False,
        then=None,
        samples=max(event.samples, len(run) - 1) if samples is None else samples,
        capacity=event.capacity if capacity is None else capacity,
    )
    events = as_events((event,))
    system = run.system
    y0 = run.initial
    config = run.config
    # First and last alone, because the search chooses the samples between them.
    ends = run.ts[:: len(run) - 1]
    if run.run_axes == 0:
        check_events(events, system, y0, ends[0], 0)
        return run_one_system(system, y0, ends, events, config, 0).crossings[0]
    batched, shared, runs = split_batch(system, y0, ends, None, 1)
    blocks = local_blocks((batched, shared), runs)
    return run_systems(batched, shared, config, events, blocks, False).crossings[0]

"""The times at which a campaign saves states, each in the phase that covers it."""

import functools
import warnings
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..core import InputError
from ..simulation import Event, Mission, Phase
from ..simulation.legs import legs_of
from ..simulation.phase_runs import MissionTimes
from ..simulation.runnable import AbstractRunnable
from ._campaign import Campaign
from ._interface import jit_of_campaign
from ._saved_states import ChosenTimes, StatesToStore

# Rounding of a sum of durations, by which a user's time can be beyond the end of a phase.
ROUNDING = 8.0 * np.finfo(float).eps


def choose_times(
    campaign: Campaign, times: Sequence[float]
) -> tuple[ChosenTimes | MissionTimes | None, ...]:
    """The places in each phase at which states are saved, so that those at `times`, s, are among
    them; `None` for a phase without any.

    A time at the border of two phases belongs to the earlier one, before its jump. From the first
    phase that ends by an event or after a random duration, every phase has all remaining times,
    because it starts and ends at other times in each run.

    **Raises** `InputError` for a time outside the mission, and for one that may be in a phase
    sampled by a controller."""
    left = np.unique(np.asarray(times, float))
    if np.ndim(times) != 1 or left.size == 0 or not np.all(np.isfinite(left)):
        raise InputError(f"times is {times!r}: it must be a list of one or more times, in s.")
    mission = _nominal_mission(campaign)
    first = float(campaign.start)
    result = []
    ends = []
    last = {}
    for leg in legs_of(mission)[0]:
        before = _Left(left, first, True) if leg.after is None else ends[leg.after]
        chosen, after = _chosen_in(leg.phase, before, campaign.num_saved)
        result.append(chosen)
        ends.append(after)
        last[leg.line] = after
    # A branch may run at a time at which the mission itself has ended.
    left = functools.reduce(np.intersect1d, [end.times for end in last.values()])
    known = all(end.known for end in last.values())
    # The mission ends with its longest branch. Where ends differ between runs, nothing is known of
    # the times behind the first of them.
    start = (max if known else min)(end.start for end in last.values() if end.known == known)
    _check_left(left, first, start, [leg.phase for leg in legs_of(mission)[0]], known)
    return tuple(result)


class _Left(NamedTuple):
    """The remaining times at the start of a phase.

    - `times`: s, that no earlier phase has.
    - `start`: of the phase, s, or of the first earlier one whose end differs between runs.
    - `known`: whether `start` is that of the phase."""

    times: np.ndarray
    start: float
    known: bool


# Compiled, because each operation that builds a mission would be a separate program.
@jit_of_campaign
def _nominal_mission(campaign: Campaign) -> Mission:
    return campaign.mission(campaign.nominal())[0]


def _chosen_in(
    phase: Phase, before: _Left, num_saved: int
) -> tuple[ChosenTimes | MissionTimes | None, _Left]:
    """The places in a phase at which states are saved, and the remaining times."""
    left, start, known = before
    if not left.size:
        return None, before
    if isinstance(phase.system, AbstractRunnable):
        raise InputError(
            f"times has {left[-1]:.9g} s: it must be at most {start:.9g} s, because a controller "
            f"samples the phase {phase.name!r}, which begins {'then' if known else 'later'}. Use "
            "`samples` to store states of such a phase."
        )
    if not known or isinstance(phase.until, Event) or np.ndim(phase.until) > 0:
        # A sum of durations matches the start to rounding only.
        near = np.abs(left - start) <= ROUNDING * (1.0 + abs(start))
        times = jnp.asarray(np.where(near, start, left))
        return MissionTimes(times, num_saved), before._replace(known=False)
    duration = float(phase.until)
    # The state of a phase of no length is that of the phase before, which has its time.
    if not duration:
        return None, before
    places = (left - start) / duration
    rounding = ROUNDING * (1.0 + abs(start / duration))
    here = (places >= -rounding) & (places <= 1.0 + rounding)
    chosen = _saved(np.clip(places[here], 0.0, 1.0), num_saved) if here.any() else None
    return chosen, _Left(left[~here], start + duration, known)


def warn_of_times_outside(
    campaign: Campaign, kept: StatesToStore, trajectories: Mapping[str, np.ndarray]
) -> None:
    """Warn of times that no run of the first call reaches, in phases whose times differ between
    runs."""
    if isinstance(kept, int) or not any(isinstance(c, MissionTimes) for c in kept):
        return
    # Only names and order of the phases are needed, and nothing is computed.
    mission = eqx.filter_eval_shape(lambda c: c.mission(c.nominal())[0], campaign)
    reached: dict[float, bool] = {}
    for leg, chosen in zip(legs_of(mission)[0], kept, strict=True):
        if isinstance(chosen, MissionTimes):
            here = np.isfinite(trajectories[f"{leg.name}.time"]).any(axis=-1)
            for t, at_time in zip(np.asarray(chosen.times).tolist(), here.tolist(), strict=True):
                reached[t] = reached.get(t, False) or at_time
    if not all(reached.values()):
        runs = next(iter(trajectories.values())).shape[-1]
        result = ", ".join(f"{t:.9g}" for t, at_time in reached.items() if not at_time)
        warnings.warn(
            f"times has {result} s, at which none of the first {runs} runs is active: the stored "
            "states are NaN for all of them.",
            stacklevel=4,
        )


def _check_left(
    left: np.ndarray, first: float, start: float, phases: Sequence[Phase], known: bool
) -> None:
    """Raise `InputError` for times at which no phase can run.

    `start`: of the first phase whose end differs between runs; or the end of the mission."""
    if known and left.size:
        raise InputError(
            f"times has {left[-1]:.9g} s: it must be a time of the mission, from {first:.9g} s to "
            f"{start:.9g} s."
        )
    durations = [p.until for p in phases if not isinstance(p.until, Event)]
    # A mission backwards in time is not checked here.
    before = left[left < start - ROUNDING * (1.0 + abs(start))]
    if before.size and all(np.all(np.asarray(x) >= 0.0) for x in durations):
        raise InputError(
            f"times has {before[0]:.9g} s: it must be a time of the mission, from {first:.9g} s on."
        )


def _saved(places: np.ndarray, num_saved: int) -> ChosenTimes:
    places = np.unique(places)
    # The outputs read states at equal distances, and the store keeps the chosen ones: one run saves
    # both.
    even = np.linspace(0.0, 1.0, num_saved)
    fractions = np.union1d(places, even)
    outputs, kept = (jnp.asarray(np.searchsorted(fractions, x)) for x in (even, places))
    return ChosenTimes(jnp.asarray(fractions), outputs, kept)

"""The times at which a campaign keeps states, each in the phase that covers it."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..core import InputError
from ..simulation import Event, Phase
from ..simulation._flight import AbstractFlight
from ._along import ChosenTimes
from ._campaign import Campaign

# Of a sum of durations, as a user writes it, beyond the end of a phase.
ROUNDING = 8.0 * np.finfo(float).eps


def choose_times(campaign: Campaign, times: Any) -> tuple[ChosenTimes | None, ...]:
    """For each phase where its states are saved so that those at `times`, s, are among them; `None`
    for a phase without any.

    A time at the border of two phases belongs to the earlier one, before its jump.

    **Raises** `InputError` for a time at which the mission does not run, and for one beyond the
    start of a phase whose end is not known before the run."""
    left = np.unique(np.asarray(times, float))
    if np.ndim(times) != 1 or left.size == 0 or not np.all(np.isfinite(left)):
        raise InputError(f"times is {times!r}: it must be a list of one or more times, in s.")
    # Compiled, because each operation that builds a mission would be a program of its own.
    mission = eqx.filter_jit(lambda c: c.build(c.nominal())[0])(campaign)
    first = start = float(campaign.start)
    found: list[ChosenTimes | None] = []
    for phase in mission.phases:
        if left.size and not _is_known(phase):
            raise InputError(
                f"times has {left[-1]:.9g} s: it must be at most {start:.9g} s, where the phase "
                f"{phase.name!r} begins, which every run ends at a time of its own or a controller "
                f"samples. `samples` keeps states of such a phase."
            )
        found.append(None)
        duration = float(phase.until) if left.size else 0.0
        if duration:
            places, rounding = (left - start) / duration, ROUNDING * (1.0 + abs(start / duration))
            here = (places >= -rounding) & (places <= 1.0 + rounding)
            if here.any():
                found[-1] = _saved(np.clip(places[here], 0.0, 1.0), campaign.along)
            left, start = left[~here], start + duration
    if left.size:
        raise InputError(
            f"times has {left[-1]:.9g} s: it must be a time of the mission, from {first:.9g} s to "
            f"{start:.9g} s."
        )
    return tuple(found)


def _saved(places: np.ndarray, along: int) -> ChosenTimes:
    places, even = np.unique(places), np.linspace(0.0, 1.0, along)
    fractions = np.union1d(places, even)
    outputs, kept = (jnp.asarray(np.searchsorted(fractions, x)) for x in (even, places))
    return ChosenTimes(jnp.asarray(fractions), outputs, kept)


def _is_known(phase: Phase) -> bool:
    """Whether all runs of a phase last equally long, and can be saved at any time."""
    scatters = isinstance(phase.until, Event) or np.ndim(phase.until) > 0
    return not scatters and not isinstance(phase.system, AbstractFlight)

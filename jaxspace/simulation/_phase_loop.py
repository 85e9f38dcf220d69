"""Consecutive phases that differ in their numbers only, computed by one program in a loop.

A program contains the vector field, the step and the event search of each phase. The fall
under a first parachute, the wait for the second one and the fall under both have the same
structure, and a loop over them contains these parts once, which reduces the compilation time. A
duration is run as an event that does not happen within it.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, Scalar, State
from ..core.structure import same_structure
from ..integration.config import IntegrationConfig
from ..integration.events import Event, closures_of_events
from ..integration.integrate import locates_events, searches_steps
from ..integration.layout import broadcast_state, runs_of, state_at
from ._integrator import Integrator
from ._mission import Phase
from ._to_event import SwitchedCondition, integrate_to_event
from .checks import check_events
from .legs import Leg
from .phase_runs import SaveTimes, with_missed
from .runnable import AbstractRunnable
from .trajectory import Trajectory


def loop_groups(
    legs: Sequence[Leg],
    num_saved: int | Sequence[SaveTimes],
    configs: tuple[IntegrationConfig, ...],
) -> dict[int, list[int]]:
    """The phases of a mission that can be run in a loop, by the first of each group: each saves its
    two ends only, with steps that can be searched for an event.

    Arguments as of `run_mission`."""
    saved = [num_saved] * len(legs) if isinstance(num_saved, int) else num_saved
    groups: list[list[int]] = [[]]
    for number, leg in enumerate(legs):
        last, config = groups[-1], configs[number]
        ends_alone = isinstance(saved[number], int) and saved[number] == 2
        if not ends_alone or not searches_steps(config):
            # Nothing joins an empty group but the first of the next one.
            groups.append([])
            continue
        follows = last and leg.after == last[-1] and not leg.parted
        same = follows and same_structure(configs[last[0]], config)
        if same and all(_one_structure(legs[k].phase, leg.phase) for k in last):
            last.append(number)
        else:
            groups.append([number])
    return {group[0]: group for group in groups if len(group) > 1}


def _one_structure(first: Phase, then: Phase) -> bool:
    """Whether two phases, of which one follows the other without a jump, differ in their numbers
    only."""
    if first.then is not None or isinstance(first.system, AbstractRunnable):
        return False
    # The loop knows no phase's start when it stacks their numbers.
    if first.counts_from_start:
        return False
    events = [phase.until for phase in (first, then) if isinstance(phase.until, Event)]
    if not all(same_structure(event, events[0]) for event in events):
        return False
    return same_structure(first.system, then.system)


def run_in_loop(
    phases: Sequence[Phase], y0: State, t0: Scalar, config: IntegrationConfig, run_axes: int
) -> list[Trajectory] | None:
    """The results of these phases up to their jumps, of which only the last one may have one; and
    `None` where one of them does not locate its event during its steps.

    `t0`: where the first one starts, s."""
    events = [phase.until for phase in phases if isinstance(phase.until, Event)]
    system = phases[0].system
    assert isinstance(system, AbstractSystem)
    # Durations alone need no search, which the loop would make for each.
    if len(phases) < 2 or not events:
        return None
    y0 = broadcast_state(system, t0, y0)
    runs = runs_of(y0, run_axes)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    t0 = jnp.broadcast_to(jnp.asarray(t0, dtype), runs)
    if not locates_events(config, system, y0, t0):
        return None
    check_events(tuple(events), system, y0, t0, run_axes, "Phase.until")
    sought = [isinstance(phase.until, Event) for phase in phases]
    longest = [p.until.within if isinstance(p.until, Event) else p.until for p in phases]
    within = [jnp.broadcast_to(jnp.asarray(x, dtype), runs) for x in longest]
    # A phase without an event takes that of another one, which is not sought.
    pairs = [(p.system, p.until if isinstance(p.until, Event) else events[0]) for p in phases]
    numbers, parts_of = _stacked(pairs)

    def one(
        carry: tuple[State, Array], own: tuple[list[Array], Array, Array]
    ) -> tuple[tuple[State, Array], Trajectory]:
        y, t = carry
        differing, within, sought = own
        system, event = parts_of(differing)
        event = dataclasses.replace(event, condition=SwitchedCondition(event.condition, sought, t))
        events = closures_of_events((event,), t, y)
        # A phase that starts beyond its event lasts no time, as it does outside of a loop.
        beyond = events[0].beyond(t, y)
        if beyond is not None:
            beyond = beyond & sought
            within = jnp.where(beyond, 0.0, within)
        times = jnp.stack([t, t + within])
        run = integrate_to_event(Integrator(system, config, run_axes), y, times, events)
        run = with_missed(run, beyond, sought)
        return (state_at(run.states, -1, run_axes), run.ts[-1]), run

    own = numbers, jnp.stack(within), jnp.array(sought)
    _, results = jax.lax.scan(one, (y0, t0), own)
    return _of_each_phase(results, sought)


def _of_each_phase(results: Trajectory, sought: list[bool]) -> list[Trajectory]:
    """The results of a loop, phase by phase; `sought`: whether each was to end at its event."""
    every = [jax.tree.map(lambda x, k=k: x[k], results) for k in range(len(sought))]
    # Outside of a loop a phase of known duration has no event, and so none that could have
    # happened.
    none = jnp.zeros((0, *every[0].status.shape), bool)
    return [
        run if event else dataclasses.replace(run, happened=none)
        for run, event in zip(every, sought, strict=True)
    ]


def _stacked(trees: Sequence[Any]) -> tuple[list[Array], Callable[[list[Array]], Any]]:
    """The arrays that differ between trees of one structure, one after the other on a new first
    axis; and the tree with one of each of them."""
    every = [jax.tree.flatten(eqx.filter(tree, eqx.is_array)) for tree in trees]
    rest = eqx.filter(trees[0], eqx.is_array, inverse=True)
    leaves, structure = every[0]
    columns = list(zip(*(x for x, _ in every), strict=True))
    # Shared values remain outside of the loop.
    differ = [any(x is not column[0] for x in column) for column in columns]

    def tree(own: list[Array]) -> Any:
        mine = iter(own)
        chosen = [next(mine) if d else x for d, x in zip(differ, leaves, strict=True)]
        return eqx.combine(jax.tree.unflatten(structure, chosen), rest)

    own = [jnp.stack(column) for column, d in zip(columns, differ, strict=True) if d]
    return own, tree

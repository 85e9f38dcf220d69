"""The configuration of every phase of a mission, before anything is compiled."""

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..core import InputError, Scalar
from ..core.structure import shape_of
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig, resolve
from ..integration.events import Event
from ..integration.exact_part import with_exact_part
from ..integration.field_trace import field_trace
from ..integration.initial_state import state_dtype
from ..integration.programs import Runs, rolls_stages
from ._mission import Mission, Phase
from ._warnings import warn_of_switches
from .checks import check_structure, shapes_after
from .legs import legs_of
from .runnable import AbstractRunnable


def resolve_phases(
    mission: Mission,
    y0: PyTree,
    accuracy: Accuracy,
    run_axes: int = 0,
    *,
    rolled: bool | None = None,
) -> tuple[IntegrationConfig, ...]:
    """The configuration of every phase, in the order of `legs_of`, before anything is compiled.

    The structure of the state in a phase follows from the jumps before it. `rolled`: whether the
    stages of many runs are rolled, by default determined by the mission only, so that a run does
    not depend on the number of others."""
    configs, operations = resolve_and_count(mission, y0, accuracy, run_axes)
    # The operations of the fields of all phases together, which are one program.
    if run_axes and (rolls_stages(Runs.MANY, operations) if rolled is None else rolled):
        return tuple(config.rolled_stages() for config in configs)
    return configs


def resolve_and_count(
    mission: Mission, y0: PyTree, accuracy: Accuracy, run_axes: int
) -> tuple[tuple[IntegrationConfig, ...], int]:
    """`resolve_phases` with the steps of one run, and the operations of the vector fields of all
    phases together."""
    configs = []
    operations = 0
    # Of each phase, at its end: the shapes of the state before its jump, and after it.
    left, behind = [], []
    legs, _ = legs_of(mission)
    for leg in legs:
        phase = leg.phase
        if leg.after is None:
            y = jax.tree.map(shape_of, y0)
        else:
            y = (left if leg.parted else behind)[leg.after]
        # Only shapes are needed: a jump may change the structure of the state.
        zero = jax.ShapeDtypeStruct((), state_dtype(y))
        if leg.start is not None:
            y = shapes_after(leg.start, zero, y, f"Mission.start before the phase {leg.name!r}")
        check_until(phase, run_axes)
        whole = check_structure(phase.moving, y, zero, one_run=run_axes == 0, stacklevel=5)
        events = (phase.until,) if isinstance(phase.until, Event) else ()
        warn_of_switches(phase.moving, events, whole, zero, stacklevel=5)
        if isinstance(phase.system, AbstractRunnable):
            # The steps between two samples are fixed, and never run out.
            configs.append(phase.system.config(y, accuracy))
        else:
            # The rate of rotation at the start of the mission is taken for later phases as well.
            phase_accuracy = with_exact_part(accuracy, phase.system, y0, longest(phase.until))
            configs.append(resolve(phase.system, y, phase_accuracy))
            operations += field_trace(phase.system, zero, whole).operations
        # The jump takes the state at the end of the phase, broadcast to the runs of its system.
        left.append(whole)
        if phase.then is not None:
            whole = shapes_after(phase.then, zero, whole, f"Phase {leg.name!r}: then")
        behind.append(whole)
    return tuple(configs), operations


def longest(until: Scalar | Event) -> Scalar:
    """The longest time that a phase may take, s."""
    if not isinstance(until, Event):
        return until
    assert until.within is not None
    return until.within


def check_until(phase: Phase, run_axes: int) -> None:
    """Raise `InputError` for a duration with other axes than the runs."""
    until = phase.until
    if not isinstance(until, Event) and jnp.ndim(until) > run_axes:
        allowed = "(runs,) or one time" if run_axes else "one time"
        raise InputError(
            f"Phase {phase.name!r}: until has the shape {until.shape}: it must be {allowed}, in s."
        )

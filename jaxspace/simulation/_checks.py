"""What is refused before a run is compiled: times, structures and events that cannot be right."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, InputError, State, check_finite, is_concrete
from ..integration._accuracy import state_dtype
from ..integration._events import Event
from ..integration._integrate import broadcast_state
from ..integration._selection import shape_of


def check_times(ts: Any, y0: State, axes: int = 1) -> Array:
    """The save times in the precision of the state.

    Raises `InputError` unless they are finite and ascend or descend."""
    ts = jnp.asarray(ts, state_dtype(y0))
    if not 1 <= ts.ndim <= axes or ts.shape[0] < 2:
        allowed = "one axis of at least two times" if axes == 1 else "(times,) or (times, runs)"
        raise InputError(f"ts has the shape {ts.shape}: it must be {allowed}.")
    if is_concrete(ts):
        check_finite("ts", ts)
        steps = np.diff(np.asarray(ts, dtype=float), axis=0)
        if not np.all(np.all(steps >= 0.0, axis=0) | np.all(steps <= 0.0, axis=0)):
            raise InputError("ts turns around: its times must ascend or descend.")
    return ts


def check_num_saved(num_saved: int) -> None:
    """Raise `InputError` unless each phase saves a start and an end."""
    if not 2 <= num_saved <= 10**7:
        raise InputError(f"num_saved is {num_saved}: it must be from 2 to 1e7.")


def check_structure(system: AbstractSystem, y0: State, t: Array | jax.ShapeDtypeStruct) -> None:
    """Raise `InputError` unless the derivative has the structure of the state."""
    leaves, structure = jax.tree.flatten(jax.tree.map(shape_of, (system, y0, t)))
    try:
        _check_structure(structure, tuple(leaves))
    except TypeError:
        # A leaf that cannot be hashed: nothing can be kept from one call to the next.
        _check_structure.__wrapped__(structure, tuple(leaves))


@functools.lru_cache(maxsize=256)
def _check_structure(structure: Any, leaves: tuple[Any, ...]) -> None:
    """Once for each system and state of one make: tracing the field costs more than a short run."""
    system, y0, t = jax.tree.unflatten(structure, leaves)
    derivative = eqx.filter_eval_shape(lambda s, t, y: s.vector_field(t, y), system, t, y0)
    if jax.tree.structure(derivative) == jax.tree.structure(y0):
        return
    held, given = (
        [
            jax.tree_util.keystr(path) or "an array"
            for path, _ in jax.tree_util.tree_flatten_with_path(tree)[0]
        ]
        for tree in (y0, derivative)
    )
    raise InputError(
        f"y0 holds {', '.join(held)}, and {type(system).__name__}.vector_field returns "
        f"{', '.join(given)}: the derivative must have the structure of the state."
    )


def check_events(
    events: tuple[Event, ...], system: AbstractSystem, y0: State, t: Array, run_axes: int
) -> None:
    """Raise `InputError` for a condition that is not one number for each run."""
    if not events:
        return
    y = eqx.filter_eval_shape(broadcast_state, system, t, y0)
    leaf = jax.tree.leaves(y)[0]
    runs = leaf.shape[leaf.ndim - run_axes :]
    for number, event in enumerate(events):
        value = jax.eval_shape(event.condition, t, y)
        shape = getattr(value, "shape", type(value).__name__)
        if shape not in (runs, ()):
            raise InputError(
                f"events[{number}].condition returns {shape}: it must return one number."
            )

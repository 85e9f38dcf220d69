"""Checks before a run is compiled: its times, structures and events."""

import functools
import inspect
import reprlib
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, DTypeLike, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.checks import check_finite, is_concrete
from ..core.layout import run_axes_of
from ..core.structure import once_per_structure
from ..core.tracing import is_traced
from ..core.user_functions import reason_of
from ..integration.accuracy import Accuracy
from ..integration.events import Event
from ..integration.field_trace import field_trace
from ..integration.layout import broadcast_state, runs_of
from ._warnings import warn_of_kinks, warn_of_switches

Verb = TypeVar("Verb", bound=Callable[..., Any])

# A time, s, or its shape.
Time: TypeAlias = Scalar | jax.ShapeDtypeStruct


# Names of a tolerance in other libraries.
TOLERANCES = ("tol", "tolerance", "rel_tol", "reltol", "abs_tol", "abstol", "solver", "stepsize")


def hints_of_arguments(verb: Verb) -> Verb:
    """The verb, with a helpful error for unknown arguments. It raises
    `TypeError` for one, as every function does."""
    known = [*inspect.signature(verb).parameters]

    @functools.wraps(verb)
    def checked(*given: object, **named: object) -> object:
        for name in named.keys() - set(known):
            raise TypeError(f"{verb.__name__} has no argument {name}{_hint(name, known)}")
        return verb(*given, **named)

    return cast(Verb, checked)


def _hint(name: str, known: list[str]) -> str:
    """The replacement for an unknown argument, as the end of the message."""
    if name in Accuracy.__dataclass_fields__:
        return f": give accuracy=Accuracy({name}=...)."
    if name in TOLERANCES:
        return ": give accuracy=1e-9, or accuracy=Accuracy(rtol=..., atol=..., method=...)."
    return "." + (InputError.hint(name, known) or f" It has {', '.join(known)}.")


def check_times(ts: object, dtype: DTypeLike, axes: int = 1) -> Array:
    """The save times in the precision `dtype` of the state.

    Raises `InputError` unless they are finite and ascend or descend."""
    ts = as_times("ts", ts, dtype, "an array of times, s")
    if not 1 <= ts.ndim <= axes or ts.shape[0] < 2:
        allowed = "one axis of at least two times" if axes == 1 else "(times,) or (times, runs)"
        raise InputError(f"ts has the shape {ts.shape}: it must be {allowed}.")
    if is_concrete(ts):
        check_finite("ts", ts)
        times = np.asarray(ts, dtype=float)
        ascends, descends = times[1:] >= times[:-1], times[1:] <= times[:-1]
        if not np.all(ascends.all(axis=0) | descends.all(axis=0)):
            raise InputError(
                "ts changes direction: its times must be strictly ascending or descending."
            )
    return ts


def as_times(name: str, x: object, dtype: DTypeLike, allowed: str) -> Array:
    """Times in the precision `dtype` of the state. Raises `InputError`, which names the `allowed`
    values, for anything but real numbers."""
    # Even a conversion that changes nothing would run a program.
    if isinstance(x, jax.Array) and x.dtype == dtype and not x.weak_type:
        return x
    known = not is_traced(x)
    if known:
        try:
            kind = jnp.asarray(x).dtype if isinstance(x, list | tuple) else np.asarray(x).dtype
        except (TypeError, ValueError, OverflowError):
            kind = np.dtype(object)
        # A text of digits and a complex number would be converted without an error.
        real = jnp.issubdtype(kind, jnp.floating) or jnp.issubdtype(kind, jnp.integer)
        if not real or isinstance(x, str):
            raise InputError(f"{name} is {reprlib.repr(x)}: it must be {allowed}.")
    if known and not isinstance(x, list | tuple):
        return jax.device_put(np.asarray(x, dtype))
    ts = jnp.asarray(x)
    if jnp.issubdtype(ts.dtype, jnp.complexfloating):
        raise InputError(f"{name} is complex: it must be {allowed}.")
    return ts.astype(dtype)


def check_num_saved(num_saved: int) -> None:
    """Raise `InputError` unless each phase saves a start and an end."""
    if not isinstance(num_saved, int) or not 2 <= num_saved <= 10**7:
        raise InputError(f"num_saved is {num_saved}: it must be a whole number from 2 to 1e7.")


def check_run(
    system: AbstractSystem,
    y0: PyTree,
    ts: Array,
    events: tuple[Event, ...],
    *,
    run_axes: int,
    traced: bool,
    stacklevel: int,
) -> None:
    """Check and warn of the initial state of a run, or of a batch, together with its system and its
    events.

    **Arguments**

    - `y0`: of an `InitialState`; `ts`: save times, s.
    - `traced`: whether any of the numbers are; then only shapes are checked.
    - `stacklevel`: that of the caller, for the warnings.

    **Raises** `InputError` as `check_structure`, `check_values` and `check_events` do; the
    conditions of a batch are checked block by block."""
    # A shape is enough to trace a vector field, and has no number that would be computed.
    start = jax.ShapeDtypeStruct(ts.shape[1:], ts.dtype)
    one_run = run_axes == 0
    shapes = check_structure(system, y0, start, one_run=one_run, stacklevel=stacklevel + 1)
    if not traced:
        check_values(system, ts, y0)
    if one_run:
        check_events(events, system, shapes, start, 0)
    warn_of_switches(system, events, shapes, start, stacklevel=stacklevel + 1)


def check_values(system: AbstractSystem, ts: Array, y0: PyTree) -> None:
    """Call `check_values` of the system, which raises `InputError`, at the start of a run whose
    numbers are known."""
    if type(system).check_values is not AbstractSystem.check_values:
        # Indexed by NumPy, because JAX would compile the indexing; and by the class of the system,
        # because the method of an instance is a separate module, slow to create.
        t = np.atleast_1d(np.asarray(ts))[0]
        type(system).check_values(system, jnp.asarray(t) if t.ndim else float(t), y0)


def shapes_after(
    jump: Callable[[Scalar, State], State], t: Time, y: PyTree, name: str = "jump"
) -> PyTree:
    """The shapes of the state after a jump, from those of the time and of the state before.

    Raises `InputError`, which names the jump, if it fails for them or does not return a state."""
    try:
        after = _jumped(jump, t, y)
    except InputError:
        raise
    # A jump may raise anything for a state of another kind; its words are quoted.
    except Exception as error:
        raise InputError(
            f"{name} fails for the time and a state with {_held(y)}: {reason_of(error)}"
        ) from error
    leaves = jax.tree.leaves(after)
    if not leaves or not all(isinstance(leaf, jax.ShapeDtypeStruct) for leaf in leaves):
        what = "nothing" if after is None else f"an object of type {type(after).__name__}"
        raise InputError(f"{name} returns {what}: it must return the state after the jump.")
    return after


@once_per_structure
def _jumped(jump: Callable[[Scalar, State], State], t: Time, y: PyTree) -> PyTree:
    return eqx.filter_eval_shape(lambda jump, t, y: jump(t, y), jump, t, y)


@once_per_structure
def check_structure(
    system: AbstractSystem, y0: PyTree, t: Time, *, one_run: bool, stacklevel: int
) -> PyTree:
    """The shapes of the state, broadcast to the runs of the system; `stacklevel` is that of the
    caller, for a warning.

    Raises `InputError` unless the derivative has the structure of the state. With `one_run` also
    for an array that by its declaration carries several runs."""
    if one_run:
        _check_one_run(system, y0)
    # A vector field may raise anything for a state of another kind; its words are quoted.
    try:
        trace = field_trace(system, t, y0)
        derivative = trace.rate
        if one_run:
            _check_axes(system, y0, derivative)
        if jax.tree.structure(derivative) == jax.tree.structure(y0):
            whole = eqx.filter_eval_shape(broadcast_state, system, t, y0)
            # Three more: itself, and the two frames of `once_per_structure`.
            count = len(jax.tree.leaves(whole))
            warn_of_kinks(trace.jaxpr, system, count, stacklevel=stacklevel + 3)
            return whole
    except InputError:
        raise
    except Exception as error:
        # The likely cause: a function of one run, such as a network.
        cure = (
            ""
            if one_run
            else (
                " In a batch the runs are on the last axis: vectorise a function of a single run "
                "with jax.vmap(f, in_axes=-1, out_axes=-1)."
            )
        )
        raise InputError(
            f"{type(system).__name__}.vector_field fails for y0, which contains {_held(y0)}: "
            f"{reason_of(error)}{cure}"
        ) from error
    raise InputError(
        f"y0 contains {_held(y0)}, and {type(system).__name__}.vector_field returns "
        f"{_held(derivative)}: the derivative must have the structure of the state."
    )


def _check_axes(system: AbstractSystem, y0: PyTree, derivative: PyTree) -> None:
    """Raise `InputError` for a derivative of one run with axes that the state does not have, which
    would be taken for runs."""
    if jax.tree.structure(derivative) != jax.tree.structure(y0):
        return
    leaves = jax.tree_util.tree_flatten_with_path(y0)[0]
    for (path, leaf), rate in zip(leaves, jax.tree.leaves(derivative), strict=True):
        if np.broadcast_shapes(np.shape(leaf), rate.shape) != np.shape(leaf):
            name = "y0" + jax.tree_util.keystr(path)
            raise InputError(
                f"{type(system).__name__}.vector_field returns {rate.shape} for {name}, which has "
                f"the shape {np.shape(leaf)}: the derivative must have the shape of the state."
            )


def _check_one_run(system: AbstractSystem, y0: PyTree) -> None:
    """Raise `InputError` for an array with more axes than its field declares components.

    A single integration would use the same steps for all of them, and have one status."""
    # Arrays without a declaration, such as a state of bare arrays, may have any axes.
    axes = run_axes_of((system, y0), lambda x: 0)
    leaves = jax.tree_util.tree_flatten_with_path((system, y0))[0]
    for (path, leaf), runs in zip(leaves, jax.tree.leaves(axes), strict=True):
        if runs:
            name = ("system", "y0")[path[0].idx] + jax.tree_util.keystr(path[1:])
            raise InputError(
                f"{name} has the shape {leaf.shape}, with a batch axis: simulate and "
                "simulate_mission integrate a single run, simulate_batch and "
                "simulate_mission_batch a batch (studies.sensitivity with batch=True). For several "
                "bodies, pass a dictionary of position and velocity, each (3, bodies)."
            )


def _held(tree: PyTree) -> str:
    """The arrays of a tree with their shapes, in words."""
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return ", ".join(
        f"{jax.tree_util.keystr(path) or 'an array'} {getattr(leaf, 'shape', '')}".strip()
        for path, leaf in leaves
    )


def as_events(given: object) -> tuple[Event, ...]:
    """The events as a tuple. Raises `InputError` for anything else than a sequence of them."""
    members = None
    if isinstance(given, Iterable) and not isinstance(given, Event):
        # Gathered once, because a generator gives its events a single time.
        members = tuple(given)
    events = tuple(event for event in members or () if isinstance(event, Event))
    if members is None or len(events) < len(members):
        name = type(given).__name__
        raise InputError(f"events is of type {name}: it must be a tuple of `Event`.")
    if any(event.passed is not None for event in events):
        raise InputError(
            "events contains an event with passed=True: it is allowed as Phase.until only, because "
            "a separate run would end at its start."
        )
    collected = any(not event.terminal and event.then is None for event in events)
    if collected and has_jumps(events):
        raise InputError(
            "events contains both an event with a jump (then) and one that is only recorded: "
            "together with a jump, every event must be terminal or have a jump. Give the recorded "
            "event an identity jump."
        )
    return events


def has_jumps(events: tuple[Event, ...]) -> bool:
    """Whether one of the events jumps and the run continues."""
    return any(event.then is not None for event in events)


def check_dense(dense: bool, events: tuple[Event, ...]) -> None:
    """Raise `InputError` for `dense=True` with events that jump in place."""
    if dense and has_jumps(events):
        raise InputError(
            "dense=True is not available with an event that jumps (then): such a run stores no "
            "steps, so the requested times must be among ts."
        )


def check_jump(event: Event, t: Time, y: PyTree, name: str) -> None:
    """Raise `InputError` for an in-place jump that changes the structure of the state."""
    if event.then is None:
        return
    after = shapes_after(event.then, t, y, f"{name}.then")
    if _held(after) != _held(y):
        raise InputError(
            f"{name}.then receives a state with {_held(y)} and returns {_held(after)}: the "
            "structure must be unchanged, because the run continues."
        )


def check_events(
    events: tuple[Event, ...],
    system: AbstractSystem,
    y: PyTree,
    t: Time,
    run_axes: int,
    name: str = "events[{}]",
) -> None:
    """Raise `InputError` for a condition that is not one number for each run.

    - `y`, `t`: a state that is broadcast to the runs of the `system`, and a time, or their shapes.
    - `name`: that of an event, for the message, with a placeholder for its number."""
    if events:
        names = tuple(name.format(number) for number in range(len(events)))
        _check_events(events, type(system).__name__, y, t, run_axes, names)


@once_per_structure
def _check_events(
    events: tuple[Event, ...],
    system: str,
    y: PyTree,
    t: Time,
    run_axes: int,
    names: tuple[str, ...],
) -> None:
    runs = runs_of(y, run_axes)
    # One time for each run, so that a condition of the time alone carries runs, too.
    t = jax.ShapeDtypeStruct(runs, t.dtype)
    for name, event in zip(names, events, strict=True):
        what = f"{name}.condition"
        try:
            value = eqx.filter_eval_shape(event.condition, t, y)
        # A condition may raise anything for a state of another kind; its words are quoted.
        except Exception as error:
            raise InputError(
                f"{what} fails for the time and the state of {system}: {reason_of(error)}"
            ) from error
        shape = getattr(value, "shape", type(value).__name__)
        if shape != runs:
            of_each = f", {runs}: it must not reduce over the batch axis" if runs else ""
            raise InputError(f"{what} returns {shape}: it must return one number{of_each}.")
        if not jnp.issubdtype(value.dtype, jnp.floating):
            raise InputError(
                f"{what} returns {value.dtype.name}: it must return a number that passes through "
                f"zero, such as the difference of two sides of a comparison."
            )
        check_jump(event, t, y, name)

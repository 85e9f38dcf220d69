"""One run of a system or a mission as a compiled program: what it leaves, how long it takes, how
much memory it asks for."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..core import AbstractSystem, State, check_finite
from ..integration._accuracy import Accuracy, check_initial_state
from ..simulation import Mission, Trajectory, simulate
from ..simulation._simulate import check_times

ENOUGH = 2.0  # s: a run is not repeated after its repetitions took so long


class Flight(NamedTuple):
    """What a run leaves: its final state, times and states of every phase, its status, the
    evaluations and the accepted steps of every phase."""

    final: State
    spans: tuple[Any, ...]
    status: Any
    evaluations: tuple[Any, ...]
    steps: tuple[Any, ...]


def flight(system: AbstractSystem | Mission, y0: State, ts: Any, accuracy: Accuracy) -> Flight:
    """A run, whatever it is that runs."""
    run = simulate(system, y0, ts, accuracy=accuracy, throw=False)  # pyright: ignore[reportArgumentType, reportCallIssue]
    phases: tuple[Trajectory, ...] = (run,) if isinstance(run, Trajectory) else run.phases
    spans = tuple((p.ts, p.states) for p in phases)

    def count(name):
        return tuple(p.stats.get(name, 0) for p in phases)

    return Flight(run.final, spans, run.status, count("evaluations"), count("steps"))


def checked_start(system: Any, y0: State, ts: Any) -> tuple[State, Any]:
    """Initial state and times as arrays. Raises `InputError` as `simulate` does, which cannot see
    them once they are traced."""
    y0 = jax.tree.map(jnp.asarray, y0)
    check_initial_state(y0)
    if not isinstance(system, Mission):
        return y0, check_times(ts, y0)
    check_finite("ts", ts)
    return y0, jnp.asarray(ts, jnp.result_type(*jax.tree.leaves(y0)))


class Program(NamedTuple):
    """A compiled function; what compiling it took, s; and the memory it asks for, bytes (`None`
    where that is not known)."""

    call: Callable[..., Any]
    seconds: float
    memory: int | None


def aot_compile(function: Callable[..., Any], *arguments: Any) -> Program:
    """The function of arrays, compiled for arguments like these."""
    started = time.perf_counter()
    call = jax.jit(function).lower(*arguments).compile()
    seconds = time.perf_counter() - started
    try:
        sizes: Any = call.memory_analysis()
        memory = (
            sizes.argument_size_in_bytes
            + sizes.output_size_in_bytes
            + sizes.temp_size_in_bytes
            - sizes.alias_size_in_bytes
        )
    except (AttributeError, NotImplementedError, jax.errors.JaxRuntimeError):
        memory = None
    return Program(call, seconds, memory)


def timed(call: Callable[..., Any], repeats: int, *arguments: Any) -> tuple[Any, float]:
    """The result, and the median time, s, of up to `repeats` calls after a first one."""
    result, times = jax.block_until_ready(call(*arguments)), []
    while len(times) < repeats and (not times or sum(times) < ENOUGH):
        started = time.perf_counter()
        jax.block_until_ready(call(*arguments))
        times.append(time.perf_counter() - started)
    return result, float(np.median(times))


def in_precision(tree: Any, precision: str) -> Any:
    """Every floating-point array of the tree in the `precision`."""
    return jax.tree.map(lambda x: jnp.asarray(x, precision) if eqx.is_inexact_array(x) else x, tree)


def blocks(tree: State) -> list[tuple[np.ndarray, bool]]:
    """The blocks of a state in double precision, each with whether it is a quaternion, whose sign
    means nothing."""
    found = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [
        (np.asarray(x, float), getattr(path[-1], "name", "") == "wxyz" if path else False)
        for path, x in found
    ]


def distance(state: State, reference: State) -> float:
    """The largest over all blocks of |difference| / |block| (the difference itself for a block that
    is zero)."""
    worst = 0.0
    for (x, quaternion), (exact, _) in zip(blocks(state), blocks(reference), strict=True):
        apart = np.linalg.norm(x - exact)
        apart = min(apart, np.linalg.norm(x + exact)) if quaternion else apart
        size = np.linalg.norm(exact)
        relative = apart / (size if size > 0.0 else 1.0)
        worst = float(relative) if not relative <= worst else worst  # a NaN is the worst of all
    return worst

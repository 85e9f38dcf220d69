"""One run of a system or a mission as a compiled program: its result, time and memory."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.checks import check_finite
from ..integration.accuracy import Accuracy
from ..integration.initial_state import InitialState
from ..simulation import Mission
from ..simulation.checks import check_times
from ..simulation.dispatch import simulate_any
from ..simulation.legs import legs_of
from ..simulation.mission_result import Simulated, numbers_of

# s: a run is not repeated after its repetitions took so long.
ENOUGH = 2.0

Tree = TypeVar("Tree")
OutputOfRun: TypeAlias = Callable[[Scalar, State], Array]
"""An output of the time at which a run ends, and of its final state."""


def run_once(
    system: AbstractSystem | Mission,
    y0: State,
    ts: Float[Array, " times"] | Float[Array, ""],
    accuracy: Accuracy,
) -> Simulated:
    """A run of a system or a mission.

    **Arguments**

    - `system`, `y0`: the system and its initial state.
    - `ts`: the save times of a system, or the time at which a mission starts, s.
    - `accuracy`: tolerance and method.

    **Returns** its numbers, which a compiled program can return. A failed run has the status for
    it, and raises no error."""
    return numbers_of(simulate_any(system, y0, ts, accuracy=accuracy, throw=False))


def value_of(run: Simulated, output: OutputOfRun) -> Array:
    """An output of the end of a run."""
    return output(run.end, run.final)


def counts_of(run: Simulated, name: str) -> list[int]:
    """A count of each phase: "evaluations" of its vector field, or its accepted "steps"."""
    # A closed form counts nothing.
    return [int(phase.stats.get(name, 0)) for phase in run.phases]


def systems_of(system: AbstractSystem | Mission) -> list[AbstractSystem]:
    """The system of every phase of a mission; of a system, itself."""
    if not isinstance(system, Mission):
        return [system]
    return [leg.phase.moving for leg in legs_of(system)[0]]


def check_start(
    system: AbstractSystem | Mission,
    y0: State,
    ts: Float[ArrayLike, " times"] | Float[ArrayLike, ""],
) -> tuple[State, Float[Array, " times"] | Float[Array, ""]]:
    """Initial state and times as arrays.

    **Raises** `InputError` as `simulate` does, which cannot see them once they are traced."""
    y, dtype = InitialState.of(y0)
    y = jax.tree.map(jnp.asarray, y)
    if not isinstance(system, Mission):
        return y, check_times(ts, dtype)
    check_finite("ts", ts)
    return y, jnp.asarray(ts, dtype)


class Program(NamedTuple):
    """A compiled function.

    - `call`: runs it.
    - `seconds`: time of its compilation, s.
    - `memory`: required memory, bytes; `None` if it is unknown."""

    call: Callable[..., Any]
    seconds: float
    memory: int | None


def aot_compile(function: Callable[..., PyTree[Array]], *arguments: PyTree[ArrayLike]) -> Program:
    """The function, compiled for arguments of these shapes."""
    started = time.perf_counter()
    call = jax.jit(function).lower(*arguments).compile()
    seconds = time.perf_counter() - started
    # Not every backend analyses the memory of a program, and their errors differ.
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


def timed(call: Callable[..., Tree], repeats: int, *arguments: PyTree) -> tuple[Tree, float]:
    """The result, and the median time, s, of up to `repeats` calls after a first one."""
    # Once untimed, because a first call also loads the program; and with a wait for the numbers,
    # because JAX returns before they are computed.
    result = jax.block_until_ready(call(*arguments))
    times: list[float] = []
    while len(times) < repeats and (not times or sum(times) < ENOUGH):
        started = time.perf_counter()
        jax.block_until_ready(call(*arguments))
        times.append(time.perf_counter() - started)
    return result, float(np.median(times))


def in_precision(tree: Tree, precision: str) -> Tree:
    """Every floating-point array of the tree in the `precision`."""
    return jax.tree.map(lambda x: jnp.asarray(x, precision) if eqx.is_inexact_array(x) else x, tree)


class Block(NamedTuple):
    """One array of a state in double precision, and whether it is a quaternion."""

    values: np.ndarray
    quaternion: bool

    @property
    def size(self) -> float:
        """The norm, or 1 where it is zero."""
        return float(np.linalg.norm(self.values)) or 1.0


def blocks(tree: State) -> list[Block]:
    """The arrays of a state."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    result = []
    for path, x in leaves:
        name = getattr(path[-1], "name", "") if path else ""
        result.append(Block(np.asarray(x, float), name == "wxyz"))
    return result


def distance(state: State, reference: State) -> float:
    """The largest over all blocks of |difference| / |block| of the `reference`.

    The difference itself for a block that is zero; NaN where any block is NaN."""
    relative = []
    for block, exact in zip(blocks(state), blocks(reference), strict=True):
        apart = np.linalg.norm(block.values - exact.values)
        if block.quaternion:
            # A quaternion and its negative are one attitude.
            apart = np.minimum(apart, np.linalg.norm(block.values + exact.values))
        relative.append(apart / exact.size)
    # NumPy's maximum propagates NaN, Python's may lose it.
    return float(np.max(relative))

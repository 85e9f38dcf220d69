"""Runs that raise an error are identified by halving, so that only their rows are lost."""

import contextlib
from collections.abc import Callable, Iterator
from typing import TypeVar

import jax
import numpy as np

from ..core.status import SimulationError

T = TypeVar("T")

# What JAX raises when a compiled program fails, also for an error of a called-back function.
RAISED = jax.errors.JaxRuntimeError


@contextlib.contextmanager
def callbacks() -> Iterator[None]:
    """Raise `RAISED` for an error of a function that is called back, of whatever class."""
    try:
        yield
    except Exception as error:
        # JAX sometimes raises the same text as a ValueError.
        if isinstance(error, RAISED) or "CpuCallback error" not in str(error):
            raise
        raise RAISED(str(error)) from error


def isolate(function: Callable[[np.ndarray], T], count: int) -> T:
    """Call `function(used)` with all of `count` runs marked in `used` that raise no error.

    `function` computes all runs, (count,); unused ones have the nominal inputs.

    **Raises** `SimulationError` where an error is raised without any of these runs as well."""

    def call(used: np.ndarray) -> T:
        with callbacks():
            return function(used)

    used = np.ones(count, bool)
    try:
        return call(used)
    except RAISED as error:
        # Insufficient memory is not a property of a run.
        if "RESOURCE_EXHAUSTED" in str(error):
            raise
        # The nominal inputs take the place of those of every run: where these raise, no run can be
        # blamed.
        try:
            call(np.zeros(count, bool))
        except RAISED as nominal:
            raise SimulationError(
                f"The nominal run cannot be simulated: a function of the campaign raises an error "
                f"({reason(nominal)})."
            ) from nominal
        used[_raising(call, np.arange(count), count)] = False
        return call(used)


def reason(error: BaseException) -> str:
    """Message of the error that the called function raised, without its traceback."""
    # The text of jax ends with that of Python, which ends with class and sentence.
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1].rstrip(".") if lines else type(error).__name__


def _raising(call: Callable[[np.ndarray], T], among: np.ndarray, count: int) -> np.ndarray:
    """Find the runs among these for which the call raises, by halving the set."""
    used = np.zeros(count, bool)
    used[among] = True
    try:
        call(used)
        return among[:0]
    except RAISED:
        if among.size == 1:
            return among
    halves = np.array_split(among, 2)
    return np.concatenate([_raising(call, half, count) for half in halves])

"""Runs of a scene whose effects are multiplied by factors: one program for all of them.

    q(s):   the output when the load of effect k is multiplied by s_k

The derivative along one factor is that of forward mode, next to the run itself.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import State
from ..core.status import Status
from ..integration.accuracy import Accuracy
from ..integration.initial_state import state_dtype
from ..simulation.mission_result import Simulated
from ._runs import OutputOfRun, run_once, value_of
from ._scene_effects import Runnable, scale_effects


class ScaledOutcome(NamedTuple):
    """Result of a run with scaled effects.

    - `value`, `derivative`: the output, and its derivative along one factor.
    - `status`: of the `run`."""

    value: np.ndarray
    derivative: np.ndarray
    status: Status
    run: Simulated


class ScaledRuns(NamedTuple):
    """Runs with scaled effects, and how their outputs are compared.

    - `names`: of the effects.
    - `call`: the compiled run, of the factors, the direction of the derivative and the tolerance.
    - `rtol`: the relative tolerance of the runs.
    - `signless`: whether an output and its negative are the same."""

    names: tuple[str, ...]
    call: Callable[[list[float], list[float], float], tuple]
    rtol: float
    signless: bool

    def run(
        self, without: Sequence[str] = (), along: str | None = None, tighter: float = 1.0
    ) -> ScaledOutcome:
        """The run without some effects, with the derivative along the factor of one."""
        factors = [0.0 if name in without else 1.0 for name in self.names]
        direction = [1.0 if name == along else 0.0 for name in self.names]
        value, derivative, run = self.call(factors, direction, self.rtol * tighter)
        return ScaledOutcome(
            np.asarray(value, float),
            np.asarray(derivative, float),
            Status(int(run.status)),
            run,
        )

    def change(self, value: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """Change of an output; a quaternion and its negative are one attitude."""
        if self.signless and np.linalg.norm(value + nominal) < np.linalg.norm(value - nominal):
            value = -value
        # The difference of two single numbers would be no array.
        return np.asarray(value - nominal)


def scaled_runs(
    system: Runnable,
    y0: State,
    ts: Array,
    output: OutputOfRun,
    accuracy: Accuracy,
    names: tuple[str, ...],
    signless: bool,
) -> ScaledRuns:
    """The run with factors, compiled once for all of them.

    **Arguments**

    - `system`, `y0`, `ts`: of the runs.
    - `output`: of the end of a run.
    - `accuracy`: of the runs; its tolerance may be tightened later.
    - `names`: of the effects, in the order of their factors.
    - `signless`: whether an output and its negative are the same.

    **Returns** the runs."""
    dtype = state_dtype(y0)
    arrays, static = eqx.partition((system, y0, ts), eqx.is_array)

    def run(
        arrays: PyTree[Array], factors: list[Array], direction: list[Array], rtol: Array
    ) -> tuple[Array, Array, Simulated]:
        system, y0, ts = eqx.combine(arrays, static)
        tightened = dataclasses.replace(accuracy, rtol=rtol)

        def scaled_run(factors: list[Array]) -> tuple[Array, Simulated]:
            scaled = scale_effects(system, dict(zip(names, factors, strict=True)))
            outcome = run_once(scaled, y0, ts, tightened)
            return value_of(outcome, output), outcome

        return jax.jvp(scaled_run, (factors,), (direction,), has_aux=True)

    # Factors and tolerance are traced, so that all runs of a study share this program.
    program = jax.jit(run)

    def call(factors: list[float], direction: list[float], rtol: float) -> tuple:
        # Arrays of the state's precision: Python floats would compile a separate program.
        factor_arrays = [jnp.asarray(x, dtype) for x in factors]
        direction_arrays = [jnp.asarray(x, dtype) for x in direction]
        return program(arrays, factor_arrays, direction_arrays, jnp.asarray(rtol, dtype))

    assert accuracy.rtol is not None
    return ScaledRuns(names, call, float(accuracy.rtol), signless)

"""Configuration of the integration between two samples, and repetition with finer steps."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core.checks import is_concrete
from ..core.tracing import is_traced
from ..integration.accuracy import DEFAULT_RTOL, Accuracy
from ..integration.config import IntegrationConfig, check_tolerance
from ..integration.initial_state import state_dtype
from ..simulation.repeat import error_of_too_few_steps
from ..simulation.trajectory import Trajectory
from ..solvers import FixedSteps
from ._advance import as_fixed
from ._program import LoopInputs, Static
from ._sampled_loop import AbstractSampledLoop

REPEATS = 3
"""Maximum number of repetitions of a run with finer steps before its status reports too few
steps."""


def repeated(
    program: Callable[..., Trajectory],
    inputs: LoopInputs,
    config: IntegrationConfig,
    static: Static,
) -> tuple[Trajectory, IntegrationConfig]:
    """The run, repeated with finer steps if they were too few and the numbers are known."""
    for _ in range(REPEATS + 1):
        result = program(inputs, config, static)
        # Traced numbers have no known error that could decide.
        if is_traced(inputs) or not is_concrete(result.status):
            break
        error = float(np.max(error_of_too_few_steps(result)))
        if error == 0.0:
            break
        # By the size of the error and not by doubling: each repetition compiles another program.
        config = config.with_more_steps(error)
    return result, config


def config_of(
    loop: AbstractSampledLoop, y0: PyTree, accuracy: Accuracy, steps: int | None = None
) -> IntegrationConfig:
    """Configuration of the integration between two samples. Raises `InputError` for a method that a
    loop does not support."""
    dtype = state_dtype(y0)
    rtol = DEFAULT_RTOL.get(dtype.name, 1e-2) if accuracy.rtol is None else accuracy.rtol
    # For a traced tolerance, from which no method can be chosen.
    rough = 1e-9
    if is_concrete(rtol):
        check_tolerance(float(np.min(np.asarray(rtol))), dtype)
        rough = float(np.max(np.asarray(rtol)))
    method = as_fixed(accuracy.method, rough, loop.steps if steps is None else steps)
    rtol = jnp.asarray(rtol, dtype)
    # As in a run of a system (`Accuracy`).
    atol = 1e-3 * rtol if accuracy.atol is None else jnp.asarray(accuracy.atol, dtype)
    return IntegrationConfig(rtol, atol, method, accuracy.max_steps, None)


def steps_of(config: IntegrationConfig) -> int:
    """The fixed steps between two nodes."""
    assert isinstance(config.solver, FixedSteps)
    return config.solver.steps

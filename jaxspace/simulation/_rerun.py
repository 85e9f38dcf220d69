"""Runs repeated with finer steps, to see how far their final states move."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, State
from ..integration.config import IntegrationConfig
from ..integration.layout import broadcast_state, state_at
from ..integration.status import Status
from ._integrator import Integrator
from .batch_layout import in_blocks, local_blocks, split_batch
from .blocks import Blocks, jit_wide_vectors

# A fraction of the run that is not a simple ratio, so that a closed form makes different rounding
# errors.
PART = 0.4


def _final_state(
    system: AbstractSystem, y0: State, ts: Array, config: IntegrationConfig, run_axes: int
) -> State:
    """The state at the last of `ts`, through a state within the run; NaN where the steps run
    out."""
    ends = jnp.stack([ts[0], ts[0] + PART * (ts[-1] - ts[0]), ts[-1]])
    y0 = broadcast_state(system, ts[0], y0)
    result = Integrator(system, config, run_axes).through(y0, ends)
    final = state_at(result.states, -1, run_axes)
    return jax.tree.map(lambda x: jnp.where(result.status == Status.MAX_STEPS, jnp.nan, x), final)


_final_state_of_one = jit_wide_vectors(_final_state)


@jit_wide_vectors
def _final_states(
    batched: tuple, shared: tuple, config: IntegrationConfig, blocks: Blocks
) -> State:

    def run(
        system: AbstractSystem, y0: State, ts: Array, configs: tuple[IntegrationConfig, ...]
    ) -> State:
        return _final_state(system, y0, ts, configs[0], 1)

    return in_blocks(run, batched, shared, (config,), blocks)


def final_state_again(
    system: AbstractSystem, y0: State, ts: Array, config: IntegrationConfig, run_axes: int
) -> State:
    """The final state of each run, simulated again with another configuration.

    **Arguments**

    - `system`, `y0`, `ts`: of one run, or of a batch with the runs last.
    - `config`: usually tighter than the first one.
    - `run_axes`: 0 for one run, 1 for a batch."""
    if run_axes == 0:
        return _final_state_of_one(system, y0, ts, config, 0)
    ends = ts[:: max(ts.shape[0] - 1, 1)]
    batched, shared, runs = split_batch(system, y0, ends, None, 1)
    return _final_states(batched, shared, config, local_blocks((batched, shared), runs))

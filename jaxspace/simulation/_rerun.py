"""Runs repeated: with finer steps, to see how far their final states move, or with their steps, for
states at any time."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, State
from ..core.jit import quick_jit
from ..core.status import Status
from ..integration.config import IntegrationConfig
from ..integration.crossings import Crossings
from ..integration.layout import broadcast_state, state_at
from ..integration.result import IntegrationResult
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


@quick_jit
def with_stored_steps(
    system: AbstractSystem, y0: State, ts: Array, config: IntegrationConfig
) -> IntegrationResult:
    """One run from `y0` through `ts`, (times,), with its steps, which a closed form has not."""
    integrator = Integrator(system, config, 0)
    return integrator.at_times(y0, ts, dense=config.method != "closed_form")


def starts_of_parts(
    t0: float, y0: State, crossings: tuple[Crossings, ...]
) -> list[tuple[float, State]]:
    """Times, s, and states from which one run continues: its start, and its in-place jumps."""
    starts = [(t0, y0)]
    for each in crossings:
        if each.after is not None:
            times = np.asarray(each.ts)[: int(each.count)]
            starts += [(float(t), state_at(each.after, k, 0)) for k, t in enumerate(times)]
    # Stable, because events of one time act in their order.
    return sorted(starts, key=lambda start: abs(start[0] - t0))


def last_finite(states: State) -> int:
    """The number of the last time, before the first one at which some component is not finite;
    components first, then times."""
    leaves = [np.asarray(x) for x in jax.tree.leaves(states)]
    good = [np.all(np.isfinite(x), axis=tuple(range(x.ndim - 1))) for x in leaves]
    bad = np.flatnonzero(~np.all(good, axis=0))
    return (int(bad[0]) if bad.size else leaves[0].shape[-1]) - 1

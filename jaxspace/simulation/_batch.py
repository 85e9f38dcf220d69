"""Many runs of a system, integrated in blocks, each run with individual steps."""

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import ArrayLike, Float, PyTree, Real

from ..core import AbstractSystem, State
from ..core.captured import captured_as_leaves
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy, as_accuracy, check_tolerances
from ..integration.config import IntegrationConfig, resolve
from ..integration.events import Event
from ..integration.exact_part import exact, with_exact_part
from ..integration.initial_state import InitialState
from ..integration.stiffness import InitialConditions
from ._batch_runs import again_by, run_systems
from ._final_error import FinalError
from ._mission import check_system
from ._to_final_error import to_final_error
from .batch_layout import InAxes, cut_batch, local_blocks, split_batch
from .blocks import Blocks
from .checks import (
    as_events,
    check_dense,
    check_run,
    check_times,
    hints_of_arguments,
)
from .finish import checked
from .repeat import Configs, rerun_failed
from .run_call import RunCall
from .trajectory import Trajectory

# Runs of a batch that are inspected to choose its method.
SAMPLED = 16


@hints_of_arguments
def simulate_batch(
    systems: AbstractSystem,
    y0s: State,
    ts: Real[ArrayLike, "times *#runs"] | Sequence[Real[ArrayLike, ""]],
    *,
    accuracy: Accuracy | FinalError | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    in_axes: InAxes = None,
    throw: bool = False,
) -> Trajectory:
    """`simulate` for many runs, with the batch axis as the last axis of every array.

    **Arguments**

    - `systems`, `y0s`: as in `simulate`. The batched arrays follow from the declared shapes: a
      field annotated `Float[Array, "3 *#runs"]` is batched if it has two axes. Arrays of a system
      without an annotation, such as the weights of a network, are shared; arrays of a state without
      an annotation are batched.
    - `ts`: save times, s, (times,) for all runs, or (times, runs).
    - `accuracy`, `events`, `dense`, `throw`: as in `simulate`.
    - `in_axes`: overrides these shapes: a pair of pytrees for `systems` and `y0s`, as in
      `jax.vmap`, of -1 (batch axis last) and `None` (shared).

    **Returns** a `Trajectory` with the batch axis last and a `Status` for each run. A failed run is
    marked in its status. Some runs are repeated:

    - Outside of `jit`, with "auto", runs that reached the maximum number of steps are repeated with
      the method that suits their parameters and states, and with the exact part of their motion in
      closed form. Runs whose fixed steps missed the tolerance are repeated with up to eight times
      as many.

    All local devices are used, unless the arrays or a transformation fix the device.

    Every run has individual steps: it is not affected by the other runs, including failed ones.
    Only the derivative of a run may depend on them, within the tolerance, if a run of its block
    takes more than a few thousand steps.

    **Raises** `InputError` as `simulate` does, and for arrays with different batch sizes.
    `SimulationError`, if `throw`, for a failed run."""
    check_system("systems", systems, "simulate_mission_batch")
    systems = captured_as_leaves(systems)
    y0s, dtype = InitialState.of(y0s, batch=True)
    ts = check_times(ts, dtype, axes=2)
    events = captured_as_leaves(as_events(events))
    check_dense(dense, events)
    batched, shared, runs = split_batch(systems, y0s, ts, in_axes, times_axes=1)
    if isinstance(accuracy, FinalError):
        options = {"events": events, "dense": dense, "in_axes": in_axes}
        return to_final_error(simulate_batch, (systems, y0s, ts), accuracy, throw, options, (runs,))
    # As one system of all runs: the checks below trace it once, and not once for each run.
    whole = cut_batch(batched, shared)
    traced = is_traced((batched, shared))
    check_run(whole[0], whole[1], ts, events, run_axes=1, traced=traced, stacklevel=3)
    # A traced status cannot decide which runs are repeated (below).
    accuracy = as_accuracy(accuracy)
    check_tolerances(accuracy, runs)

    def configs_for(rows: np.ndarray | None, exactly: bool) -> Configs:
        asked = exact(accuracy) if exactly else accuracy
        return (_resolve_for(asked, whole, batched, rows),)

    def run(batched: PyTree, blocks: Blocks, configs: Configs) -> Trajectory:
        return run_systems(batched, shared, configs[0], events, blocks, dense)

    configs = configs_for(None, False)
    result = run(batched, local_blocks((batched, shared), runs), configs)
    if not traced:
        # The steps of a repetition with an exact part are those of the rest alone.
        options = {"exactly": not dense}
        result, configs = rerun_failed(
            result, configs, again_by(run, batched), configs_for, **options
        )
    trajectory = dataclasses.replace(result, call=RunCall(whole[0], accuracy, configs[0]))
    return checked(trajectory, throw, stacklevel=3)


def _resolve_for(
    accuracy: Accuracy,
    whole: PyTree,
    batched: PyTree,
    rows: np.ndarray | None,
) -> IntegrationConfig:
    """The configuration for the runs `rows`, by default for all of them."""
    system, y0, ts = whole
    accuracy = with_exact_part(accuracy, system, y0, ts)

    def starts() -> InitialConditions | None:
        if is_traced((whole, accuracy)):
            return None
        among = np.arange(jax.tree.leaves(batched)[0].shape[-1]) if rows is None else rows
        # The first and the last run are among them, because inputs are often sorted.
        sample = among[np.linspace(0, among.size - 1, SAMPLED).astype(int)]
        axes = jax.tree.map(
            lambda x, own: None if x is None else int(own is not None),
            whole,
            batched,
            is_leaf=lambda x: x is None,
        )
        return InitialConditions(whole, axes, sample)

    return resolve(system, y0, accuracy, starts)

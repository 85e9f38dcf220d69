"""Many runs of a mission, integrated in blocks."""

from jaxtyping import ArrayLike, Float, PyTree, Real

from ..core import InputError, State
from ..core.captured import captured_as_leaves
from ..core.checks import check_finite
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy, as_accuracy, check_tolerances
from ..integration.exact_part import exact
from ..integration.initial_state import InitialState
from ._batch_runs import again_by, run_missions
from ._final_error import FinalError
from ._mission import Mission, check_mission
from ._to_final_error import to_final_error
from .batch_layout import InAxes, cut_batch, local_blocks, split_batch
from .blocks import Blocks
from .checks import as_times, check_num_saved, hints_of_arguments
from .finish import checked, with_calls
from .mission_result import MissionTrajectory
from .phases import resolve_phases
from .repeat import Configs, rerun_failed


@hints_of_arguments
def simulate_mission_batch(
    missions: Mission,
    y0s: State,
    t0: Real[ArrayLike, "*runs"] = 0.0,
    *,
    accuracy: Accuracy | FinalError | Float[ArrayLike, ""] | None = None,
    num_saved: int = 2,
    in_axes: InAxes = None,
    throw: bool = False,
) -> MissionTrajectory:
    """`simulate_mission` for many runs, with the batch axis as the last axis of every array.

    The events of the phases occur at a different time in each run, and the durations of the phases
    may differ between runs.

    **Arguments**

    - `missions`, `y0s`: as in `simulate_mission`; the batched arrays follow from the declared
      shapes, as in `simulate_batch`.
    - `t0`: the time at which the first phase starts, s, for all runs, or (runs,).
    - `accuracy`, `num_saved`, `throw`: as in `simulate_mission`.
    - `in_axes`: as in `simulate_batch`.

    **Returns** a `MissionTrajectory` with the batch axis last and a `Status` for each run. A failed
    run is marked in its status. Runs are repeated as in `simulate_mission`. Devices, blocks and
    steps are as in `simulate_batch`.

    **Raises** `InputError` as `simulate_mission` does, and for arrays with different batch sizes.
    `SimulationError`, if `throw`, for a failed run."""
    check_mission("missions", missions, "simulate_batch")
    missions = captured_as_leaves(missions)
    y0s, dtype = InitialState.of(y0s, batch=True)
    check_num_saved(num_saved)
    t0 = as_times("t0", t0, dtype, "one time, or one for each run, s")
    check_finite("t0", t0)
    if t0.ndim > 1:
        raise InputError(
            f"t0 has the shape {t0.shape}: it must be a scalar or one start time for each run, in "
            "s."
        )
    batched, shared, runs = split_batch(missions, y0s, t0, in_axes, times_axes=0)
    if isinstance(accuracy, FinalError):
        given = (missions, y0s, t0)
        options = {"num_saved": num_saved, "in_axes": in_axes}
        return to_final_error(simulate_mission_batch, given, accuracy, throw, options, (runs,))
    mission, y0, _ = cut_batch(batched, shared)
    # A traced status cannot decide which runs are repeated.
    traced = is_traced((batched, shared))
    # After the errors at the end: a `FinalError` calls this verb again, with a tolerance.
    given = as_accuracy(accuracy)
    check_tolerances(given, runs)

    def configs_for(rows: object, exactly: bool) -> Configs:
        accuracy = exact(given) if exactly else given
        return resolve_phases(mission, y0, accuracy, 1)

    def run(batched: PyTree, blocks: Blocks, configs: Configs) -> MissionTrajectory:
        return run_missions(batched, shared, configs, num_saved, blocks)

    # Not by the function above: warnings of a mission count the calls from here.
    configs = resolve_phases(mission, y0, given, 1)
    result = run(batched, local_blocks((batched, shared), runs), configs)
    if not traced:
        result, configs = rerun_failed(result, configs, again_by(run, batched), configs_for)
    trajectory = with_calls(result, mission, given, configs)
    return checked(trajectory, throw, stacklevel=3)

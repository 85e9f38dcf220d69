"""`simulate_mission`: the phases of a mission in sequence, from an initial state."""

from jaxtyping import ArrayLike, Float, PyTree, Real

from ..core import InputError
from ..core.captured import captured_as_leaves
from ..core.checks import check_finite, is_concrete
from ..core.jit import quick_jit
from ..core.status import Status
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy, as_accuracy, check_tolerances
from ..integration.exact_part import exact
from ..integration.initial_state import InitialState
from ._final_error import FinalError
from ._mission import Mission, check_mission
from ._to_final_error import to_final_error
from .checks import as_times, check_num_saved, check_values, hints_of_arguments
from .failures import cause_of_leaving, mask_mission, place_of_failure
from .finish import checked, with_calls
from .mission_result import MissionTrajectory
from .mission_runs import run_mission
from .phases import resolve_phases
from .repeat import Configs, rerun_failed


@hints_of_arguments
def simulate_mission(
    mission: Mission,
    y0: PyTree,
    t0: Real[ArrayLike, ""] = 0.0,
    *,
    accuracy: Accuracy | FinalError | Float[ArrayLike, ""] | None = None,
    num_saved: int = 2,
    throw: bool = True,
) -> MissionTrajectory:
    """Simulate a mission, phase by phase, from the state `y0`; use `simulate` for a system.

    **Arguments**

    - `mission`: phases, each with a system, an end and a jump.
    - `y0`: the initial state of the first phase.
    - `t0`: the time at which it starts, s.
    - `accuracy`: the relative tolerance of each step, 1e-9 by default; an `Accuracy`; or a
      requested final error, a `FinalError`.
    - `num_saved`: number of states saved per phase, from its start to its end.
    - `throw`: whether to raise `SimulationError` for a failed run; otherwise read its `status`.

    **Returns** a `MissionTrajectory`, with a `Trajectory` for each phase. It is differentiable, in
    forward and in reverse mode, with respect to every number in `mission` and `y0`, and to `t0`.
    Under `jax.vmap` the runs are integrated as by `simulate_mission_batch`.

    Outside of `jit` a mission is repeated like a run of `simulate`: with more steps in a phase
    whose fixed steps missed the tolerance, and with the exact parts of its motion in closed form if
    it reached the maximum number of steps. Also outside of `jit`, it issues the warnings of the
    systems about their runs, such as a path below the surface (`Scene.warning`).

    **Raises** `InputError`, before anything is compiled, for a start time that is not a scalar; a
    tolerance that the precision cannot reach; a method that a phase does not support; a state that
    is not finite, has mixed precision or differs in structure from its derivative; a jump that does
    not return a state; and a system. `SimulationError`, with the phase, for a failed run; under
    `jit`, when the compiled program runs."""
    check_mission("mission", mission, "simulate")
    if isinstance(accuracy, FinalError):
        options = {"num_saved": num_saved}
        return to_final_error(simulate_mission, (mission, y0, t0), accuracy, throw, options)
    mission = captured_as_leaves(mission)
    y0, dtype = InitialState.of(y0)
    t0 = as_times("t0", t0, dtype, "one time, s")
    check_finite("t0", t0)
    if t0.ndim != 0:
        raise InputError(
            f"t0 has the shape {t0.shape}: it must be a scalar, the start time of the mission in s."
        )
    check_num_saved(num_saved)
    given = as_accuracy(accuracy)
    check_tolerances(given, None)
    if not is_traced((mission, y0, t0)):
        check_values(mission.phases[0].moving, t0, y0)

    def run(configs: Configs) -> MissionTrajectory:
        return run_mission(mission, y0, t0, num_saved, configs, 0)

    def configs_for(rows: object, exactly: bool) -> Configs:
        return resolve_phases(mission, y0, exact(given) if exactly else given)

    # Not by the function above: warnings of a mission count the calls from here.
    configs = resolve_phases(mission, y0, given)
    result, configs = rerun_failed(run(configs), configs, lambda *a: run(a[2]), configs_for)
    whole = result
    # A known status without a failure needs no further program.
    if not is_concrete(result.status) or int(result.status) > Status.EVENT:
        result = _failed_are_nan(result)
    trajectory = with_calls(result, mission, given, configs)
    return checked(trajectory, throw, lambda: _failed_phase(trajectory, whole), stacklevel=3)


def _failed_phase(result: MissionTrajectory, whole: MissionTrajectory) -> str:
    """Sentence that names the phase in which a mission failed, where that phase began, and what
    left the range of validity; `whole` is the result with the states beyond the failure."""
    for name, phase in result.items():
        if int(phase.status) > Status.EVENT:
            # A mission stores no steps, so that only the start of the phase is known.
            start = place_of_failure(int(phase.status), None, float(phase.ts[0]), phase.initial)
            start = start.replace("The run", f"The phase {name!r}")
            if int(phase.status) != Status.OUTSIDE_MODEL:
                return start
            states = whole[name]
            return f"{cause_of_leaving(phase.system, states.ts, states.states)} {start}".strip()
    return ""


# Compiled, because outside of `jit` each operation would be compiled and called separately.
_failed_are_nan = quick_jit(mask_mission)

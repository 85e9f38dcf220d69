"""The results of runs, as computed by engines and saved in stores."""

from typing import Any, NamedTuple


class RunResults(NamedTuple):
    """Inputs, outputs, status and evaluations of runs, each (runs,); and by "phase.part" the states
    of their trajectories, each (..., times, runs), if requested."""

    inputs: dict[str, Any]
    outputs: dict[str, Any]
    status: Any
    evaluations: Any
    trajectories: dict[str, Any]

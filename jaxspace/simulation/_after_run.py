"""Warnings that a system issues about its finished runs."""

import warnings

from ..core.tracing import is_traced
from ._mission_trajectory import MissionTrajectory
from .trajectory import Trajectory


def warn_after(result: Trajectory | MissionTrajectory, stacklevel: int) -> None:
    """Issue the warnings of the systems about their run (`AbstractSystem.warning`), if its numbers
    are known. `stacklevel` is that of the caller."""
    phases = result.phases if isinstance(result, MissionTrajectory) else (result,)
    for run in phases:
        # Those of a traced system are traced, too.
        if is_traced((run.ts, run.states)):
            return
        # By its class: the method of an instance is a module of its own, slow to make.
        words = type(run.system).warning(run.system, run.ts, run.states, run.undisturbed)
        if words:
            warnings.warn(words, stacklevel=stacklevel + 1)

"""Result of a mission: the trajectory of each of its phases."""

from typing import TYPE_CHECKING, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import State
from ..integration.accuracy import Accuracy
from ._summary import summary_of_mission
from .mission_result import AbstractMissionResult, BranchEnd
from .trajectory import Trajectory

if TYPE_CHECKING:
    import os
    from pathlib import Path


@final
class MissionTrajectory(AbstractMissionResult):
    """Trajectories of the phases of a mission, each up to its end before the jump.

    It reads as a list of its phases: `len(result)`, `for phase in result`, `result[0]`; also by
    their names, `result["ascent"]` and `for name, phase in result.items()`. The phases of branches
    follow those of the mission itself. A branch, `result["booster"]`, is a `MissionTrajectory`,
    too; `result["booster.fall"]` is a phase of it.

    - `phases`, `names`: a `Trajectory` for each phase, and their names.
    - `final`, `end`: state after the last jump of each run, and its time, s.
    - `status`: first failure of each run, branches included, or else the status of its last phase.
    - `branches`, `branch_names`: where each branch ends, and their names."""

    phases: tuple[Trajectory, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    final: State
    end: Float[Array, "*runs"]
    status: Int[Array, "*runs"]
    branches: tuple[BranchEnd, ...] = ()
    branch_names: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def initial(self) -> State:
        """The state at the start of the first phase."""
        return self.phases[0].initial

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy of the mission, as the caller gave it."""
        return self.phases[0].accuracy

    def of(self, i: int) -> "MissionTrajectory":
        """The i-th run of a batch, as a mission of one run."""
        phases = tuple(phase.of(i) for phase in self.phases)
        ends = self.final, self.end, self.status, self.branches
        final, end, status, branches = jax.tree.map(lambda x: x[..., i], ends)
        parts = phases, self.names, final, end, status, branches
        return MissionTrajectory(*parts, self.branch_names)

    def show(self, path: "str | os.PathLike[str] | None" = None) -> "Path":
        """Open the mission in the browser as a page that moves (`jaxspace.plots.view_page`)."""
        # Imported here, so that only a mission that is shown needs the plots.
        from ..plots import show_run

        return show_run(self, path)

    @property
    def evaluations(self) -> Array:
        """Evaluations of the vector field over all phases."""
        return sum((p.stats["evaluations"] for p in self.phases), jnp.array(0))

    def __repr__(self) -> str:
        return summary_of_mission(self).text()

    def _repr_html_(self) -> str:
        return summary_of_mission(self).html()

"""Result of a mission: the trajectory of each of its phases."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import InputError, State
from ..integration.accuracy import Accuracy
from ._summary import summary_of_mission
from .trajectory import Trajectory

if TYPE_CHECKING:
    import os
    from pathlib import Path


@final
class MissionTrajectory(eqx.Module):
    """Trajectories of the phases of a mission, each up to its end before the jump.

    It reads as a list of its phases: `len(result)`, `for phase in result`, `result[0]`; also by
    their names, `result["ascent"]` and `for name, phase in result.items()`.

    - `phases`, `names`: a `Trajectory` for each phase, and their names.
    - `final`, `end`: state after the last jump of each run, and its time, s.
    - `status`: first failure of each run, or else the status of its last phase."""

    phases: tuple[Trajectory, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    final: State
    end: Float[Array, "*runs"]
    status: Int[Array, "*runs"]

    def __getitem__(self, phase: int | str) -> Trajectory:
        """The trajectory of a phase, by its number or its name. Raises `InputError` for a name that
        no phase has."""
        if isinstance(phase, str):
            if phase not in self.names:
                raise InputError(
                    f"The mission has no phase {phase!r}: its phases are "
                    f"{', '.join(self.names)}.{InputError.hint(phase, self.names)}"
                )
            phase = self.names.index(phase)
        count = len(self.phases)
        if not isinstance(phase, int) or not -count <= phase < count:
            raise IndexError(f"The mission has {count} phases: there is no number {phase!r}.")
        return self.phases[phase]

    def __len__(self) -> int:
        return len(self.phases)

    def __iter__(self) -> Iterator[Trajectory]:
        return iter(self.phases)

    def items(self) -> Iterator[tuple[str, Trajectory]]:
        """Name and trajectory of each phase, in order."""
        return zip(self.names, self.phases, strict=True)

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
        final, end, status = jax.tree.map(lambda x: x[..., i], (self.final, self.end, self.status))
        return MissionTrajectory(phases, self.names, final, end, status)

    def show(self, path: "str | os.PathLike[str] | None" = None) -> "Path":
        """Open the mission in the browser as a page that moves (`jaxspace.plots.view_page`)."""
        # Imported late: a mission that is not shown needs no plots.
        from ..plots import show_run

        return show_run(self, path)

    def evaluations(self) -> Array:
        """Evaluations of the vector field over all phases."""
        return sum((p.stats["evaluations"] for p in self.phases), jnp.array(0))

    def __repr__(self) -> str:
        return summary_of_mission(self).text()

    def _repr_html_(self) -> str:
        return summary_of_mission(self).html()

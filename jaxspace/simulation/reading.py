"""Results that contain a trajectory and expose its attributes."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
from jaxtyping import Array, Int, PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.structure import HashedModule
from ..integration.accuracy import Accuracy
from ._summary import Summary, summary_of_run
from .trajectory import Trajectory

if TYPE_CHECKING:
    import os
    from pathlib import Path

    import xarray
    from matplotlib.figure import Figure


class AbstractRun(HashedModule):
    """A run that contains more than its `trajectory`, and also has the attributes of the
    trajectory."""

    trajectory: eqx.AbstractVar[Trajectory]

    def facts(self) -> list[tuple[str, ...]]:
        """Further lines of its printed form: names and sentences."""
        return []

    @property
    def ts(self) -> Array:
        """Save times, s, (times,), or (times, runs) where events have stopped runs."""
        return self.trajectory.ts

    @property
    def states(self) -> State:
        """The states at the save times: a position is (3, times, *runs)."""
        return self.trajectory.states

    @property
    def initial(self) -> State:
        """The first state: a position is (3, *runs)."""
        return self.trajectory.initial

    @property
    def final(self) -> State:
        """The last state: a position is (3, *runs)."""
        return self.trajectory.final

    @property
    def status(self) -> Int[Array, "*runs"]:
        """A `Status` for each run."""
        return self.trajectory.status

    @property
    def event(self) -> Int[Array, "*runs"]:
        """Number of the event that stopped the run, -1 for none."""
        return self.trajectory.event

    @property
    def stats(self) -> dict[str, Array]:
        """Steps, evaluations, largest local error in units of the tolerance."""
        return self.trajectory.stats

    @property
    def accuracy(self) -> Accuracy:
        """The accuracy, as the caller gave it."""
        return self.trajectory.accuracy

    def __getitem__(self, k: int) -> State:
        """The state at the k-th time."""
        return self.trajectory[k]

    def __len__(self) -> int:
        return len(self.trajectory)

    def along(self, function: Callable[[AbstractSystem, Scalar, State], PyTree]) -> PyTree:
        """`function(system, t, y)` at every time of every run (`Trajectory.along`). The system of a
        closed loop has no commands."""
        return self.trajectory.along(function)

    def to_xarray(self) -> "xarray.Dataset":
        """The run as a data set with named axes and units (`Trajectory.to_xarray`)."""
        return self.trajectory.to_xarray()

    def plot(self) -> "Figure":
        """A figure of the run (`Trajectory.plot`)."""
        return self.trajectory.plot()

    def show(self, path: "str | os.PathLike[str] | None" = None) -> "Path":
        """Open an animated 3-D view of the run in the browser (`Trajectory.show`)."""
        return self.trajectory.show(path)

    def _summary(self) -> Summary:
        return summary_of_run(self.trajectory, self.facts())

    def __repr__(self) -> str:
        # Not by fields, as `eqx.Module` would: a run has thousands of numbers.
        return self._summary().text()

    def _repr_html_(self) -> str:
        return self._summary().html()

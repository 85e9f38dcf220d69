"""Result of a mission: the results of its phases by index and name, and its branches by name."""

import dataclasses
import functools
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import InputError, State
from ..core.printing import printed
from ..core.status import Status, combine_status
from ..core.structure import HashedModule
from ..integration.accuracy import Accuracy
from ._summary import summary_of_mission
from .trajectory import Trajectory

if TYPE_CHECKING:
    import os
    from pathlib import Path


@printed(end="s", status=Status)
class BranchEnd(NamedTuple):
    """The end of a branch of a mission.

    - `final`, `end`: state after its last jump, and its time, s.
    - `status`: first failure of each run since the start of the mission, or else the status of its
      last phase."""

    final: State
    end: Float[Array, "*runs"]
    status: Int[Array, "*runs"]


@final
class MissionTrajectory(HashedModule):
    """Trajectories of the phases of a mission, each up to its end before the jump.

    It reads as a list of its phases: `len(result)`, `for phase in result`, `result[0]`; also by
    their names, `result["ascent"]` and `for name, phase in result.items()`. The phases of branches
    follow those of the mission itself. A branch, `result["booster"]`, is a `MissionTrajectory`,
    too; `result["booster.fall"]` is a phase of it.

    - `phases`, `names`: a `Trajectory` for each phase, and their names.
    - `final`, `end`: state after the last jump of each run, and its time, s.
    - `status`: first failure of each run, branches included, or else the status of its last phase.
    - `branches`, `branch_names`: the end of each branch, and their names."""

    phases: tuple[Trajectory, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    final: State
    end: Float[Array, "*runs"]
    status: Int[Array, "*runs"]
    branches: tuple[BranchEnd, ...] = ()
    branch_names: tuple[str, ...] = eqx.field(static=True, default=())

    def __getitem__(self, phase: int | str) -> Any:
        """The result of a phase, by its index or name, or a branch by its name. Raises
        `InputError` for an unknown name."""
        if isinstance(phase, str):
            if phase in self.branch_names:
                return self._branch(phase)
            if phase not in self.names:
                known = (*self.names, *self.branch_names)
                what = "phase or branch" if self.branch_names else "phase"
                raise InputError(
                    f"The mission has no {what} {phase!r}: its phases are {', '.join(self.names)}"
                    + (f"; its branches {', '.join(self.branch_names)}" * bool(self.branch_names))
                    + f".{InputError.hint(phase, known)}"
                )
            phase = self.names.index(phase)
        count = len(self.phases)
        if not isinstance(phase, int) or not -count <= phase < count:
            raise IndexError(
                f"Phase number {phase!r} is out of range: the mission has {count} phases."
            )
        return self.phases[phase]

    def __len__(self) -> int:
        return len(self.phases)

    def __iter__(self) -> Iterator[Trajectory]:
        return iter(self.phases)

    def items(self) -> Iterator[tuple[str, Trajectory]]:
        """Name and result of each phase, in order."""
        return zip(self.names, self.phases, strict=True)

    def without_branches(self) -> "MissionTrajectory":
        """The mission without its branches, with the first failure of its phases."""
        if not self.branch_names:
            return self
        heads = tuple(f"{name}." for name in self.branch_names)
        phases = {k: phase for k, phase in self.items() if not k.startswith(heads)}
        # The status of the whole counts the failures of branches, which are left out here.
        status = functools.reduce(combine_status, [run.status for run in phases.values()])
        return self._with_named(phases, status=status, branches=(), branch_names=())

    def _branch(self, name: str) -> "MissionTrajectory":
        """The branch of this name, with its own branches."""
        head = f"{name}."
        phases = {k[len(head) :]: phase for k, phase in self.items() if k.startswith(head)}
        ends = dict(zip(self.branch_names, self.branches, strict=True))
        own = ends[name]
        inner = {k[len(head) :]: end for k, end in ends.items() if k.startswith(head)}
        return self._with_named(
            phases,
            final=own.final,
            end=own.end,
            status=status_of_all(own.status, inner.values()),
            branches=tuple(inner.values()),
            branch_names=tuple(inner),
        )

    # As of `Trajectory`.
    def with_phases(self, phases: Iterable[Trajectory], status: Array) -> Any:
        """The result with other phases of the same names, and another status."""
        return dataclasses.replace(self, phases=tuple(phases), status=status)

    def _with_named(self, phases: dict[str, Trajectory], **fields: Any) -> "MissionTrajectory":
        return dataclasses.replace(
            self, phases=tuple(phases.values()), names=tuple(phases), **fields
        )

    @property
    def initial(self) -> State:
        """The state at the start of the first phase."""
        return self.phases[0].initial

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy of the mission, as passed by the caller."""
        return self.phases[0].accuracy

    def of(self, i: int) -> "MissionTrajectory":
        """The i-th run of a batch, as a mission of one run."""
        phases = tuple(phase.of(i) for phase in self.phases)
        ends = self.final, self.end, self.status, self.branches
        final, end, status, branches = jax.tree.map(lambda x: x[..., i], ends)
        parts = phases, self.names, final, end, status, branches
        return MissionTrajectory(*parts, self.branch_names)

    def show(self, path: "str | os.PathLike[str] | None" = None) -> "Path":
        """Open an animated 3-D view of the mission in the browser (`jaxspace.plots.view_page`)."""
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


# What a verb returns, of a system or of a mission; and the one of both that a function was given.
Simulated: TypeAlias = Trajectory | MissionTrajectory
Result = TypeVar("Result", bound=Simulated)


def status_of_all(main: Int[Array, "*runs"], branches: Iterable[BranchEnd]) -> Int[Array, "*runs"]:
    """The status of a mission with its `branches`: the first failure, or else the status of the
    mission itself."""

    def with_branch(status: Array, branch: BranchEnd) -> Array:
        # The success of a branch is independent of the mission.
        return combine_status(status, combine_status(branch.status, status))

    return functools.reduce(with_branch, branches, main)


def numbers_of(result: Result) -> Result:
    """Times, states, status and counts of a result, without its call, its steps and its controller:
    a compiled program can return them."""
    # They contain functions, which a compiled program cannot return.
    left = {"call": None, "control": None, "dense": None}
    phases = [dataclasses.replace(phase, **left) for phase in result.phases]
    return result.with_phases(phases, result.status)

"""The parsed content of a scene file as plain data; operations on it are functions elsewhere."""

import dataclasses
from pathlib import Path

from ..core import InputError
from ..core.listed import no_method
from ..statistics import StopRule
from ._kinds.kind import Values
from ._kinds.named_files import NamedFile, NamedFiles
from ._mission.control import is_noisy
from ._mission.parsed import Parsed
from ._requests.inputs import Input
from ._requests.joint_inputs import MadeInput
from ._requests.optimize_table import Task
from ._requests.output_spec import OutputSpec
from .units import WrittenUnits


@dataclasses.dataclass(frozen=True)
class FileContent:
    """The content of a scene file, every entry checked.

    - `path`, `text`: of the file.
    - `parsed`: its values in SI.
    - `inputs`: the distribution of every dispersed number.
    - `outputs`: those of each run of a campaign.
    - `sweep`: the values of the numbers in [sweep], SI, by path; empty without it.
    - `units`: those in which the file gives its numbers.
    - `task`: the content of [optimize], or `None`.
    - `files`: the files that it names.
    - `modules`: Python files that were run for it."""

    # Compared by `text` and `parsed`, from which the other fields follow.
    path: Path = dataclasses.field(compare=False)
    text: str
    parsed: Parsed
    inputs: dict[str, Input | MadeInput] = dataclasses.field(compare=False)
    outputs: tuple[OutputSpec, ...] = dataclasses.field(compare=False)
    units: WrittenUnits = dataclasses.field(compare=False)
    task: Task | None = dataclasses.field(default=None, compare=False)
    files: NamedFiles = dataclasses.field(default_factory=lambda: NamedFiles(Path()), compare=False)
    modules: tuple[NamedFile, ...] = dataclasses.field(default=(), compare=False)
    sweep: dict[str, tuple[float, ...]] = dataclasses.field(default_factory=dict, compare=False)

    @property
    def kind(self) -> str:
        """The kind of the file: "system", "scene", "mission" or "flight"."""
        return self.parsed.kind

    @property
    def values(self) -> Values:
        """The values of the file, numbers in SI."""
        return self.parsed.values

    @property
    def title(self) -> str:
        """The title, or the name of the file."""
        return self.values["title"] or self.path.stem

    @property
    def start(self) -> float:
        """The time of the initial state, s."""
        # Phases have durations: a mission has no entry for its start time.
        return 0.0 if self.parsed.is_mission else self.values["times"]["start"]

    @property
    def dispersion(self) -> Values:
        """The table [dispersion]. Raises `InputError` without it."""
        if self.values["dispersion"] is None:
            raise InputError(
                "dispersion is missing: a table with outputs and inputs is required here."
            )
        return self.values["dispersion"]

    @property
    def runs(self) -> int:
        """Number of runs of [dispersion], with [sweep] of each row: one where no input is random.
        Raises `InputError` without [dispersion]."""
        return 1 if self.sweeps_only else self.dispersion["runs"]

    @property
    def sweeps_only(self) -> bool:
        """Whether the runs differ in the numbers of [sweep] only."""
        swept = bool(self.sweep) and set(self.inputs) == set(self.sweep)
        return swept and not is_noisy(self.values)

    @property
    def rows(self) -> int:
        """Number of rows of [sweep]; 1 without it."""
        return len(next(iter(self.sweep.values()), (None,)))

    @property
    def seed(self) -> int:
        """Seed of the random inputs of [dispersion]. Raises `InputError` without it."""
        return self.dispersion["seed"]

    @property
    def until(self) -> StopRule | None:
        """The rule that ends the campaign of the file before its `runs`; `None` without one."""
        rule = self.dispersion["until"]
        if rule is None:
            return None
        return StopRule(rule["output"], **{k: float(x) for k, x in rule.items() if k != "output"})

    @property
    def method(self) -> str:
        """The method of [dispersion]. Raises `InputError` without it."""
        return self.dispersion["method"]

    @property
    @no_method
    def compare(self) -> tuple[str, ...]:
        """The cheaper methods with which the file compares its runs."""
        return tuple(self.dispersion["compare"])

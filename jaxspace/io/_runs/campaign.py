"""The campaign of the table [dispersion] of a scene file."""

from collections.abc import Callable, Mapping

import equinox as eqx
from jaxtyping import Array

from ...core import State
from ...dispersion import Campaign
from ...dispersion.purpose import ByPurpose
from ...sampling import LatinHypercube, Sobol, Uniform
from ...simulation import Accuracy, Mission, MissionTrajectory
from .._file_content import FileContent
from .._kinds.kind import Values
from .._mission.build import build_mission
from .._mission.building import Runs, replaced
from .._mission.control import is_noisy
from .._mission.parsed import Parsed
from .._requests.inputs import Input
from .._requests.joint_inputs import MadeInput

NOISE = "control.noise"
"""The input from which the noise of the sensors of a run follows."""


def campaign_of(
    file: FileContent,
    scatters: Mapping[str, Input | MadeInput],
    outputs: Callable[[MissionTrajectory, dict[str, Array]], dict[str, Array]],
    design: LatinHypercube | Sobol | None,
    num_saved: int,
    texts: Mapping[str, str],
    accuracy: Accuracy | ByPurpose,
) -> Campaign:
    """The campaign of a `SceneFile`.

    **Arguments**

    - `file`: the content of the scene file.
    - `scatters`: the distribution of each input, by its path.
    - `outputs`: the outputs of each run.
    - `design`: the design of the runs; random if `None`.
    - `num_saved`: states of each phase that the outputs read.
    - `texts`: of the files that the scene names.
    - `accuracy`: of the runs."""
    limits = {path: how.nominal.quantity for path, how in scatters.items()}
    units = {path: quantity.unit for path, quantity in limits.items()}
    inputs = {path: how.distribution() for path, how in scatters.items()}
    return Campaign(
        BuildOfFile(file.parsed.structure, file.parsed.numbers()),
        inputs | _noise(file.values),
        outputs,
        units | {spec.name: spec.unit for spec in file.outputs},
        file.start,
        file.text,
        limits,
        design,
        # Only outputs with a limit have a requirement that a report can judge.
        {spec.name: spec.required for spec in file.outputs if spec.required[:2] != (None, None)},
        num_saved,
        # Texts and not paths: a store is opened where these files are not.
        dict(texts),
        accuracy,
        {module.path.name: module.text for module in file.modules},
    )


def design_of(sampling: str, runs: int) -> LatinHypercube | Sobol | None:
    """The design for this number of runs, by its name in the file."""
    if sampling == "latin_hypercube":
        return LatinHypercube(runs)
    return Sobol() if sampling == "sobol" else None


def warnings_of(inputs: Mapping[str, Input | MadeInput]) -> tuple[str, ...]:
    """Sentences on inputs that are allowed but probably a mistake."""
    return tuple(line for path, how in inputs.items() for line in how.warnings(path))


def _noise(values: Values) -> dict[str, Uniform]:
    """The seed of the noise of each run, as a further input."""
    # Drawn as the inputs are, so that the noise of a run depends on its number alone.
    whole = Uniform(0.0, 1.0)  # pyright: ignore[reportArgumentType]  # converted by its fields
    return {NOISE: whole} if is_noisy(values) else {}


class BuildOfFile(eqx.Module):
    """The `build` of a campaign. The numbers of the file are leaves, so that another number needs
    no compilation.

    - `parsed`: the structure of the file.
    - `values`: its numbers."""

    parsed: Parsed = eqx.field(static=True)
    values: Values

    def __call__(self, samples: dict[str, Array]) -> tuple[Mission, State]:
        runs = next(iter(samples.values())).shape[0]
        numbers = replaced(self.values, samples)
        return build_mission(self.parsed, numbers, Runs(runs), samples.get(NOISE))

"""A validated scene file, which builds its systems and campaigns."""

import dataclasses
import functools
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import final

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..control import ClosedLoop, LoopRun
from ..core import AbstractSystem, InputError, State
from ..core.jit import quick_jit
from ..core.listed import Listed
from ..dispersion import Campaign
from ..dispersion.purpose import BY_PURPOSE, ByPurpose
from ..dispersion.reweighting import reweight
from ..integration.accuracy import DEFAULT_RTOL
from ..optimization import Progress, StopReason
from ..robust import DesignOptimum
from ..scene import Scene
from ..simulation import (
    Accuracy,
    Event,
    FinalError,
    Mission,
    MissionTrajectory,
    simulate_mission,
)
from ..simulation.dispatch import simulate_any
from ..simulation.legs import legs_of
from ..simulation.mission_result import Simulated
from ..statistics import Dispersion
from ..statistics.requirements import Requirement
from ..statistics.weighted import WeightedDispersion
from ..vehicles import LaunchSite
from ._file_content import FileContent
from ._kinds.named_files import NamedFiles
from ._mission.build import build_mission
from ._mission.building import Runs
from ._mission.checks import air_warnings
from ._mission.flight import SITE
from ._requests.accuracy import steps_of
from ._requests.final_error import requested_error, rounded_down, tolerance_of
from ._requests.inputs import changed_distributions, with_distributions
from ._requests.output_entries import applicable_outputs, unit_of
from ._requests.output_spec import INITIAL, NOMINAL, OutputSpec, needs
from ._runs.campaign import NOISE, campaign_of, design_of, warnings_of
from ._runs.file_units import in_file_units
from ._runs.nominal import (
    FinalOutput,
    function_of,
    nominal_states,
    outputs_of,
    spec_of_end,
    warned_of_ground,
    with_run,
)
from ._runs.outputs import MoreOutputs, Outputs
from ._search.optimise import failed_start, optimise
from ._search.optimum import Optimum
from ._search.optimum_file import with_numbers
from ._search.over_runs import optimise_over_runs
from .by_numpy import by_numpy
from .units import in_unit

# Traced once for all files of one structure.
_build_as_one = quick_jit(build_mission)


@final
@dataclasses.dataclass(frozen=True)
class SceneFile(FileContent):
    """A validated scene file and its operations: building of systems and campaigns, runs, and
    optimisation.

    - `path`: of the file.
    - `text`: of the file.
    - `parsed`: the values in SI.
    - `inputs`: the distribution of every dispersed number.
    - `outputs`: the outputs of each run of a campaign.
    - `units`: the units in which the file gives its numbers.
    - `task`: the content of [optimize], or `None`.
    - `files`: the files that it names.
    - `modules`: the Python files that were run for it.
    - `sweep`: the values of the numbers in [sweep], SI, by path; empty without it.

    Its `kind` is "system", "scene", "mission" or "flight", and its `title` defaults to the name of
    the file. A run starts at the time `start`, s."""

    @functools.cached_property
    def accuracy(self) -> Accuracy:
        """Tolerance, method and limits of the steps, the first as `tolerance`."""
        return steps_of(self.parsed, self.tolerance)

    @functools.cached_property
    def tolerance(self) -> float:
        """The relative tolerance of the steps; the default one where a campaign determines it "by
        purpose". For a file with `final_error`, the tolerance required by its nominal run, which is
        simulated for this purpose, rounded down to two digits.

        **Raises** `SimulationError` if that run fails."""
        if self.by_purpose:
            return DEFAULT_RTOL["float64"]
        if self.final_error is None:
            return self.values["accuracy"]
        samples = 2 if self.values["dispersion"] is None else self._states_read
        # The program of `nominal_mission` for campaigns, which follows.
        run = self._mission_run(self.final_error, samples, throw=True)
        return rounded_down(tolerance_of(run.phases[0]))

    @property
    def by_purpose(self) -> bool:
        """Whether the campaign of the file determines its tolerance by purpose."""
        return self.values["accuracy"] == BY_PURPOSE

    @property
    def campaign_accuracy(self) -> Accuracy | ByPurpose:
        """The accuracy of the campaign of the file."""
        return ByPurpose(steps_of(self.parsed, None)) if self.by_purpose else self.accuracy

    @functools.cached_property
    def final_error(self) -> FinalError | None:
        """The final error that the file requests for its nominal run; `None` without."""
        return requested_error(self.values["final_error"], steps_of(self.parsed, None))

    @property
    def system(self) -> AbstractSystem | Mission:
        """The system, the scene or the mission of the nominal run."""
        mission, _ = self._nominal
        return mission if self.parsed.is_mission else mission.phases[0].moving

    @property
    def y0(self) -> State:
        """The initial state of the nominal run."""
        return self._nominal[1]

    @property
    def ts(self) -> Array:
        """The save times, s, (times,); the start of a mission, ()."""
        if self.parsed.is_mission:
            return jnp.zeros(())
        times = self.values["times"]
        return jnp.linspace(times["start"], times["end"], times["samples"])

    @property
    def mission(self) -> Mission:
        """The file as a mission; for a system or a scene, a mission with one phase."""
        return self._nominal[0]

    @functools.cached_property
    def _nominal(self) -> tuple[Mission, State]:
        with by_numpy():
            return _build_as_one(self.parsed.structure, self.parsed.numbers(), Runs())

    def scenes(self) -> dict[str, Scene]:
        """The scene of every phase, by the name of the phase; empty for a system."""
        phases = {leg.name: leg.phase.moving for leg in legs_of(self.mission)[0]}
        return {name: moving for name, moving in phases.items() if isinstance(moving, Scene)}

    @functools.cached_property
    def site(self) -> LaunchSite | None:
        """The launch site of a flight, with its rail and the air above it; `None` for other
        files."""
        return self.parsed.building().make(SITE) if self.kind == "flight" else None

    @functools.cached_property
    def loop(self) -> ClosedLoop | None:
        """The closed loop of the file; `None` without [control]."""
        # A mission runs the loops of its phases itself.
        loop = self.mission.phases[0].system
        return loop if isinstance(loop, ClosedLoop) and not self.parsed.is_mission else None

    def simulate(
        self,
        *,
        ts: Float[ArrayLike, "*times"] | None = None,
        accuracy: Accuracy | FinalError | Float[ArrayLike, ""] | None = None,
        events: Sequence[Event] | None = None,
        num_saved: int | None = None,
        throw: bool = True,
    ) -> Simulated | LoopRun:
        """The nominal run of the system, scene, mission or closed loop that the file describes
        (`kind`, `loop`).

        **Arguments**, of which the first three override those of the file

        - `ts`: as in `jaxspace.simulate`; for a mission its start time.
        - `accuracy`: as in `jaxspace.simulate`.
        - `events`: as there, or as in `ClosedLoop.simulate`; the phases of a mission define their
          own.
        - `num_saved`: as in `jaxspace.simulate_mission`, for a mission.
        - `throw`: whether to raise `SimulationError` for a failed run.

        **Raises** `InputError` and `SimulationError` as these do."""
        ts = self.ts if ts is None else ts
        if accuracy is None:
            accuracy = self.accuracy if self.final_error is None else self.final_error
        if self.loop is not None:
            if num_saved is not None:
                raise InputError(
                    f"num_saved is {num_saved}: a closed loop saves its states at ts instead."
                )
            if isinstance(accuracy, FinalError):
                raise InputError("accuracy is a FinalError: a closed loop requires a tolerance.")
            # The loop runs without its phase, and so without the event that ends it.
            until = self.mission.phases[0].until
            if events is None:
                events = (until,) if isinstance(until, Event) else ()
            return self.loop.simulate(self.y0, ts, accuracy=accuracy, events=events, throw=throw)
        run = simulate_any(
            self.system,
            self.y0,
            ts,
            accuracy=accuracy,
            events=events or (),
            num_saved=num_saved,
            throw=throw,
        )
        return warned_of_ground(run, self.values, stacklevel=2)

    def build(self, samples: Mapping[str, Array]) -> tuple[Mission, State]:
        """Mission and initial states of many runs.

        **Arguments**

        - `samples`: numbers of the file by their path, each (runs,).

        **Returns** the mission, whose parameters are scalars or have the batch axis last, and the
        states, which are always batched."""
        # A campaign has at least one input, which gives the number of runs.
        runs = next(iter(samples.values())).shape[0]
        numbers = self.parsed.numbers(samples)
        return build_mission(self.parsed.structure, numbers, Runs(runs), samples.get(NOISE))

    def campaign(
        self,
        nominal: MissionTrajectory | None = None,
        *,
        inputs: Mapping[str, object] | None = None,
        outputs: Callable[[MissionTrajectory, dict[str, Array]], dict[str, Array]] | None = None,
        warn: bool = True,
        runs: int | None = None,
    ) -> Campaign:
        """The campaign of [dispersion] and [sweep], for `disperse`.

        **Arguments**

        - `nominal`: the nominal run of `mission`, to which some outputs refer; computed if required
          and not given.
        - `inputs`: further dispersed numbers, or other distributions for those of [dispersion]: by
          the path of a number of the file a distribution, in SI, or a table as in
          [dispersion.inputs], such as `{"deviation": "2 km"}`.
        - `outputs`: a function of a `MissionTrajectory` and the inputs that returns additional
          outputs, each (runs,), by name, like `Campaign.outputs`.
        - `warn`: whether to issue the warnings of the file (`SceneFile.warnings`).
        - `runs`: number of runs for a Latin hypercube, of each row of [sweep], if not that of the
          file.

        **Raises** `InputError` without [dispersion], and for inputs that the file does not have."""
        # Raises without [dispersion], before the nominal run is simulated in vain.
        asked = self.dispersion
        # A copy, because files given for one campaign do not belong to another.
        files = NamedFiles(self.files.folder, self.files.texts)
        scatters = with_distributions(self.inputs, inputs or {}, self.parsed, files)
        for warning in warnings_of(scatters) if warn else ():
            warnings.warn(warning, stacklevel=2)
        if nominal is None and needs(self.outputs, NOMINAL):
            nominal = self.nominal_mission()
        reference = None if nominal is None else nominal_states(nominal)
        own = self._outputs_of(self.outputs, reference)
        every = own if outputs is None else MoreOutputs(own, outputs)
        design = design_of(asked["sampling"], self.runs if runs is None else runs)
        campaign = campaign_of(
            self, scatters, every, design, self._states_read, files.texts, self.campaign_accuracy
        )
        return campaign.at(self.sweep) if self.sweep else campaign

    def reweight(
        self, result: Dispersion, changes: Mapping[str, Mapping[str, object]]
    ) -> WeightedDispersion:
        """The statistics that the campaign of this file would have with other distributions of
        some inputs, from its stored runs.

        **Arguments**

        - `result`: the runs of the campaign.
        - `changes`: by the path of an input the changed keys of its table in [dispersion.inputs],
          such as `{"deviation": "2 km"}`.

        **Returns** a `WeightedDispersion`.

        **Raises** `InputError` as `jaxspace.dispersion.reweight`, and for other inputs and keys."""
        files = NamedFiles(self.files.folder, self.files.texts)
        inputs = changed_distributions(changes, self.inputs, self.parsed, files)
        planned = int(result.attributes.get("planned_runs", result.runs)) // result.rows
        return reweight(result, self.campaign(warn=False, runs=planned), inputs)

    def in_units(self, result: Dispersion) -> Dispersion:
        """The dispersion with its inputs in the units in which the file writes them, instead of
        SI; outputs have the units of the file already.

        **Arguments**

        - `result`: of the campaign of this file."""
        return in_file_units(self, result)

    @property
    def _states_read(self) -> int:
        """Number of states of each phase that the outputs need."""
        # Without extremes, only the ends of the phases are read.
        extremes = any(spec.take for spec in self.outputs)
        return self.dispersion["extreme_samples"] if extremes else 2

    def optimize(
        self,
        progress: Progress | None = None,
        *,
        start: Mapping[str, float] | None = None,
        steps: int | None = None,
    ) -> Optimum:
        """The optimal values of the design variables of the file, as defined by its [optimize].

        **Arguments**

        - `progress`: called after each step with its number, objective, violation and gradient.
        - `start`: the design variables at the start of the search, SI, by path, as
          `Optimum.values`; by default those of the file.
        - `steps`: integration steps of each phase, instead of those of the file.

        **Returns** an `Optimum`, whose `converged` indicates whether the search reached its
        tolerance; `Optimum.checked` compares it with a run at the accuracy of the file.

        **Raises** `InputError` without [optimize], or if the gradient disagrees with finite
        differences."""
        if self.task is None:
            raise InputError("optimize is missing: a table with design variables is required here.")
        if self.task.dispersed:
            raise InputError(
                'optimize.over is "dispersion": call SceneFile.optimize_design instead.'
            )
        result = optimise(self, self.task, progress, start, steps)
        if int(result.minimum.reason) != StopReason.NOT_FINITE:
            return result
        # The search itself saves only the ends of a run.
        run = self.nominal_mission(samples=2)
        return dataclasses.replace(result, warning=failed_start(result, run))

    def optimize_design(
        self,
        progress: Progress | None = None,
        *,
        store: str | os.PathLike[str] | None = None,
        resume: bool = False,
        nominal: bool = False,
    ) -> DesignOptimum:
        """The optimal values of the design variables of the file over the runs of its [dispersion].

        **Arguments**

        - `progress`: called after each step with its number, objective, violation and gradient.
        - `store`, `resume`: as in `robust.optimise_design`.
        - `nominal`: whether to use the nominal run only, for comparison.

        **Returns** a `DesignOptimum`, whose `x` are the design variables by path, SI; its outputs
        are in the units of the file.

        **Raises** `InputError` without [optimize] over dispersion, and as `optimise_design`."""
        if self.task is None or not self.task.dispersed:
            raise InputError('optimize.over must be "dispersion" here.')
        base = self.campaign(warn=False)
        return optimise_over_runs(self, self.task, base, progress, store, resume, nominal)

    def with_design(self, optimum: DesignOptimum) -> str:
        """The text of the file with the design variables replaced by an optimum of
        `optimize_design`, preserving comments and units. Raises `InputError` without [optimize]."""
        if self.task is None:
            raise InputError("optimize is missing: no design variables are defined.")
        values = {path: float(x) for path, x in optimum.x.items()}
        return with_numbers(self, self.task, values)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about probable mistakes: a range without the nominal value, more than one draw
        of a thousand that will be rejected, effects in different air."""
        return Listed((*air_warnings(self.parsed), *warnings_of(self.inputs)))

    def nominal_mission(self, samples: int | None = None, factor: float = 1.0) -> MissionTrajectory:
        """The nominal run as a mission, at the accuracy of the file times `factor`, or with its
        `final_error` if the factor is one; its status reports a failure.

        `samples`: states of each phase; by default as many as the outputs of [dispersion] need."""
        samples = self._states_read if samples is None else samples
        asked = self.final_error
        if asked is None or factor != 1.0:
            # A finer tolerance than rounding allows would be rejected.
            least = 32.0 * float(jnp.finfo(jnp.result_type(float)).eps)
            rtol = max(self.tolerance * factor, least)
            asked = dataclasses.replace(self.accuracy, rtol=rtol)
        run = self._mission_run(asked, samples)
        return warned_of_ground(run, self.values, stacklevel=2)

    def _mission_run(
        self, accuracy: Accuracy | FinalError, samples: int, throw: bool = False
    ) -> MissionTrajectory:
        return simulate_mission(
            self.mission, self.y0, self.start, accuracy=accuracy, num_saved=samples, throw=throw
        )

    def nominal_outputs(
        self, nominal: Simulated | LoopRun, every: bool = False
    ) -> dict[str, tuple[float, str]]:
        """The outputs of the nominal run, with their units.

        **Arguments**

        - `nominal`: the run, as returned by `nominal_mission` or `simulate`.
        - `every`: whether to return all outputs whose arguments the file has, instead of those of
          [dispersion]."""
        specs = applicable_outputs(self.parsed, self.units) if every else self.outputs
        # Without a reference: the nominal run deviates from itself by nothing.
        return outputs_of(nominal, self._outputs_of(specs, None))

    def shown_unit(self, name: str, si: str) -> tuple[str, float]:
        """The display unit of a quantity with this name, that of the file for it or for another one
        of its kind, and the factor from the unit `si` to it."""
        unit = self.units.of(name, si)
        return unit, in_unit(si, unit)

    def final_output(self, name: str) -> FinalOutput:
        """An output of the final state of a run, for `effect_budget`.

        `name`: of a declared output, a method of an effect such as "drag.dynamic_pressure", or the
        path of a number of the state such as "final.omega.2".

        **Raises** `InputError` for an unknown name, or an output whose arguments the file does not
        have."""
        spec = spec_of_end(name, self.parsed, self.units)
        nominal = nominal_states(self.nominal_mission()) if needs((spec,), NOMINAL) else None
        outputs = self._outputs_of((spec,), nominal)
        si = unit_of(spec, self.parsed)
        return FinalOutput(function_of(outputs, spec), si, spec.factor)

    def outputs_along(self, specs: tuple[OutputSpec, ...]) -> Outputs:
        """These outputs, for their values along a run (`Outputs.along`)."""
        return self._outputs_of(specs, None)

    def _outputs_of(
        self, specs: tuple[OutputSpec, ...], reference: dict[int, State] | None
    ) -> Outputs:
        initial = with_run(self.y0) if needs(specs, INITIAL) else None
        # Their requirements are judged elsewhere, and would be part of the program.
        specs = tuple(spec._replace(required=Requirement()) for spec in specs)
        return Outputs(self.parsed.structure, specs, self.parsed.numbers(), reference, initial)

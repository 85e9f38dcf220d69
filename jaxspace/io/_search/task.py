"""The run of a search: objective and constraints of [optimize] from the design variables.

The run is `simulation.simulate_compact`, which compiles in seconds."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...core import AbstractSystem, State
from ...optimization import Criterion
from ...simulation import CompactRun, MissionTrajectory, Status, simulate_compact
from ...simulation.legs import legs_of
from .._file_content import FileContent
from .._kinds.kind import Values
from .._mission.build import build_mission
from .._mission.building import Runs, replaced
from .._mission.parsed import Parsed
from .._requests.optimize_table import Task
from .._requests.output_spec import OutputSpec
from .._runs.outputs import Curve, Curves, Outputs, line_ends


class Search(eqx.Module):
    """Objective and constraints of the run of a file, as a function of its design variables.

    The numbers of the file are arrays, so that files of one structure share their programs.

    - `parsed`, `values`: the structure of the file, and its numbers.
    - `start`: the time of the initial state, s.
    - `specs`: the outputs of the objective and of the constraints.
    - `limits`: the kinds of the constraints, of `LIMITS`; `targets`: their targets, SI.
    - `sign`: -1 for a maximum.
    - `steps`: integration steps of each phase."""

    parsed: Parsed = eqx.field(static=True)
    values: Values
    start: Array
    specs: tuple[OutputSpec, ...] = eqx.field(static=True)
    limits: tuple[str, ...] = eqx.field(static=True)
    targets: Array
    sign: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)

    def __call__(self, x: Mapping[str, Array]) -> Criterion:
        """Objective and constraints of the run with the numbers `x` at their paths."""
        values = replaced(self.values, x)
        mission, y0 = build_mission(self.parsed, values, Runs())
        run = simulate_compact(mission, y0, self.start, steps=self.steps)
        states, ends = line_ends(run)
        # Before the jump of a phase: a mass that is dropped there still counts for its outputs.
        states |= {k: p.before for k, p in enumerate(run.phases)}
        ends |= {k: p.ts[-1] for k, p in enumerate(run.phases)}
        systems = [leg.phase.moving for leg in legs_of(mission)[0]]
        curves = {k: _curve(systems[k], run, k) for spec in self.specs for k in spec.phases}
        objective, *numbers = values_of(self.parsed, values, self.specs, states, ends, curves)
        demands = list(zip(numbers, self.limits, self.targets, strict=True))
        equal = [v - target for v, limit, target in demands if limit == "equal"]
        above = [_margin(*demand) for demand in demands if demand[1] != "equal"]
        happened = jnp.stack([p.happened for p in run.phases])
        # A phase that misses its event ends anywhere: the search turns back.
        reported = objective
        objective = jnp.where(jnp.all(happened), objective, jnp.nan)
        return Criterion(
            self.sign * objective,
            jnp.stack(equal) if equal else None,
            jnp.stack(above) if above else None,
            report=(reported, numbers, run.error, happened),
        )


def search_of(file: FileContent, task: Task, steps: int) -> Search:
    """The search for the optimum of a `task` of the file."""
    demands = task.demands
    return Search(
        file.parsed.structure,
        file.parsed.numbers(),
        jnp.asarray(float(file.start)),
        (task.objective, *(demand.spec for demand in demands)),
        tuple(demand.limit for demand in demands),
        jnp.asarray([float(demand.target) for demand in demands]),
        task.sign,
        steps,
    )


def values_of(
    file: Parsed,
    values: Values,
    specs: tuple[OutputSpec, ...],
    states: dict[int, State],
    ends: dict[int, Array],
    curves: Curves,
) -> list[Array]:
    """The outputs, SI, from the states and the times, s, at the end of each phase (-1: of all), and
    along some of them."""
    # Outputs take runs on the last axis, so that this is a batch of one run.
    batch, times, along = jax.tree.map(
        lambda x: jnp.asarray(x)[..., None], (states, ends, dict(curves))
    )
    # By number, because the objective may be constrained as well.
    named = tuple(s._replace(name=str(k), factor=1.0) for k, s in enumerate(specs))
    result = Outputs(file, named, values, None).numbers(batch, times, {}, along)
    return [result[spec.name][0] for spec in named]


def _curve(system: AbstractSystem, run: CompactRun, number: int) -> Curve:
    """The states along a phase at the ends of its steps, with their rates."""
    phase = run.phases[number]
    rate = jax.vmap(system.vector_field, in_axes=(0, -1), out_axes=-1)
    return Curve(phase.ts, phase.states, rate(phase.ts, phase.states))


def failed_phase(run: MissionTrajectory) -> str:
    """The first failed phase of a run, with the message of its status; or nothing."""
    for name, phase in run.items():
        status = Status(int(phase.status))
        if not status.good:
            return f"{name} failed. {status.sentence}"
    return ""


def _margin(value: Array, limit: str, target: Array) -> Array:
    """Margin of an inequality, negative where it is violated."""
    return value - target if limit == "at_least" else target - value

"""The run of a search: objective and constraints of [optimize] from the design variables.

The run is `simulation.simulate_compact`, which compiles in seconds."""

from collections.abc import Mapping

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
from .._requests.optimize_table import Demand, Task
from .._requests.output_spec import OutputSpec
from .._runs.outputs import Curve, Curves, Outputs, line_ends


def criterion(file: FileContent, task: Task, x: Mapping[str, Array], steps: int) -> Criterion:
    """Objective and constraints of the run with the numbers `x` at their paths."""
    values = replaced(file.values, x)
    mission, y0 = build_mission(file.parsed, values, Runs())
    run = simulate_compact(mission, y0, file.start, steps=steps)
    states, ends = line_ends(run)
    # Before the jump of a phase: a mass that is dropped there still counts for its outputs.
    states |= {k: p.before for k, p in enumerate(run.phases)}
    ends |= {k: p.ts[-1] for k, p in enumerate(run.phases)}
    specs = (task.objective, *(d.spec for d in task.demands))
    systems = [leg.phase.moving for leg in legs_of(mission)[0]]
    curves = {k: _curve(systems[k], run, k) for spec in specs for k in spec.phases}
    objective, *numbers = values_of(file.parsed, values, specs, states, ends, curves)
    equal = [v - d.target for v, d in zip(numbers, task.demands, strict=True) if d.limit == "equal"]
    above = [
        _margin(v, d) for v, d in zip(numbers, task.demands, strict=True) if d.limit != "equal"
    ]
    happened = jnp.stack([p.happened for p in run.phases])
    # A phase that misses its event ends anywhere: the search turns back.
    reported = objective
    objective = jnp.where(jnp.all(happened), objective, jnp.nan)
    return Criterion(
        task.sign * objective,
        jnp.stack(equal) if equal else None,
        jnp.stack(above) if above else None,
        report=(reported, numbers, run.error, happened),
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


def _margin(value: Array, demand: Demand) -> Array:
    """Margin of an inequality, negative where it is violated."""
    return value - demand.target if demand.limit == "at_least" else demand.target - value

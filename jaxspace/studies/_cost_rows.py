"""The rows of a table of accuracy and cost: every setting is run, timed and compared."""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import State
from ..core.status import Status
from ..simulation import Trajectory
from ..simulation.trajectory import relative_change
from ._cost_case import Case, Programs
from ._cost_reference import Reference
from ._runs import aot_compile, blocks, counts_of, distance, systems_of, timed
from ._scene_effects import Runnable
from .cost_table import FIXED_STEP_RTOL, Cost, Method


def cost_rows(
    case: Case,
    name: str,
    method: Method,
    precision: str,
    tolerances: Sequence[float | None],
    reference: Reference,
    repeats: int,
) -> list[Cost]:
    """The rows of one method in one precision.

    **Arguments**

    - `case`: the case, in this precision.
    - `name`, `method`: the method, and its name in tables.
    - `tolerances`: relative ones; `None` where the method has none.
    - `reference`: for the errors.
    - `repeats`: of the timed runs.

    **Returns** a row for each tolerance."""
    if not tolerances:
        return []
    programs = _programs(case, name, method, precision, reference)
    drifts = jax.jit(lambda arrays, phases: _drifts(case.restored(arrays)[0], phases))
    rows = []
    for tolerance in tolerances:
        rtol = FIXED_STEP_RTOL if tolerance is None else tolerance
        run, seconds = timed(programs.run.call, repeats, case.arrays, rtol)
        status = Status(int(run.status))
        # Outside of the timed program, because invariants are not computed in a run.
        drift = drifts(case.arrays, run.phases)
        row = Cost(
            method=name,
            precision=precision,
            tolerance=tolerance,
            error=_error(run.final, reference),
            seconds=seconds,
            compile_seconds=programs.run.seconds,
            evaluations=sum(counts_of(run, "evaluations")),
            steps=sum(counts_of(run, "steps")),
            memory=programs.run.memory,
            drift={key: float(value) for key, value in drift.items()},
            failure="" if status.good else status.sentence,
        )
        if programs.gradient is not None and reference.gradient is not None:
            result, seconds = timed(programs.gradient, repeats, case.arrays, rtol)
            error = _gradient_error(result, reference.gradient, case)
            row = row._replace(gradient_error=error, gradient_seconds=seconds)
        rows.append(row)
    return rows


def _error(final: State, reference: Reference) -> float:
    """The error of a final state; NaN where there is nothing to measure it against."""
    return math.nan if reference.final is None else distance(final, reference.final)


def _programs(
    case: Case, name: str, method: Method, precision: str, reference: Reference
) -> Programs:
    """The compiled run, and the gradient where the reference has one."""
    # In double precision the reference has compiled a method already.
    known = reference.programs.get(name) if precision == "float64" else None
    if known is None:
        # The tolerance is traced, so that one program is sufficient for all of them.
        known = Programs(aot_compile(case.run(method), case.arrays, FIXED_STEP_RTOL), None)
    if known.gradient is None and reference.gradient is not None and reference.output is not None:
        known = known._replace(gradient=jax.jit(case.gradient(method, reference.output)))
    return known


def _drifts(system: Runnable, phases: tuple[Trajectory, ...]) -> dict[str, Float[Array, ""]]:
    """The largest relative change of every invariant, over all phases of a mission."""
    largest: dict[str, Array] = {}
    for phase, run in zip(systems_of(system), phases, strict=True):
        of_times = jax.vmap(phase.invariants, in_axes=(0, -1), out_axes=-1)
        invariants = of_times(run.ts, run.states)
        for name, values in invariants.items():
            change = jnp.max(relative_change(values, 0))
            largest[name] = jnp.maximum(change, largest[name]) if name in largest else change
    return largest


def _gradient_error(gradient: State, reference: State, case: Case) -> float:
    """|difference| / |gradient|, with every block of the initial state in units of its norm."""
    _, y0, _ = case.restored(case.arrays)
    sizes = [block.size for block in blocks(y0)]

    def scaled(tree: State) -> np.ndarray:
        pairs = zip(sizes, blocks(tree), strict=True)
        return np.concatenate([size * block.values.ravel() for size, block in pairs])

    exact = scaled(reference)
    # A gradient of zero is compared as it is.
    return float(np.linalg.norm(scaled(gradient) - exact) / (np.linalg.norm(exact) or 1.0))

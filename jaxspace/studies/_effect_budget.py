"""Which effects matter for an output of a run, and which of them may be left out.

    q(s):   the output when the load of effect k is multiplied by s_k
    -dq/ds_k at s = 1       what leaving out effect k changes, to first order
    q(s_k = 0) - q(1)       what it changes

All of this is one compiled program: the scene of scaled effects, with its derivative along one
factor in forward mode.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int, PyTree

from ..core import InputError, Scalar, State, check_positive, quantities
from ..integration import Accuracy, SimulationError, Status, least_tolerance
from ..integration._accuracy import DEFAULT_RTOL, as_accuracy, state_dtype
from ..scene import budget
from ..solvers import refine, solver_traits
from ._budget_table import EffectBudget, Influence
from ._runs import RunOutcome, aot_compile, check_start, in_precision, run_once, timed
from ._scene_effects import (
    Runnable,
    effect_names,
    phases_by_effect,
    remove_effects,
    scale_effects,
    scenes,
)

# Of the influence: where the prediction is off by more, the run without the effect counts.
NONLINEAR = 0.1
REPEATS = 5


class _ScaledOutcome(NamedTuple):
    """What a run with scaled effects leaves.

    - `value`, `derivative`: the output, and its derivative along one factor.
    - `status`, `phases`, `evaluations`: as in `RunOutcome`."""

    value: np.ndarray
    derivative: np.ndarray
    status: Status
    phases: tuple[tuple[Float[Array, " times"], State], ...]
    evaluations: tuple[Int[Array, ""], ...]


class _ScaledRuns(NamedTuple):
    """Runs with scaled effects, and how their outputs are compared.

    - `names`: of the effects.
    - `call`: the compiled run, of the factors, the direction of the derivative and the tolerance.
    - `rtol`: the relative tolerance of the runs.
    - `signless`: whether an output and its negative are the same."""

    names: tuple[str, ...]
    call: Callable[[list[float], list[float], float], tuple]
    rtol: float
    signless: bool

    def run(
        self, without: Sequence[str] = (), along: str | None = None, tighter: float = 1.0
    ) -> _ScaledOutcome:
        """The run without some effects, with the derivative along the factor of one."""
        factors = [0.0 if name in without else 1.0 for name in self.names]
        direction = [1.0 if name == along else 0.0 for name in self.names]
        value, derivative, run = self.call(factors, direction, self.rtol * tighter)
        return _ScaledOutcome(
            np.asarray(value, float),
            np.asarray(derivative, float),
            Status(int(run.status)),
            run.phases,
            run.evaluations,
        )

    def change(self, value: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """How far an output has moved; a quaternion and its negative are one attitude."""
        if self.signless and np.linalg.norm(value + nominal) < np.linalg.norm(value - nominal):
            return -value - nominal
        return value - nominal


def effect_budget(
    scene: Runnable,
    y0: State,
    ts: Float[ArrayLike, " times"] | Float[ArrayLike, ""] = 0.0,
    *,
    output: str | Callable[[State], Array] | None = None,
    tolerance: float | None = None,
    accuracy: Accuracy | Scalar | None = None,
    repeats: int = REPEATS,
) -> EffectBudget:
    """What each effect of a scene, or of the scenes of a mission, does to an output of a run.

    **Arguments**

    - `scene`, `y0`, `ts`: as in `simulate`; for a mission `ts` is the time of its start, s.
    - `output`: of the final state: the name of a part, such as "position", "velocity", "attitude"
      (its change is an angle), "omega" or "mass", or a function of the final state; by default the
      first part that the state holds.
    - `tolerance`: how far the output may move, in its unit. With it, the effects that may be left
      out are found, from the least on, and a run of exactly the others confirms it.
    - `accuracy`: of the runs. Influences below the error of the integration are not resolved; a run
      at a hundredth of the tolerance, or with twice as many fixed steps, shows that error.
    - `repeats`: of the timed runs.

    **Returns** an `EffectBudget`: print it or `plot` it.

    **Raises** `InputError` for a system without effects, an output that the state does not hold or
    a tolerance that is not positive; `SimulationError` when the run itself fails."""
    of_final, name, unit = _output(output, y0)
    if tolerance is not None:
        check_positive("tolerance", tolerance)
    check_positive("repeats", repeats)
    phases_of = phases_by_effect(scene)
    y0, ts = check_start(scene, y0, ts)
    own = as_accuracy(accuracy)
    if own.rtol is None:
        own = dataclasses.replace(own, rtol=DEFAULT_RTOL[state_dtype(y0).name])
    runs = _scaled_runs(scene, y0, ts, of_final, own, tuple(phases_of), name == "attitude")
    nominal = runs.run()
    if not nominal.status.good:
        raise SimulationError(nominal.status.sentence)
    # A tolerance only judges fixed steps: twice as many show the error of the integration.
    if not isinstance(own.method, str) and solver_traits(own.method).fixed_step:
        twice = dataclasses.replace(own, method=refine(own.method, 2))
        finer = _scaled_runs(scene, y0, ts, of_final, twice, runs.names, runs.signless).run()
    else:
        least = 2.0 * least_tolerance(state_dtype(y0))
        finer = runs.run(tighter=max(1e-2, least / runs.rtol))
    # NaN where the finer run failed.
    noise = float(np.linalg.norm(runs.change(finer.value, nominal.value)))
    shares = _shares(scene, nominal)
    rows = [
        _influence(runs, effect, phases, shares[effect], nominal.value, noise)
        for effect, phases in phases_of.items()
    ]
    rows.sort(key=lambda row: -row.influence)
    table = EffectBudget(name, unit, nominal.value, noise, tuple(rows), tolerance)
    if tolerance is None:
        return table

    def timed_run(system: Runnable) -> tuple[np.ndarray, Status, float]:
        return _timed_run(system, y0, ts, of_final, own, repeats)

    return _verified(table, runs, _negligible(table, runs), scene, timed_run)


def _output(
    output: str | Callable[[State], Array] | None, y0: State
) -> tuple[Callable[[State], Array], str, str]:
    """The output as a function, its name and its unit."""
    if callable(output):
        return output, "output", ""
    units = {
        name: declared.unit
        for name, declared in quantities(type(y0)).items()
        if getattr(y0, name, None) is not None
    }
    if output is None and units:
        output = next(iter(units))
    if output not in units:
        raise InputError(
            f"output is {output!r}: it must be one of {', '.join(units)}, or a function of the "
            f"final state."
        )
    if output == "attitude":
        # A small rotation moves the quaternion by half its angle.
        return lambda y: 2.0 * y.attitude.wxyz, output, "rad"
    return lambda y: getattr(y, output), output, units[output]


def _scaled_runs(
    system: Runnable,
    y0: State,
    ts: Array,
    output: Callable[[State], Array],
    accuracy: Accuracy,
    names: tuple[str, ...],
    signless: bool,
) -> _ScaledRuns:
    """The run with factors, compiled once for all of them."""
    dtype = state_dtype(y0)
    arrays, static = eqx.partition((system, y0, ts), eqx.is_array)

    def run(
        arrays: PyTree[Array], factors: list[Array], direction: list[Array], rtol: Array
    ) -> tuple[Array, Array, RunOutcome]:
        system, y0, ts = eqx.combine(arrays, static)
        own = dataclasses.replace(accuracy, rtol=rtol)

        def value_of(factors: list[Array]) -> tuple[Array, RunOutcome]:
            scaled = scale_effects(system, dict(zip(names, factors, strict=True)))
            outcome = run_once(scaled, y0, ts, own)
            return output(outcome.final), outcome

        return jax.jvp(value_of, (factors,), (direction,), has_aux=True)

    program = jax.jit(run)

    def call(factors: list[float], direction: list[float], rtol: float) -> tuple:
        # Arrays of the state's precision: Python floats would compile a program of their own.
        factor_arrays = [jnp.asarray(x, dtype) for x in factors]
        direction_arrays = [jnp.asarray(x, dtype) for x in direction]
        return program(arrays, factor_arrays, direction_arrays, jnp.asarray(rtol, dtype))

    assert accuracy.rtol is not None
    return _ScaledRuns(names, call, float(accuracy.rtol), signless)


def _influence(
    runs: _ScaledRuns,
    name: str,
    phases: tuple[str, ...],
    share: float,
    nominal: np.ndarray,
    noise: float,
) -> Influence:
    """The row of one effect."""
    predicted = -runs.run(along=name).derivative
    without = runs.run(without=(name,))
    linear = float(np.linalg.norm(predicted))
    if not without.status.good:
        change = tuple(predicted.ravel().tolist())
        failure = without.status.sentence
        return Influence(name, phases, linear, linear, None, False, change, share, failure)
    found = runs.change(without.value, nominal)
    left_out = float(np.linalg.norm(found))
    off = float(np.linalg.norm(found - predicted))
    # A difference that the error of the integration explains is no sign of nonlinearity.
    nonlinear = off > NONLINEAR * left_out and not off <= 10.0 * noise
    change = tuple((found if nonlinear else predicted).ravel().tolist())
    influence = left_out if nonlinear else linear
    return Influence(name, phases, influence, linear, left_out, nonlinear, change, share)


def _shares(system: Runnable, nominal: _ScaledOutcome) -> dict[str, float]:
    """What the run saves, of its arithmetic, when an effect is left out: operations of one
    evaluation times evaluations."""
    saved: dict[str, float] = {}
    total = 0.0
    for k, _, scene in scenes(system):
        # Counted in double precision, whose programs are the ones that users run.
        ts, states = in_precision(nominal.phases[k], "float64")
        y = jax.tree.map(lambda x: x[..., 0], states)
        rows = budget(in_precision(scene, "float64"), ts[0], y)
        count = int(nominal.evaluations[k])
        for name, row in zip(effect_names(scene), rows[:-1], strict=True):
            saved[name] = saved.get(name, 0.0) + count * row.operations
        total += count * sum(row.operations for row in rows)
    return {name: value / max(total, 1.0) for name, value in saved.items()}


def _negligible(table: EffectBudget, runs: _ScaledRuns) -> tuple[str, ...]:
    """The effects that may be left out together, from the least influence on."""
    assert table.tolerance is not None
    dropped: tuple[str, ...] = ()
    for row in reversed(table.rows):
        if row.failure or row.influence > table.tolerance:
            continue
        run = runs.run(without=(*dropped, row.effect))
        moved = np.linalg.norm(runs.change(run.value, table.nominal))
        if run.status.good and moved <= table.tolerance:
            dropped = (*dropped, row.effect)
    return dropped


def _verified(
    table: EffectBudget,
    runs: _ScaledRuns,
    dropped: tuple[str, ...],
    scene: Runnable,
    timed_run: Callable[[Runnable], tuple[np.ndarray, Status, float]],
) -> EffectBudget:
    """The table with the set that a run of exactly that set confirms, and with what it saves."""
    assert table.tolerance is not None
    every = tuple(row.effect for row in table.rows)
    while dropped:
        value, status, seconds_kept = timed_run(remove_effects(scene, dropped))
        change = float(np.linalg.norm(runs.change(value, table.nominal)))
        if status.good and change <= table.tolerance:
            return dataclasses.replace(
                table,
                kept=tuple(name for name in every if name not in dropped),
                dropped=dropped,
                change=change,
                seconds=timed_run(scene)[2],
                seconds_kept=seconds_kept,
            )
        # The last one to be dropped has the largest influence.
        dropped = dropped[:-1]
    return dataclasses.replace(table, kept=every)


def _timed_run(
    system: Runnable,
    y0: State,
    ts: Array,
    output: Callable[[State], Array],
    accuracy: Accuracy,
    repeats: int,
) -> tuple[np.ndarray, Status, float]:
    """Output and status of a plain run, and its median time, s."""
    arrays, static = eqx.partition((system, y0, ts), eqx.is_array)

    def run(arrays: PyTree[Array], rtol: Array) -> tuple[Array, Array]:
        system, y0, ts = eqx.combine(arrays, static)
        outcome = run_once(system, y0, ts, dataclasses.replace(accuracy, rtol=rtol))
        return output(outcome.final), outcome.status

    rtol = jnp.asarray(accuracy.rtol)
    program = aot_compile(run, arrays, rtol)
    (value, status), seconds = timed(program.call, repeats, arrays, rtol)
    return np.asarray(value, float), Status(int(status)), seconds

"""Which effects matter for an output of a run, and which of them may go.

    q(s):   the output when the load of effect k is multiplied by s_k
    -dq/ds_k at s = 1       what leaving out effect k changes, to first order
    q(s_k = 0) - q(1)       what it changes

All of this is one compiled program: the scene of scaled effects, with its derivative along one
factor in forward mode.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, InputError, Scalar, State, check_positive
from ..integration import Accuracy, SimulationError, Status, least_tolerance
from ..integration._accuracy import DEFAULT_RTOL, as_accuracy
from ..scene import budget
from ..simulation import Mission
from ..solvers import refine, solver_traits
from ._budget_table import EffectBudget, Influence
from ._flights import aot_compile, checked_start, flight, in_precision, timed
from ._scene_effects import labels, members, scenes, with_factors, without

UNITS = {"position": "m", "velocity": "m/s", "attitude": "rad", "omega": "rad/s", "mass": "kg"}
NONLINEAR = (
    0.1  # of the influence: where the prediction is off by more, the run without the effect counts
)
REPEATS = 5


class _Answer(NamedTuple):
    """Output and its slope along one factor, status, times and states of the phases, and
    evaluations of each."""

    value: np.ndarray
    slope: np.ndarray
    status: Status
    spans: Any
    evaluations: tuple[Any, ...]


class _Question(NamedTuple):
    """What is asked: how a run with factors is computed, and how outputs are compared."""

    names: tuple[str, ...]
    call: Callable[[Any, Any, Any], Any]
    rtol: float
    signless: bool

    def ask(
        self, without: tuple[str, ...] = (), along: str | None = None, tighter: float = 1.0
    ) -> _Answer:
        """The run without some effects, with the slope along the factor of one."""
        factors = [0.0 if n in without else 1.0 for n in self.names]
        found = self.call(
            factors, [1.0 if n == along else 0.0 for n in self.names], self.rtol * tighter
        )
        value, slope, status, spans, evaluations = found
        return _Answer(
            np.asarray(value, float),
            np.asarray(slope, float),
            Status(int(status)),
            spans,
            evaluations,
        )

    def change(self, value: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """How far an output has moved; a quaternion and its negative are one attitude."""
        flipped = self.signless and np.linalg.norm(value + nominal) < np.linalg.norm(
            value - nominal
        )
        return -value - nominal if flipped else value - nominal


def effect_budget(
    scene: AbstractSystem | Mission,
    y0: State,
    ts: Any = 0.0,
    *,
    output: str | Callable[[State], Any] | None = None,
    tolerance: float | None = None,
    accuracy: Accuracy | Scalar | None = None,
    repeats: int = REPEATS,
) -> EffectBudget:
    """What each effect of a scene, or of the scenes of a mission, does to an output of the run from
    `y0` over `ts`.

    - `output`: of the final state: "position", "velocity", "attitude" (its change is an angle),
      "omega", "mass", or a function of the final state; by default the first of these that the
      state holds.
    - `tolerance`: how far the output may move, in its unit; with it, the effects that may go are
      found, from the least on, and a run of exactly the others confirms it.
    - `accuracy`: of the runs; influences below the error of the integration are not resolved. It is
      told by a run at a hundredth of the tolerance, or with twice as many equal steps.

    Returns an `EffectBudget`: print it or `plot` it. Raises `InputError` for a system without
    effects, an output that the state does not hold or a tolerance that is not positive,
    `SimulationError` when the run itself ends badly."""
    chosen, name = _output(output, y0)
    if tolerance is not None:
        check_positive("tolerance", tolerance)
    check_positive("repeats", repeats)
    phases_of = members(scene)
    y0, ts = checked_start(scene, y0, ts)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    accuracy = as_accuracy(accuracy)
    if accuracy.rtol is None:
        accuracy = dataclasses.replace(accuracy, rtol=DEFAULT_RTOL[dtype.name])

    def ask_by(how):
        return _question(scene, y0, ts, chosen, how, tuple(phases_of), name == "attitude")

    question = ask_by(accuracy)
    nominal = question.ask()
    if not nominal.status.good:
        raise SimulationError(nominal.status.sentence)
    # A tolerance only judges fixed steps: twice as many show the error of the integration.
    if not isinstance(accuracy.method, str) and solver_traits(accuracy.method).fixed_step:
        finer = ask_by(dataclasses.replace(accuracy, method=refine(accuracy.method, 2))).ask()
    else:
        finer = question.ask(tighter=max(1e-2, 2.0 * least_tolerance(dtype) / question.rtol))
    ended = finer.status not in (Status.MAX_STEPS, Status.NOT_FINITE)
    noise = float(np.linalg.norm(question.change(finer.value, nominal.value))) if ended else np.nan
    shares = _shares(scene, nominal)
    rows = [
        _influence(question, n, phases_of[n], shares[n], nominal.value, noise) for n in phases_of
    ]
    rows.sort(key=lambda r: -r.influence)
    table = EffectBudget(name, UNITS.get(name, ""), nominal.value, noise, tuple(rows), tolerance)
    if tolerance is None:
        return table
    return _verified(
        table, question, _dropped(table, question), (scene, y0, ts), chosen, accuracy, repeats
    )


def _output(output: Any, y0: Any) -> tuple[Callable[[State], Any], str]:
    """The output as a function, and its name."""
    if callable(output):
        return output, "output"
    there = tuple(n for n in UNITS if getattr(y0, n, None) is not None)
    if output is None and there:
        output = there[0]
    if output not in there:
        raise InputError(
            f"output is {output!r}: it must be one of {', '.join(there)}, or a function of the final state."
        )
    if output == "attitude":
        return (
            lambda y: 2.0 * y.attitude.wxyz,
            output,
        )  # a small rotation moves the quaternion by half its angle
    return lambda y: getattr(y, output), output


def _question(
    system: Any,
    y0: State,
    ts: Any,
    output: Any,
    accuracy: Accuracy,
    names: tuple[str, ...],
    signless: bool,
) -> _Question:
    """The run with factors, compiled once for all the questions."""
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    numbers, rest = eqx.partition((system, y0, ts), eqx.is_array)

    def run(numbers: Any, factors: list[Array], along: list[Array], rtol: Array) -> Any:
        system, y0, ts = eqx.combine(numbers, rest)
        how = dataclasses.replace(accuracy, rtol=rtol)

        def answer(factors: list[Array]) -> Any:
            flown = flight(with_factors(system, names, factors), y0, ts, how)
            return output(flown.final), (flown.status, flown.spans, flown.evaluations)

        value, slope, rest_of_it = jax.jvp(answer, (factors,), (along,), has_aux=True)
        return value, slope, *rest_of_it

    program = jax.jit(run)

    def number(x):
        return jnp.asarray(x, dtype)

    def call(factors: list[float], along: list[float], rtol: float) -> Any:
        return program(
            numbers, [number(f) for f in factors], [number(a) for a in along], number(rtol)
        )

    return _Question(names, call, float(accuracy.rtol), signless)


def _influence(
    question: _Question,
    name: str,
    phases: tuple[str, ...],
    share: float,
    nominal: np.ndarray,
    noise: float,
) -> Influence:
    """The row of one effect."""
    predicted = -question.ask(along=name).slope
    left = question.ask(without=(name,))
    linear = float(np.linalg.norm(predicted))
    if not left.status.good:
        change = tuple(predicted.ravel().tolist())
        return Influence(
            name, phases, linear, linear, None, False, change, share, left.status.sentence
        )
    found = question.change(left.value, nominal)
    left_out = float(np.linalg.norm(found))
    off = float(np.linalg.norm(found - predicted))
    nonlinear = off > NONLINEAR * left_out and not off <= 10.0 * noise
    change = found if nonlinear else predicted
    influence = left_out if nonlinear else linear
    return Influence(
        name, phases, influence, linear, left_out, nonlinear, tuple(change.ravel().tolist()), share
    )


def _shares(system: Any, nominal: _Answer) -> dict[str, float]:
    """What the run saves, of its arithmetic, when an effect is left out: operations of one
    evaluation times evaluations."""
    saved: dict[str, float] = {}
    total = 0.0
    for k, _, scene in scenes(system):
        ts, states = in_precision(nominal.spans[k], jnp.result_type(float).name)
        rows = budget(
            in_precision(scene, ts.dtype.name), ts[0], jax.tree.map(lambda x: x[..., 0], states)
        )
        count = int(nominal.evaluations[k])
        for label, row in zip(labels(scene), rows[:-1], strict=True):
            saved[label] = saved.get(label, 0.0) + count * row.operations
        total += count * sum(row.operations for row in rows)
    return {label: value / max(total, 1.0) for label, value in saved.items()}


def _dropped(table: EffectBudget, question: _Question) -> tuple[str, ...]:
    """The effects that may go together, from the least influence on."""
    assert table.tolerance is not None
    gone: tuple[str, ...] = ()
    for row in reversed(table.rows):
        if row.trouble or row.influence > table.tolerance:
            continue
        answer = question.ask(without=(*gone, row.effect))
        moved = np.linalg.norm(question.change(answer.value, table.nominal))
        if answer.status.good and moved <= table.tolerance:
            gone = (*gone, row.effect)
    return gone


def _verified(
    table: EffectBudget,
    question: _Question,
    dropped: tuple[str, ...],
    run: Any,
    output: Any,
    accuracy: Accuracy,
    repeats: int,
) -> EffectBudget:
    """The table with the set that a run of exactly that set confirms, and with what it saves."""
    system, y0, ts = run
    seconds = None
    while dropped:
        less = without(system, dropped)
        (value, status), seconds_kept = _flown(less, y0, ts, output, accuracy, repeats)
        change = float(np.linalg.norm(question.change(value, table.nominal)))
        if status.good and table.tolerance is not None and change <= table.tolerance:
            _, seconds = _flown(system, y0, ts, output, accuracy, repeats)
            break
        dropped = dropped[:-1]
    else:
        change = seconds_kept = None
    kept = tuple(r.effect for r in table.rows if r.effect not in dropped)
    head = (table.output, table.unit, table.nominal, table.noise, table.rows, table.tolerance)
    return EffectBudget(*head, kept, dropped, change, seconds, seconds_kept)


def _flown(system: Any, y0: State, ts: Any, output: Any, accuracy: Accuracy, repeats: int) -> Any:
    """Output and status of a plain run, and its median time, s."""
    numbers, rest = eqx.partition((system, y0, ts), eqx.is_array)

    def run(numbers: Any, rtol: Any) -> Any:
        system, y0, ts = eqx.combine(numbers, rest)
        flown = flight(system, y0, ts, dataclasses.replace(accuracy, rtol=rtol))
        return output(flown.final), flown.status

    rtol = jnp.asarray(accuracy.rtol)
    (value, status), seconds = timed(aot_compile(run, numbers, rtol).call, repeats, numbers, rtol)
    return (np.asarray(value, float), Status(int(status))), seconds

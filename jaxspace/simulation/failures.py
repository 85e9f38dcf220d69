"""Results of failed runs: NaN in place of numbers, and errors."""

import dataclasses
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..integration.result import DenseOutput
from ..integration.status import Status
from ._loud import raise_where_failed, sentence_alone
from .mission_result import MissionResult
from .run_result import RunResult, nan_unless, reached, scaled

T = TypeVar("T")

STEEPEST = 4.0
"""The power of the time above which a growing number of steps indicates a singularity."""


def nan_where_failed(result: T, status: Array | None = None) -> T:
    """The result with NaN for what a failed run did not reach within the tolerance.

    **Arguments**

    - `result`: a `RunResult` or `MissionResult`; or with a `status` any tree of arrays with the
      runs last.

    **Returns** the result with NaN. A `RunResult`: see `reached`. A `MissionResult`: each phase,
    and the final state and the end of a mission or branch that failed. Any other tree: all numbers
    of the run."""
    if status is not None:
        return scaled(result, nan_unless(status <= Status.EVENT))
    if isinstance(result, MissionResult):
        # By its own phases, because a branch may succeed where another one fails.
        main = result.without_branches()
        final, end = nan_where_failed((main.final, main.end), main.status)
        phases = [reached(phase) for phase in result.phases]
        branches = tuple(nan_where_failed(branch, branch.status) for branch in result.branches)
        ends = {"final": final, "end": end, "branches": branches}
        return dataclasses.replace(result, phases=phases, **ends)
    assert isinstance(result, RunResult)
    return reached(result)


def loud(result: T) -> T:
    """The result of a traced simulation whose arrays all raise an error if a run failed.

    Values and derivatives raise, so that it does not matter which of them the caller returns. The
    arguments of the run (`system`, `accuracy`) stay as they are."""
    status: Array = result.status  # pyright: ignore[reportAttributeAccessIssue]
    failed = status > Status.EVENT
    worst = jnp.max(jnp.where(failed, status, Status.COMPLETED))
    numbers = _numbers(result)
    factor = nan_unless(~failed)
    integers, floats = eqx.partition(numbers, lambda x: not eqx.is_inexact_array(x))
    # Mapped outside of `jit`, this is a separate program, which has ended when the call returns.
    with sentence_alone():
        factor, integers = raise_where_failed((factor, integers), worst)

    def leaf(x: Array) -> Array:
        # Numbers that all runs share fail with any of them.
        has_runs = x.shape[x.ndim - factor.ndim :] == factor.shape
        return x * (factor if has_runs else jnp.min(factor)).astype(x.dtype)

    return _with_numbers(result, eqx.combine(jax.tree.map(leaf, floats), integers))


def place_of_failure(status: int, dense: DenseOutput | None, t0: float, y0: PyTree) -> str:
    """Time and state at which a single run failed, as a sentence.

    **Arguments**

    - `dense`: the steps of the run; `None` for a closed form, which takes none, and where there are
      too many to store.
    - `t0`, `y0`: its start, s, and the state there."""
    if dense is None:
        return f"The run starts at t = {t0:.6g} s with {_numbers_of(y0)}."
    ts = np.asarray(dense.ts)
    states = jax.tree.map(np.asarray, dense.states)
    finite = np.isfinite(ts)
    for x in jax.tree.leaves(states):
        finite &= np.all(np.isfinite(x), axis=tuple(range(x.ndim - 1)))
    last = int(np.flatnonzero(finite)[-1]) if finite.any() else 0
    text = "It got to"
    if status == Status.TOLERANCE_MISSED and last > 0:
        # The shortest step marks the place that the run could not pass.
        last = int(np.argmin(np.abs(np.diff(ts[: last + 1]))))
        text = "Its shortest step is at"
    state = _numbers_of(jax.tree.map(lambda x: x[..., last], states))
    return f"{text} t = {ts[last]:.6g} s, with {state}."


def enough_steps(dense: DenseOutput, t0: float, t1: float, max_steps: int) -> str:
    """Estimated number of further steps of a run whose steps ran out, as a sentence; empty where
    the steps shorten too fast for an estimate.

    The number of steps is extrapolated as a power of the time, fitted to the last half of them: it
    grows with the square of the time where a torque spins a body up.

    **Arguments**

    - `dense`: the steps of the run.
    - `t0`, `t1`: where it starts and where it should end, s.
    - `max_steps`: number of its steps, rejected ones included."""
    ts = np.asarray(dense.ts)
    lengths = np.abs(ts[np.isfinite(ts)] - t0)
    # The first of them is the start.
    half, reached = lengths[len(lengths) // 2], lengths[-1]
    if not 0.0 < half < reached:
        return ""
    power = max(np.log(2.0) / np.log(reached / half), 1.0)
    if power > STEEPEST:
        return ""
    # Two digits, and twice the number, because the estimate may be too low.
    steps = int(float(f"{max_steps * (abs(t1 - t0) / reached) ** power:.2g}"))
    return (
        f"Its end at t = {t1:.6g} s takes about {steps} steps if they go on so: "
        f"Accuracy(max_steps={2 * steps})."
    )


def _numbers_of(y: PyTree) -> str:
    """The numbers of a state, by the names of its parts."""
    leaves = jax.tree_util.tree_flatten_with_path(y)[0]
    parts = []
    for path, leaf in leaves:
        name = jax.tree_util.keystr(path).strip(".") or "y"
        number = np.array2string(np.asarray(leaf), precision=6, threshold=12)
        parts.append(f"{name} = {' '.join(number.split())}")
    return ", ".join(parts)


NUMBERS = (
    "ts",
    "states",
    "status",
    "event",
    "happened",
    "stats",
    "dense",
    "crossings",
    "final",
    "end",
    "branches",
    "phases",
)


def _numbers(result: Any) -> dict[str, Any]:
    """The arrays of a trajectory that the run has computed."""
    fields = {f.name for f in dataclasses.fields(result)}
    fields_of = {name: getattr(result, name) for name in NUMBERS if name in fields}
    if "phases" in fields_of:
        fields_of["phases"] = [_numbers(phase) for phase in fields_of["phases"]]
    return fields_of


def _with_numbers(result: Any, numbers: dict[str, Any]) -> Any:
    """The trajectory with other arrays."""
    numbers = dict(numbers)
    if "phases" in numbers:
        pairs = zip(result.phases, numbers["phases"], strict=True)
        numbers["phases"] = tuple(_with_numbers(phase, changed) for phase, changed in pairs)
    return dataclasses.replace(result, **numbers)

"""Results of failed runs: NaN in place of numbers, and errors.

A JAX program raises an error through a Python function that it calls. JAX reports the exception of
this function twice: in its log, with a traceback, and as an error whose message contains the
traceback of the call and ends with the exception. Here the log is shortened to the message of the
failure.
"""

import dataclasses
import logging
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Int, PyTree

from ..core import AbstractSystem
from ..core.limits import beyond_of
from ..core.status import SimulationError, Status, sentence_alone
from ..integration.result import DenseOutput
from .masking import mask_invalid, nan_unless, scaled
from .mission_result import MissionTrajectory

T = TypeVar("T")

STEEPEST = 4.0
"""The power of the time above which a growing number of steps indicates a singularity."""


def nan_where_failed(tree: T, status: Array) -> T:
    """A tree of arrays, runs last, with NaN for all numbers of a run that failed."""
    return scaled(tree, nan_unless(status <= Status.EVENT))


def mask_mission(result: MissionTrajectory) -> MissionTrajectory:
    """The result of a mission with NaN for states that a failed run did not reach within the
    tolerance: in each phase (`mask_invalid`), and in the final state and the end of a mission or
    branch that failed."""
    # By its own phases, because a branch may succeed where another one fails.
    main = result.without_branches()
    final, end = nan_where_failed((main.final, main.end), main.status)
    phases = tuple(mask_invalid(phase) for phase in result.phases)
    branches = tuple(nan_where_failed(branch, branch.status) for branch in result.branches)
    return dataclasses.replace(result, phases=phases, final=final, end=end, branches=branches)


def raise_if_failed(result: T) -> T:
    """The result of a traced simulation whose arrays all raise an error if a run failed.

    Values and derivatives raise, so that it does not matter which of them the caller returns. The
    arguments of the run (`call`) stay as they are."""
    status: Array = result.status  # pyright: ignore[reportAttributeAccessIssue]
    failed = status > Status.EVENT
    worst = jnp.max(jnp.where(failed, status, Status.COMPLETED))
    numbers = _numbers(result)
    factor = nan_unless(~failed)
    integers, floats = eqx.partition(numbers, lambda x: not eqx.is_inexact_array(x))
    # Mapped outside of `jit`, this is a separate program, which has ended when the call returns.
    with sentence_alone():
        factor, integers = _raise_where_failed((factor, integers), worst)

    def leaf(x: Array) -> Array:
        # Numbers that all runs share fail with any of them.
        has_runs = x.shape[x.ndim - factor.ndim :] == factor.shape
        return x * (factor if has_runs else jnp.min(factor)).astype(x.dtype)

    return _with_numbers(result, eqx.combine(jax.tree.map(leaf, floats), integers))


def place_of_failure(status: int, dense: DenseOutput | None, t0: float, y0: PyTree) -> str:
    """Time and state at which a single run failed, as a message.

    **Arguments**

    - `dense`: the steps of the run; `None` for a closed form, which has none, and if there are too
      many to store.
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


def cause_of_leaving(system: AbstractSystem, ts: Array, states: PyTree) -> str:
    """The quantity that left the range of validity first, as a message; empty where the system
    does not declare it.

    **Arguments**

    - `system`: of a single run.
    - `ts`: times, s, (times,); those that are not finite are left out.
    - `states`: the states there."""
    known = np.isfinite(np.asarray(ts))
    times = jnp.asarray(np.asarray(ts)[known])
    times_first = jax.tree.map(lambda x: jnp.moveaxis(x[..., known], -1, 0), states)
    flags = jax.vmap(lambda t, y: system.outside(t, y))(times, times_first)
    if flags is None or not np.any(flags):
        return ""
    first = int(np.argmax(flags))
    limits = system.limits(times[first], jax.tree.map(lambda x: x[first], times_first))
    limit = beyond_of(limits)
    return "" if limit is None else f"At t = {float(times[first]):.6g} s {limit.sentence()}."


def cause_of_nan(system: AbstractSystem, dense: DenseOutput) -> str:
    """The quantities whose rate is not finite at the last finite state of a run, as a message;
    where every rate is finite, the quantity that changes fastest."""
    ts, states = np.asarray(dense.ts), jax.tree.map(np.asarray, dense.states)
    finite = np.isfinite(ts)
    for x in jax.tree.leaves(states):
        finite &= np.all(np.isfinite(x), axis=tuple(range(x.ndim - 1)))
    if not finite.any():
        return ""
    last = int(np.flatnonzero(finite)[-1])
    y = jax.tree.map(lambda x: jnp.asarray(x[..., last]), states)
    rate = system.vector_field(jnp.asarray(ts[last]), y)
    names = [
        jax.tree_util.keystr(path).strip(".") or "y"
        for path, _ in jax.tree_util.tree_flatten_with_path(y)[0]
    ]
    rates = [np.asarray(x) for x in jax.tree.leaves(rate)]
    bad = [name for name, x in zip(names, rates, strict=True) if not np.all(np.isfinite(x))]
    if bad:
        return f"There the derivative of {', '.join(bad)} is not finite."
    # The time in which each quantity changes by its own size is the shortest for the cause.
    sizes = [float(np.max(np.abs(x))) for x in jax.tree.leaves(y)]
    speeds = [
        float(np.max(np.abs(x))) / size if size > 0.0 else 0.0
        for x, size in zip(rates, sizes, strict=True)
    ]
    fastest = int(np.argmax(speeds))
    return (
        f"There {names[fastest]} changes fastest, by its size in "
        f"{1.0 / max(speeds[fastest], 1e-300):.3g} s."
    )


def enough_steps(dense: DenseOutput, t0: float, t1: float, max_steps: int) -> str:
    """Estimated number of further steps of a run that reached the maximum number of steps, as a
    message; empty where the steps shorten too fast for an estimate.

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
        f"Its end at t = {t1:.6g} s requires about {steps} steps at this rate: "
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


def _numbers(result: Any) -> dict[str, Any]:
    """The arrays of a trajectory computed by the run: neither the arguments of its call nor the
    content of its controller, which may be non-numeric."""
    left = ("call", "control")
    fields = [f for f in dataclasses.fields(result) if not f.metadata.get("static", False)]
    numbers = {f.name: getattr(result, f.name) for f in fields if f.name not in left}
    if "phases" in numbers:
        numbers["phases"] = [_numbers(phase) for phase in numbers["phases"]]
    return numbers


def _with_numbers(result: Any, numbers: dict[str, Any]) -> Any:
    """The trajectory with other arrays."""
    numbers = dict(numbers)
    if "phases" in numbers:
        pairs = zip(result.phases, numbers["phases"], strict=True)
        numbers["phases"] = tuple(_with_numbers(phase, changed) for phase, changed in pairs)
    return dataclasses.replace(result, **numbers)


def _raise_where_failed(tree: T, status: Int[Array, ""]) -> T:
    """The arrays of the `tree`, which raise `SimulationError` where they are computed if the
    `status` is that of a failure; of mapped runs the largest status counts."""
    leaves, structure = jax.tree.flatten(tree)
    return jax.tree.unflatten(structure, raise_p.bind(status, *map(jnp.asarray, leaves)))


def _raised_alone(status: Array, *arrays: Array) -> Sequence[Array]:
    """Outside of a program, where the status can be read."""
    if status > Status.EVENT:
        _fail(status)
    return arrays


def _raised_by_program(status: Array, *arrays: Array) -> Sequence[Array]:
    shapes = jax.eval_shape(lambda: arrays)

    def failed(*arrays: Array) -> PyTree:
        del arrays
        return jax.pure_callback(_fail, shapes, status)

    return jax.lax.cond(status > Status.EVENT, failed, lambda *arrays: arrays, *arrays)


_by_program = mlir.lower_fun(_raised_by_program, multiple_results=True)


def _lowered(context: mlir.LoweringRuleContext, status: object, *arrays: object) -> object:
    # An exported program runs without Python: the numbers of its failed runs are NaN.
    if context.module_context.lowering_parameters.for_export:
        return arrays
    return _by_program(context, status, *arrays)


def _raised_tangent(
    primals: Sequence[Array], tangents: Sequence[Array | ad.Zero]
) -> tuple[Sequence[Array], Sequence[Array | ad.Zero]]:
    # The primal values raise, which is enough for the derivatives as well.
    return raise_p.bind(*primals), tangents[1:]


def _raised_batch(
    args: Sequence[Array], axes: Sequence[int | None]
) -> tuple[Sequence[Array], Sequence[int | None]]:
    status, *arrays = args
    # One branch for all mapped runs, because a mapped branch would evaluate both sides.
    worst = status if axes[0] is None else jnp.max(status, axis=axes[0])
    return raise_p.bind(worst, *arrays), axes[1:]


# A primitive, because only its rules know whether numbers are known and what a program is for.
raise_p = Primitive("raise_where_failed")
raise_p.multiple_results = True
raise_p.def_impl(_raised_alone)
raise_p.def_abstract_eval(lambda status, *arrays: arrays)
ad.primitive_jvps[raise_p] = _raised_tangent
batching.primitive_batchers[raise_p] = _raised_batch
mlir.register_lowering(raise_p, _lowered)  # pyright: ignore[reportArgumentType]


def _fail(worst: Array) -> None:
    logging.getLogger("jax._src.callback").addFilter(_SHORT)
    sentence = Status(int(worst)).sentence
    raise SimulationError(f"{sentence} Run it with throw=False to read the status of each run.")


class _SentenceAlone(logging.Filter):
    """A filter of the log that shortens the entry of a failed run, and leaves the others."""

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, SimulationError):
            record.msg = str(error)
            record.args = None
            record.exc_info = None
        return True


# One object, which the logger keeps once however often a run fails.
_SHORT = _SentenceAlone()

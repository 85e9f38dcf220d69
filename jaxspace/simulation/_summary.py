"""Printed form of a run or a mission: a few lines and a table, as text and as HTML."""

import html
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Int, PyTree

from ..core import State
from ..core.checks import is_concrete
from ..core.status import Status
from ..core.text import aligned, html_table
from ..integration.layout import state_at
from ._dataset import blocks_of
from .run_call import RunCall

Row = tuple[str, ...]
# A network in a state has thousands of components, and a quaternion has four.
MOST_COMPONENTS = 4


@runtime_checkable
class PrintedRun(Protocol):
    """The printed fields of a `Trajectory`; they are described there."""

    @property
    def ts(self) -> Array: ...
    @property
    def states(self) -> State: ...
    @property
    def status(self) -> Array: ...
    @property
    def stats(self) -> dict[str, Array]: ...
    @property
    def run_axes(self) -> int: ...
    @property
    def control(self) -> dict[str, PyTree] | None: ...
    @property
    def call(self) -> RunCall | None: ...


@runtime_checkable
class PrintedMission(Protocol):
    """The printed fields of a `MissionTrajectory`; they are described there."""

    @property
    def phases(self) -> Sequence[PrintedRun]: ...
    @property
    def final(self) -> State: ...
    @property
    def end(self) -> Array: ...
    @property
    def status(self) -> Array: ...
    @property
    def evaluations(self) -> Array: ...
    def items(self) -> Iterable[tuple[str, PrintedRun]]: ...


class Summary(NamedTuple):
    """Content of a printed result.

    - `title`: the kind of the result.
    - `facts`: names and sentences.
    - `tables`: each with its head; the first two columns are words."""

    title: str
    facts: list[Row]
    tables: list[list[Row]]

    def text(self) -> str:
        """The lines for a terminal."""
        parts = [aligned(self.facts, left=2)] if self.facts else []
        parts += [aligned(table, left=2) for table in self.tables]
        lines = [f"  {line}" for part in parts for line in part.splitlines()]
        return "\n".join([self.title, *lines])

    def html(self) -> str:
        """HTML form for notebooks."""
        parts = [html_table(self.facts, left=2, head=False)] if self.facts else []
        parts += [html_table(table, left=2) for table in self.tables]
        return f"<div><b>{html.escape(self.title)}</b>{''.join(parts)}</div>"


def summary_of_run(run: PrintedRun, facts: Sequence[Row] = ()) -> Summary:
    """Printed form of a `Trajectory`; only the shapes while it is traced.

    `facts`: more of them, before how it ended."""
    title = f"{'Trajectory' if run.control is None else 'Closed loop'} of "
    title += _system(run)
    sampled = _sampled(run)
    if not _has_numbers(run):
        tables = [_state_table(run.states)]
        tables += [_state_table(x, what="sample") for x in sampled]
        return Summary(f"{title} (traced)", [], tables)
    first, last = _range(run.ts[0]), _range(run.ts[-1])
    work = "{} steps, {} evaluations".format(*_counts(run))
    if run.call is not None:
        work = f"{_method(run)}, rtol {float(np.max(run.call.config.rtol)):.0e}; {work}"
    lines: list[Row] = [
        ("times", f"{first} s to {last} s, {run.ts.shape[0]} saved"),
        ("method", work),
        *facts,
        *_ended(run.status),
    ]
    # Of a batch the range at the end, because most runs start with similar states.
    # Only the last state of many runs.
    places = (-1,) if run.run_axes else (0, -1)
    ends = [state_at(run.states, k, run.run_axes) for k in places]
    tables = [_state_table(run.states, ends, run.run_axes)]
    rows = (0, -1)[-len(ends) :]
    for tree in sampled:
        ends = [state_at(tree, k, run.run_axes) for k in rows]
        tables.append(_state_table(tree, ends, run.run_axes, "sample"))
    return Summary(title + _of_runs(run.status), lines, tables)


def _sampled(run: PrintedRun) -> list[PyTree]:
    """Commands and readings of the controller of a run, by name; empty without one."""
    if run.control is None:
        return []
    return [{name: run.control[name] for name in ("commands", "readings")}]


def summary_of_mission(result: PrintedMission) -> Summary:
    """Printed form of a `MissionTrajectory`; only the shapes while it is traced."""
    count = len(result.phases)
    title = f"Mission of {count} phase{'s' if count > 1 else ''}"
    if not _has_numbers(result):
        phases: list[Row] = [("phase", "system")]
        phases += [(name, _system(phase)) for name, phase in result.items()]
        return Summary(f"{title} (traced)", [], [phases, _state_table(result.final)])
    rows: list[Row] = [("phase", "system", "from [s]", "to [s]", "method", "steps", "ended")]
    for name, phase in result.items():
        cells = (_range(phase.ts[0]), _range(phase.ts[-1]), _method(phase))
        rows.append((name, _system(phase), *cells, _counts(phase)[0], _statuses(phase.status)))
    work = _range(result.evaluations)
    facts = [
        ("times", f"{_range(result.phases[0].ts[0])} s to {_range(result.end)} s"),
        ("work", f"{work} evaluations of the vector fields"),
        *_ended(result.status),
    ]
    state = _state_table(result.final, [result.final], result.status.ndim)
    return Summary(title + _of_runs(result.status), facts, [rows, state])


def _has_numbers(result: PrintedRun | PrintedMission) -> bool:
    """Whether the arrays of a result are known: false while it is traced, and in a tree of
    shapes."""
    leaves = jax.tree.leaves(result)
    if any(isinstance(x, Tracer | jax.ShapeDtypeStruct) for x in leaves):
        return False
    # Trees of axes or of flags have the class of the result, too.
    return is_concrete(result.status) and isinstance(result.status, jax.Array | np.ndarray)


def _of_runs(status: Int[Array, "*runs"]) -> str:
    if not status.ndim:
        return ""
    return f", {status.size} run{'' if status.size == 1 else 's'}"


def _system(run: PrintedRun) -> str:
    """The name of the system of a run; the phases of `Campaign.outputs` have none."""
    return "a phase" if run.call is None else type(run.call.system).__name__


def _method(run: PrintedRun) -> str:
    if run.call is None:
        return "-"
    config = run.call.config
    how = "closed form" if isinstance(config.method, str) else type(config.method).__name__
    return f"{how} next to a closed form" if config.decoupled else how


def _counts(run: PrintedRun) -> tuple[str, str]:
    """Numbers of steps and evaluations of a run, or of the runs of a batch."""
    steps, evaluations = (_range(run.stats.get(name, 0)) for name in ("steps", "evaluations"))
    return steps, evaluations


def _range(x: ArrayLike) -> str:
    """A number, or the least and the greatest of those of many runs."""
    numbers = np.ravel(np.asarray(x))
    if not numbers.size:
        return "-"
    low, high = _number(np.fmin.reduce(numbers)), _number(np.fmax.reduce(numbers))
    return low if low == high else f"{low} .. {high}"


def _number(x: Any) -> str:
    # Counts in full, and measured numbers to six digits; with zero added, which has no sign.
    return f"{x}" if np.issubdtype(type(x), np.integer) else f"{float(x) + 0.0:.6g}"


def _state_table(
    shaped: PyTree, states: Sequence[State] = (), run_axes: int = 0, what: str = "state"
) -> list[Row]:
    """A line for each block: its name, unit and shape, and its numbers in each of the `states`.

    For several runs, the least and the greatest value of each component."""
    if run_axes:
        heads = ("least, at the end", "greatest")
    else:
        heads = ("at the start", "at the end")[-len(states) :] if states else ()
    rows: list[Row] = [(what, "unit", "shape", *heads)]
    numbers = [[leaf for _, _, leaf in blocks_of(state)] for state in states]
    for k, (name, unit, leaf) in enumerate(blocks_of(shaped)):
        cells = [text for state in numbers for text in _listed(np.asarray(state[k]), run_axes)]
        shape = getattr(leaf, "shape", type(leaf).__name__)
        rows.append((name, unit, str(shape), *cells))
    return rows


def _listed(x: np.ndarray, run_axes: int) -> list[str]:
    """The components of one block; of runs, the least and the greatest of each that are finite."""
    if not run_axes:
        return [_components(x.reshape(-1))]
    # NaN in failed runs hides the others from `min`, and not from `fmin`.
    rows = x.reshape(*x.shape[: x.ndim - run_axes], -1)
    if not rows.shape[-1]:
        return ["-", "-"]
    return [_components(f.reduce(rows, axis=-1).reshape(-1)) for f in (np.fmin, np.fmax)]


def _components(numbers: np.ndarray) -> str:
    shown = ", ".join(_number(x) for x in numbers[:MOST_COMPONENTS])
    return f"{shown}, ..." if numbers.size > MOST_COMPONENTS else shown


def _statuses(status: Int[Array, "*runs"]) -> str:
    """The name of a status, or how many runs have each."""
    counted = Counter(np.ravel(np.asarray(status)).tolist())
    if np.ndim(status) == 0:
        return Status(next(iter(counted))).name
    return ", ".join(f"{counted[code]} {Status(code).name}" for code in sorted(counted))


def _ended(status: Int[Array, "*runs"]) -> list[Row]:
    """End of the run; for a batch, the number of runs by status, and the first that failed."""
    statuses = np.ravel(np.asarray(status))
    if np.ndim(status) == 0:
        return [("status", Status(int(statuses[0])).sentence)]
    failed = np.flatnonzero(statuses > Status.EVENT)
    well = f"{statuses.size - failed.size} of {statuses.size} runs succeeded"
    rows: list[Row] = [("status", f"{well}: {_statuses(status)}")]
    if failed.size:
        rows.append(("", f"Run {failed[0]}: {Status(int(statuses[failed[0]])).sentence}"))
    return rows

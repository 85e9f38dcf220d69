"""Times between which straight lines show a run: evaluated where the saved ones are too few, and
thinned out where they are too many.

A line over an interval is compared with the run at an interior point that is not a simple fraction
of it, so that periodic motion does not agree with the line by coincidence. Where the difference
exceeds a share of the range of the component, the interval is divided there, and its neighbours are
compared again.
"""

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import jax
import numpy as np
from jaxtyping import PyTree

from ..core import InputError
from ..core.jit import quick_jit
from ..rotations import Quaternion
from ._leaves import state_leaves

if TYPE_CHECKING:
    from ..core import State
    from ..simulation import Trajectory

# Rows (components, times) by name; and the function of system, time and state that has them.
Rows: TypeAlias = dict[str, np.ndarray]
Shown: TypeAlias = Callable[[Any, Any, Any], dict[str, PyTree]]

PLACE = 0.5 * (3.0 - math.sqrt(5.0))
LINE = 1e-3
"""The largest error of a line, relative to the range of a component."""
VISIBLE = 5e-3
"""The same for lines between saved times, which are used while their error is below this."""
NEAR = 1e-2
"""The error of a displayed number, such as an altitude, relative to its value."""
READ = ("altitude", "distance", "speed")
TURNING, TURN_ERROR = "turning", 3e-3
"""An attitude between whose quaternions the page turns evenly, and its error there."""
WXYZ = "wxyz"
"""Last word of the name of a row of quaternions."""
MOST_POINTS = 20_000
"""Points of a line that is drawn finer than it was saved."""
CHUNK = 256
"""Times that one call of the compiled program evaluates."""
START, INNER = 65, 4
NOISE = 30.0
"""Errors of a run, in parts of its tolerance."""
# Of the duration: shorter intervals are not divided, because they contain a kink.
NARROW = 1e-5
FEW = 4
"""Saved times of which no fewer show a curvature."""
MOST_SAVED = 1000
TINY = 1e-300


class Drawn(NamedTuple):
    """The drawn part of a phase: times, states, and the leaves that these times do not resolve."""

    ts: Any
    states: "State"
    coarse: frozenset[str]


def leaf_rows(_system: object, _t: object, state: "State") -> dict[str, PyTree]:
    """The leaves of a state, as they are drawn in time."""
    rows = {}
    for name, _, leaf in state_leaves(state):
        quaternion = isinstance(leaf, Quaternion)
        values = leaf.wxyz if quaternion else leaf
        if values is not None and np.issubdtype(values.dtype, np.floating):
            rows[f"{name} {WXYZ}" if quaternion else name] = values
    return rows


def bent(phase: "Trajectory", shown: Shown) -> bool:
    """Whether lines between the saved times are off by more than is seen, by their curvature."""
    ts = np.asarray(phase.ts, float).reshape(len(phase.ts), -1)
    if len(ts) < FEW:
        return True
    runs = max(ts.shape[1], int(np.size(phase.status)))
    ts = np.broadcast_to(ts, (len(ts), runs))
    h = np.abs(np.diff(ts, axis=0))
    for name, values in _along(phase, shown).items():
        if name == TURNING:
            continue
        y = _continuous(name, np.asarray(values).reshape(-1, len(ts), runs))
        slope = np.diff(y, axis=1) / np.fmax(h, TINY)
        second = 2.0 * np.abs(np.diff(slope, axis=1)) / np.fmax(h[1:] + h[:-1], TINY)
        off = 0.125 * np.fmax(h[1:], h[:-1]) ** 2 * second
        allowed = _allowed(name, y, VISIBLE / LINE, _noise(phase))
        # NaN, where a run failed, is not a curvature.
        if np.any(off > allowed[:, 1:-1]):
            return True
    return False


def refined(phase: "Trajectory", runs: int, coarse: frozenset[str], shown: Shown) -> Drawn:
    """The first `runs` of a phase at times between which lines show it; as it was saved, with the
    leaves that are `coarse`, where it cannot be repeated."""
    count = min(runs, int(np.size(phase.status)))
    each = [phase.of(i) for i in range(count)] if phase.run_axes else [phase]
    try:
        parts = [run.with_steps() for run in each]
    except InputError:
        return Drawn(phase.ts, phase.states, coarse)
    lines = [_line(run, own, shown) for run, own in zip(each, parts, strict=True)]
    every = frozenset() if all(good for *_, good in lines) else coarse
    if not phase.run_axes:
        ((ts, states, _),) = lines
        return Drawn(ts, jax.tree.map(jax.numpy.asarray, states), every)
    # Lines of one length: the shorter ones stay at their ends.
    length = max(len(ts) for ts, *_ in lines)
    picks = [np.minimum(np.arange(length), len(ts) - 1) for ts, *_ in lines]
    ts = np.stack([line[0][pick] for line, pick in zip(lines, picks, strict=True)], axis=-1)
    padded = [
        jax.tree.map(lambda x, pick=pick: x[..., pick], line[1])
        for line, pick in zip(lines, picks, strict=True)
    ]
    return Drawn(
        ts, jax.tree.map(lambda *xs: jax.numpy.asarray(np.stack(xs, axis=-1)), *padded), every
    )


def thinned(
    times: np.ndarray, rows: Rows, error: float, most: int, turned: np.ndarray, turn: float
) -> np.ndarray | None:
    """Indices of the times required by lines with an error of `error`; `None` for more than `most`.

    From each time to the farthest one up to which every time between is near the line, and which is
    no more than one `turn` later, by the angle `turned` at each time, rad."""
    limits = {name: _allowed(name, y[..., None], error / LINE)[..., 0] for name, y in rows.items()}

    def straight(i: int, j: int) -> bool:
        if j - i < 2:
            return True
        if turned[j] - turned[i] > turn:
            return False
        between = np.arange(i + 1, j)
        share = (times[between] - times[i]) / ((times[j] - times[i]) or 1.0)
        return all(
            np.all(
                np.abs(_mixed(name, y[:, i, None], y[:, j, None], share) - y[:, between])
                <= limits[name][:, between]
            )
            for name, y in rows.items()
        )

    chosen = [0]
    length = 1
    while chosen[-1] < len(times) - 1:
        if len(chosen) >= most:
            return None
        i, last = chosen[-1], len(times) - 1
        # The length before is the guess of the next one.
        while length > 1 and not straight(i, min(i + length, last)):
            length //= 2
        while i + length < last and straight(i, min(i + 2 * length, last)):
            length *= 2
        chosen.append(min(i + length, last))
    return np.array(chosen)


def _line(
    run: "Trajectory", parts: "tuple[Trajectory, ...]", shown: Shown
) -> tuple[np.ndarray, "State", bool]:
    """Times, states and whether lines between them show the run."""
    if not parts:
        return np.asarray(run.ts), jax.tree.map(np.asarray, run.states), True
    saved = np.asarray(run.ts)
    most = max(MOST_POINTS // len(parts), START)
    lines = [_refined_part(part, saved, shown, most) for part in parts]
    ts = np.concatenate([ts for ts, *_ in lines])
    states = jax.tree.map(lambda *xs: np.concatenate(xs, axis=-1), *(y for _, y, _ in lines))
    return ts, states, all(good for *_, good in lines)


def _refined_part(
    part: "Trajectory", saved: np.ndarray, shown: Shown, most: int
) -> tuple[np.ndarray, "State", bool]:
    ts = _first_times(part, saved, most)
    states, rows = _evaluated(part, ts, shown)
    whole, noise = abs(ts[-1] - ts[0]), _noise(part)
    checked = np.zeros(len(ts) - 1, bool)
    while True:
        left = np.flatnonzero(~checked & (np.abs(np.diff(ts)) > NARROW * whole))
        if left.size == 0 or len(ts) >= most:
            return ts, states, left.size == 0
        inner = ts[left] + (PLACE * np.diff(ts)[left]).astype(ts.dtype)
        new_states, new_rows = _evaluated(part, inner, shown)
        wrong = np.zeros(left.size, bool)
        for name, y in rows.items():
            z, line = new_rows[name], _mixed(name, y[:, left], y[:, left + 1], PLACE)
            # A quaternion and its negative are one attitude.
            if _is_quaternion(name):
                z = z * np.where(np.sum(line * z, axis=0) < 0.0, -1.0, 1.0)
            allowed = _allowed(name, y[..., None], 1.0, noise)[..., 0][:, left]
            wrong |= np.any(np.abs(z - line) > allowed, axis=0)
        checked[left] = True
        added = left[wrong] + 1
        # The halves are compared, and the intervals on both sides.
        near = np.unique(np.concatenate([left[wrong] - 1, left[wrong] + 1]))
        near = near[(near >= 0) & (near < checked.size)]
        checked[near] = False
        checked = np.insert(checked, added, False)
        checked[added + np.arange(added.size) - 1] = False
        ts = np.insert(ts, added, inner[wrong])
        states, rows = _inserted((states, rows), added, (new_states, new_rows), wrong)


def _inserted(old: PyTree, places: np.ndarray, new: PyTree, chosen: np.ndarray) -> PyTree:
    """The arrays with the `chosen` ones of new times at these places of the last axis."""
    return jax.tree.map(lambda x, z: np.insert(x, places, z[..., chosen], axis=-1), old, new)


def _first_times(part: "Trajectory", saved: np.ndarray, most: int) -> np.ndarray:
    """Ends of steps with some times between, or even times of a closed form; and those saved."""
    t0, t1 = np.asarray(part.ts)[[0, -1]]
    if part.dense is None:
        times: Iterable = np.linspace(t0, t1, START)
    else:
        ends = np.asarray(part.dense.ts)
        ends = np.unique(np.concatenate([ends[np.isfinite(ends)], [t0, t1]]))
        inner = INNER if INNER * len(ends) < most else 1
        shares = np.arange(inner) / inner
        times = np.append((ends[:-1, None] + shares * np.diff(ends)[:, None]).reshape(-1), ends[-1])
    if len(saved) <= MOST_SAVED:
        times = np.concatenate([times, saved])
    times = np.asarray(times, saved.dtype)
    times = np.unique(times[(times >= min(t0, t1)) & (times <= max(t0, t1))])
    return times if t1 > t0 else times[::-1]


@quick_jit
def _program(part: "Trajectory", ts: jax.Array, shown: Shown) -> tuple["State", dict[str, PyTree]]:
    def one(t: jax.Array) -> tuple["State", dict[str, PyTree]]:
        state = part.at(t)
        rows = shown(part.system, t, state)
        return state, {name: x.reshape(-1) for name, x in rows.items()}

    return jax.tree.map(lambda x: jax.numpy.moveaxis(x, 0, -1), jax.lax.map(one, ts))


def _evaluated(part: "Trajectory", ts: np.ndarray, shown: Shown) -> tuple["State", Rows]:
    """States and rows at these times, the last axis."""
    count = -(-len(ts) // CHUNK) * CHUNK
    # Chunks of one size, so that there is one program.
    padded = np.concatenate([ts, np.full(count - len(ts), ts[-1])]).reshape(-1, CHUNK)
    found = [
        jax.tree.map(np.asarray, _program(part, jax.numpy.asarray(chunk), shown))
        for chunk in padded
    ]
    return jax.tree.map(lambda *xs: np.concatenate(xs, axis=-1)[..., : len(ts)], *found)


_of_saved = quick_jit(lambda phase, shown: phase.along(shown))


def _along(phase: "Trajectory", shown: Shown) -> dict[str, PyTree]:
    """The displayed values at the saved times."""
    if shown is not leaf_rows:
        return _of_saved(phase, shown)
    return leaf_rows(None, None, phase.states)


def _noise(phase: "Trajectory") -> float:
    """The errors of a run that are not motion, relative to a component."""
    return NOISE * float(np.max(np.asarray(phase.config.rtol)))


def _allowed(name: str, y: np.ndarray, factor: float, noise: float = 1e-9) -> np.ndarray:
    """The allowed error of a line at each of the values `y`, (components, times, runs)."""
    if name == TURNING:
        return np.full(y.shape, min(TURN_ERROR * factor, 0.02))
    size = np.fmax.reduce(np.abs(y).reshape(-1), initial=0.0)
    span = np.fmax.reduce(y, axis=1) - np.fmin.reduce(y, axis=1)
    # Of a vector by its largest component; what is constant but for its error has no span.
    span = np.fmax.reduce(span.reshape(-1), initial=0.0)
    allowed = max(LINE * factor * span, noise * size)
    if name in READ:
        return np.fmin(allowed, factor * (NEAR * np.abs(y) + 0.1 * LINE * span))
    return np.full(y.shape, allowed)


def _mixed(name: str, a: np.ndarray, b: np.ndarray, share: float | np.ndarray) -> np.ndarray:
    """Values at a share of the way from `a` to `b`, (components, times), as they are drawn."""
    if _is_quaternion(name):
        b = b * np.where(np.sum(a * b, axis=0) < 0.0, -1.0, 1.0)
    line = a + share * (b - a)
    return line / np.fmax(np.linalg.norm(line, axis=0), TINY) if name == TURNING else line


def _is_quaternion(name: str) -> bool:
    # A quaternion and its negative are one attitude.
    return name == TURNING or name.endswith(WXYZ)


def _continuous(name: str, y: np.ndarray) -> np.ndarray:
    """Values, with the sign of each quaternion that brings it closest to the one before."""
    if not _is_quaternion(name):
        return y
    jumps = np.where(np.sum(y[:, 1:] * y[:, :-1], axis=0) < 0.0, -1.0, 1.0)
    return y * np.cumprod(np.concatenate([np.ones((1, *jumps.shape[1:])), jumps]), axis=0)

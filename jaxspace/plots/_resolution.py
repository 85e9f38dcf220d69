"""Whether the saved times of a run resolve its motion, and finer ones where they do not.

    a line from y_0 to y_1 is drawn right where y_1 - y_0 is about h (f_0 + f_1)/2,
    and is off by h^2 |y''|/8 at its middle
    an attitude turns by 2 h |q'| between two times

    symbol    meaning                                       unit
    y, f      a component of the state, and its derivative  its own, its own per s
    h         time between two saved times                  s
    q'        derivative of the quaternion                  1/s

For a sine sampled four times per period the two sides differ by a tenth of its range, and by all of
it if it is sampled twice. So it is resolved below a quarter, and an attitude up to a quarter of a
turn. Fewer than four times show no curvature: such a run is never taken as resolved.

A run that is not resolved is evaluated again (`Trajectory.with_steps`), at the ends of its steps
and between them, and each interval is divided until the error of a line between its ends is below a
thousandth of the range of the component (`_refinement`). Only a closed loop cannot be repeated.

The derivative of a rigid body's velocity needs its vector field, whose compilation takes longer
than a figure. It is not needed where the position changes by the integral of the velocity as it was
saved: a motion of the velocity between two times would show in the position. So does one of the
angular velocity in the attitude.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PyTree

from ..core.jit import quick_jit
from ..rotations import Quaternion
from ._leaves import state_leaves
from ._refinement import FEW, Drawn, Shown, bent, leaf_rows, refined

if TYPE_CHECKING:
    from ..core import State
    from ..simulation import Trajectory

MISSED = 0.25
TURN = 0.5 * math.pi
CONSTANT, TINY = 1e-6, 1e-300
# Intervals of a closed loop that may have a kink, and how many times it has at least then.
KINKS, ENOUGH = 2, 20
# Each with its rate, and a mass, make up the state of a rigid body or of a point.
RATES = {"position": "velocity", "attitude": "omega"}


def resolved(phase: "Trajectory", runs: int = 1, shown: Shown = leaf_rows) -> Drawn:
    """The times and states of a phase: those saved where lines between them are right, otherwise
    finer ones, of the first `runs` of a batch.

    - `shown`: the values drawn along lines, a function of the system, the time and the state."""
    if not hasattr(phase, "with_steps") or np.all(phase.ts[0] == phase.ts[-1]):
        return Drawn(phase.ts, phase.states, frozenset())
    names = frozenset(name for name, _, leaf in state_leaves(phase.states) if leaf is not None)
    if phase.control is not None:
        coarse = names if len(phase.ts) < FEW else _coarse(phase, KINKS)
        return Drawn(phase.ts, phase.states, coarse)
    # The lines first: their check compiles nothing.
    coarse = names if bent(phase, shown) else _coarse(phase, 0)
    return refined(phase, runs, coarse, shown) if coarse else Drawn(phase.ts, phase.states, coarse)


@quick_jit
def _derivatives(phase: "Trajectory") -> "State":
    return phase.along(lambda system, t, y: system.vector_field(t, y))


@quick_jit
def _of_motion(states: "State") -> dict[str, PyTree]:
    """The derivatives contained in a state: of a position, and of an attitude."""
    result = {}
    if getattr(states, "velocity", None) is not None:
        result["position"] = states.velocity
    if getattr(states, "omega", None) is not None and isinstance(states.attitude, Quaternion):
        result["attitude"] = states.attitude.rate(states.omega)
    return result


def _coarse(phase: "Trajectory", kinks: int) -> frozenset[str]:
    """The leaves that move too far between two saved times, in more than so many intervals."""
    # Of a few intervals none is a kink: all of them may be missed.
    kinks = kinks if len(phase.ts) >= ENOUGH else 0
    # The field alone does not know what a controller commands.
    if phase.control is not None:
        derivatives = _of_motion(phase.states)
    elif _follows_its_rates(phase, kinks):
        return frozenset()
    else:
        derivatives = {name: leaf for name, _, leaf in state_leaves(_derivatives(phase))}
    ts = np.asarray(phase.ts).reshape(len(phase.ts), -1)
    coarse = set()
    for name, _, leaf in state_leaves(phase.states):
        f = derivatives.get(name)
        attitude = isinstance(leaf, Quaternion)
        if f is None:
            continue
        y, f = (np.asarray(x.wxyz if isinstance(x, Quaternion) else x) for x in (leaf, f))
        if y.shape != f.shape or not np.issubdtype(y.dtype, np.floating):
            continue
        runs = y.shape[-1] if phase.run_axes else 1
        y, f = (x.reshape(-1, len(ts), runs) for x in (y, f))
        if attitude:
            rate = 2.0 * np.sqrt(np.sum(f * f, axis=0))
            good = _largest_turn(rate, np.diff(ts, axis=0)) <= TURN
        else:
            good = _part_resolved(y, f, ts, kinks)
        if not good:
            coarse.add(name)
    return frozenset(coarse)


def _follows_its_rates(phase: "Trajectory", kinks: int) -> bool:
    """Whether the times resolve the state of a rigid body, or of a point, as far as the state
    itself shows it; false where it does not."""
    leaves = {name: leaf for name, _, leaf in state_leaves(phase.states) if leaf is not None}
    mass = leaves.pop("mass", None)
    burnt = np.zeros(0) if mass is None else np.diff(np.asarray(mass), axis=-1 - phase.run_axes)
    pairs = {name: rate for name, rate in RATES.items() if name in leaves}
    known = {*pairs, *pairs.values()} == set(leaves)
    # A mass that only falls, or only grows, has nothing between two times that they do not show.
    if not known or (np.any(burnt < 0.0) and np.any(burnt > 0.0)):
        return False
    ts = np.asarray(phase.ts).reshape(len(phase.ts), -1)
    h = np.diff(ts, axis=0)
    for name, rate in pairs.items():
        y, f = leaves[name], np.asarray(leaves[rate])
        y = np.asarray(y.wxyz if isinstance(y, Quaternion) else y)
        if y.shape[1:] != f.shape[1:] or f.shape[0] != 3 or f.ndim != 2 + phase.run_axes:
            return False
        y, f = (x.reshape(len(x), len(ts), -1) for x in (y, f))
        if name == "attitude":
            resolved = _largest_turn(np.sqrt(np.sum(f * f, axis=0)), h) <= TURN
            change = _turns(y)
        else:
            resolved = _part_resolved(y, f, ts, kinks)
            change = np.diff(y, axis=1)
        if not (resolved and _is_integral(change, f, h, kinks)):
            return False
    return True


def _turns(q: np.ndarray) -> np.ndarray:
    """The vectors of the turns between attitudes that follow each other, rad, in body axes,
    (3, times - 1, runs); the shorter way round."""
    w, v = q[0], q[1:]
    cross = np.cross(v[:, :-1], v[:, 1:], axis=0)
    sine = w[:-1] * v[:, 1:] - w[1:] * v[:, :-1] - cross
    cosine = w[:-1] * w[1:] + np.sum(v[:, :-1] * v[:, 1:], axis=0)
    size = np.sqrt(np.sum(sine * sine, axis=0))
    angle = 2.0 * np.arctan2(size, np.abs(cosine))
    return np.sign(cosine) * angle / np.fmax(size, TINY) * sine


def _is_integral(change: np.ndarray, f: np.ndarray, h: np.ndarray, kinks: int) -> bool:
    """Whether the `change` between two times is the integral of `f` along straight lines, up to a
    quarter of the range of each component of `f`.

    `change`: (components, times - 1, runs); `f`: (components, times, runs); `h`: s, (times - 1,
    runs or 1)."""
    span = np.fmax.reduce(f, axis=1) - np.fmin.reduce(f, axis=1)
    missed = np.abs(change - 0.5 * h * (f[:, 1:] + f[:, :-1]))
    moves = missed > CONSTANT * np.abs(h) * np.fmax.reduce(np.abs(f).reshape(-1))
    far = moves & (missed > MISSED * np.abs(h) * span[:, None])
    return not np.any(np.count_nonzero(far, axis=1) > kinks)


def _largest_turn(rate: np.ndarray, h: np.ndarray) -> float:
    """The largest turn between two times, rad, by the size of the angular velocity, (times, runs).

    `h`: s, (times - 1, runs or 1)."""
    # NaN, where a run failed, is not a turn.
    return float(np.fmax.reduce((np.abs(h) * np.fmax(rate[1:], rate[:-1])).reshape(-1)))


def _part_resolved(y: np.ndarray, f: np.ndarray, ts: np.ndarray, kinks: int) -> bool:
    """Whether the times resolve any other part of a state, relative to the range of each component.

    `y`, `f`: (components, times, runs); `ts`: (times, runs or 1)."""
    span = np.fmax.reduce(y, axis=1) - np.fmin.reduce(y, axis=1)
    missed = np.abs(np.diff(y, axis=1) - 0.5 * np.diff(ts, axis=0) * (f[:, 1:] + f[:, :-1]))
    # Values that are constant up to rounding need no resolution.
    moves = missed > CONSTANT * np.fmax.reduce(np.abs(y).reshape(-1))
    far = moves & (missed > MISSED * span[:, None])
    return not np.any(np.count_nonzero(far, axis=1) > kinks)

"""Whether the saved times of a run resolve its motion, and finer ones where the run has them.

    a line from y_0 to y_1 is drawn right where y_1 - y_0 is about h (f_0 + f_1)/2
    an attitude turns by 2 h |q'| between two times

    symbol    meaning                                       unit
    y, f      a component of the state, and its derivative  its own, its own per s
    h         time between two saved times                  s
    q'        derivative of the quaternion                  1/s

Of a sine that is sampled four times a turn the two sides differ by a tenth of what it spans, and by
all of it where it is sampled twice. So it is resolved below a quarter, and an attitude up to a
quarter of a turn.

The derivative of a rigid body's velocity needs its vector field, whose program takes longer than a
figure. It is not needed where the position changes by the integral of the velocity as it was saved:
a motion of the velocity between two times would show in the position. So does one of the angular
velocity in the attitude.
"""

import dataclasses
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core.quantities import quantities
from ..rotations import Quaternion

if TYPE_CHECKING:
    from ..core import State
    from ..simulation import Trajectory

MISSED = 0.25
TURN = 0.5 * math.pi
CONSTANT, KINKS, TINY = 1e-6, 2, 1e-300
# Each with its rate, and a mass, make up the state of a rigid body or of a point.
RATES = {"position": "velocity", "attitude": "omega"}
# So much of a radian between two points makes a smooth line.
SMOOTH = 0.3
MOST_POINTS = 20_000
"""Points of a line that is drawn finer than it was saved."""


class Drawn(NamedTuple):
    """The drawn part of a phase: times, states, and the leaves that these times do not resolve."""

    ts: Any
    states: "State"
    coarse: frozenset[str]


def resolved(phase: "Trajectory") -> Drawn:
    """The times and states of a phase, between those saved, too, where these are too few and the
    run has more: a closed form, or `dense=True`."""
    coarse, interval = _coarse(phase)
    if not coarse or not _knows_between(phase):
        return Drawn(phase.ts, phase.states, coarse)
    ts = np.asarray(phase.ts)
    span = np.nanmax(np.abs(ts - ts[0]))
    count = int(min(max(span / interval, len(ts)), MOST_POINTS)) + 1
    share = jnp.linspace(0.0, 1.0, count, dtype=ts.dtype)
    finer = phase.ts[0] + jnp.multiply.outer(share, phase.ts[-1] - phase.ts[0])
    left = frozenset() if count <= MOST_POINTS else coarse
    return Drawn(finer, _between(phase, finer), left)


def state_leaves(state: "State", name: str = "", unit: str = "") -> list[tuple[str, str, PyTree]]:
    """Name, declared unit and value of every array or quaternion of a state, in order."""
    if state is None:
        return []
    if dataclasses.is_dataclass(state) and not isinstance(state, Quaternion):
        declared = quantities(type(state))
        children = [
            (field.name, declared[field.name].unit if field.name in declared else "")
            for field in dataclasses.fields(state)
        ]
        members = [(key, unit, getattr(state, key)) for key, unit in children]
    elif isinstance(state, dict):
        members = [(str(key), "", value) for key, value in state.items()]
    elif isinstance(state, tuple | list):
        members = [(str(k), "", value) for k, value in enumerate(state)]
    else:
        return [(name or "state", unit, state)]
    result = []
    for key, unit, value in members:
        # "parts" only collects what effects add: its members have names of their own.
        path = " ".join(word for word in (name, key) if word and word != "parts")
        result += state_leaves(value, path, unit)
    return result


def _knows_between(phase: "Trajectory") -> bool:
    """Whether `phase.at` gives states between the saved times."""
    return phase.dense is not None or (
        phase.config.method == "closed_form" and phase.system.closed_form() is not None
    )


@eqx.filter_jit
def _between(phase: "Trajectory", ts: jax.Array) -> "State":
    states = jax.lax.map(phase.at, ts)
    # Times stand before the runs, and behind the components.
    last = -1 - phase.run_axes
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, last), states)


@eqx.filter_jit
def _derivatives(phase: "Trajectory") -> "State":
    return phase.along(lambda system, t, y: system.vector_field(t, y))


@eqx.filter_jit
def _of_motion(states: "State") -> dict[str, PyTree]:
    """The derivatives that a state itself holds: of a position, and of an attitude."""
    result = {}
    if getattr(states, "velocity", None) is not None:
        result["position"] = states.velocity
    if getattr(states, "omega", None) is not None and isinstance(states.attitude, Quaternion):
        result["attitude"] = states.attitude.rate(states.omega)
    return result


def _coarse(phase: "Trajectory") -> tuple[frozenset[str], float]:
    """The leaves that move too far between two saved times, and the interval at which all of them
    are smooth, s."""
    if not hasattr(phase, "along") or len(phase.ts) < 2:
        return frozenset(), math.inf
    # The field alone does not know what a controller commands.
    if phase.control is not None:
        derivatives = _of_motion(phase.states)
    elif _follows_its_rates(phase):
        return frozenset(), math.inf
    else:
        derivatives = {name: leaf for name, _, leaf in state_leaves(_derivatives(phase))}
    ts = np.asarray(phase.ts).reshape(len(phase.ts), -1)
    intervals = {}
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
        step = _of_attitude(f, np.diff(ts, axis=0)) if attitude else _of_part(y, f, ts)
        if step < math.inf:
            intervals[name] = step
    return frozenset(intervals), min(intervals.values(), default=math.inf)


def _follows_its_rates(phase: "Trajectory") -> bool:
    """Whether the times resolve the state of a rigid body, or of a point, as far as the state alone
    shows it; false where it does not."""
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
            resolved = _of_part(y, f, ts) == math.inf
            change = np.diff(y, axis=1)
        if not (resolved and _is_integral(change, f, h)):
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


def _is_integral(change: np.ndarray, f: np.ndarray, h: np.ndarray) -> bool:
    """Whether the `change` between two times is the integral of `f` along straight lines, but for
    a quarter of what each component of `f` spans.

    `change`: (components, times - 1, runs); `f`: (components, times, runs); `h`: s, (times - 1,
    runs or 1)."""
    span = np.fmax.reduce(f, axis=1) - np.fmin.reduce(f, axis=1)
    missed = np.abs(change - 0.5 * h * (f[:, 1:] + f[:, :-1]))
    moves = missed > CONSTANT * np.abs(h) * np.fmax.reduce(np.abs(f).reshape(-1))
    far = moves & (missed > MISSED * np.abs(h) * span[:, None])
    return not np.any(np.count_nonzero(far, axis=1) > KINKS)


def _of_attitude(f: np.ndarray, h: np.ndarray) -> float:
    """The interval in which an attitude turns little, s; infinite where it does so already.

    `f`: q', (4, times, runs); `h`: (times - 1, runs or 1)."""
    rate = 2.0 * np.sqrt(np.sum(f * f, axis=0))
    coarse = _largest_turn(rate, h) > TURN
    return SMOOTH / float(np.fmax.reduce(rate.reshape(-1))) if coarse else math.inf


def _largest_turn(rate: np.ndarray, h: np.ndarray) -> float:
    """The largest turn between two times, rad, by the size of the angular velocity, (times, runs).

    `h`: s, (times - 1, runs or 1)."""
    # NaN, where a run failed, is no turn.
    return float(np.fmax.reduce((np.abs(h) * np.fmax(rate[1:], rate[:-1])).reshape(-1)))


def _of_part(y: np.ndarray, f: np.ndarray, ts: np.ndarray) -> float:
    """The same of any other part of a state, by what each component spans.

    `y`, `f`: (components, times, runs); `ts`: (times, runs or 1)."""
    span = np.fmax.reduce(y, axis=1) - np.fmin.reduce(y, axis=1)
    missed = np.abs(np.diff(y, axis=1) - 0.5 * np.diff(ts, axis=0) * (f[:, 1:] + f[:, :-1]))
    # What is constant but for rounding has nothing to resolve.
    moves = missed > CONSTANT * np.fmax.reduce(np.abs(y).reshape(-1))
    far = moves & (missed > MISSED * span[:, None])
    # One interval or two are a kink, such as a burnout.
    coarse = np.count_nonzero(far, axis=1) > KINKS
    if not coarse.any():
        return math.inf
    rate = np.fmax.reduce(np.abs(f), axis=1)[coarse] / np.fmax(0.5 * span[coarse], TINY)
    return SMOOTH / float(np.fmax.reduce(rate))

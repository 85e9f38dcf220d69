"""Whether a run is slow motion beside a fast linear one, told by its numbers at the start.

    w = max |eigenvalue of J|,    J = df/dy at the start
    1. w |span| >= 1e5, and w h >= 300        an explicit method would want more steps than a run may take
    2. |J(y + f / w) - J(y)| <= 0.05 w        where the fast motion leads, it is still the same motion
    3. a step of 300 / w by the exponential method is within the tolerance

All are measured in the lengths of the state's blocks, as the tolerance is. A body that spins, or an orbit of many revolutions,
fails at the second line: its Jacobian turns with it. A gyrocompass, damped or ringing linear modes, and a fast decay onto which
the motion has settled pass.

    symbol  meaning                                  unit
    f, y    vector field and state at the start
    w       fastest rate                             1/s
    h       time between the states asked for        s
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from .._core import AbstractSystem, State
from ..solvers import ExponentialRosenbrock
from ._blocks import untransformed

EXPLICIT = 1e5  # radians or decay times in the span: DOP853 takes a step for each, or two for three
TRIAL = 300.0  # radians or decay times in a step: about as many as DOP853 passes while a step of 30 components is computed
SAME = 0.05
LEAST = 1e-3  # of a block's own unit: shorter ones count as this, as for the default absolute tolerance
MOST = 40  # components of a state: beyond, the exponential method's matrices cost more than they save


class Start(NamedTuple):
    """A single run as it is asked for."""

    system: AbstractSystem
    y: State
    ts: Array


def is_stiff(starts: Iterable[Start], rtol: float) -> bool:
    """Whether some of the runs would take an explicit method very many steps, and the exponential method serves all those.

    `False` where the numbers are not known (under `jit`, or in a derivative), or `rtol` is zero, as it is not known then."""
    if rtol == 0.0:
        return False
    verdicts = [_verdict(start, rtol) for start in starts if _readable(start)]
    long = [verdict for verdict in verdicts if verdict is not None]
    return bool(long) and all(long)


def _readable(start: Start) -> bool:
    leaves = jax.tree.leaves(start)
    placeholders = any(isinstance(x, jax.ShapeDtypeStruct) for x in leaves)
    return not placeholders and untransformed(leaves) and sum(map(np.size, jax.tree.leaves(start.y))) <= MOST


def _verdict(start: Start, rtol: float) -> bool | None:
    """Whether the exponential method serves a run; `None` if an explicit one would not take very many steps."""
    ts, v = np.asarray(start.ts), _flat(start.y)
    span = float(ts[-1] - ts[0])
    f, jacobian = _at(start, ts[0], v)
    if not (f.shape == v.shape and np.all(np.isfinite(jacobian))):
        return None
    w = float(np.max(np.abs(np.linalg.eigvals(jacobian))))
    if w * abs(span) < max(EXPLICIT, TRIAL * (ts.size - 1)):
        return None
    size = np.maximum(_sizes(start.y, v), _sizes(start.y, v + f / w))
    change = (_at(start, ts[0], v + f / w)[1] - jacobian) * size / size[:, None]
    if not np.max(np.abs(change)) <= SAME * w:
        return False
    y1, error = map(_flat, _trial(start.system, ts[0], start.y, ts.dtype.type(np.copysign(TRIAL / w, span))))
    return bool(np.all(np.abs(error) <= rtol * np.maximum(_sizes(start.y, v), _sizes(start.y, y1))))


def _flat(y: State) -> np.ndarray:
    return np.concatenate([np.asarray(x).reshape(-1) for x in jax.tree.leaves(y)])


def _sizes(y: State, v: np.ndarray) -> np.ndarray:
    """For every component of a state laid out in `v` the length of its block, as the default tolerances take it."""
    block = np.repeat(np.arange(len(jax.tree.leaves(y))), [x.size for x in jax.tree.leaves(y)])
    return np.sqrt(np.bincount(block, v * v))[block] + LEAST


def _at(start: Start, t: Any, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vector field and its Jacobian at the state laid out in `v`, from differences."""
    step = (np.sqrt(np.finfo(v.dtype).eps) * _sizes(start.y, v)).astype(v.dtype)
    rates = np.asarray(_rates(start.system, t, start.y, v + np.diag(step), v))
    return rates[-1], ((rates[:-1] - rates[-1]) / step[:, None]).T


@eqx.filter_jit
def _rates(system: AbstractSystem, t: Array, y: State, moved: Any, v: Any) -> Array:
    """The vector field at states laid out in the rows of `moved` and in `v`: derivatives would take far longer to compile."""
    state = ravel_pytree(y)[1]
    return jax.vmap(lambda v: ravel_pytree(system.vector_field(t, state(v)))[0])(jnp.concatenate([moved, v[None]]))


@eqx.filter_jit
def _trial(system: AbstractSystem, t: Array, y: State, h: Array) -> tuple[State, State]:
    """The state after a step `h` of the exponential method, and the estimate of its error."""
    term: Any = diffrax.ODETerm(lambda s, y, args: system.vector_field(s, y))
    return ExponentialRosenbrock().step(term, t, t + h, y, None, None, jnp.array(False))[:2]

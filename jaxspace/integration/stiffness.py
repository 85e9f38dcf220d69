"""Whether a run is stiff, that is slow motion together with a fast linear one, by its initial
numbers.

    w = max |eigenvalue of J|,    J = df/dy at the start
    1. w |span| >= 1e4, and w h >= 300      explicit steps would be more than a run may take
    2. |J(y + f / w) - J(y)| <= 0.05 w      the fast motion is linear
    3. a step of 300 / w by the exponential method is within the tolerance

All norms are relative to the lengths of the state's blocks, as the tolerance is. A body that spins,
or an orbit of many revolutions, fails the second condition, because its Jacobian turns with it. A
gyrocompass, damped or ringing linear modes, and a fast decay onto which the motion has settled
pass.

    symbol  meaning                                  unit
    f, y    vector field and state at the start
    w       fastest rate                             1/s
    h       time between the save times              s
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, PyTree

from ..core import AbstractSystem, State
from ..core.jit import jit_quickly
from .methods import STIFF

# Radians or decay times in a run: DOP853 takes five steps for three of them, which is more than a
# run may take by default.
EXPLICIT = 1e4
# Radians or decay times in a step of the exponential method: about as many as DOP853 passes while
# one such step of 30 components is computed.
TRIAL = 300.0
# Relative change of the Jacobian up to which the fast motion counts as linear.
SAME = 0.05
# Smallest length of a block, in its unit, as for the default absolute tolerance.
LEAST = 1e-3
# Components of a state beyond which the matrices of the method cost more than they save.
MOST_COMPONENTS = 40


class InitialConditions(NamedTuple):
    """Runs as they are requested, of which some are sampled; their numbers are known.

    - `runs`: (system, state, times), with the runs on the last axis of what carries them.
    - `run_axes`: of each array of `runs`, number of trailing batch axes (0 or 1).
    - `rows`: the numbers of the sampled runs."""

    runs: PyTree
    run_axes: PyTree[int]
    rows: np.ndarray

    @classmethod
    def of_one(cls, system: AbstractSystem, y: State, ts: Array) -> "InitialConditions":
        """A single run."""
        runs = (system, y, ts)
        return cls(runs, jax.tree.map(lambda _: 0, runs), np.zeros(1, int))

    @property
    def components(self) -> int:
        """Number of components of the state of one run."""
        _, state, _ = self.runs
        _, axes, _ = self.run_axes
        return sum(
            math.prod(np.shape(x)[:-1] if n else np.shape(x))
            for x, n in zip(jax.tree.leaves(state), jax.tree.leaves(axes), strict=True)
        )


def is_stiff(starts: InitialConditions, rtol: float) -> bool:
    """Whether some of the runs would require very many steps of an explicit method, and the
    exponential method suits all of these.

    `False` for a state with many components, or if `rtol` is zero, which represents an unknown
    tolerance."""
    if rtol == 0.0 or starts.components > MOST_COMPONENTS:
        return False
    system, y, ts = starts.runs
    times = np.shape(ts)[0]
    # Start and end alone, so that another number of save times causes no compilation.
    ends = np.asarray(ts)[np.array([0, -1])]
    starts = starts._replace(runs=(system, y, ends))
    still = np.zeros((starts.rows.size, starts.components))
    f, jacobian, size, span = map(np.asarray, _linearised(starts, still))
    sound = np.all(np.isfinite(jacobian), axis=(1, 2))
    w = np.max(np.abs(np.linalg.eigvals(np.where(sound[:, None, None], jacobian, 0.0))), axis=1)
    long = w * np.abs(span) >= max(EXPLICIT, TRIAL * (times - 1))
    if not np.any(long):
        return False
    w = np.where(long, w, np.inf)[:, None]
    _, there, size_there, _ = map(
        np.asarray, _linearised(starts, np.where(long[:, None], f / w, 0.0))
    )
    size = np.maximum(size, size_there)
    change = np.max(np.abs(there - jacobian) * size[:, None, :] / size[:, :, None], axis=(1, 2))
    if not np.all((change <= SAME * w[:, 0])[long]):
        return False
    error, size_after = map(np.asarray, _trial(starts, np.copysign(TRIAL / w[:, 0], span)))
    return bool(np.all((np.abs(error) <= rtol * np.maximum(size, size_after))[long]))


def of_each(starts: InitialConditions, function: Callable[..., PyTree], given: Array) -> PyTree:
    """`function(system, y, ts, x)` of each sampled run, with its row of `given`.

    System and state of a batch are passed as a batch of one run."""
    *batch, ts = jax.tree.map(
        lambda x, n: jnp.moveaxis(x[..., starts.rows], -1, 0) if n else x,
        starts.runs,
        starts.run_axes,
    )
    # Shared arrays have a batch axis of length one: without it they would broadcast against the
    # components.
    batch = jax.tree.map(lambda x, n: x[..., None] if n else x, batch, list(starts.run_axes[:2]))
    picked = (*batch, ts)
    axes = jax.tree.map(lambda n: 0 if n else None, starts.run_axes)
    given = given.astype(jnp.result_type(*jax.tree.leaves(starts.runs[1])))
    # Leaves other than arrays, such as a user's functions, cannot pass through a map.
    arrays, static = eqx.partition(picked, eqx.is_array)
    axes, _ = eqx.partition(axes, jax.tree.map(eqx.is_array, picked))

    def one(arrays: PyTree, x: Array) -> PyTree:
        return function(*eqx.combine(arrays, static), x)

    return jax.vmap(one, in_axes=(axes, 0))(arrays, given)


def _sizes(y: State) -> Array:
    """Length of the block to which each component belongs, as in the default tolerances."""
    return (
        ravel_pytree([jnp.sqrt(jnp.sum(x * x)) * jnp.ones_like(x) for x in jax.tree.leaves(y)])[0]
        + LEAST
    )


@jit_quickly
def _linearised(starts: InitialConditions, away: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """The vector field, its Jacobian and the sizes at the states moved by `away`, and the spans.

    Computed with differences, because derivatives would take far longer to compile. NaN where the
    rate of a state has another shape."""

    def one(
        system: AbstractSystem, y: State, ts: Array, away: Array
    ) -> tuple[Array, Array, Array, Array]:
        v, state = ravel_pytree(y)
        v = v + away
        size = _sizes(state(v))
        step = np.sqrt(np.finfo(v.dtype).eps).item() * size
        f = jax.vmap(lambda v: ravel_pytree(system.vector_field(ts[0], state(v)))[0])(
            v + jnp.concatenate([jnp.zeros_like(v)[None], jnp.diag(step)])
        )
        if f.shape[1] != v.size:
            f = jnp.full((v.size + 1, v.size), jnp.nan, v.dtype)
        return f[0], ((f[1:] - f[0]) / step[:, None]).T, size, ts[-1] - ts[0]

    return of_each(starts, one, jnp.asarray(away))


@jit_quickly
def _trial(starts: InitialConditions, h: ArrayLike) -> tuple[Array, Array]:
    """The estimated errors of a step `h` of the exponential method, and the sizes after it."""

    def one(system: AbstractSystem, y: State, ts: Array, h: Array) -> tuple[Array, Array]:
        term: diffrax.ODETerm = diffrax.ODETerm(lambda s, y, args: system.vector_field(s, y))
        y1, error, *_ = STIFF.step(term, ts[0], ts[0] + h, y, None, None, jnp.array(False))
        return ravel_pytree(error)[0], _sizes(y1)

    return of_each(starts, one, jnp.asarray(h))

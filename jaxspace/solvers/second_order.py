"""Second-order systems in normalised time s, for the solvers of this package.

    dr/ds = dt/ds v        dv/ds = dt/ds a(s, r)        dt/ds: duration of the segment, any unit

Runge-Kutta-Nystrom and Stormer methods sum accelerations into velocities, and obtain the rate of
the position from the vector field, so that they do not need dt/ds. A state consists of a position
and a velocity: a `BodyState`, a module or a named tuple with these two fields, or a dictionary with
these two keys.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from diffrax import AbstractTerm
from jax.interpreters import partial_eval
from jaxtyping import Array, Bool, Float, PyTree

from ..core import InputError, Scalar, State
from ..core.barrier import barrier
from ..core.jit import quick_jit
from .vector_field import just_before

Vectors = Float[Array, "..."]

PARTS = ("position", "velocity")


class Parts(NamedTuple):
    """Places of the two arrays of a state.

    - `structure`: that of the state.
    - `velocity_first`: whether its velocity precedes its position."""

    structure: jax.tree_util.PyTreeDef
    velocity_first: bool

    @classmethod
    def of(cls, y: PyTree) -> "Parts | None":
        """The places in a state, or in its shapes; `None` if it has no position or no velocity, or
        if there is anything else."""
        leaves, structure = jax.tree_util.tree_flatten_with_path(y)
        # A key of a dictionary, or a field of a module or of a named tuple.
        names = tuple(
            getattr(path[0], "name", getattr(path[0], "key", None)) if len(path) == 1 else None
            for path, _ in leaves
        )
        if names not in (PARTS, PARTS[::-1]):
            return None
        return cls(structure, names != PARTS)

    def split(self, y: PyTree) -> tuple[PyTree, PyTree]:
        """Position and velocity of such a state, or of its rate."""
        first, second = jax.tree.leaves(y)
        return (second, first) if self.velocity_first else (first, second)

    def state(self, position: Vectors, velocity: Vectors) -> State:
        """The state of this position and velocity."""
        pair = (velocity, position) if self.velocity_first else (position, velocity)
        return jax.tree.unflatten(self.structure, pair)


# Under `jit`, so that the seventeen or more stages of a step share one trace of the vector field.
@quick_jit
def _acceleration(
    terms: AbstractTerm, s: Scalar, r: Vectors, v: Vectors, args: PyTree, parts: Parts
) -> Vectors:
    return barrier(parts.split(terms.vf(s, parts.state(barrier(r), v), args))[1])


class SecondOrder(NamedTuple):
    """A second-order system during one step.

    - `terms`, `args`: the vector field, as diffrax passes it to a step.
    - `parts`: places of position and velocity in a state.
    - `r`, `v`: position and velocity at the start of the step.
    - `end`: the normalised time just before the end of the step.
    - `dt_ds`: the rate of the position for a velocity of ones.
    """

    terms: AbstractTerm
    args: PyTree
    parts: Parts
    r: Vectors
    v: Vectors
    end: Float[Array, ""]
    dt_ds: Vectors

    def acceleration(self, s: Float[Array, ""], r: Vectors) -> Vectors:
        """dv/ds at the position `r`, for the velocity at the start of the step."""
        end = jnp.minimum(s, self.end)
        return _acceleration(self.terms, end, r, self.v, self.args, self.parts)

    def position_rate(self, v: Vectors) -> Vectors:
        """dr/ds for the velocity `v`."""
        return self.dt_ds * v

    def state(self, r: Vectors, v: Vectors) -> State:
        """The state of position `r` and velocity `v`."""
        return self.parts.state(r, v)

    def velocity_matters(self, run_axes: int | None) -> Bool[Array, "*runs"]:
        """Whether the acceleration of a run changes when its velocity is zero, for each run.

        Then no method for second-order systems applies to it. `run_axes`: number of trailing axes
        carry runs; `None` for all but the first, that of the components."""
        r, v = jax.lax.stop_gradient((self.r, self.v))
        components = v.ndim - run_axes if run_axes is not None else min(v.ndim, 1)

        def a(v: Vectors) -> Vectors:
            return self.parts.split(self.terms.vf(self.end, self.state(r, v), self.args))[1]

        if not _reads_argument(a, v):
            return jnp.zeros(v.shape[components:], bool)
        axes = tuple(range(components))
        # By its values, because the velocity may be read without an effect.
        moving = a(v)
        still = a(jnp.zeros_like(v))
        # A thousand roundings, because an acceleration may be the difference of large terms.
        rounding = 1e3 * jnp.finfo(still.dtype).eps * jnp.max(jnp.abs(still), axis=axes)
        same = jnp.abs(moving - still) <= rounding
        return jax.lax.stop_gradient(~jnp.all(same | ~jnp.isfinite(moving), axis=axes))


def _reads_argument(function: Callable[[Array], Array], x: Array) -> bool:
    """Whether the result of the function depends on its argument, by its trace."""
    jaxpr = jax.make_jaxpr(function)(x).jaxpr
    _, read = partial_eval.dce_jaxpr(jaxpr, [True])
    return any(read)


def second_order(
    terms: AbstractTerm,
    t0: Float[Array, ""],
    t1: Float[Array, ""],
    y0: State,
    args: PyTree,
    solver: str,
) -> SecondOrder:
    """The system during the step from `t0` to `t1`.

    Raises `InputError`, which names the `solver`, unless the state consists of a position and a
    velocity."""
    parts = Parts.of(y0)
    if parts is None:
        raise InputError(
            f"{solver} requires a state that consists of a position and a velocity: use DOP853() "
            "for this state."
        )
    r, v = parts.split(y0)
    end = just_before(t0, t1)
    # The rate of the position in normalised time, of each run, is that of the vector field.
    dt_ds, _ = parts.split(terms.vf(end, parts.state(r, jnp.ones_like(v)), args))
    return SecondOrder(terms, args, parts, r, v, end, dt_ds)


def estimate_by_coarsening(
    integrate: Callable[[int], State],
    steps: int,
    fewer: int,
    error_reduction: Scalar,
    estimate: bool,
) -> tuple[State, State]:
    """The state at the end of equal steps, and an estimate of its error.

    **Arguments**

    - `integrate`: returns the state at the end for a number of steps.
    - `steps`, `fewer`: the two numbers of steps.
    - `error_reduction`: the difference of the two solutions over the error.
    - `estimate`: whether to estimate the error, which is zero otherwise.

    **Returns** the state after `steps` steps, and its error, which has no derivatives.
    """
    end = integrate(steps)
    if not estimate:
        return end, jax.tree.map(jnp.zeros_like, end)
    difference = jax.tree.map(jnp.subtract, end, integrate(fewer))
    error = jax.tree.map(lambda x: x / error_reduction, difference)
    return end, jax.lax.stop_gradient(error)

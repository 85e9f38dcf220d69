"""Second-order systems as the solvers here see them, in normalised time s.

    dr/ds = dt/ds v        dv/ds = dt/ds a(s, r)        dt/ds: duration of the segment, any unit

Runge-Kutta-Nystrom and Stormer methods sum accelerations into velocities, and learn from the
vector field how the position moves with a velocity. So they need not know dt/ds, and no state
holds anything but positions and velocities.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from diffrax import AbstractTerm
from jax.interpreters import partial_eval
from jaxtyping import Array, Bool, Float, PyTree

from ..core import InputError, Scalar, State, barrier
from ._vector_field import just_before

Vectors = Float[Array, "..."]


# Jitted, so that the stages of a step, seventeen and more, share one tracing of the vector field.
@eqx.filter_jit
def _acceleration(terms: AbstractTerm, s: Scalar, r: Vectors, y: State, args: PyTree) -> Vectors:
    return barrier(terms.vf(s, dataclasses.replace(y, position=barrier(r)), args).velocity)


class SecondOrder(NamedTuple):
    """A second-order system during one step.

    - `terms`, `args`: the vector field, as diffrax hands it to a step.
    - `y0`: the state at the start of the step.
    - `end`: the normalised time just before the end of the step.
    - `dt_ds`: the rate of the position for a velocity of ones.
    """

    terms: AbstractTerm
    args: PyTree
    y0: State
    end: Float[Array, ""]
    dt_ds: Vectors

    def acceleration(self, s: Float[Array, ""], r: Vectors) -> Vectors:
        """dv/ds at the position `r`; the velocity is taken not to matter."""
        return _acceleration(self.terms, jnp.minimum(s, self.end), r, self.y0, self.args)

    def position_rate(self, v: Vectors) -> Vectors:
        """dr/ds for the velocity `v`."""
        return self.dt_ds * v

    def state(self, r: Vectors, v: Vectors) -> State:
        """The state of position `r` and velocity `v`."""
        return dataclasses.replace(self.y0, position=r, velocity=v)

    def velocity_matters(self) -> Bool[Array, "*runs"]:
        """For each run whether its acceleration changes when it stands still.

        Then no method for second-order systems applies to it."""
        y0 = jax.lax.stop_gradient(self.y0)

        def a(v: Vectors) -> Vectors:
            return self.terms.vf(self.end, dataclasses.replace(y0, velocity=v), self.args).velocity

        if not _reads_argument(a, y0.velocity):
            return jnp.zeros(y0.velocity.shape[1:], bool)
        # By its numbers, because it may be read and not matter.
        moving = a(y0.velocity)
        still = a(jnp.zeros_like(y0.velocity))
        # A thousand roundings: an acceleration may be the difference of large terms.
        rounding = 1e3 * jnp.finfo(still.dtype).eps * jnp.max(jnp.abs(still), axis=0)
        same = jnp.abs(moving - still) <= rounding
        return jax.lax.stop_gradient(~jnp.all(same | ~jnp.isfinite(moving), axis=0))


def _reads_argument(function: Callable[[Array], Array], x: Array) -> bool:
    """Whether any operation leads from the argument to what the function returns."""
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

    Raises `InputError`, which names the `solver`, unless the state holds a position, a velocity and
    nothing else."""
    parts = [getattr(y0, name, None) for name in ("position", "velocity")]
    if any(part is None for part in parts) or len(jax.tree.leaves(y0)) != 2:
        raise InputError(
            f"{solver} integrates a position and a velocity, and nothing else: "
            "take DOP853() for this state."
        )
    end = just_before(t0, t1)
    # The vector field knows how the position moves in normalised time, for each run by itself.
    ones = dataclasses.replace(y0, velocity=jnp.ones_like(y0.velocity))
    return SecondOrder(terms, args, y0, end, terms.vf(end, ones, args).position)


def estimate_by_coarsening(
    integrate: Callable[[int], State],
    steps: int,
    fewer: int,
    error_reduction: Scalar,
    estimate: bool,
) -> tuple[State, State]:
    """The state at the end of equal steps, and an estimate of its error.

    **Arguments**

    - `integrate`: the state at the end of so many steps.
    - `steps`, `fewer`: the two numbers of steps that are compared.
    - `error_reduction`: by how much smaller than the difference of the two the error is.
    - `estimate`: whether the error is wanted; without it, it is zero and costs nothing.

    **Returns** the state after `steps` steps, and its error, which has no derivatives.
    """
    end = integrate(steps)
    if not estimate:
        return end, jax.tree.map(jnp.zeros_like, end)
    difference = jax.tree.map(jnp.subtract, end, integrate(fewer))
    error = jax.tree.map(lambda x: x / error_reduction, difference)
    return end, jax.lax.stop_gradient(error)

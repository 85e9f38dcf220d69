"""Derivatives of saved states with respect to the times at which they are saved.

The loop saves at fixed normalised times s, and its derivatives hold them fixed. The time that
belongs to s moves with the ends of the segments, and the time asked for moves with the save times
and with the duration of the run. A state that is asked for at t, and was saved at t(s), is

    y(t) = y(t(s)) + integral of f from t(s) to t

which adds nothing to the value, where both times are equal, but f (dt - dt(s)) to the derivative.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractSystem, State
from .normalised_time import Segments


@eqx.filter_custom_jvp
def _moved(dt: Array, t: Array, y: State, system: AbstractSystem) -> State:
    """The state a time `dt`, s, after `t`, for a `dt` of zero that has derivatives."""
    return y


@_moved.def_jvp
def _moved_jvp(primals: PyTree, tangents: PyTree) -> tuple[State, State]:
    dt, t, y, system = primals
    of_dt, _, of_y, _ = tangents
    # Once more this function, so that the derivatives of the derivative are right, too.
    moved = _moved(dt, t, y, system)
    leaves, structure = jax.tree.flatten(y)
    # An array that does not move has no tangent.
    given = zip(leaves, structure.flatten_up_to(of_y), strict=True)
    of_y = structure.unflatten([jnp.zeros_like(x) if d is None else d for x, d in given])
    if of_dt is None:
        return moved, of_y
    rate = system.vector_field(t + dt, moved)
    return moved, jax.tree.map(lambda d, f: d + (f * of_dt).astype(d.dtype), of_y, rate)


def at_save_times(
    states: State,
    system: AbstractSystem,
    segments: Segments,
    save_ts: Float[Array, " times"],
    fractions: Float[Array, " times"],
) -> State:
    """The saved states with derivatives by the times at which they are saved.

    **Arguments**

    - `states`: at the normalised times `save_ts`, times first.
    - `fractions`: the same times as fractions of the duration, which they are asked for at.

    **Returns** the same values."""
    asked = segments.t0 + jnp.multiply.outer(fractions, segments.total)
    saved = jax.vmap(segments.time)(jax.lax.stop_gradient(save_ts))
    late = asked - saved
    # Equal but for rounding: of the difference, the derivatives alone count.
    late = late - jax.lax.stop_gradient(late)
    return jax.vmap(_moved, in_axes=(0, 0, 0, None))(late, asked, states, system)

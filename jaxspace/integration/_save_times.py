"""Derivatives of saved states with respect to the times at which they are saved.

The loop saves at normalised times s, which are constant in its derivatives. The time t(s) depends
on the ends of the segments, and the requested time t on the save times and on the duration of the
run. The state at t that was saved at t(s) is

    y(t) = y(t(s)) + integral of f from t(s) to t

The integral is zero in value, because both times are equal, and adds f (dt - dt(s)) to the
derivative.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractSystem, State
from .events import whole
from .normalised_time import Segments


@eqx.filter_custom_jvp
def _moved(dt: Array, t: Array, y: State, system: AbstractSystem) -> State:
    """The state a time `dt`, s, after `t`, where `dt` is zero in value but has derivatives."""
    return y


@_moved.def_jvp
def _moved_jvp(primals: PyTree, tangents: PyTree) -> tuple[State, State]:
    dt, t, y, system = primals
    of_dt, _, of_y, _ = tangents
    # The function calls itself, so that derivatives of higher order are right, too.
    moved = _moved(dt, t, y, system)
    of_y = whole(of_y, y)
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
    - `fractions`: the requested times as fractions of the duration.

    **Returns** the same values."""
    asked = segments.t0 + jnp.multiply.outer(fractions, segments.total)
    saved = jax.vmap(segments.time)(jax.lax.stop_gradient(save_ts))
    late = asked - saved
    # Equal but for rounding, so that only the derivatives of the difference are used.
    late = late - jax.lax.stop_gradient(late)
    return jax.vmap(_moved, in_axes=(0, 0, 0, None))(late, asked, states, system)

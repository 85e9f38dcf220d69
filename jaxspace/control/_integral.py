"""The integral of an error over samples, with anti-windup: it waits while a command is limited."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, Vector
from ._advance import select


class Integral(NamedTuple):
    """The memory of a law with an integral.

    - `total`: integral of the error; `before`, that before the last sample.
    - `last`: time of the last sample, s; infinite before the first one."""

    total: Float[Array, "..."]
    before: Float[Array, "..."]
    last: Float[Array, "*#runs"]


def integrating(like: Vector) -> Integral:
    """The integral before the first sample; `like` has the shape of the error."""
    zero = jnp.zeros_like(like)
    return Integral(zero, zero, jnp.full(like.shape[1:], jnp.inf, like.dtype))


def integrated(memory: Integral, t: Scalar, error: Vector) -> Integral:
    """The integral after a sample at `t`, s; the error counts for the time since the last
    sample."""
    first = jnp.isinf(memory.last)
    elapsed = jnp.where(first, 0.0, t - jnp.where(first, 0.0, memory.last))
    total = memory.total + elapsed * error
    return Integral(total, memory.total, jnp.broadcast_to(t, memory.last.shape).astype(total.dtype))


def unwound(memory: Integral, cut: Array) -> Integral:
    """The integral without the last sample where the command was `cut`, (*runs,) or by
    component."""
    return memory._replace(total=select(cut, memory.before, memory.total))

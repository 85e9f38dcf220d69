"""The integral of an error over samples, with anti-windup: it waits while a command is limited."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, Vector
from ..core.compensated import two_sum
from ._advance import select


class Integral(NamedTuple):
    """The memory of a law with an integral.

    - `total`: integral of the error; `rest`: its rounding error, because a sample adds little to
      the integral of a long run; `before`, `rest_before`: those before the last sample.
    - `last`: time of the last sample, s; infinite before the first one."""

    total: Float[Array, "..."]
    rest: Float[Array, "..."]
    before: Float[Array, "..."]
    rest_before: Float[Array, "..."]
    last: Float[Array, "*#runs"]


def integrating(like: Vector) -> Integral:
    """The integral before the first sample; `like` has the shape of the error."""
    zero = jnp.zeros_like(like)
    return Integral(zero, zero, zero, zero, jnp.full(like.shape[1:], jnp.inf, like.dtype))


def integrated(memory: Integral, t: Scalar, error: Vector) -> Integral:
    """The integral after a sample at `t`, s; the error counts for the time since the last
    sample."""
    first = jnp.isinf(memory.last)
    elapsed = jnp.where(first, 0.0, t - jnp.where(first, 0.0, memory.last))
    total, rest = two_sum(memory.total, memory.rest + elapsed * error)
    last = jnp.broadcast_to(t, memory.last.shape).astype(total.dtype)
    return Integral(total, rest, memory.total, memory.rest, last)


def unwound(memory: Integral, cut: Array) -> Integral:
    """The integral without the last sample where the command was `cut`, (*runs,) or by
    component."""
    return memory._replace(
        total=select(cut, memory.before, memory.total),
        rest=select(cut, memory.rest_before, memory.rest),
    )

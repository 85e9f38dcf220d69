"""Numbers of a file as parameters and states of one run, or of many side by side: the runs
trail."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar


class Lanes(NamedTuple):
    """How many runs are built side by side: `runs`, or `None` for a single one without an axis of
    runs.

    A number of the file is a scalar, or (runs,) where it is dispersed."""

    runs: int | None = None

    def vector(self, components: Any) -> Float[Array, "components *#runs"]:
        """A parameter from, say, three components: (3,) of one run; else (3, 1), or (3, runs) if
        one of them is dispersed."""
        parts = [jnp.asarray(c) for c in components]
        shape = jnp.broadcast_shapes(() if self.runs is None else (1,), *(p.shape for p in parts))
        return jnp.stack([jnp.broadcast_to(p, shape) for p in parts])

    def scalar(self, number: Any) -> Scalar:
        """A number of the state, of every run: () or (runs,)."""
        return jnp.broadcast_to(jnp.asarray(number), () if self.runs is None else (self.runs,))

    def full(self, components: Any) -> Float[Array, "components *#runs"]:
        """A vector of the state, of every run: (3,) or (3, runs)."""
        return jnp.stack([self.scalar(c) for c in components])

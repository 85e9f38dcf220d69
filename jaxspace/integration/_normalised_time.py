"""A system as an integration sees it: on a clock that counts segments, in which nothing jumps.

The system's break times cut the span, segment i takes s from i to
i + 1, and every run maps the clock to its own time,

    t = t0 + T (u_i + (s - i)(u_{i+1} - u_i)),      dy/ds = T (u_{i+1} - u_i) f(t, y)

so that runs of different length, with their own break times, share one integration, and derivatives
with respect to the length of the span and to the break times come out by themselves.

    symbol  meaning                                            unit
    T       length of the span, t1 - t0 (negative: backwards)  s
    u_i     break times as fractions of the span, ascending    1
    f       vector field of the system                         state/s
"""

from typing import cast, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractRegularised, AbstractSplit, AbstractSystem, Scalar, State


@final
class Rate(eqx.Module):
    """dy/ds on the clock of the integration, as a function of s and y."""

    system: AbstractSystem
    u: Array
    t0: Array
    span: Array

    def _segment(self, s: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """The clock time at which the segment of `s` starts, the fraction of the span there, and
        that which the segment takes."""
        segments = self.u.shape[0] - 1
        start = jnp.clip(jnp.floor(s), 0.0, segments - 1.0)
        i = start.astype(jnp.int32) if segments > 1 else 0
        return start, self.u[i], self.u[i + 1] - self.u[i]

    def time(self, s: Scalar) -> Scalar:
        """The time at the clock time `s`."""
        start, u, width = self._segment(s)
        return self.t0 + self.span * (u + (s - start) * width)

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        """The duration of a clock time `ds` from `s` on."""
        return ds * (self.span * self._segment(s)[2])

    def __call__(self, s: Scalar, y: State) -> State:
        pace = self.duration(s, 1.0)
        return jax.tree.map(lambda k: k * pace, self.system.vector_field(self.time(s), y))

    def regularised(self) -> AbstractRegularised:
        """The regularised variables of the system, which has them."""
        return cast(AbstractRegularised, self.system.regularised())

    def split(self) -> AbstractSplit:
        """The drift and the kick of the system, which has them."""
        return cast(AbstractSplit, self.system.split())

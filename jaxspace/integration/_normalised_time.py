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

    def _form(self) -> AbstractRegularised:
        return cast(AbstractRegularised, self.system.regularised())

    def enter(self, y: State) -> Array:
        """The regular variables of a system that has a regular form."""
        return self._form().to_regularised(y)

    def leave(self, z: Array) -> State:
        """The state of the regular variables."""
        return self._form().from_regularised(z)

    def push(self, s0: Scalar, s1: Scalar, z: Array) -> Array:
        """The perturbation of the regular variables entered at the clock time `s0`, as it is
        between `s0` and `s1`."""
        whole = self.duration(s0, s1 - s0) * (1.0 - 4.0 * jnp.finfo(z.dtype).eps)
        since = jnp.clip(z[-1], jnp.minimum(whole, 0.0), jnp.maximum(whole, 0.0))
        return self._form().perturbation(self.time(s0) + since, z)

    def slope(self, z: Array, push: Array) -> Array:
        """The slope of the regular variables."""
        return self._form().derivative(z, push)

    def remaining(self, duration: Scalar, z: Array) -> Scalar:
        """About how much fictitious time a `duration` takes."""
        return self._form().fictitious_time(duration, z)

    def drift(self, s: Scalar, ds: Scalar, y: State) -> State:
        """The drift of a split system, from the clock time `s` on."""
        return cast(AbstractSplit, self.system.split()).drift(self.duration(s, ds), y)

    def kick(self, s: Scalar, ds: Scalar, y: State) -> State:
        """The kick of a split system, as it is at the clock time `s`."""
        return cast(AbstractSplit, self.system.split()).kick(self.time(s), self.duration(s, ds), y)

"""Dense output: states within a step."""

from abc import abstractmethod

import diffrax
import jax
import jax.numpy as jnp
from equinox import AbstractVar
from jaxtyping import Array, Float

from ..core import State


class AbstractDenseOutput(diffrax.AbstractLocalInterpolation):
    """The dense output of a step from `t0` to `t1`, as diffrax evaluates it."""

    t0: AbstractVar[Float[Array, ""]]
    t1: AbstractVar[Float[Array, ""]]

    @abstractmethod
    def state(self, t: Float[Array, "*#runs"]) -> State:
        """The state at the time `t` within the step; `t` may differ between runs."""

    def evaluate(
        self,
        t0: Float[Array, "*#runs"],
        t1: Float[Array, "*#runs"] | None = None,
        left: bool = True,
    ) -> State:
        """The state at `t0`, or its change from `t0` to `t1`."""
        del left
        if t1 is None:
            return self.state(t0)
        return jax.tree.map(jnp.subtract, self.state(t1), self.state(t0))

    def fraction(self, t: Float[Array, "*#runs"]) -> Float[Array, "*#runs"]:
        """Fraction of the step before `t`."""
        h = self.t1 - self.t0
        # Also evaluated for a step of no length, although nothing reads the result.
        return (t - self.t0) / jnp.where(h == 0.0, 1.0, h)


def evaluated(polynomial: diffrax.AbstractLocalInterpolation, t: Float[Array, "*runs"]) -> State:
    """The state at the time `t` of each run within a step; a dense output of diffrax takes a
    single time."""
    if t.ndim == 0 or isinstance(polynomial, AbstractDenseOutput):
        return polynomial.evaluate(t)
    axes = jax.tree.map(lambda x: -1 if jnp.ndim(x) else None, polynomial)
    return jax.vmap(evaluated, in_axes=(axes, -1), out_axes=-1)(polynomial, t)

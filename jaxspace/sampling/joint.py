"""Inputs that are drawn together: their interface, and each of their numbers as an input.

Files of the distributions: `_correlated.py`, `_cone.py`.
"""

from abc import abstractmethod
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError
from ..core.structure import HashedModule
from .distributions import AbstractDistribution


class AbstractJoint(HashedModule):
    """A distribution of several numbers together."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number n of components."""

    @property
    @abstractmethod
    def dimensions(self) -> int:
        """Number k of standard normal numbers that make one draw."""

    @property
    @abstractmethod
    def mean(self) -> Float[Array, " n"]:
        """The numbers of the nominal run."""

    @property
    @abstractmethod
    def covariance(self) -> Float[Array, "n n"]:
        """The mean of (x - m)(x - m)^T about `mean`."""

    @abstractmethod
    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, " n"]:
        """One draw from standard normal numbers."""

    def searched(self, z: Float[Array, " k"]) -> tuple[Float[Array, " n"], Float[Array, ""]]:
        """The draw at `z` in a search for rare events, and how likely it is in comparison with that
        search: one, except with marginals that have rare values."""
        values = self.from_normal(z)
        return values, jnp.ones((), values.dtype)

    @abstractmethod
    def text(self) -> str:
        """The distribution in words, for records."""

    @property
    def expectation(self) -> Float[Array, " n"]:
        """Mean of a draw; that of truncated marginals differs from `mean`."""
        return self.mean

    @abstractmethod
    def outside(self, index: int, low: float, high: float) -> float:
        """The share of all draws whose component `index` is below `low` or above `high`."""

    def inputs(self, *names: str) -> dict[str, AbstractDistribution]:
        """The inputs of a campaign with these `names`, drawn together.

        `Campaign(build, {**cone.inputs("u_x", "u_y", "u_z"), "mass": ...}, ...)`. Raises
        `InputError` unless there is a name for each number."""
        if len(names) != self.size:
            raise InputError(f"{len(names)} names are given for {self.size} numbers.")
        source = "+".join(names)
        # The abstract fields of the base are properties here, and not arguments.
        made = (
            Component(joint=self, index=k, shared=source)  # pyright: ignore[reportCallIssue]
            for k in range(self.size)
        )
        return dict(zip(names, made, strict=True))


@final
class Component(AbstractDistribution):
    """One number of a joint distribution; `AbstractJoint.inputs` makes them.

    - `joint`, `index`: which number of which distribution.
    - `shared`: the name of the draw that all numbers share."""

    joint: AbstractJoint
    index: int = eqx.field(static=True)
    shared: str = eqx.field(static=True)

    @property
    def source(self) -> str:
        return self.shared

    @property
    def dimensions(self) -> int:
        return self.joint.dimensions

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Mean of this number."""
        return self.joint.mean[self.index]

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Standard deviation of this number."""
        return jnp.sqrt(self.joint.covariance[self.index, self.index])

    def sample(self, key: Array) -> Float[Array, ""]:
        # Every component of a joint gets the same key, and thus the same numbers z.
        return self.from_normal(jax.random.normal(key, (self.joint.dimensions,)))

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        return self.joint.from_normal(z)[self.index]

    def searched(self, z: Float[Array, "..."]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        values, factor = self.joint.searched(z)
        return values[self.index], factor

    def outside(self, low: float, high: float) -> float:
        return self.joint.outside(self.index, low, high)

    @property
    def expectation(self) -> Float[Array, ""]:
        return self.joint.expectation[self.index]

    def text(self) -> str:
        return f"number {self.index} of {self.joint.text()}"

"""The interface of a campaign for the lower-level replays and checks."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import TypeAlias

import equinox as eqx
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Integer

from ..core import State
from ..core.quantities import Quantity
from ..core.structure import HashedModule
from ..sampling.designs import AbstractDesign
from ..sampling.distributions import AbstractDistribution
from ..simulation import Mission
from ..simulation.mission_result import MissionTrajectory
from ..statistics.requirements import Requirement

BuildFunction: TypeAlias = Callable[[dict[str, Array]], tuple[Mission, State]]
"""The mission and its initial state from the inputs, each (runs,)."""
OutputFunction: TypeAlias = Callable[[MissionTrajectory, dict[str, Array]], dict[str, Array]]
"""The outputs, each (runs,), from a result and the inputs."""
Limits: TypeAlias = tuple[float | None, float | None] | Requirement
"""The least and the greatest value that is allowed, or a requirement."""


class AbstractCampaign(HashedModule):
    """The definition of the runs of a campaign; fields and methods are those of `Campaign`."""

    # In the order of `Campaign`, which type checkers take for that of its arguments.
    build: eqx.AbstractVar[BuildFunction]
    inputs: eqx.AbstractVar[dict[str, AbstractDistribution]]
    outputs: eqx.AbstractVar[OutputFunction]
    units: eqx.AbstractVar[dict[str, str]]
    start: eqx.AbstractVar[Float[Array, ""]]
    description: eqx.AbstractVar[str]
    limits: eqx.AbstractVar[tuple[tuple[str, Quantity], ...]]
    design: eqx.AbstractVar[AbstractDesign | None]
    requirements: eqx.AbstractVar[tuple[tuple[str, Limits], ...]]
    num_saved: eqx.AbstractVar[int]

    @abstractmethod
    def nominal(self, runs: int = 1) -> dict[str, Float[Array, " runs"]]:
        """The mean of every input, (runs,)."""

    @abstractmethod
    def samples(
        self, key: Array, numbers: Integer[Array, " runs"]
    ) -> dict[str, Float[Array, " runs"]]:
        """The inputs of the runs with these numbers."""

    @abstractmethod
    def mission(self, samples: dict[str, Float[Array, " *runs"]]) -> tuple[Mission, State]:
        """The mission and the initial state of runs with these inputs."""

    @abstractmethod
    def allowed(self, samples: dict[str, Float[Array, " runs"]]) -> Bool[Array, " runs"]:
        """Whether all inputs of a run are in the ranges allowed by their classes, for each run."""

    @abstractmethod
    def refusal(self, samples: Mapping[str, ArrayLike]) -> str:
        """Why a run with these inputs is rejected; empty if it is allowed."""

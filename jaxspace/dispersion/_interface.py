"""The interface of a campaign for the lower-level replays and checks."""

import dataclasses
import functools
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Concatenate, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Integer

from ..core import State
from ..core.jit import quick_jit
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

P = ParamSpec("P")
T = TypeVar("T")
C = TypeVar("C", bound="AbstractCampaign")


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


def for_programs(campaign: C) -> C:
    """The campaign without what is only recorded and judged: its texts and requirements.

    As an argument of a compiled function they would be part of the program."""
    beside = {"description": "", "requirements": (), "files": (), "modules": ()}
    if all(getattr(campaign, name) == empty for name, empty in beside.items()):
        return campaign
    return dataclasses.replace(campaign, **beside)


def jit_of_campaign(
    function: Callable[Concatenate[C, P], T],
    jit: Callable[[Callable[Concatenate[C, P], T]], Callable[Concatenate[C, P], T]] = quick_jit,
) -> Callable[Concatenate[C, P], T]:
    """A compiled function of a campaign (`for_programs`) and other arguments."""
    compiled = jit(function)

    @functools.wraps(function)
    def call(campaign: C, *args: P.args, **kwargs: P.kwargs) -> T:
        return compiled(for_programs(campaign), *args, **kwargs)

    return call

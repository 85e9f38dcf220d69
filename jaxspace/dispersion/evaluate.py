"""A campaign as a function from given inputs to outputs, for derivatives, sigma points and samples
that are not drawn by `disperse`."""

__all__ = ["Evaluator"]

import functools
from collections.abc import Mapping
from typing import NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int, Key

from ..core.jit import jit_quickly
from ..core.status import Status
from ..core.structure import HashedModule
from ..integration.accuracy import Accuracy
from ..sampling.designs import AbstractDesign, Sobol, map_normals, normal_columns
from ..simulation.blocks import jit_wide_vectors
from ..simulation.failures import nan_where_failed
from ._campaign import Campaign, check_no_sweep
from ._exact_parts import for_turns
from ._interface import jit_of_campaign
from ._outputs import outputs_of
from ._runs import nominal_unless, run_inputs
from ._whole import check_whole

BLOCK = 256
"""Runs in one call: every number of runs is padded to a multiple, so that one program is
sufficient."""


class Evaluated(NamedTuple):
    """Outputs by name, each (runs,), NaN where a run failed; and the status of each run."""

    outputs: dict[str, np.ndarray]
    status: np.ndarray

    @property
    def good(self) -> np.ndarray:
        """Whether each run succeeded, (runs,)."""
        return self.status <= Status.EVENT


def evaluate_traced(
    campaign: Campaign, accuracy: Accuracy, samples: dict[str, Float[Array, " runs"]]
) -> tuple[dict[str, Float[Array, " runs"]], Int[Array, " runs"]]:
    """Outputs and status of runs with these inputs, by adaptive steps; differentiable."""
    result, _ = run_inputs(campaign, accuracy, samples, campaign.num_saved)
    shape = next(iter(samples.values())).shape
    return outputs_of(campaign.outputs, result, samples), jnp.broadcast_to(result.status, shape)


def evaluate_allowed(
    campaign: Campaign, accuracy: Accuracy, samples: dict[str, Float[Array, " runs"]]
) -> tuple[dict[str, Float[Array, " runs"]], Int[Array, " runs"]]:
    """The same with the status `REFUSED` for runs whose inputs are outside of the allowed ranges;
    the outputs of failed runs are meaningless."""
    allowed = campaign.allowed(samples)
    inputs = nominal_unless(allowed, campaign, samples)
    outputs, status = evaluate_traced(campaign, accuracy, inputs)
    return outputs, jnp.where(allowed, status, Status.REFUSED)


def fixed_normals(campaign: Campaign, runs: int, seed: int) -> Float[Array, "runs dimensions"]:
    """Independent standard normal numbers that place runs by the design of the campaign, or on
    scrambled Sobol points where it has none.

    Raises `InputError` for numbers that are not whole."""
    check_whole("runs", runs, 1)
    check_whole("seed", seed)
    check_no_sweep(campaign, "a fixed set of runs")
    design = Sobol() if campaign.design is None else campaign.design
    dimensions = sum(map(len, normal_columns(campaign.inputs).values()))
    return _normals(design, jax.random.key(seed), runs, dimensions)


# One program: alone, each of some two hundred operations on bits would be compiled for itself.
@jit_quickly
def _normals(
    design: AbstractDesign, key: Key[Array, ""], runs: int, dimensions: int
) -> Float[Array, "runs dimensions"]:
    return design.normals(key, jnp.arange(runs), dimensions)


def inputs_at(
    campaign: Campaign, normals: Float[Array, "runs dimensions"]
) -> dict[str, Float[Array, " runs"]]:
    """The inputs at these standard normal numbers; differentiable in the distributions."""
    return map_normals(campaign.inputs, normals)


@functools.partial(jit_of_campaign, jit=jit_wide_vectors)
def _evaluate(
    campaign: Campaign, accuracy: Accuracy, samples: dict[str, Float[Array, " runs"]]
) -> tuple[dict[str, Float[Array, " runs"]], Int[Array, " runs"]]:
    outputs, status = evaluate_allowed(campaign, accuracy, samples)
    return nan_where_failed(outputs, status), status


@final
class Evaluator(HashedModule):
    """The outputs of a campaign for given inputs.

    - `campaign`, `accuracy`: of the runs."""

    campaign: Campaign
    accuracy: Accuracy

    def __call__(self, samples: Mapping[str, ArrayLike]) -> Evaluated:
        """The runs with these inputs, each (runs,), of whatever number."""
        given = {name: np.asarray(x) for name, x in samples.items()}
        runs = len(next(iter(given.values())))
        # Filled up with the last run: zeros could be a run that fails, or takes long.
        filled = {
            name: np.concatenate([x, np.full(-runs % BLOCK, x[-1])]) for name, x in given.items()
        }
        parts = []
        for first in range(0, runs, BLOCK):
            block = {name: jnp.asarray(x[first : first + BLOCK]) for name, x in filled.items()}
            parts.append(_evaluate(self.campaign, self.accuracy, block))
        outputs, status = jax.tree.map(lambda *x: np.concatenate(x)[:runs], *parts)
        exactly = for_turns(self.campaign, self.accuracy, status)
        if exactly is not None:
            return Evaluator(self.campaign, exactly)(samples)
        return Evaluated(outputs, status)

"""Replay of one run of a campaign, in full detail."""

__all__ = ["Replay"]

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import InputError
from ..core.printing import printed
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.status import SimulationError, Status
from ..simulation import MissionTrajectory
from ..simulation.finish import with_calls
from ..simulation.mission_runs import run_mission
from ..simulation.phases import resolve_phases
from ._exact_parts import for_turns
from ._interface import AbstractCampaign, OutputFunction
from ._isolation import RAISED, callbacks, reason
from ._outputs import outputs_of, raised
from ._saved_states import saved_states, thinned


@final
@printed()
class Replay(eqx.Module):
    """A run of a campaign with its trajectory.

    - `number`, `seed`: which run it is.
    - `inputs`, `outputs`: by name; the outputs of the trajectory, whose steps are adaptive, agree
      with those of the campaign to the tolerance.
    - `trajectory`: the phases, with the requested number of states.
    - `refusal`: why a run is refused; its trajectory then is that of the inputs all the same, where
      they have one."""

    number: int
    seed: int
    inputs: dict[str, float]
    outputs: dict[str, float]
    trajectory: MissionTrajectory
    refusal: str

    @property
    def status(self) -> Status:
        """Status of the run."""
        return Status.REFUSED if self.refusal else Status(int(self.trajectory.status))


@eqx.filter_jit
def _run(
    campaign: AbstractCampaign,
    accuracy: Accuracy,
    samples: dict[str, Array],
    num_saved: int,
    outputs: OutputFunction,
) -> tuple[MissionTrajectory, dict[str, Array], tuple[IntegrationConfig, ...]]:
    mission, y0 = campaign.mission(samples)
    configs = resolve_phases(mission, y0, accuracy, 1)
    saved, every_nth = saved_states(campaign.along, num_saved)
    result = run_mission(mission, y0, campaign.start, saved, configs, 1)
    return thinned(result, every_nth), outputs_of(outputs, result, samples), configs


def replay(
    campaign: AbstractCampaign, number: int, seed: int, accuracy: Accuracy, num_saved: int
) -> Replay:
    """`Campaign.replay`; campaigns know their replays, which do not know them in turn."""
    # Keys are made with 32 bits: a greater number would be that of another run.
    if not 0 <= number < 2**32:
        raise InputError(f"number is {number}: it must be that of a run, from 0 on.")
    samples = eqx.filter_jit(lambda c, k, n: c.samples(k, n))(
        campaign, jax.random.key(seed), jnp.full((1,), number, jnp.uint32)
    )
    inputs = {name: float(samples[name][0]) for name in campaign.inputs}
    outputs = campaign.outputs
    try:
        with callbacks():
            computed = jax.block_until_ready(_run(campaign, accuracy, samples, num_saved, outputs))
            exactly = for_turns(campaign, accuracy, computed[0].status)
            if exactly is not None:
                accuracy = exactly
                computed = jax.block_until_ready(
                    _run(campaign, accuracy, samples, num_saved, outputs)
                )
    except RAISED as error:
        raise _error(campaign, number, samples, accuracy, error) from error
    result, numbers, configs = computed
    refusal = campaign.refusal(inputs)
    try:
        mission, _ = campaign.mission(samples)
    except InputError as error:
        # The message names the input, and not the formula in which it is out of range.
        if refusal:
            raise InputError(f"Run {number} is refused: {refusal}") from error
        raise
    trajectory = with_calls(result, mission, accuracy, configs).of(0)
    values = {name: float(x[0]) for name, x in numbers.items()}
    # Outputs of a compiled function are sorted by name; the units have the order of the file.
    ordered = {name: values[name] for name in campaign.units if name in values} | values
    return Replay(number, seed, inputs, ordered, trajectory, refusal)


def _error(
    campaign: AbstractCampaign,
    number: int,
    samples: dict[str, Array],
    accuracy: Accuracy,
    error: Exception,
) -> SimulationError:
    """The exception for a run in which a function of the campaign raises an error."""
    what = f"Run {number}"
    # Run once more without outputs: if that succeeds, an output raises the error.
    try:
        with callbacks():
            result, _, _ = jax.block_until_ready(_run(campaign, accuracy, samples, 0, _no_outputs))
    except RAISED:
        return SimulationError(
            f"{what} cannot be run: a function of the campaign raises an error ({reason(error)})."
        )
    return raised(what, campaign.outputs, result, samples, error)


def _no_outputs(result: MissionTrajectory, samples: dict[str, Array]) -> dict[str, Array]:
    del result, samples
    return {}

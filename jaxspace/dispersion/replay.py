"""Replay of one run of a campaign, in full detail."""

__all__ = ["Replay"]

import functools
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError
from ..core.jit import jit_quickly
from ..core.printing import printed
from ..core.status import SimulationError, Status
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..simulation import MissionTrajectory
from ..simulation.blocks import Blocks
from ..simulation.finish import with_calls
from ._exact_parts import for_turns
from ._interface import AbstractCampaign, for_programs, jit_of_campaign
from ._isolation import RAISED, callbacks, reason
from ._outputs import raised
from ._program import Drawn, call_size, draw_inputs, program, runs_with_rolled_stages
from ._runs import run_inputs
from ._saved_states import saved_states, thinned
from .purpose import with_tolerance


@final
@printed()
class Replay(eqx.Module):
    """A run of a campaign with its trajectory.

    - `number`, `seed`: of the run.
    - `inputs`, `outputs`: by name, bit-identical to those of the campaign if it stores no states;
      NaN for a run that is rejected or fails.
    - `trajectory`: the phases, with the requested number of states. Its ends agree with the outputs
      to the tolerance, because steps may also end where states are saved.
    - `refusal`: why a run is rejected; its trajectory is then that of its inputs, if possible."""

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


# A single run: the program takes far longer to compile than to run.
@functools.partial(jit_of_campaign, jit=jit_quickly)
def _run(
    campaign: AbstractCampaign,
    accuracy: Accuracy,
    samples: dict[str, Array],
    num_saved: int,
) -> tuple[MissionTrajectory, tuple[IntegrationConfig, ...]]:
    saved, every_nth = saved_states(campaign.num_saved, num_saved)
    result, configs = run_inputs(campaign, accuracy, samples, saved, rolled=True)
    return thinned(result, every_nth), configs


def _outputs(
    campaign: AbstractCampaign, accuracy: Accuracy, drawn: Drawn, runs: int
) -> dict[str, float]:
    """The outputs of the first of these runs, from the program of a campaign of `runs` runs."""
    devices = jax.local_devices()[:1]
    blocks = Blocks.on(devices, call_size(devices))
    rolled = runs_with_rolled_stages(campaign, accuracy, blocks.size, runs)
    # A whole call, because other numbers of runs would be other programs.
    run = program(devices[0].platform)
    results = run(for_programs(campaign), accuracy, drawn, blocks, 0, rolled)
    return {name: float(np.asarray(x)[0]) for name, x in results.outputs.items()}


def replay(
    campaign: AbstractCampaign,
    number: int,
    seed: int,
    accuracy: Accuracy,
    num_saved: int,
    runs: int,
) -> Replay:
    """`Campaign.replay`; campaigns know their replays, which do not know them in turn."""
    # Keys are made with 32 bits: a greater number would be that of another run.
    if not 0 <= number < 2**32:
        raise InputError(f"number is {number}: it must be a run number, starting from 0.")
    # As the runs of the campaign have it: without a number it would be another program.
    accuracy = with_tolerance(accuracy)
    call = call_size(jax.local_devices())
    numbers = jnp.full((call,), number, jnp.uint32)
    drawn = draw_inputs(
        for_programs(campaign), jax.random.key(seed), numbers, jnp.ones((call,), bool)
    )
    samples = {name: x[:1] for name, x in drawn.inputs.items()}
    inputs = {name: float(samples[name][0]) for name in campaign.inputs}
    refusal = campaign.refusal(inputs)
    what = f"Run {number}"
    try:
        with callbacks():
            result, configs = jax.block_until_ready(_run(campaign, accuracy, samples, num_saved))
            exactly = for_turns(campaign, accuracy, result.status)
            if exactly is not None:
                accuracy = exactly
                again = _run(campaign, accuracy, samples, num_saved)
                result, configs = jax.block_until_ready(again)
    except RAISED as error:
        raise SimulationError(
            f"{what} cannot be simulated: a function of the campaign raises an error "
            f"({reason(error)})."
        ) from error
    try:
        with callbacks():
            values = _outputs(campaign, accuracy, drawn, runs)
    except RAISED as error:
        ends, _ = _run(campaign, accuracy, samples, 0)
        raise raised(what, campaign.outputs, ends, samples, error) from error
    try:
        mission, _ = campaign.mission(samples)
    except InputError as error:
        # The message names the input, and not the formula in which it is out of range.
        if refusal:
            raise InputError(f"{what} is rejected: {refusal}") from error
        raise
    trajectory = with_calls(result, mission, accuracy, configs).of(0)
    # Outputs of a compiled function are sorted by name; the units have the order of the file.
    ordered = {name: values[name] for name in campaign.units if name in values} | values
    return Replay(number, seed, inputs, ordered, trajectory, refusal)

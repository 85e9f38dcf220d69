"""The nominal run and the first runs of a campaign, on which its outputs are checked."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..integration.accuracy import Accuracy
from ..integration.compiling import QUICK
from ..simulation.mission_runs import run_mission
from ..simulation.phases import resolve_phases
from ._campaign import Campaign
from ._isolation import isolate
from ._outputs import FirstRuns, check_apart, outputs_to_check
from ._program import Drawn

CHECKED = 15
"""Number of runs besides the nominal one: enough to see one among others."""


@eqx.filter_jit(**QUICK)
def _first_runs(
    campaign: Campaign, accuracy: Accuracy, drawn: dict[str, Float[Array, " runs"]]
) -> FirstRuns:
    """The nominal run, and then the first runs of those drawn."""
    nominal = campaign.nominal()
    samples = {name: jnp.concatenate([x, drawn[name][:CHECKED]]) for name, x in nominal.items()}
    mission, y0 = campaign.mission(samples)
    # Few runs, whose program takes far longer to compile than to run.
    configs = resolve_phases(mission, y0, accuracy, 1, small=True)
    return FirstRuns(run_mission(mission, y0, campaign.start, 2, configs, 1), samples)


def check_outputs(
    campaign: Campaign, accuracy: Accuracy, draw: Callable[[np.ndarray], Drawn]
) -> None:
    """Check that the outputs of a run depend on that run alone (`check_apart`).

    `draw(used)` are the inputs of the first runs, of which those `used` raise no error. No mission
    runs where the outputs are those of the library."""
    if outputs_to_check(campaign.outputs) is None:
        return

    def runs(used: np.ndarray) -> FirstRuns:
        result = _first_runs(campaign, accuracy, draw(used).used)
        return jax.tree.map(lambda x: np.asarray(x) if eqx.is_array(x) else x, result)

    check_apart(campaign.outputs, campaign.along, isolate(runs, CHECKED))

"""Unknowns of a design by their paths in the mission, against the optimum in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
from test_robust_design import SCATTER, Line, Rest

from jaxspace.core import InputError
from jaxspace.dispersion import Campaign, Normal
from jaxspace.robust import optimise_design
from jaxspace.robust.free import Free, free_by_path
from jaxspace.robust.statistics import MeanPlus
from jaxspace.simulation import Mission, Phase


def build(samples):
    rest = Phase(Rest(), jnp.asarray(2.0))
    return Mission([rest]), Line(0.9 + 0.0 * samples["w"])


def outputs(result, samples):
    x, t = result.final.y, result.phases[0].ts[-1]
    return {"y": (x - 1.0) ** 2 + SCATTER * x * samples["w"] + (t - 3.0) ** 2}


CAMPAIGN = Campaign(build, {"w": Normal(0.0, 1.0)}, outputs)


def test_parts_of_state_and_mission_are_found():
    """Of (x - 1)^2 + k s x + (t - 3)^2: the place x of every run, and the duration t they share."""
    design = free_by_path(
        CAMPAIGN, {"state.y": Free(0.0, 2.0), "mission.phases.0.until": Free(1.0, 5.0, scale=1.0)}
    )
    assert design.start == {"state.y": 0.9, "mission.phases.0.until": 2.0}
    assert design.scale == {"state.y": 2.0, "mission.phases.0.until": 1.0}
    found = optimise_design(
        design.campaign,
        design.start,
        minimise=MeanPlus("y", 1.0),
        bounds=design.bounds,
        scale=design.scale,
        tolerance=1e-6,
    )
    # 1,024 Sobol points know mean and deviation to 0.1 %.
    np.testing.assert_allclose(found.x["state.y"], 1.0 - 0.5 * SCATTER, atol=0.005)
    np.testing.assert_allclose(found.x["mission.phases.0.until"], 3.0, atol=1e-3)


def test_what_is_wrong_with_a_path_is_said():
    for free, sentence in (
        ({}, "free is empty"),
        ({"phases.0": Free()}, "begins with 'phases': it must begin with mission or state"),
        ({"mission.phases.1": Free()}, "mission.phases has 0"),
        ({"mission.phases.0.untill": Free()}, "has system, until, .* Did you mean until"),
        ({"mission.phases.0.name": Free()}, "holds no floats"),
        ({"state.y": Free(1.0, 0.0)}, "low = 1 and high = 0: the lower one must be below"),
    ):
        with pytest.raises(InputError, match=sentence):
            free_by_path(CAMPAIGN, free)
    random = Campaign(lambda s: (build(s)[0], Line(s["w"])), CAMPAIGN.inputs, outputs)
    with pytest.raises(InputError, match="a number cannot be free and random"):
        free_by_path(random, {"state.y": Free()})

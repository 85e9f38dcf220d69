"""Unknowns of a design by their paths in the mission, against the optimum in closed form."""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from test_robust_design import SCATTER, Line, Rest

from jaxspace.core import AbstractSystem, InputError
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
        ({"mission.phases.0.name": Free()}, "contains no floats"),
        ({"state.y": Free(1.0, 0.0)}, "low = 1 and high = 0: the lower one must be below"),
    ):
        with pytest.raises(InputError, match=sentence):
            free_by_path(CAMPAIGN, free)
    random = Campaign(lambda s: (build(s)[0], Line(s["w"])), CAMPAIGN.inputs, outputs)
    with pytest.raises(InputError, match="a number cannot be both a design variable and random"):
        free_by_path(random, {"state.y": Free()})


@final
class Steered(AbstractSystem):
    """y' = u(t), linear between the values of a table, and a network of it."""

    table: Float[Array, " times"]
    law: eqx.nn.Linear

    def vector_field(self, t, y):
        push = jnp.interp(t, jnp.arange(3.0), self.table)
        return Line(push + self.law(push[None])[0] + 0.0 * y.y)

    def invariants(self, t, y):
        return {}


def test_tables_and_modules_are_free_as_a_whole():
    law = eqx.nn.Linear(1, 1, key=jax.random.key(0), dtype=float)

    def steered(samples):
        system = Steered(jnp.array([1.0, 2.0, 3.0]), law)
        return Mission([Phase(system, jnp.asarray(2.0))]), Line(0.0 * samples["w"])

    campaign = Campaign(steered, CAMPAIGN.inputs, outputs)
    table, whole = "mission.phases.0.system.table", "mission.phases.0.system.law"
    design = free_by_path(campaign, {table: Free(0.0, 4.0), whole: Free(scale=0.1)})
    assert design.start[table].shape == (3,)
    assert eqx.tree_equal(design.start[whole], eqx.filter(law, eqx.is_inexact_array))
    np.testing.assert_array_equal(design.bounds[1][table], 4.0)
    np.testing.assert_array_equal(design.scale[whole].weight, 0.1)
    moved = {
        table: jnp.array([3.0, 2.0, 1.0]),
        whole: jax.tree.map(lambda x: 2.0 * x, design.start[whole]),
    }
    (mission, _) = design.campaign(moved).build({"w": jnp.zeros(5)})
    found = mission.phases[0].system
    np.testing.assert_array_equal(found.table, [3.0, 2.0, 1.0])
    np.testing.assert_array_equal(found.law.weight, 2.0 * law.weight)
    np.testing.assert_array_equal(found.law.bias, 2.0 * law.bias)

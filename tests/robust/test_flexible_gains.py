"""The scene `flexible_gains`: its runs against linear analysis, and its search."""

from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from jaxspace import Scene, load
from jaxspace.dispersion import Campaign, disperse
from jaxspace.io import SceneFile
from jaxspace.mechanics.missile_loop import MissileLoop
from jaxspace.robust import assess_designs
from jaxspace.statistics import Dispersion
from jaxspace.studies import modes
from jaxspace.vehicles import FlexibleStage

SCENE = Path(__file__).parents[2] / "examples" / "scenes" / "flexible_gains.toml"
DURATION = 4.0
# Sine of the three degrees of the target.
TURN = 0.05233595624294383


@pytest.fixture(scope="module")
def file() -> SceneFile:
    return load(SCENE)


def loop_of(campaign: Campaign, runs: Dispersion) -> MissileLoop:
    """The loop of the stage, with the numbers of these runs."""
    mission, _ = campaign.mission({name: jnp.asarray(x) for name, x in runs.inputs.items()})
    made = mission.phases[0].system
    assert isinstance(made, Scene)
    stage = made.effects[-1]
    assert isinstance(stage, FlexibleStage)
    return stage.loop


def linear_ends(loop: MissileLoop, runs: Dispersion) -> dict[str, np.ndarray]:
    """Lean, deg, and its rate, deg/s, at the end of each run: of both planes by the exponential of
    the loop, which the stage is for small angles."""
    share = loop.missile.engine["turn"]
    lean = lambda y: y.missile.pitch + share * y.missile.engine  # noqa: E731
    lean_rate = lambda y: y.missile.pitch_rate + share * y.missile.engine_rate  # noqa: E731
    linear = eqx.filter_jit(modes)(
        loop, loop.state(jnp.zeros(runs.runs)), outputs=(lean, lean_rate)
    )
    matrices, outputs = np.asarray(linear.matrix), np.asarray(linear.output_matrix)
    bending = loop.missile.modes
    start = np.zeros((len(matrices), 2, runs.runs))
    # A state is the angle of the engine, bending and pitch, then their rates, then the slosh.
    start[1 + bending, 0] = -TURN
    start[3 + 2 * bending] = runs.inputs["initial.omega.1"], -runs.inputs["initial.omega.0"]
    ends = [
        outputs[..., k] @ scipy.linalg.expm(DURATION * matrices[..., k]) @ start[..., k]
        for k in range(runs.runs)
    ]
    found = np.linalg.norm(ends, axis=-1)
    assert np.all(linear.stable)
    return dict(zip(("lean", "lean_rate"), np.rad2deg(np.transpose(found)), strict=True))


def test_the_runs_are_those_of_the_linear_loop(file):
    """At the gains of the file."""
    campaign = file.campaign()
    runs = disperse(campaign, 32)
    expected = linear_ends(loop_of(campaign, runs), runs)
    for name, values in expected.items():
        # Sines stand for angles: of the third order in the three degrees, and in the rate.
        np.testing.assert_allclose(runs.values(name), values, atol=3.0 * TURN**2, err_msg=name)
        assert np.ptp(values) > 0.05


@pytest.mark.sweep
def test_the_gains_are_best_by_the_linear_loop(file):
    """In their closed form, fresh runs keep both limits, and one limit with as many runs beyond it
    as are allowed."""
    found = file.optimize_design()
    assert found.converged, found.sentence()
    fresh = assess_designs(found, runs=2048).designs["robust"].runs
    kept = linear_ends(loop_of(found.problem.campaign(found.x), fresh), fresh)
    limits = {"lean": 0.25, "lean_rate": 0.15}
    beyond = {name: np.mean(kept[name] > limit) for name, limit in limits.items()}
    # Of 5 %, by four standard errors of 400 runs and 2,048.
    error = 4.0 * np.sqrt(0.05 * 0.95 * (1.0 / 400.0 + 1.0 / 2048.0))
    assert max(beyond.values()) < 0.05 + error, beyond
    assert max(beyond.values()) > 0.05 - error, beyond

"""Every number of every example scene can be dispersed, or is rejected with the reason."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.control import Sensor
from jaxspace.core import InputError
from jaxspace.dispersion import Uniform
from jaxspace.dispersion._runs import run_inputs
from jaxspace.io import load
from jaxspace.io._requests.inputs import measures
from jaxspace.simulation import Accuracy
from jaxspace.solvers import Tsit5

SCENES = sorted((Path(__file__).resolve().parents[2] / "examples" / "scenes").glob("*.toml"))
DISPERSION = """
[dispersion]
runs = 8
outputs = ["end_time"]

[dispersion.inputs]
"%s" = { distribution = "uniform", low = -1.0, high = 1.0 }
"""


def about(number):
    """A narrow distribution about a number; a zero may have to be non-negative."""
    width = 1e-9 * abs(number)
    return Uniform(number - width, number + width) if number else Uniform(0.0, 1e-12)


def with_dispersion(scene, folder):
    """The scene, with a dispersed number if it has none."""
    text = scene.read_text()
    if "[dispersion" in text:
        return load(scene)
    path = folder / scene.name
    numbers = [name for name, _ in measures(load(scene).values)]
    path.write_text(text + DISPERSION % numbers[0])
    return load(path)


@pytest.mark.parametrize("scene", SCENES, ids=lambda path: path.stem)
def test_every_number_of_a_scene_can_be_dispersed(scene, tmp_path):
    """All of them at once, in a block of runs: the program is traced, and not compiled."""
    file = with_dispersion(scene, tmp_path)
    numbers = dict(measures(file.values))
    inputs = {x: about(float(number)) for x, number in numbers.items() if not x.startswith("disp")}
    campaign = file.campaign(inputs=inputs, warn=False)
    accuracy = Accuracy(1e-6, method=Tsit5())

    def final(campaign, inputs):
        return run_inputs(campaign, accuracy, inputs, 2)[0].final

    shapes = eqx.filter_eval_shape(final, campaign, campaign.nominal(64))
    assert len(inputs) >= 8 and {leaf.shape[-1] for leaf in jax.tree.leaves(shapes)} == {64}


@pytest.mark.parametrize(
    "name", ["control.delay", "control.period", "control.sensors.omega.period"]
)
def test_a_number_that_sets_the_form_of_the_program_is_rejected_with_the_reason(name, tmp_path):
    (scene,) = (path for path in SCENES if path.stem == "sampled_slew")
    path = tmp_path / "slew.toml"
    text = scene.read_text().replace("walk = 1e-7", 'period = "1 s"\nwalk = 1e-7')
    path.write_text(text + DISPERSION % "body.inertia.0")
    with pytest.raises(
        InputError, match=f"^inputs.{name} cannot be dispersed: the number {name} s"
    ):
        load(path).campaign(inputs={name: Uniform(0.1, 0.2)}, warn=False)


def test_errors_of_a_sensor_may_differ_between_runs():
    """Each run then has the reading that a sensor with its own errors gives."""
    runs = jnp.arange(1.0, 5.0)
    y = {"x": jnp.ones((3, 4)) * jnp.array([1.0, 2.0, 3.0])[:, None]}

    def read(run, **errors):
        sensor = Sensor(lambda t, y: y["x"], **errors)
        some = y if run is None else {"x": y["x"][:, run]}
        drift = jnp.zeros_like(some["x"])
        return sensor.read(jnp.array(0.0), some, drift, 4.0, lambda k, like: jnp.ones_like(like))

    for kind in ("noise", "bias", "walk", "quantum", "limit"):
        reading, drift = read(None, **{kind: runs})
        for run in range(4):
            alone, after = read(run, **{kind: runs[run]})
            np.testing.assert_array_equal(reading[:, run], alone)
            np.testing.assert_array_equal(drift[:, run], after)
    # Errors of the components precede those of the runs.
    by_component, _ = read(None, noise=jnp.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(by_component[:, 0], [1.1, 2.2, 3.3], rtol=1e-15)

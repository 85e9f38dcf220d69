"""Inputs of a scene file that are given in Python: beside those of the file, or in their place."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace.core import InputError
from jaxspace.dispersion import ConeDirection, Normal, Uniform, disperse, open_store

SYSTEM = """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[system]
name = "two_body"
[initial]
position = ["7000 km", "0 km", "0 km"]
velocity = ["0 km/s", "7.5 km/s", "1 km/s"]
[times]
end = "10 min"
"""
SCENE = SYSTEM.replace('[system]\nname = "two_body"', "[effects.point_gravity]")
PHASE = '[[phase]]\nname = "coast"\neffects = ["point_gravity"]\nduration = "10 min"\n'
MISSION = SCENE.replace('[times]\nend = "10 min"\n', PHASE)
FILES = {"system": SYSTEM, "scene": SCENE, "mission": MISSION}
ONE = '"initial.velocity.1" = { deviation = "5 m/s" }'
DISPERSION = """
[dispersion]
sampling = "{sampling}"
outputs = ["final.position.0"]
[dispersion.inputs]
{one}
"initial.position.0" = {{ deviation = "{deviation}" }}
"""
MORE = """
"planet.mu" = { distribution = "uniform", low = 3.985e14, high = 3.987e14 }
"initial.position.2" = { deviation = "30 m" }
"""
IN_PYTHON = {
    "initial.position.0": Normal(7e6, 2e3),
    "planet.mu": Uniform(3.985e14, 3.987e14),
    "initial.position.2": {"deviation": "30 m"},
}
# Seconds of every program that was compiled or read from a folder.
COMPILED = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **more: (
        COMPILED.append(seconds) if event.endswith("backend_compile_duration") else None
    )
)
DIRECTION = '[[dispersion.direction]]\nof = "initial.velocity"\nwithin = "2 deg"\n'


def loaded(tmp_path, kind, *more, sampling="random", deviation="1 km"):
    text = FILES[kind] + DISPERSION.format(one=ONE, sampling=sampling, deviation=deviation)
    path = tmp_path / "scene.toml"
    path.write_text(text + "".join(more))
    return jaxspace.load(path)


@pytest.mark.parametrize(
    "kind, sampling", [("system", "random"), ("scene", "latin_hypercube"), ("mission", "sobol")]
)
def test_inputs_given_in_python_are_those_of_a_file(kind, sampling, tmp_path, key):
    """To the bit: what they are, and what is drawn of them."""
    here = loaded(tmp_path, kind, sampling=sampling).campaign(inputs=IN_PYTHON, runs=16)
    there = loaded(tmp_path, kind, MORE, sampling=sampling, deviation="2 km").campaign(runs=16)
    assert here.text() == there.text()
    assert (here.units, here.limits) == (there.units, there.limits)
    for name, x in here.samples(key, jnp.arange(16)).items():
        np.testing.assert_array_equal(x, there.samples(key, jnp.arange(16))[name])


def test_a_campaign_of_inputs_given_in_python(tmp_path):
    """It flies what it draws, and its store is another one than that of the file alone."""
    file, store = loaded(tmp_path, "system"), tmp_path / "s.zarr"
    campaign = file.campaign(inputs=IN_PYTHON)
    flown = disperse(campaign, 32, store=store, accuracy=1e-9)
    there = loaded(tmp_path, "system", MORE, deviation="2 km").campaign()
    expected = disperse(there, 32, accuracy=1e-9)
    name = "final.position.0"
    np.testing.assert_array_equal(flown.values(name), expected.values(name))
    assert np.ptp(open_store(store).inputs["planet.mu"]) > 0.0
    with pytest.raises(InputError, match="another campaign: the inputs"):
        disperse(file.campaign(), 32, store=store, accuracy=1e-9, resume=True)


def test_a_file_that_is_loaded_again_compiles_nothing(tmp_path):
    """Nor does the same file at another place; with another number it is another file."""
    here, there = tmp_path / "a", tmp_path / "b"
    here.mkdir()
    there.mkdir()
    first = loaded(here, "system")
    expected = disperse(first.campaign(), 16, accuracy=1e-9)
    before = len(COMPILED)
    again = loaded(there, "system")
    assert again == first and hash(again) == hash(first)
    found = disperse(again.campaign(), 16, accuracy=1e-9)
    assert before > 0 and len(COMPILED) == before
    np.testing.assert_array_equal(*(x.values("final.position.0") for x in (found, expected)))
    assert loaded(here, "system", deviation="2 km") != first


def test_a_direction_given_in_python(tmp_path, key):
    velocity = [f"initial.velocity.{k}" for k in range(3)]
    cone = ConeDirection(jnp.array([0.0, 7500.0, 1000.0]), np.deg2rad(2.0)).inputs(*velocity)
    text = loaded(tmp_path, "mission").text.replace(f"{ONE}\n", "")
    (tmp_path / "scene.toml").write_text(text + DIRECTION)
    file = jaxspace.load(tmp_path / "scene.toml")
    here = loaded(tmp_path, "mission").campaign(inputs=cone).samples(key, jnp.arange(8))
    there = file.campaign().samples(key, jnp.arange(8))
    for name in velocity:
        # An angle in degrees is converted by a factor that rounds.
        np.testing.assert_allclose(here[name], there[name], rtol=1e-14, atol=1e-10)
    with pytest.raises(
        InputError, match="is correlated with other inputs: initial.velocity.0, init"
    ):
        file.campaign(inputs={"initial.velocity.1": Normal(7500.0, 1.0)})


@pytest.mark.parametrize(
    "given, words",
    [
        (
            {"initial.positon.0": Normal(0.0, 1.0)},
            "inputs.initial.positon.0 is not a known number of this file: it must be one "
            "of initial.*, planet.*. Did you mean initial.position.0?",
        ),
        ({"planet.mass": Normal(0.0, 1.0)}, "it must be one of planet.mu, planet.radius"),
        ({"planet.mu": 4e14}, "inputs.planet.mu is 400000000000000.0: it must be a distribution"),
        ({"planet.mu": {"deviation": "1 m"}}, "inputs.planet.mu.deviation"),
        ({"planet.mu": {"deviaton": 1.0}}, "Did you mean deviation?"),
    ],
)
def test_a_wrong_input_is_named(given, words, tmp_path):
    with pytest.raises(InputError, match=re.escape(words)):
        loaded(tmp_path, "system").campaign(inputs=given)


def test_an_input_that_is_refused_too_often_is_a_warning(tmp_path):
    with pytest.warns(
        UserWarning, match="50 % of the runs will be rejected, because planet.radius"
    ):
        loaded(tmp_path, "system").campaign(inputs={"planet.radius": Uniform(-1.0, 1.0)})

"""Scene files: what is read, and in which words everything else is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from jaxspace.cli import load
from jaxspace.io import Quantity, SceneError

SCENES = Path(__file__).resolve().parents[1] / "examples" / "scenes"
KICK = (SCENES / "kick_stage.toml").read_text()
TWO_BODY = (SCENES / "two_body.toml").read_text()
TOP = (SCENES / "top.toml").read_text()


@pytest.fixture
def scene(tmp_path):
    """Loads a scene file from its text."""

    def loaded(text):
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return load(path)

    return loaded


LENGTH = Quantity("length", "m", "400 mi")
RATE = Quantity("angular rate", "rad/s", "5.5 rpm")
MASS = Quantity("mass", "kg", "60 kg", "positive")
ANGLE = Quantity("angle", "rad", "28.5 deg")
ISP = Quantity("specific impulse", "s", "286 s", "positive")
INERTIA = Quantity("moment of inertia", "kg m^2", "12 slug ft^2", "positive")
MU = Quantity("gravitational parameter", "m^3/s^2", "398600 km^3/s^2", "positive")
NUMBER = Quantity("a ratio", "", "0.01")


@pytest.mark.parametrize(
    "quantity, value, si",
    [
        (LENGTH, "400 mi", 400 * 1609.344),  # the statute mile of 1959
        (RATE, "5.5 rpm", 5.5 * math.pi / 30),
        (ISP, "286 s", 286.0),
        (MASS, "60 kg", 60.0),
        (MASS, 60, 60.0),
        (ANGLE, "28.5 deg", math.radians(28.5)),
        (ANGLE, 0.5, 0.5),
        (RATE, "1e-3 rad/s", 1e-3),
        (MU, "398600.4418 km^3/s^2", 3.986004418e14),
        (INERTIA, "1 slug ft^2", 14.593902937206364 * 0.3048**2),
        (NUMBER, "50 %", 0.5),
        (LENGTH, " -1.5e1 mm ", -0.015),
    ],
)
def test_values_with_units(quantity, value, si):
    assert quantity.read(value) == pytest.approx(si, rel=1e-12)  # rounding of a product


@pytest.mark.parametrize(
    "quantity, value",
    [
        (RATE, "60 kg"),
        (RATE, "1 Hz"),  # a cycle is 2 pi rad, and pint would take it for one
        (MASS, -1.0),
        (MASS, 0),
        (LENGTH, math.nan),
        (LENGTH, math.inf),
        (LENGTH, True),
        (LENGTH, None),
        (LENGTH, [1.0]),
        (LENGTH, "12 parrots"),
        (LENGTH, "m"),
        (LENGTH, ""),
        (LENGTH, "1 m; 2 m"),
        (LENGTH, "__import__('os')"),
        (LENGTH, "9**9**9 m"),
        (NUMBER, "3 m"),
    ],
)
def test_values_that_are_refused(quantity, value):
    with pytest.raises(ValueError) as refusal:
        quantity.read(value)
    assert quantity.example in str(refusal.value)


# A change of the kick stage, and what the message has to hold: the key, the value, what is allowed,
# the nearest name.
BAD = {
    "unknown_key": (
        "burn_time =",
        "burntime =",
        ["effects.thrust.burntime", "Did you mean burn_time?"],
    ),
    "unknown_effect_in_phase": (
        'effects = ["point_gravity", "oblateness", "thrust"',
        'effects = ["point_gravty", "oblateness", "thrust"',
        [
            "phase.0.effects.0",
            '"point_gravty"',
            "gravity_gradient, thrust, jet_damping",
            "Did you mean point_gravity?",
        ],
    ),
    "unknown_effect_table": (
        "[effects.jet_damping]",
        "[effects.jet_dampin]",
        ["jet_dampin", "Did you mean jet_damping?"],
    ),
    "unknown_table": ("[planet]", "[planett]", ["planett", "Did you mean planet?"]),
    "unknown_output": (
        '  "pointing",',
        '  "ponting",',
        ["dispersion.outputs.5", '"ponting"', "Did you mean pointing?"],
    ),
    "unknown_input": (
        '"body.dry_mass" =',
        '"body.dry_mas" =',
        ["dispersion.inputs.body.dry_mas", "Did you mean body.dry_mass?"],
    ),
    "unknown_distribution": (
        '"truncated_normal"',
        '"truncated"',
        [
            "dispersion.inputs.initial.omega.2.distribution",
            '"truncated"',
            "Did you mean truncated_normal?",
        ],
    ),
    "negative_mass": (
        'dry_mass = "1191 kg"',
        "dry_mass = -5.0",
        ["body.dry_mass is -5.0", "a positive number in kg"],
    ),
    "mass_for_a_rate": (
        '"60 rpm"]',
        '"60 kg"]',
        ["initial.omega.2", '"60 kg"', "angular rate", "rad/s"],
    ),
    "cycles_for_a_rate": ('"60 rpm"]', '"1 Hz"]', ["initial.omega.2", '"1 Hz"', "rad/s"]),
    "no_inertia": ('inertia = ["1031', '# inertia = ["1031', ["body.inertia is missing", "kg m^2"]),
    "no_j2": ("j2 = 1.08262668e-3", "", ["planet.j2 is missing", "the effect oblateness needs it"]),
    "no_impulse": (
        'total_impulse = "5.80 MN s"',
        "",
        ["effects.thrust.total_impulse is missing", "N s"],
    ),
    "no_attitude": ('along = "velocity"', "", ["initial.attitude", "along", "angles"]),
    "impossible_inertia": (
        '"521 kg m^2"]',
        '"5210 kg m^2"]',
        ["body.inertia", "5210", "sum of the other two"],
    ),
    "short_vector": (
        'tilt = ["0 deg", "0 deg"]',
        'tilt = ["0 deg"]',
        ["initial.attitude.tilt", "a list of 2 entries"],
    ),
    "number_for_a_vector": (
        'tilt = ["0 deg", "0 deg"]',
        "tilt = 0",
        ["initial.attitude.tilt is 0", "a list of 2 entries"],
    ),
    "no_end_of_phase": ('until = "burnout"', "", ["phase.0", "duration", "until", "burnout"]),
    "same_name": ('name = "coast"', 'name = "burn"', ["phase.1.name", '"burn"', "another name"]),
    "no_runs": ("runs = 10000", "runs = 0", ["dispersion.runs is 0", "above zero"]),
    "deviation_of_another_kind": (
        '{ deviation = "2 kg" }',
        '{ deviation = "2 s" }',
        ["body.dry_mass.deviation", '"2 s"', "kg"],
    ),
    "percentage_of_zero": (
        '0" = { deviation = "1 mm" }',
        '0" = { deviation = "1 %" }',
        ["thrust.offset.0.deviation", '"1 %"'],
    ),
    "empty_input": (
        '{ deviation = "2 kg" }',
        "{}",
        ["dispersion.inputs.body.dry_mass.deviation is missing"],
    ),
    "limits_turned": (
        'low = "56 rpm"',
        'low = "65 rpm"',
        ["dispersion.inputs.initial.omega.2.high", "above low"],
    ),
    "profile_descends": ("84.1]", "4.1]", ["effects.thrust.profile.times", "ascend"]),
    "no_toml": ("[planet]", "[planet", ["is not TOML", "line"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scenes_get_one_clear_line(scene, tmp_path, case):
    old, new, words = BAD[case]
    assert KICK.count(old) >= 1
    with pytest.raises(SceneError) as refusal:
        scene(KICK.replace(old, new, 1))
    message = str(refusal.value)
    assert message.startswith(str(tmp_path / "scene.toml") + ": ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    "text, words",
    [
        (
            TWO_BODY.replace('"two_body"', '"twobody"'),
            ["system.name", '"twobody"', "Did you mean two_body?"],
        ),
        (
            TWO_BODY.replace('name = "two_body"', ""),
            ["system.name is missing", "one of top, two_body"],
        ),
        (
            TWO_BODY.replace('mu = "398600.4418 km^3/s^2"', "mu = -1"),
            ["system.mu is -1", "positive"],
        ),
        (TWO_BODY.replace("radius =", "# radius ="), ["system.radius is missing"]),
        (
            TOP.replace("axial_inertia", "axial_inertias"),
            ["system.axial_inertias", "Did you mean axial_inertia?"],
        ),
        (TOP.replace('end = "2 s"', 'end = "2 m"'), ["times.end", '"2 m"']),
        (TOP + "\n[dispersion]\nruns = 3\n", ["dispersion is not a key"]),
    ],
)
def test_bad_systems_get_one_clear_line(scene, text, words):
    with pytest.raises(SceneError) as refusal:
        scene(text)
    assert "\n" not in str(refusal.value)
    for word in words:
        assert word in str(refusal.value)


def test_two_faults_get_two_lines(scene):
    text = KICK.replace('dry_mass = "1191 kg"', "dry_mass = -5.0").replace('"60 rpm"]', '"60 kg"]')
    with pytest.raises(SceneError) as refusal:
        scene(text)
    lines = str(refusal.value).splitlines()
    assert len(lines) == 2 and "body.dry_mass" in lines[0] and "initial.omega.2" in lines[1]


def test_a_file_that_is_not_there():
    with pytest.raises(SceneError, match="nowhere.toml: cannot be read"):
        load("nowhere.toml")


def test_dispersed_numbers_are_built_like_nominal_ones(scene):
    """The lanes of a batch whose samples are all nominal hold the nominal mission, number for
    number."""
    import jax

    file = scene(KICK)
    mission, y0 = file.nominal_mission()
    campaign = file.campaign(None)
    lanes, z0 = campaign.build(campaign.nominal(3))
    assert jax.tree.structure(lanes) == jax.tree.structure(mission)
    assert all(x.shape[-1] == 3 for x in jax.tree.leaves(z0))
    for one, many in zip(jax.tree.leaves((mission, y0)), jax.tree.leaves((lanes, z0)), strict=True):
        many = np.asarray(many)
        many = many if many.ndim == np.ndim(one) else many[..., 0]
        np.testing.assert_allclose(many, one, rtol=1e-14, atol=1e-14)


def test_percentages_and_units_of_deviations(scene):
    inputs = scene(KICK).inputs
    assert inputs["effects.thrust.total_impulse"] == (
        "normal",
        {"deviation": pytest.approx(0.0025 * 5.8e6)},
    )
    assert inputs["initial.attitude.tilt.0"] == (
        "normal",
        {"deviation": pytest.approx(math.radians(0.3))},
    )
    name, numbers = inputs["initial.omega.2"]
    assert name == "truncated_normal"
    assert numbers["low"] == pytest.approx(56 * math.pi / 30)


def test_inputs_may_be_nested_tables(scene):
    text = KICK.replace('"body.dry_mass" =', "body.dry_mass =")
    assert scene(text).inputs == scene(KICK).inputs


def test_tables_of_effects_follow_the_phases(scene):
    scenes = scene(KICK).scenes()
    assert [type(e).__name__ for e in scenes["burn"].effects] == [
        "PointGravity",
        "Oblateness",
        "Thrust",
        "JetDamping",
    ]
    assert [type(e).__name__ for e in scenes["coast"].effects] == ["PointGravity", "Oblateness"]
    assert scenes["coast"].parts == ("position", "velocity", "attitude", "omega", "mass")


def test_the_gravity_gradient_in_a_file(scene):
    """It reads the strength of the planet."""
    text = KICK.replace("[effects.thrust]", "[effects.gravity_gradient]\n\n[effects.thrust]")
    text = text.replace('["point_gravity", "oblateness"]', '["point_gravity", "gravity_gradient"]')
    effects = scene(text).scenes()["coast"].effects
    assert [type(e).__name__ for e in effects] == ["PointGravity", "GravityGradient"]
    assert effects[1].mu == effects[0].mu

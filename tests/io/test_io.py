"""Scene files: what is read, and in which words everything else is refused."""

import dataclasses
import json
import math
import re
import tomllib
import warnings
from pathlib import Path
from typing import ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxspace
from jaxspace import load
from jaxspace.bodies import AbstractEffect, AbstractJump, BodyState, Load
from jaxspace.core import AbstractSystem, Scalar, argument, event, output, quantity
from jaxspace.core.common_units import factor_to
from jaxspace.core.vectors import axis
from jaxspace.dispersion import AbstractDistribution
from jaxspace.io import SceneError
from jaxspace.io.units import expected, in_unit, read_number, units

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
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


LENGTH = argument("m", doc="a length")
RATE = argument("rad/s", doc="an angular rate")
MASS = argument("kg", positive=True, doc="a mass")
ANGLE = argument("rad", doc="an angle")
ISP = argument("s", positive=True, doc="a specific impulse")
INERTIA = argument("kg m^2", positive=True, doc="a moment of inertia")
MU = argument("m^3/s^2", positive=True, doc="a gravitational parameter")
NUMBER = argument("", doc="a ratio")
SHARE = argument("", low=0.0, high=1.0, doc="a share")


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
    assert read_number(value, quantity)[0] == pytest.approx(si, rel=1e-12)  # rounding of a product


@pytest.mark.parametrize(
    "si, text",
    [
        *(("m", x) for x in ("km", "cm", "mm", "mi")),
        *(("s", x) for x in ("ms", "min", "h", "d", "day")),
        *(("kg", x) for x in ("g", "t")),
        *(("N", x) for x in ("kN", "MN", "kg m/s^2")),
        *(("rad", x) for x in ("deg", "arcmin", "arcsec")),
        *(("rad/s", x) for x in ("rpm", "deg/s", "deg/day")),
        *(("m/s", x) for x in ("km/s", "km/h")),
        *(("", x) for x in ("%", "1", "deg", "rad")),
        ("Pa", "kPa"), ("N m", "kN m"), ("N s", "MN s"), ("m^3/s^2", "km^3/s^2"), ("1/s", "1/h"),
        ("kg m^2", "g cm^2"), ("kg/m^3", "g/cm^3"), ("m^2", "mm^2"), ("N/m", "kN/m"),
    ],
)  # fmt: skip
@given(number=st.floats(-1e9, 1e9, allow_subnormal=False))
def test_common_units_are_those_of_the_library(si, text, number):
    unit = units().parse_units(text)
    expected = units().Quantity(number, unit).to(si or "dimensionless").magnitude
    # The factors themselves are rounded, those of quotients twice.
    assert number * factor_to(si, text) == pytest.approx(expected, rel=5e-16, abs=0.0)


@pytest.mark.parametrize("si, text", [("m", "yd"), ("m", "s"), ("rad", "%"), ("m/s", "m/s/s")])
def test_other_units_are_left_to_the_library(si, text):
    assert factor_to(si, text) is None


def test_units_go_out_as_they_come_in():
    for declared, text in ((LENGTH, "400 mi"), (RATE, "5.5 rpm"), (MU, "3 km^3/s^2")):
        number, unit = read_number(text, declared)
        back = number * in_unit(declared.unit, unit)
        assert back == pytest.approx(float(text.split()[0]), rel=1e-14)  # two products, rounded


def test_a_unit_of_the_file_belongs_to_its_key(scene):
    """A tangent given in degrees turns no eccentricity into degrees: pure numbers are no kind. A
    key has the unit of its own, and others the first one of their kind."""
    text = KICK.replace("misalignment = [0.0, 0.0]", 'misalignment = ["0.1 deg", "1 %"]')
    wanted = '"inclination", "eccentricity", "final.omega.0", "argument_of_periapsis", "altitude"'
    text = text.replace('  "cone_angle",', f"  {wanted},").replace('  "inclination",\n', "", 1)
    text = text.replace('lead = "2.9 deg"', 'lead = "50 mrad"').replace("28.5 deg", "1710 arcmin")
    text = text.replace('["0 deg/s", "0 deg/s", "60 rpm"]', '[0.0, "0 deg/s", "60 rpm"]')
    file = scene(text)
    units = {spec.name: (spec.unit, spec.factor) for spec in file.outputs}
    assert units["eccentricity"] == ("", 1.0)
    assert units["final.omega.0"][0] == "deg/s"
    assert units["argument_of_periapsis"][0] == "deg" and units["inclination"][0] == "arcmin"
    assert units["pointing"][0] == "arcmin" and units["altitude"][0] == "km"
    assert file.units.of("misalignment", "") == "deg"


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
        (SHARE, 1.5),
        (SHARE, "-1 %"),
    ],
)
def test_values_that_are_refused(quantity, value):
    with pytest.raises(ValueError) as refusal:
        read_number(value, quantity)
    assert expected(quantity) in str(refusal.value)


@pytest.mark.parametrize("degrees", [28.5, -180, 7])
def test_an_angle_of_more_than_a_turn_needs_its_unit(degrees):
    with pytest.raises(ValueError, match=f'"{degrees:g} deg" or "{degrees:g} rad"'):
        read_number(degrees, ANGLE)
    assert read_number(f"{degrees} deg", ANGLE)[0] == pytest.approx(math.radians(degrees))
    assert read_number(f"{degrees} rad", ANGLE)[0] == degrees


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
            "gravity_gradient, ",
            "jet_damping, ",
            "steered_thrust, ",
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
    "no_j2": (
        "j2 = 1.08262668e-3",
        "",
        ["planet.j2 is missing", "the effect oblateness requires it"],
    ),
    "no_impulse": (
        'total_impulse = "5.80 MN s"',
        "",
        ["effects.thrust.total_impulse is missing", "N s"],
    ),
    "no_attitude": ('along = "velocity"', "", ["initial.attitude.along is missing", "give angles"]),
    "angle_without_unit": (
        'inclination = "28.5 deg"',
        "inclination = 28.5",
        ["initial.orbit.inclination is 28.5", "more than a turn", '"28.5 deg"'],
    ),
    "unknown_method": (
        "accuracy = 3e-7",
        'method = "DOP854"',
        ["method", '"DOP854"', "Did you mean DOP853?"],
    ),
    "no_room_for_steps": ("accuracy = 3e-7", "max_steps = 0", ["max_steps is 0", "above zero"]),
    "negative_step": ("accuracy = 3e-7", 'max_step = "-1 s"', ["max_step", "positive", "in s"]),
    "unknown_place": (
        '"speed_error", at = "burn"',
        '"speed_error", at = "brun"',
        ["dispersion.outputs.3.at", "final, burn, coast", "Did you mean burn?"],
    ),
    "unit_of_another_kind": (
        'unit = "rpm"',
        'unit = "km"',
        ["dispersion.outputs.6.unit", '"km"', "a unit of angular rate"],
    ),
    "path_of_an_output": (
        '"cone_angle"',
        '"final.omga.2"',
        ["final.omga.2", "attitude, mass, omega, position, velocity", "Did you mean omega?"],
    ),
    "index_of_an_output": ('"cone_angle"', '"final.omega.3"', ["final.omega.3", "0 to 2"]),
    "no_motor": (
        '"oblateness", "thrust", "jet_damping"]',
        '"oblateness"]',
        ["phase.0.until", "burnout", "no effect of this phase defines that time"],
    ),
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
    "same_name": (
        'name = "coast"',
        'name = "burn"',
        ["phase.1.name", '"burn"', "not used by an earlier phase"],
    ),
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
            ["system.name is missing", "two_body, "],
        ),
        (
            TWO_BODY.replace('mu = "398600.4418 km^3/s^2"', "mu = -1"),
            ["planet.mu is -1", "positive"],
        ),
        (
            TWO_BODY.replace("radius =", "# radius ="),
            ["planet.radius is missing", "initial.orbit requires it"],
        ),
        (
            TWO_BODY.replace("mu =", "# mu ="),
            ["planet.mu is missing", "system requires it"],
        ),
        (
            TWO_BODY.replace("[initial.orbit]", "[initial]\nomega = [0, 0, 1]\n[initial.orbit]"),
            ["initial has omega but not attitude"],
        ),
        (
            TWO_BODY + "[initial.attitude]\nangles = [0, 0, 0]\n[initial]\nomega = [0, 0, 1]\n",
            ["initial has attitude, which TwoBody does not change"],
        ),
        (
            TOP.replace("axial_inertia", "axial_inertias"),
            ["system.axial_inertias", "Did you mean axial_inertia?"],
        ),
        (TOP.replace('end = "2 s"', 'end = "2 m"'), ["times.end", '"2 m"']),
        (
            TOP + "\n[dispersion]\noutputs = ['pointing']\n[dispersion.inputs]\n"
            "'system.axial_inertia' = { deviation = '1 %' }\n",
            ["has no body"],
        ),
    ],
)
def test_bad_systems_get_one_clear_line(scene, text, words):
    with pytest.raises(SceneError) as refusal:
        scene(text)
    assert "\n" not in str(refusal.value)
    for word in words:
        assert word in str(refusal.value)


def test_an_effect_that_refers_to_another_one_needs_it(scene):
    text = KICK.replace(
        '"thrust", "jet_damping"]\nuntil = "burnout"', '"jet_damping"]\nduration = 9'
    )
    with pytest.raises(
        SceneError, match=r"jet_damping requires .* mass rate .* one of steered_thrust"
    ):
        scene(text)


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
    """The runs of a batch whose samples are all nominal hold the nominal mission, number for
    number."""
    file = scene(KICK)
    samples = {path: jnp.full(3, float(how.nominal)) for path, how in file.inputs.items()}
    runs, z0 = file.build(samples)
    assert jax.tree.structure(runs) == jax.tree.structure(file.mission)
    assert all(x.shape[-1] == 3 for x in jax.tree.leaves(z0))
    pairs = zip(jax.tree.leaves((file.mission, file.y0)), jax.tree.leaves((runs, z0)), strict=True)
    for one, many in pairs:
        many = np.asarray(many)
        many = many if many.ndim == np.ndim(one) else many[..., 0]
        np.testing.assert_allclose(many, one, rtol=1e-14, atol=1e-14)


def test_percentages_and_units_of_deviations(scene):
    inputs = scene(KICK).inputs
    impulse = inputs["effects.thrust.total_impulse"]
    assert impulse.name == "normal"
    assert impulse.numbers == {"mean": 5.8e6, "deviation": pytest.approx(0.0025 * 5.8e6)}
    tilt = inputs["initial.attitude.tilt.0"]
    assert tilt.numbers == {"mean": 0.0, "deviation": pytest.approx(math.radians(0.3))}
    spin = inputs["initial.omega.2"]
    assert spin.name == "truncated_normal"
    assert spin.numbers["low"] == pytest.approx(56 * math.pi / 30)


def test_inputs_may_be_nested_tables(scene):
    text = KICK.replace('"body.dry_mass" =', "body.dry_mass =")
    assert scene(text).inputs.keys() == scene(KICK).inputs.keys()


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


# ---------------------------------------------------------------- what an author adds


@final
class DampedState(eqx.Module):
    """A mass on a spring."""

    x: Scalar = quantity("m", doc="displacement")
    v: Scalar = quantity("m/s", doc="its rate")


@final
class DampedSpring(AbstractSystem):
    """A mass on a damped spring."""

    stiffness: Scalar = quantity("1/s^2", positive=True, doc="over the mass")
    damping: Scalar = quantity("1/s", non_negative=True, default=0.0, doc="over the mass")

    def vector_field(self, t, y: DampedState) -> DampedState:
        return DampedState(y.v, -self.stiffness * y.x - self.damping * y.v)

    def invariants(self, t, y: DampedState):
        return {}


@output("m^2/s^2")
def spring_energy(y: DampedState) -> Scalar:
    """Kinetic energy per unit mass."""
    return 0.5 * y.v**2


@final
class Drift(AbstractEffect):
    """A constant acceleration along x."""

    size: Scalar = quantity("m/s^2", doc="of the acceleration")

    def load(self, t, y, body):
        return Load(acceleration_N=self.size * axis(0, y.position[0]))


SPRING = """
[system]
name = "damped_spring"
stiffness = "4 1/s^2"

[initial]
x = "3 cm"

[times]
end = "1 s"

[dispersion]
outputs = ["final.x", "spring_energy"]

[dispersion.inputs]
"initial.x" = { deviation = "1 mm" }
"system.damping" = { distribution = "uniform", low = 0.0, high = "0.1 1/s" }
"""
DRIFT = """
[effects.drift]
size = "2 m/s^2"

[initial]
position = [0.0, 0.0, 0.0]
velocity = ["1 km/s", 0.0, 0.0]

[times]
end = "10 s"
"""


def test_a_system_defined_here_runs_from_a_file(tmp_path):
    """x = 3 cm cos(2 t) after 1 s, to a thousand times the tolerance of a step."""
    path = tmp_path / "spring.toml"
    path.write_text(SPRING.replace('x = "3 cm"', 'x = "3 cm"\nv = 0.0'))
    with pytest.raises(SceneError, match="damped_spring.*is not a known system"):
        load(path)
    file = load(path, also=[DampedSpring, spring_energy])
    run = file.simulate()
    assert float(run.final.x) == pytest.approx(0.03 * math.cos(2.0), rel=1e-6)
    assert [(o.name, o.unit) for o in file.outputs] == [
        ("final.x", "cm"),
        ("spring_energy", "m^2/s^2"),
    ]
    nominal = file.nominal_outputs(run)
    assert nominal["final.x"] == (pytest.approx(3.0 * math.cos(2.0), rel=1e-6), "cm")
    energy = 0.5 * (0.06 * math.sin(2.0)) ** 2
    assert nominal["spring_energy"][0] == pytest.approx(energy, rel=1e-6)


def test_an_effect_defined_here_runs_from_a_file(tmp_path):
    """1 km/s * 10 s + 2 m/s^2 * (10 s)^2 / 2: a polynomial, exact for the integrator."""
    path = tmp_path / "drift.toml"
    path.write_text(DRIFT)
    run = load(path, also=[Drift]).simulate()
    assert float(run.final.position[0]) == pytest.approx(10100.0, rel=1e-12)


@event("m", direction=1, needs=("position",))
def line(t, y: BodyState) -> Scalar:
    """The distance behind a line at 5 km."""
    return y.position[0] - 5000.0


@final
class Kick(AbstractJump):
    """A change of the speed along x."""

    speed: Scalar = quantity("m/s", doc="that is added")
    needs: ClassVar[frozenset[str]] = frozenset({"velocity"})

    def __call__(self, t, y):
        kick = self.speed * axis(0, y.velocity[0])
        return dataclasses.replace(y, velocity=y.velocity + kick)


@final
class Steps(AbstractDistribution):
    """Either of two values that lie symmetric to a mean."""

    mean: Scalar = quantity("", doc="of both")
    half_width: Scalar = quantity("", positive=True, doc="distance of both from the mean")

    @property
    def deviation(self):
        return self.half_width

    def sample(self, key):
        return self.mean + self.half_width * jax.random.rademacher(key, (), float)

    def from_normal(self, z):
        return self.mean + self.half_width * jnp.sign(z)

    def outside(self, low, high):
        ends = (float(self.mean - self.half_width), float(self.mean + self.half_width))
        return 0.5 * sum(not low <= x <= high for x in ends)

    def text(self):
        return f"{float(self.mean):g} +- {float(self.half_width):g}"


LINE = """
[effects.drift]
size = "2 m/s^2"

[initial]
position = [0.0, 0.0, 0.0]
velocity = ["1 km/s", 0.0, 0.0]

[[phase]]
name = "approach"
effects = ["drift"]
until = "line"
within = "10 s"
jump.kick.speed = "0.3 km/s"

[[phase]]
name = "beyond"
effects = ["drift"]
duration = "1 s"

[dispersion]
outputs = ["final.position.0"]

[dispersion.inputs]
"phase.0.jump.kick.speed" = { distribution = "steps", mean = "0.3 km/s", half_width = "0.1 km/s" }
"""


def test_an_event_a_jump_and_a_distribution_defined_here_run_from_a_file(tmp_path):
    """v = sqrt((1 km/s)^2 + 2 (2 m/s^2) 5 km) at the line, and then 5 km + (v + kick) 1 s + 1 m."""
    path = tmp_path / "line.toml"
    path.write_text(LINE)
    also = [Drift, line, Kick, Steps]
    file = load(path, also=also)
    speed = math.sqrt(1e6 + 20e3)
    end = 5001.0 + speed + 300.0
    assert float(file.simulate().final.position[0]) == pytest.approx(end, rel=1e-9)
    drawn = file.campaign().inputs["phase.0.jump.kick.speed"]
    assert isinstance(drawn, Steps) and float(drawn.half_width) == 100.0
    assert drawn.text() == "300 +- 100"
    text = jaxspace.io.listing(also=also)
    for words in ("  line [m]", "  kick: A change of", "speed [m/s]: that is added", "  steps: "):
        assert words in text


def test_what_is_added_is_listed_and_in_the_schema():
    text = jaxspace.io.listing(also=[DampedSpring, Drift])
    assert (
        "  damped_spring: A mass on a damped spring\n    stiffness [1/s^2]: over the mass" in text
    )
    assert "    size [m/s^2]: of the acceleration" in text
    assert "damped_spring" in json.dumps(jaxspace.io.schema(also=[DampedSpring]))
    with pytest.raises(jaxspace.core.InputError, match="also contains"):
        jaxspace.io.catalog(also=[int])


def test_the_schema_accepts_what_is_read_and_refuses_what_is_not():
    schema = jaxspace.io.schema()
    assert fits(tomllib.loads(KICK), schema)
    # Two engines of one kind, and phases that name them.
    two = (SCENES / "launch.toml").read_text()
    for text in (TOP, TWO_BODY, two):
        assert fits(tomllib.loads(text), schema)
    assert not fits(tomllib.loads(two.replace("steered_thrust_2", "steered_thrust_two")), schema)
    for case in ("unknown_key", "unknown_table", "no_impulse", "short_vector", "no_runs"):
        old, new, _ = BAD[case]
        assert not fits(tomllib.loads(KICK.replace(old, new, 1)), schema), case


def fits(value, schema) -> bool:
    """Whether a value satisfies the part of JSON schema that the files use."""
    if "anyOf" in schema:
        return any(fits(value, one) for one in schema["anyOf"])
    if "enum" in schema:
        return value in schema["enum"]
    kind = schema.get("type")
    if not schema:
        return True
    if kind == "object":
        known = dict(schema.get("properties", {}))
        for pattern, one in schema.get("patternProperties", {}).items():
            known |= {key: one for key in value if re.search(pattern, key)}
        strange = schema.get("additionalProperties", True) is False and set(value) - set(known)
        return (
            isinstance(value, dict)
            and not strange
            and set(schema.get("required", ())) <= set(value)
            and all(fits(v, known[k]) for k, v in value.items() if k in known)
        )
    if kind == "array":
        least, most = schema.get("minItems", 0), schema.get("maxItems", math.inf)
        return (
            isinstance(value, list)
            and least <= len(value) <= most
            and all(fits(v, schema["items"]) for v in value)
        )
    if kind == "string":
        return isinstance(value, str) and bool(re.search(schema.get("pattern", ""), value))
    above = value > schema.get("exclusiveMinimum", -math.inf) if is_number(value) else False
    return above and value >= schema.get("minimum", -math.inf)


def is_number(value) -> bool:
    """Whether a value is a number in JSON."""
    return isinstance(value, int | float) and not isinstance(value, bool)


# ---------------------------------------------------------------- what is refused or doubted


def test_a_run_with_an_input_out_of_its_range_is_not_allowed(scene):
    text = KICK.replace('"body.dry_mass" = { deviation = "2 kg" }', "")
    text += '"initial.orbit.eccentricity" = { deviation = 0.01 }\n'
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        campaign = scene(text.replace(COMPARING, "")).campaign()
    samples = {name: jnp.full(3, d.mean) for name, d in campaign.inputs.items()}
    samples["initial.orbit.eccentricity"] = jnp.array([0.0, -0.001, 0.2])
    assert eqx.filter_jit(campaign.allowed)(samples).tolist() == [True, False, True]
    one = {name: x[1] for name, x in samples.items()}
    assert campaign.refusal(one) == (
        "initial.orbit.eccentricity is -0.001: it must be zero or positive, and finite."
    )


COMPARING = """  { output = "speed_error", at = "burn" },
  { output = "velocity_error", at = "burn" },
"""


@pytest.mark.parametrize(
    "entry, words",
    [
        ("eccentricity = { deviation = 0.01 }", ["50 % of the runs", "zero or positive"]),
        (
            'inclination = { distribution = "uniform", low = "30 deg", high = "31 deg" }',
            ["ranges from 30 to 31 deg, without the nominal value 28.5."],
        ),
    ],
)
def test_what_is_hardly_meant_is_a_warning(scene, entry, words):
    text = KICK.replace(COMPARING, "").replace(
        "[dispersion.inputs]", f"[dispersion.inputs]\ninitial.orbit.{entry}"
    )
    file = scene(text)
    assert len(file.warnings) == 1
    with pytest.warns(UserWarning) as told:
        file.campaign()
    for word in words:
        assert word in str(told[0].message)


def test_how_to_integrate_is_told_in_the_file(scene):
    text = KICK.replace("accuracy = 3e-7", 'accuracy = 1e-8\nmax_step = "2 s"\nmax_steps = 500')
    accuracy = scene(text + "").accuracy
    assert (float(accuracy.rtol), float(accuracy.max_step), accuracy.max_steps) == (
        pytest.approx(1e-8),
        2.0,
        500,
    )
    assert accuracy.method == "auto"
    equal = TWO_BODY.replace("[system]", 'method = { name = "Stormer", steps = 400 }\n[system]')
    method = scene(equal).accuracy.method
    assert (type(method).__name__, method.steps) == ("Stormer", 400)


def test_an_inertia_may_be_a_tensor(scene):
    text = """
[system]
name = "torque_free_body"
inertia = [["3 kg m^2", 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 1.5]]
[initial]
omega = ["5 rpm", 0.0, 0.1]
[initial.attitude]
angles = [0.0, 0.0, 0.0]
[times]
end = "10 s"
"""
    file = scene(text)
    np.testing.assert_array_equal(
        file.system.inertia.tensor, [[3.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 1.5]]
    )
    with pytest.raises(SceneError, match="system.inertia is .*: it must be symmetric"):
        scene(text.replace("[0.1, 2.0, 0.0]", "[0.2, 2.0, 0.0]"))

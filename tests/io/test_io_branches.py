"""Scene files whose missions part, against throws in closed form and a mission built in Python."""

import functools
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import BodyState, Event, Mission, Phase, Scene, Status, simulate_mission
from jaxspace.bodies import Detached, RigidBody
from jaxspace.bodies.parting import release
from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.core import InputError
from jaxspace.core.vectors import cross
from jaxspace.dispersion import disperse
from jaxspace.io import SceneError, listing, load
from jaxspace.io._search.task import search_of
from jaxspace.io.reports.run import mission_report
from jaxspace.orbits import UniformGravity
from jaxspace.orbits.uniform_gravity import touchdown
from jaxspace.rotations import Quaternion
from jaxspace.simulation.legs import legs_of
from jaxspace.vehicles.air_drag import descent_rate

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
G = 9.81
FILE = """
title = "A throw that parts"
accuracy = 1e-9
method = "Tsit5"

[body]
mass = "100 kg"

[effects.uniform_gravity]
acceleration = [0.0, 0.0, -9.81]

[initial]
position = ["0 m", "0 m", "0 m"]
velocity = ["1 m/s", "0 m/s", "120 m/s"]

[[phase]]
name = "ascent"
effects = ["uniform_gravity"]
duration = "5 s"

[[phase]]
name = "coast"
effects = ["uniform_gravity"]
duration = "4 s"

[branch.booster]
after = "ascent"
body.mass = "60 kg"
offset = ["0 m", "0 m", "-3 m"]
kick = ["0 m/s", "0 m/s", "-5 m/s"]

[[branch.booster.phase]]
name = "up"
effects = ["uniform_gravity"]
duration = "2 s"

[[branch.booster.phase]]
name = "fall"
effects = ["uniform_gravity"]
until = "touchdown"
within = "60 s"

[branch.cap]
after = "booster.up"
body.mass = "10 kg"
kick = ["0 m/s", "3 m/s", "0 m/s"]

[[branch.cap.phase]]
name = "fall"
effects = ["uniform_gravity"]
duration = "3 s"
"""
CAMPAIGN = """
[dispersion]
runs = 32
seed = 1
outputs = [
  { output = "final.position.2", name = "sustainer" },
  "booster.final.position.0",
  "booster.up.position.2",
  { output = "booster.cap.final.position.1", name = "cap" },
  { output = "speed", at = "booster.fall", name = "impact" },
  { output = "end_time", at = "booster.final", name = "down" },
  { output = "booster.run.position.2", take = "greatest", name = "top" },
]

[dispersion.inputs]
"initial.velocity.2" = { deviation = "2 m/s" }
"branch.booster.kick.2" = { deviation = "0.5 m/s" }
"branch.booster.body.mass" = { deviation = "1 kg" }
"""
INPUTS = ("initial.velocity.2", "branch.booster.kick.2", "branch.booster.body.mass")


def loaded(text):
    return load("throw.toml", text=text)


@functools.cache
def parted():
    return loaded(FILE + CAMPAIGN)


def by_hand(speed, kick, mass):
    """The outputs of `CAMPAIGN`: of two parts that leave 5 s after the throw, and of a third."""
    share, h, v = mass / 100.0, speed * 5.0 - 12.5 * G, speed - 5.0 * G
    z, w = h - 3.0 * (1.0 - share), v + kick * (1.0 - share)
    up = z + 2.0 * w - 2.0 * G
    # The cap leaves without an offset, across the path.
    top, down = w - 2.0 * G, 2.0 * G
    fall = (top + jnp.sqrt(top * top + 2.0 * G * up)) / G
    across = 10.0 / mass * 3.0
    return {
        "sustainer": h + 3.0 * share + 4.0 * (v - kick * share) - 8.0 * G,
        "booster.final.position.0": 7.0 + fall,
        "booster.up.position.2": up,
        "cap": 3.0 * (3.0 - across),
        "impact": jnp.sqrt(1.0 + across**2 + top * top + 2.0 * G * up),
        "down": 7.0 + fall + 0.0 * down,
        "top": z + w * w / (2.0 * G),
    }


def test_a_file_flies_as_the_mission_built_in_python():
    file = parted()
    pull = UniformGravity([0.0, 0.0, -G])

    def fall(mass):
        return Scene([pull], RigidBody(mass), ("position", "velocity", "mass"))

    def part(mass, share, offset, kick):
        return Detached(mass, share * jnp.array(offset), share * jnp.array(kick))

    # Each part moves by the share of what stays behind, and what is left against it.
    cap = Mission([Phase(fall(10.0), 3.0, name="fall")],
                  part(10.0, 5.0 / 6.0, [0.0, 0.0, 0.0], [0.0, 3.0, 0.0]), "cap")  # fmt: skip
    without = part(50.0, -1.0 / 6.0, [0.0, 0.0, 0.0], [0.0, 3.0, 0.0])
    ground = Event(touchdown, -1, within=60.0)
    booster = Mission(
        [Phase(fall(60.0), 2.0, without, "up", cap), Phase(fall(60.0), ground, name="fall")],
        part(60.0, 0.4, [0.0, 0.0, -3.0], [0.0, 0.0, -5.0]),
        "booster",
    )
    rest = part(40.0, -0.6, [0.0, 0.0, -3.0], [0.0, 0.0, -5.0])
    mission = Mission([
        Phase(fall(100.0), 5.0, rest, "ascent", booster), Phase(fall(100.0), 4.0, name="coast"),
    ])  # fmt: skip
    y0 = BodyState(jnp.zeros(3), jnp.array([1.0, 0.0, 120.0]), mass=jnp.array(100.0))
    expected = simulate_mission(mission, y0, accuracy=file.accuracy)
    run = file.simulate()
    assert run.names == expected.names == tuple(leg.name for leg in file.parsed.legs)
    assert run.branch_names == ("booster", "booster.cap")
    assert [line.name for line in file.parsed.lines[1:]] == list(run.branch_names)
    for name, phase in run.items():
        assert_allclose(phase.final.position, expected[name].final.position, atol=1e-9)
        assert_allclose(phase.final.velocity, expected[name].final.velocity, atol=1e-9)
        assert_allclose(phase.final.mass, expected[name].final.mass, rtol=1e-14)
    # At the parting, and later: one centre of mass falls freely.
    masses = (run["coast"].initial.mass, run["booster.up"].initial.mass)
    assert_allclose(sum(masses), 100.0)
    for field in ("position", "velocity"):
        parts = (getattr(run["coast"].initial, field), getattr(run["booster.up"].initial, field))
        mean = sum(m * x for m, x in zip(masses, parts, strict=True)) / 100.0
        assert_allclose(mean, getattr(run["ascent"].final, field), atol=1e-12)
    text = mission_report(file, run, expected)
    assert "booster.cap.fall: from" in text and "at the end of booster.cap, after its" in text
    assert list(file.scenes()) == list(run.names)


def test_a_campaign_has_outputs_of_all_parts():
    file = parted()
    found = disperse(file.campaign(), file.runs, seed=file.seed)
    exact = by_hand(*(jnp.asarray(found.inputs[name]) for name in INPUTS))
    # The end of the fall is known to 1e-9 of the time that is searched.
    for name, values in exact.items():
        assert_allclose(found.outputs[name], values, rtol=1e-7, err_msg=name)
    assert found.good.all() and np.ptp(found.outputs["top"]) > 10.0


SEARCH = """
[optimize]
maximise = "final.position.2"
steps = 4
[optimize.free]
"initial.velocity.2" = { low = "80 m/s", high = "160 m/s" }
"branch.booster.kick.2" = { low = "-9 m/s", high = "-1 m/s" }
[[optimize.constraint]]
output = "end_time"
at = "booster.final"
equal = "20 s"
"""


def test_a_search_sees_the_ends_of_branches():
    """The greatest height of the sustainer where the booster comes down at 20 s: the speed of the
    throw and the kick of the springs are free, and the springs push as hard as they may."""
    file = loaded(FILE + SEARCH)
    assert file.task is not None
    best = file.optimize()
    speed, kick = (best.values[name] for name in INPUTS[:2])
    exact = {name: float(x) for name, x in by_hand(speed, kick, 60.0).items()}
    assert best.converged and kick == pytest.approx(-9.0, abs=1e-6)
    assert exact["down"] == pytest.approx(20.0, abs=1e-6)
    assert best.objective == pytest.approx(exact["sustainer"], rel=1e-6)


def test_derivatives_pass_through_the_parting_of_a_file():
    """In both modes, of the outputs of the search, whose run is that of `simulate_compact`."""
    file = loaded(FILE + SEARCH)
    paths = INPUTS[:2]

    def flown(x):
        found = search_of(file, file.task, 4)(dict(zip(paths, x, strict=True)))
        return jnp.append(found.equal_zero, -found.objective)

    def exact(x):
        found = by_hand(*x, 60.0)
        return jnp.stack([found["down"] - 20.0, found["sustainer"]])

    # One weight for each output and input: both modes show an error in any derivative.
    weights, change = jnp.array([1.0, 0.7]), jnp.array([1.0, -0.4])

    @jax.jit
    def both(x):
        value, tangent = jax.jvp(flown, (x,), (change,))
        return value, tangent, jax.vjp(flown, x)[1](weights)[0]

    x = jnp.array([120.0, -5.0])
    value, tangent, gradient = both(x)
    slopes = jax.jacfwd(exact)(x)
    assert_allclose(value, exact(x), rtol=1e-12)
    assert_allclose(tangent, slopes @ change, rtol=1e-12)
    assert_allclose(gradient, weights @ slopes, rtol=1e-12)


def test_parts_that_are_released_keep_the_momentum():
    """Of two runs of a body that turns, whose mass is that of its state."""
    offset, kick = jnp.array([0.1, -0.2, -3.0]), jnp.array([0.05, -0.1, -1.5])
    parts = (Detached(60.0, offset, kick), Detached(5.0, [0.3, 0.0, 1.0], [0.0, 0.0, 0.0]))
    turn = Quaternion.from_rotation_vector(jnp.array([[0.3, 0.1], [-0.2, 0.4], [0.9, -1.0]]))
    vectors = jnp.array([[1.0, -2.0], [2.0, 0.5], [-1.0, 3.0]])
    y = BodyState(vectors, 3.0 * vectors, turn, 0.1 * vectors, jnp.array([100.0, 80.0]))
    rest, starts = release(*parts)
    after = jax.jit(lambda y: [jump(0.0, y) for jump in (rest, *starts)])(y)
    assert_allclose(sum(part.mass for part in after), y.mass, rtol=1e-15)
    for field in ("position", "velocity"):
        mean = sum(part.mass * getattr(part, field) for part in after) / y.mass
        assert_allclose(mean, getattr(y, field), rtol=1e-13)
    apart = after[1].position - after[0].position
    assert_allclose(turn.rotate_back(apart), offset[:, None] + 0.0 * vectors, atol=1e-13)
    assert starts[0].as_point()(0.0, y).attitude is None
    with pytest.raises(InputError, match="must have a mass"):
        rest(0.0, BodyState(vectors, vectors))
    with pytest.raises(InputError, match="release got no parts"):
        release()


def test_a_body_that_turns_leaves_a_point():
    """A branch without inertia has no attitude; one with inertia, and a phase with mass properties
    of its own, go on turning."""
    text = FILE.split("[branch.booster]")[0]
    text = text.replace(
        'mass = "100 kg"\n',
        'mass = "100 kg"\ninertia = ["2 kg m^2", "2 kg m^2", "1 kg m^2"]\n',
    ).replace(
        '"120 m/s"]\n', '"120 m/s"]\nattitude.angles = [0.3, 0.4, 0.5]\nomega = [0.2, 0, 1]\n'
    )
    body = '{ mass = "10 kg", inertia = [1.0, 1.0, 2.0] }'
    text = text.replace('name = "coast"', f'name = "coast"\nbody = {body}')
    for name, made in (("cap", body), ("stone", '{ mass = "1 kg" }')):
        text += f"""
[branch.{name}]
after = "ascent"
body = {made}
[[branch.{name}.phase]]
name = "fall"
effects = ["uniform_gravity"]
duration = "3 s"
"""
    run = loaded(text).simulate()
    assert run["stone"].final.attitude is None and run.branch_names == ("cap", "stone")
    # The transverse rate turns about the axis by (C - A)/A omega_z (Thomson 5.8).
    for name, ratio, span in (("ascent", -0.5, 5.0), ("coast", 1.0, 4.0), ("cap.fall", 1.0, 3.0)):
        start, end = run[name].initial.omega, run[name].final.omega
        assert_allclose(end[2], 1.0, rtol=1e-12)
        turned = jnp.arctan2(end[1], end[0]) - jnp.arctan2(start[1], start[0])
        assert_allclose(jnp.cos(turned), jnp.cos(ratio * span), atol=1e-7)


def test_names_are_listed_and_numbers_have_the_order_of_the_result():
    names = tuple(leg.name for leg in legs_of(parted().mission)[0])
    assert names == ("ascent", "coast", "booster.up", "booster.fall", "booster.cap.fall")
    text = listing(word="branches of a mission")
    assert "branch.NAME" in text and "after: name of the phase at whose end" in text
    assert tomllib.loads(FILE)["branch"]["booster"]["after"] == "ascent"


BAD = {
    ('after = "ascent"', 'after = "acsent"'): (
        'branch.booster.after = "acsent" is not a known phase: it must be one of ascent, '
        "coast. Did you mean ascent?"
    ),
    ('after = "ascent"', 'after = "coast"'): (
        'branch.booster.after is "coast": it must be a phase that is followed by another one, '
        "which continues with the remaining body."
    ),
    ('after = "booster.up"', 'after = "cap.fall"'): (
        'branch.cap.after = "cap.fall" is not a known phase: it must be one of ascent, '
        "coast, booster.up, booster.fall."
    ),
    ('body.mass = "60 kg"', 'body.mass = "160 kg"'): (
        "160 kg leave as branch.booster: they must be less than the 100 kg of body."
    ),
    ('body.mass = "60 kg"\n', ""): "branch.booster.body is missing",
    ('body.mass = "60 kg"', "body = {}"): (
        "branch.booster.body.mass is missing: it must be a positive number in kg or text with a "
        'unit of mass, such as "60 kg"; branch.booster separates with a part of it.'
    ),
    ('[body]\nmass = "100 kg"', "[body]"): "body.mass is missing",
    ('body.mass = "60 kg"', 'body.mass = "60 kg"\nkik = 1'): (
        "branch.booster.kik is not a known key: it must be one of after, body, offset, "
        "kick, phase. Did you mean kick?"
    ),
    ('kick = ["0 m/s", "0 m/s", "-5 m/s"]', 'kick = "5 m/s"'): (
        'branch.booster.kick is "5 m/s": it must be a list of 3 entries'
    ),
    ("[branch.cap]", '[branch."a.b"]'): 'branch is "a.b": it must be a name',
    ('name = "coast"', 'name = "booster"'): (
        'branch is "booster": it must be a name other than ascent, booster, final, run.'
    ),
    ('"touchdown"', '"tuchdown"'): "branch.booster.phase.1.until is",
    ('name = "fall"', 'name = "up"'): (
        'branch.booster.phase.1.name is "up": it must be a name not used by an earlier phase'
    ),
    ('"booster.final.position.0"', '"boster.final.position.0"'): "Did you mean booster.final",
    ('at = "booster.fall"', 'at = "booster.fal"'): (
        "dispersion.outputs.4.at is not a known phase: it must be one of final, "
        "booster.final, booster.cap.final, ascent, coast, booster.up, booster.fall, "
        "booster.cap.fall. Did you mean booster.fall?"
    ),
    ('"branch.booster.kick.2" =', '"branch.booster.kik.2" ='): "Did you mean branch.booster.kick.2",
}


@pytest.mark.parametrize(("change", "sentence"), BAD.items())
def test_wrong_branches_are_refused_in_a_sentence(change, sentence):
    with pytest.raises(SceneError) as error:
        loaded((FILE + CAMPAIGN).replace(*change, 1))
    assert sentence in str(error.value)


def test_a_scene_without_phases_has_no_branches():
    text = FILE.split("[[phase]]")[0] + '[times]\nend = "1 s"\n[branch.a]\nafter = "b"\n'
    with pytest.raises(SceneError, match=r"branch leaves at the end of a phase: at least one"):
        loaded(text)
    text = FILE.split("[branch.booster]")[0] + "[[branch]]\n"
    with pytest.raises(
        SceneError, match=r"branch is .*: it must be tables with names of your choice"
    ):
        loaded(text)


@pytest.mark.sweep
def test_the_first_stage_of_the_example_comes_down():
    """On its parachute at the speed of a steady descent, by the air and the gravity of the ground,
    which the turning planet makes a third of a percent less."""
    file = load(SCENES / "booster_return.toml")
    run = file.simulate()
    r, v = run["booster"].final.position, run["booster"].final.velocity
    assert run["booster"].status == Status.EVENT and run.status == Status.COMPLETED
    assert_allclose(jnp.linalg.norm(r), RADIUS_EARTH, rtol=1e-9)
    over_ground = v - cross(jnp.array([0.0, 0.0, 7.2921159e-5]), r)
    steady = descent_rate(950.0, 150.0, 1.225, MU_EARTH / RADIUS_EARTH**2)
    assert_allclose(jnp.linalg.norm(over_ground), steady, rtol=4e-3)
    # The parts at the parting, and the fairing that the sustainer drops 6.5 s later.
    whole, rest = run["first stage"].final, run["ullage coast"].initial
    part = run["booster.fall"].initial
    momentum = rest.mass * rest.velocity + part.mass * part.velocity
    assert_allclose(momentum, whole.mass * whole.velocity, rtol=1e-12, atol=1e-6)
    assert_allclose(run.final.mass, 12744.0 - 9250.0 - 950.0 - 44.0 - 2050.0, rtol=1e-9)

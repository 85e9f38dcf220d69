"""The command line: what it prints, writes and refuses, and the kick stage of the examples against
independent facts."""

import contextlib
import functools
import io
import json
import math
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from jaxspace import load
from jaxspace.cli import main
from jaxspace.cli._settings import settle
from jaxspace.cli._waiting import progress, waiting
from jaxspace.core import InputError
from jaxspace.dispersion import open_store
from jaxspace.io import SceneFile
from jaxspace.io.ephemeris import Ephemeris, read_oem
from jaxspace.simulation import MissionTrajectory
from jaxspace.solvers import Tsit5
from jaxspace.studies import accuracy_cost

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "examples" / "scenes"
KICK = (SCENES / "kick_stage.toml").read_text()

CHEAP = """
title = "A coast"
accuracy = 1e-6

[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[initial.orbit]
periapsis_altitude = "400 mi"
eccentricity = 0.1
inclination = "28.5 deg"

[[phase]]
name = "coast"
effects = ["point_gravity"]
duration = "10 min"

[dispersion]
runs = 300
seed = 3
outputs = ["periapsis_altitude", "apoapsis_altitude", "inclination"]

[dispersion.inputs]
"initial.orbit.periapsis_altitude" = { deviation = "2 km" }
"initial.orbit.inclination" = { distribution = "uniform", low = "28 deg", high = "29 deg" }
"""


@pytest.fixture(autouse=True)
def cache_elsewhere(tmp_path, monkeypatch):
    """No test writes into the user's own folders."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


BAD = [
    ("burn_time =", "burntime =", "effects.thrust.burntime"),
    ('"point_gravity", "oblateness", "thrust"', '"point_gravty", "thrust"', "point_gravity"),
    ('dry_mass = "1191 kg"', 'dry_mass = "-60 kg"', "body.dry_mass"),
    ('"60 rpm"]', '"60 kg"]', "initial.omega.2"),
    ('inertia = ["1031', '# inertia = ["1031', "body.inertia"),
    ("[planet]", "[planet", "TOML"),
]


@pytest.mark.parametrize("old, new, word", BAD)
@pytest.mark.parametrize("command", ["run", "disperse", "explain", "cost", "budget"])
def test_bad_input_ends_with_status_2_and_one_line(tmp_path, capsys, command, old, new, word):
    path = tmp_path / "scene.toml"
    path.write_text(KICK.replace(old, new))
    assert main([command, str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert (
        printed.err.startswith(str(path)) and printed.err.count("\n") == 1 and word in printed.err
    )


@pytest.fixture(scope="module")
def own_process(tmp_path_factory) -> subprocess.CompletedProcess:
    """A file that is refused, what that has touched, and the schema into a pipe whose reader leaves
    after ten characters of it, one after the other in a process of their own."""
    path = tmp_path_factory.mktemp("own") / "scene.toml"
    path.write_text(KICK.replace('"60 rpm"]', '"60 kg"]'))
    code = f"""
import sys, jax
from jaxspace.cli import main
status = main(["disperse", {str(path)!r}])
print(status, sorted(jax._src.xla_bridge._backends), flush=True)
sys.exit(main(["schema"]))
"""
    pipe = f"{shlex.join([sys.executable, '-c', code])} | head -c 15"
    return subprocess.run(["bash", "-c", pipe], capture_output=True, text=True, cwd=ROOT)


def test_bad_input_is_refused_before_a_device_is_touched(own_process):
    assert own_process.stdout.startswith("2 []\n")
    assert "initial.omega.2" in own_process.stderr and "Traceback" not in own_process.stderr


def test_a_stop_while_jax_is_imported_is_a_sentence(capsys, monkeypatch):
    class Stop:
        def find_spec(self, name, path=None, target=None):
            if name == "jaxspace.cli._carry_out":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "jaxspace.cli._carry_out", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Stop(), *sys.meta_path])
    assert main(["list"]) == 130
    assert capsys.readouterr().err == "jaxspace: stopped.\n"


@pytest.mark.parametrize(
    "wrong, least",
    [(["--runs", "0"], 1), (["--runs", "many"], 1), (["--seed", "-1"], 0), (["--chunk", "0"], 1)],
)
def test_bad_options_end_with_status_2(capsys, wrong, least):
    with pytest.raises(SystemExit) as ending:
        main(["disperse", "scene.toml", *wrong])
    assert ending.value.code == 2
    assert f"it must be a whole number from {least} to" in capsys.readouterr().err


def test_no_dispersion_to_fly(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text(CHEAP[: CHEAP.index("[dispersion]")])
    assert main(["disperse", str(path)]) == 2
    assert "dispersion is missing" in capsys.readouterr().err


@pytest.fixture(scope="module")
def dispersed(tmp_path_factory) -> tuple[Path, str]:
    """The folder of 64 runs with the seed of the file, and what was printed."""
    folder, printed = tmp_path_factory.mktemp("dispersed"), io.StringIO()
    (folder / "coast.toml").write_text(CHEAP)
    given = ["disperse", str(folder / "coast.toml"), "--runs", "64", "--out", str(folder / "a")]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        assert main(given) == 0
    return folder / "a", printed.getvalue()


def test_disperse_prints_a_table_and_keeps_the_runs(dispersed):
    folder, printed = dispersed
    for word in (
        "periapsis_altitude",
        "km",
        "deg",
        "std dev",
        "0.5 %",
        "99.5 %",
        "64 of 64 runs succeeded",
        "runs/s",
        "contributions",
    ):
        assert word in printed
    for name in ("coast.zarr", "coast.png", "coast.html"):
        assert (folder / name).exists() and name in printed
    kept = open_store(folder / "coast.zarr")
    # In point gravity the periapsis stays; its scatter is the one that goes in: 2 km, here of 64
    # draws. The file gives it in miles, and so comes what has its name.
    mile = 1.609344
    np.testing.assert_allclose(
        kept.outputs["periapsis_altitude"],
        kept.inputs["initial.orbit.periapsis_altitude"] / (1e3 * mile),
        atol=0.05,
    )
    assert abs(np.mean(kept.outputs["periapsis_altitude"]) - 400) < 5 * 2 / 8 / mile
    assert 28.0 < kept.outputs["inclination"].min() and kept.outputs["inclination"].max() < 29.0


# `test_sampling.py` asks the same of the draws.
@pytest.mark.sweep
def test_runs_depend_on_the_seed_and_their_number_alone(dispersed, tmp_path):
    path = tmp_path / "coast.toml"
    path.write_text(CHEAP)
    for folder, more in (
        ("a", ["--runs", "32", "--seed", "3"]),
        ("c", ["--runs", "32", "--seed", "4"]),
    ):
        assert main(["disperse", str(path), "--out", str(tmp_path / folder), *more]) == 0
    # The seed of the file is 3.
    a, b, c = (
        open_store(folder / "coast.zarr").outputs["apoapsis_altitude"]
        for folder in (tmp_path / "a", dispersed[0], tmp_path / "c")
    )
    np.testing.assert_array_equal(a, b[:32])
    assert not np.any(a == c)


# The command is the same for every file; what they hold is tested with their systems.
@pytest.mark.parametrize(
    "name",
    ["two_body", *(pytest.param(n, marks=pytest.mark.sweep) for n in ("top", "two_gimbal_gyro"))],
)
def test_textbook_files_run(tmp_path, capsys, name):
    assert main(["run", str(SCENES / f"{name}.toml"), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (
        "drift of energy" in printed
        and "error of" in printed
        and "reached its end within the tolerance" in printed
    )
    assert (tmp_path / f"{name}.png").exists()


def test_a_run_is_written_as_an_ephemeris(tmp_path, capsys):
    """The states of the picture in a message that others read; refused before the run."""
    scene = str(SCENES / "two_body.toml")
    epoch = "2026-03-01T12:00:00"
    given = ["run", scene, "--out", str(tmp_path), "--write", "oem"]
    assert main([*given, "--epoch", epoch, "--centre", "moon", "--frame", "ICRF"]) == 0
    assert f"ephemeris {tmp_path / 'two_body.oem'}" in capsys.readouterr().out
    (found,) = read_oem(tmp_path / "two_body.oem")
    file = load(scene)
    assert (found.centre, found.frame, found.name) == ("MOON", "ICRF", file.title)
    assert found.epoch.startswith(epoch) and found.times[0] == 0.0
    np.testing.assert_allclose(found.times[-1], file.ts[-1], atol=1e-9)
    np.testing.assert_array_equal(found.position[:, 0], file.y0.position)
    np.testing.assert_allclose(found.position[:, -1], file.simulate().final.position, rtol=1e-9)
    (tmp_path / "two_body.oem").unlink()
    for wrong, sentence in (
        (given, "--write requires --epoch, UTC at t = 0"),
        ([*given, "--epoch", "today"], "--epoch is 'today': it must be a time such as"),
        ([*given, "--epoch", epoch, "--frame", "a\nb"], "--frame is 'a\\nb': it must be a name"),
        (["run", scene, "--epoch", epoch], "--epoch requires --write oem"),
    ):
        assert main(wrong) == 2
        assert sentence in capsys.readouterr().err
    assert not list(tmp_path.glob("*.oem"))


def test_a_run_without_a_place_has_no_ephemeris():
    run = load(SCENES / "top.toml").simulate()
    with pytest.raises(InputError, match="single run of a body with position and velocity"):
        Ephemeris.of_run(run, "2026-03-01T12:00:00")


def test_a_mission_meets_its_error_and_names_its_file_for_the_next_command(tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(CHEAP.replace("accuracy = 1e-6", 'final_error = { position = "1 m" }'))
    assert main(["run", str(path), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "requested final error" in printed and "the rounding error of a closed form" in printed
    assert f"next   jaxspace disperse {path}\n" in printed


def test_explain_prints_the_table_of_every_scene(tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(CHEAP)
    assert main(["explain", str(path)]) == 0
    printed = capsys.readouterr().out
    assert (
        "coast\n" in printed
        # As the file names it.
        and "\npoint_gravity " in printed
        and "state: position, velocity" in printed
    )


SCENE = """
accuracy = 1e-8

[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[effects.point_gravity]

[initial.orbit]
periapsis_altitude = "400 mi"
eccentricity = 0.1

[times]
end = "10 min"
samples = 20
"""


def test_a_scene_and_a_mission_that_ends_at_an_event_run(tmp_path, capsys, monkeypatch):
    """Half a period from the periapsis the apoapsis is reached: pi sqrt(a^3/mu), a = (R + 400 mi) /
    0.9."""
    scene, mission = tmp_path / "scene.toml", tmp_path / "mission.toml"
    scene.write_text(SCENE)
    ending = 'until = "apoapsis"\nwithin = "2 h"'
    mission.write_text(CHEAP[: CHEAP.index("[dispersion]")].replace('duration = "10 min"', ending))
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    for path, png in ((scene, "scene.png"), (mission, "mission_coast.png")):
        assert main(["run", str(path), "--out", str(tmp_path), "--show"]) == 0
        assert (tmp_path / png).exists()
    assert opened == [(tmp_path / name).as_uri() for name in ("scene_run.html", "mission_run.html")]
    printed = capsys.readouterr().out
    half = math.pi * math.sqrt(((RADIUS + 400 * 1609.344) / 0.9) ** 3 / MU)
    assert f"to {half:.6g} s" in printed
    assert "stopped at a terminal event" in printed and "drift of energy" in printed


# The kick stage. The numbers are those of its file, typed again.
MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3
DRY, PROPELLANT, IMPULSE, BURN = 1191.0, 2010.0, 5.8e6, 84.1
EXHAUST = IMPULSE / PROPELLANT
PROFILE = (
    np.array([0.0, 0.6, 10.0, 22.0, 35.0, 48.0, 62.0, 74.0, 80.5, 84.1]),
    np.array([0.0, 60.5, 64.5, 69.0, 74.0, 77.0, 74.5, 66.0, 57.0, 0.0]),
)
OFFSET, TANGENTS, TIP_OFF = (
    (0.002, -0.001),
    (0.001, -0.0005),
    (math.radians(1.0), math.radians(-0.5)),
)


@pytest.fixture(scope="module")
def kick(tmp_path_factory) -> tuple[SceneFile, MissionTrajectory]:
    """The stage with a thrust that is off and a tip-off, flown at the accuracy of the file."""
    text = KICK.replace('offset = ["0 mm", "0 mm"]', 'offset = ["2 mm", "-1 mm"]')
    text = text.replace("misalignment = [0.0, 0.0]", "misalignment = [0.001, -0.0005]")
    text = text.replace(
        'omega = ["0 deg/s", "0 deg/s", "60 rpm"]', 'omega = ["1 deg/s", "-0.5 deg/s", "60 rpm"]'
    )
    path = tmp_path_factory.mktemp("kick") / "kick.toml"
    path.write_text(text)
    file = load(path)
    return file, file.simulate()


def rates(t, y):
    """The twelve states of a burning stage and its mass, written down once more: Thomson 5.6, 7.2,
    7.8, 7.9, and J2."""
    r, v, q, w, m = y[0:3], y[3:6], y[6:10], y[10:13], y[13]
    length = np.linalg.norm(r)
    gravity = -MU * r / length**3
    s = 5.0 * (r[2] / length) ** 2
    gravity -= 1.5 * J2 * MU * RADIUS**2 / length**5 * r * (np.array([1.0, 1.0, 3.0]) - s)
    x, f = PROFILE[0] / BURN, PROFILE[1]
    thrust = IMPULSE / BURN * np.interp(t / BURN, x, f) / np.trapezoid(f, x) if t <= BURN else 0.0
    flow = -thrust / EXHAUST
    force = (
        thrust * np.array([*TANGENTS, 1.0]) / math.sqrt(1.0 + TANGENTS[0] ** 2 + TANGENTS[1] ** 2)
    )
    left = m - DRY
    k2 = np.array([0.453**2, 0.453**2, 0.437**2])
    station = -1.69
    inertia = (
        np.array([1031.0, 1002.0, 521.0])
        + left * k2
        + DRY * left / m * station**2 * np.array([1.0, 1.0, 0.0])
    )
    slope = k2 + (DRY / m * station) ** 2 * np.array([1.0, 1.0, 0.0])
    centre = left / m * station
    arm, ring = -3.16 - centre, 0.265**2
    torque = np.cross([*OFFSET, -2.39 - centre], force)
    torque = torque + flow * (np.array([arm**2 + ring / 2, arm**2 + ring / 2, ring]) - slope) * w
    spin = (torque - np.cross(w, inertia * w)) / inertia
    turn = 0.5 * np.array(
        [
            -q[1] * w[0] - q[2] * w[1] - q[3] * w[2],
            q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
            q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
            q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
        ]
    )
    push = Rotation.from_quat([q[1], q[2], q[3], q[0]]).apply(force) / m
    return np.concatenate([v, gravity + push, turn, spin, [flow]])


def start():
    """The state at ignition: the descending node of a circular orbit, the axis 2.9 deg ahead of the
    velocity."""
    r = RADIUS + 185e3
    speed, i = math.sqrt(MU / r), math.radians(28.5)
    position = np.array([-r, 0.0, 0.0])
    velocity = speed * np.array([0.0, -math.cos(i), -math.sin(i)])
    normal = np.array([0.0, -math.sin(i), math.cos(i)])
    lead = math.radians(2.9)
    z = math.cos(lead) * velocity / speed - math.sin(lead) * position / r
    q = Rotation.from_matrix(np.stack([normal, np.cross(z, normal), z], axis=1)).as_quat()
    omega = [*TIP_OFF, 60 * math.pi / 30]
    return np.concatenate([position, velocity, [q[3], q[0], q[1], q[2]], omega, [DRY + PROPELLANT]])


@pytest.mark.sweep
def test_burn_and_coast_agree_with_another_integration(kick):
    """1 m and 1e-4 rad: the accuracy that the mission asks for. The other integration is a hundred
    times finer."""
    _, flown = kick
    y, times = start(), [*PROFILE[0], BURN + 60.0]
    ends = {}
    for t0, t1 in zip(
        times, times[1:], strict=False
    ):  # a kink of the thrust is the end of an integration
        y = solve_ivp(rates, (t0, t1), y, method="DOP853", rtol=1e-10, atol=1e-8).y[:, -1]
        ends[t1] = y
    for phase, t in (("burn", BURN), ("coast", BURN + 60.0)):
        got, want = flown[phase].final, ends[t]
        assert np.linalg.norm(got.position - want[0:3]) < 1.0
        assert (
            np.linalg.norm(got.velocity - want[3:6]) < 0.02
        )  # a metre in the minute of coast that follows
        turned = (
            Rotation.from_quat(np.roll(got.attitude.wxyz, -1))
            * Rotation.from_quat(np.roll(want[6:10], -1)).inv()
        )
        assert turned.magnitude() < 1e-4
        np.testing.assert_allclose(got.omega, want[10:13], atol=1e-5)
        assert float(got.mass) == pytest.approx(want[13], rel=1e-9)


def test_speed_gained_is_that_of_the_rocket_equation_less_small_losses(kick):
    """The losses: the axis stays while the velocity turns by 5.4 deg, so that at most 1 - cos(3
    deg) = 0.14 % goes across; the cone of a few degrees about it takes as much again, and gravity
    along the path a few m/s."""
    _, flown = kick
    ideal = EXHAUST * math.log((DRY + PROPELLANT) / DRY)
    first, last = (np.linalg.norm(flown["burn"].states.velocity[:, k]) for k in (0, -1))
    assert 0.0 < ideal - (last - first) < 0.01 * ideal


def test_the_orbit_that_is_reached(kick):
    """Energy and angular momentum at burnout give the apsides; the periapsis stays near the height
    of the injection."""
    file, flown = kick
    r, v = (np.asarray(x) for x in (flown["coast"].final.position, flown["coast"].final.velocity))
    energy, h = v @ v / 2 - MU / np.linalg.norm(r), np.linalg.norm(np.cross(r, v))
    a = -MU / (2 * energy)
    e = math.sqrt(1 - h * h / (MU * a))
    outputs = {name: x for name, (x, _) in file.nominal_outputs(flown).items()}
    assert outputs["periapsis_altitude"] == pytest.approx((a * (1 - e) - RADIUS) / 1e3, abs=1e-6)
    assert outputs["apoapsis_altitude"] == pytest.approx((a * (1 + e) - RADIUS) / 1e3, abs=1e-5)
    assert 180.0 < outputs["periapsis_altitude"] < 190.0
    assert 80e3 < outputs["apoapsis_altitude"] < 90e3
    assert outputs["inclination"] == pytest.approx(28.5, abs=0.5)
    assert outputs["speed_error"] == outputs["velocity_error"] == 0.0
    units = {name: unit for name, (_, unit) in file.nominal_outputs(flown).items()}
    assert units == {
        "periapsis_altitude": "km",
        "apoapsis_altitude": "km",
        "inclination": "deg",
        "speed_error": "m/s",
        "velocity_error": "m/s",
        "pointing": "deg",
        "spin_rate": "rpm",
        "cone_angle": "deg",
    }


def test_the_coast_keeps_the_angular_momentum(kick):
    _, flown = kick
    drift = flown["coast"].drift()
    assert float(np.max(drift["rotational_momentum"])) < 1e-5  # 360 steps at a tolerance of 3e-7
    assert float(np.max(drift["rotational_energy"])) < 1e-5


def test_the_yo_yo_takes_the_spin_and_leaves_the_cone(kick):
    """Thomson 7.5-12 on the spin at the end of the coast; pointing and cone from the final state,
    by numpy."""
    file, flown = kick
    before, after = flown["coast"].final, flown.final
    c, phi = 521.0 / (6.0 * 0.62**2) + 1.0, 8.81 / 0.62
    assert float(after.omega[2]) == pytest.approx(
        float(before.omega[2]) * (c - phi**2) / (c + phi**2), rel=1e-12
    )
    assert float(after.mass) == pytest.approx(DRY - 6.0, rel=1e-9)
    h = np.array([1031.0, 1002.0, 521.0]) * np.asarray(after.omega)
    outputs = {name: x for name, (x, _) in file.nominal_outputs(flown).items()}
    assert outputs["spin_rate"] == pytest.approx(float(after.omega[2]) * 30 / math.pi)
    assert 2.0 < outputs["spin_rate"] < 8.0
    assert outputs["cone_angle"] == pytest.approx(
        math.degrees(math.atan2(np.hypot(h[0], h[1]), h[2])), rel=1e-6
    )
    h_N = Rotation.from_quat(np.roll(after.attitude.wxyz, -1)).apply(h / np.linalg.norm(h))
    intended = Rotation.from_quat(np.roll(start()[6:10], -1)).apply([0.0, 0.0, 1.0])
    assert outputs["pointing"] == pytest.approx(math.degrees(math.acos(h_N @ intended)), rel=1e-5)


def test_cost_prints_a_table_and_recommends(tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(CHEAP)
    assert main(["cost", str(path), "--out", str(tmp_path / "a"), "--error", "1e-9"]) == 0
    printed = capsys.readouterr().out
    for word in (
        "A coast",
        "DOP853",
        "Tsit5",
        "float32",
        "1e-12",
        "evaluations",
        "Errors are against DOP853",
    ):
        assert word in printed
    # Under the attraction of a point alone a body has a closed form. Which of so short runs takes
    # the least time is up to the machine.
    assert "closed_form  float64" in printed
    assert "for a relative error of 1e-09 in the final state: " in printed
    assert (tmp_path / "a" / "coast_cost.png").exists() and "coast_cost.png" in printed


LONG_SPIN = """
title = "A long spin"
accuracy = 1e-6
max_steps = {max_steps}

[body]
inertia = ["520 kg m^2", "560 kg m^2", "340 kg m^2"]

[effects.viscous_torque]
damping = [0.3, 0.2, 0.1]

[initial]
omega = ["0.5 rpm", "0.3 rpm", "211 rpm"]

[initial.attitude]
angles = ["0 deg", "0 deg", "0 deg"]

[times]
end = "{minutes} min"
"""


def test_cost_of_a_long_spin_prints_what_it_has(tmp_path, capsys, monkeypatch):
    """Runs take as many steps as the file says; where none serves as the reference, the rows come
    without errors, and the command says why."""
    # One method and one program for its tolerances: what is tested costs no more.
    few = functools.partial(accuracy_cost, methods=(Tsit5(),), precisions=("float64",), repeats=1)
    monkeypatch.setattr("jaxspace.cli._commands.accuracy_cost", few)
    monkeypatch.setattr("jaxspace.cli._commands.TOLERANCES", (1e-3,))
    monkeypatch.setattr("jaxspace.studies._cost_reference.ROOM", (1,))
    monkeypatch.setattr("jaxspace.studies._cost_reference.HIGH_ORDER", Tsit5())
    path = tmp_path / "spin.toml"
    path.write_text(LONG_SPIN.format(max_steps=32, minutes=600))
    assert main(["cost", str(path), "--out", str(tmp_path / "a")]) == 1
    printed = capsys.readouterr().out
    # 32 steps of six evaluations, and no error.
    assert re.search(r"Tsit5 +float64 +1e-06 +-\* .* 192 +\d+ ", printed) and "nan" not in printed
    assert "The errors are unknown, because no reference run succeeds" in printed
    assert "Tsit5 at 1e-03, 1e-06 in float64: The maximum number of steps was reached" in printed
    assert not (tmp_path / "a" / "spin_cost.png").exists()


def test_budget_prints_a_table_and_what_may_go(tmp_path, capsys):
    path = tmp_path / "coast.toml"
    oblate = CHEAP.replace('"6378.137 km"', '"6378.137 km"\nj2 = 1.08262668e-3')
    path.write_text(oblate.replace('["point_gravity"]', '["point_gravity", "oblateness"]'))
    assert main(["budget", str(path), "--out", str(tmp_path / "a"), "--tolerance", "10 km"]) == 0
    printed = capsys.readouterr().out
    for word in (
        # As the file names them.
        "point_gravity  coast",
        "oblateness     coast",
        "influence [m]",
        "share",
        "within 10000 m: keep point_gravity; omit oblateness",
    ):
        assert word in printed
    assert (tmp_path / "a" / "coast_budget.png").exists() and "coast_budget.png" in printed


BAD_STUDIES = [
    (
        ["budget", "--tolerance", "10 kg"],
        '--tolerance is "10 kg": it must be a positive number in m or text with a unit of length',
    ),
    (["budget", "--tolerance", "wide"], '--tolerance is "wide": it must be a positive number in m'),
    (["budget", "--tolerance", "0 m"], '--tolerance is "0 m": it must be a positive number in m'),
    (["budget", "--output", "omega"], "Parts of the final state are position, velocity"),
    (["budget", "--output", "speeed"], 'output is "speeed": it must be one of'),
    (["budget", "--output", "coast.position.0"], "it must be an output of the final state"),
    (
        ["budget", "--output", "speed", "--tolerance", "1 m"],
        '--tolerance is "1 m": it must be a positive number in m/s',
    ),
]


@pytest.mark.parametrize("arguments, words", BAD_STUDIES)
def test_bad_questions_end_with_status_2(tmp_path, capsys, arguments, words):
    path = tmp_path / "coast.toml"
    path.write_text(CHEAP)
    assert main([arguments[0], str(path), "--out", str(tmp_path), *arguments[1:]]) == 2
    printed = capsys.readouterr().err
    assert words in printed and printed.count("\n") == 1


def test_a_textbook_system_has_no_budget(capsys, tmp_path):
    assert main(["budget", str(SCENES / "top.toml"), "--out", str(tmp_path)]) == 2
    assert "Top has no effects" in capsys.readouterr().err


def test_list_and_schema(capsys):
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert "**" not in printed
    for word in ("  thrust: ", "  periapsis [m^2/s]", "  burnout [s]", "jaxspace list NAME"):
        assert word in printed
    # An entry on each line, and their fields where they are asked for.
    assert len(printed.splitlines()) < 250 and "total_impulse" not in printed
    assert main(["list", "effects"]) == 0
    printed = capsys.readouterr().out
    assert "total_impulse [N s]" in printed and printed.count("rms_aloft [m/s]: ") == 1
    assert main(["list", "burnout"]) == 0
    found = re.findall(r"^  (\w+)", capsys.readouterr().out, re.MULTILINE)
    assert set(found) == {"propellant_depletion", "burnout"}
    # Only fields name it.
    assert main(["list", "heights [m]"]) == 0
    assert "  drag: " in capsys.readouterr().out
    assert main(["list", "drag"]) == 0
    found = capsys.readouterr().out
    # Several tables hold the same one: its fields are written once.
    assert found.count("wind_20_feet") == 1 and "      as in air_drag.air\n" in found
    assert main(["list", "Julian day"]) == 2
    assert "Julian day matches no entry" in capsys.readouterr().err
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["$schema"].startswith("https://json-schema.org")


@pytest.mark.parametrize("terminal", [True, False])
def test_a_long_command_says_on_a_terminal_what_it_is_at(terminal, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    monkeypatch.setattr("jaxspace.cli._waiting.PATIENCE", 0.05)
    with waiting("simulating"):
        time.sleep(0.2)
    said = capsys.readouterr().err
    assert said.endswith("\rsimulating: 0 s\x1b[K\n") if terminal else said == ""


@pytest.mark.parametrize("terminal", [True, False])
def test_a_bar_says_what_its_first_step_waits_for(terminal, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    monkeypatch.setattr("jaxspace.cli._waiting.PAUSE", 0.05)
    with progress("compiling", total=2, mininterval=0.0) as bar:
        time.sleep(0.2)
        before = capsys.readouterr().err
        bar.set_description_str(refresh=False)
        bar.update(2)
    after = capsys.readouterr().err.split("\r")[-1]
    if not terminal:
        assert before == after == ""
        return
    # Its seconds count on, which without a step they would not.
    assert before.count("compiling:   0%") > 2
    assert "compiling" not in after and "2/2" in after


def test_a_closed_pipe_ends_in_a_sentence(own_process):
    """The schema is longer than the buffer of a pipe: its writer notices that nobody reads."""
    assert "the output was closed prematurely" in own_process.stderr
    assert "Traceback" not in own_process.stderr


def test_a_folder_that_cannot_be_made_ends_with_status_2(tmp_path, capsys):
    path, taken = tmp_path / "coast.toml", tmp_path / "taken"
    path.write_text(CHEAP)
    taken.write_text("a file")
    assert main(["run", str(path), "--out", str(taken)]) == 2
    assert "the folder cannot be created" in capsys.readouterr().err


def test_a_system_is_dispersed_like_a_scene(tmp_path, capsys):
    """In the closed form of two bodies the mean distance after half a turn scatters as what goes
    in: da/dr_p = 1 / (1 - e)."""
    path = tmp_path / "two_body.toml"
    text = (SCENES / "two_body.toml").read_text().replace('"24 h"', '"1 h"')
    path.write_text(
        text
        + """
[dispersion]
outputs = ["semi_major_axis", "final.position.0"]
[dispersion.inputs]
"initial.orbit.periapsis_altitude" = { deviation = "1 km" }
"planet.mu" = { deviation = "1e-6 %" }
"""
    )
    assert main(["disperse", str(path), "--runs", "32", "--out", str(tmp_path)]) == 0
    assert "32 of 32 runs succeeded" in capsys.readouterr().out
    kept = open_store(tmp_path / "two_body.zarr")
    altitude = kept.inputs["initial.orbit.periapsis_altitude"]
    np.testing.assert_allclose(
        1e3 * kept.outputs["semi_major_axis"], (RADIUS + altitude) / (1.0 - 0.2921), rtol=1e-12
    )


def test_an_error_that_is_no_number_ends_with_status_2(capsys):
    with pytest.raises(SystemExit) as ending:
        main(["cost", "scene.toml", "--error", "-1"])
    assert ending.value.code == 2
    assert "it must be a positive number" in capsys.readouterr().err


def test_a_command_compiles_as_it_would_alone():
    """After one of the other kind: neither its setting nor its programs are left."""
    program = jax.jit(lambda x: jnp.sin(x) * x)
    for once in (True, False, True):
        settle(once=once)
        assert jax.config.read("jax_disable_most_optimizations") is once
        assert program._cache_size() == 0
        program(jnp.ones(3))
        settle(once=once)
        assert program._cache_size() == 1

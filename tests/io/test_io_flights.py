"""Rockets from their rail to the ground, as scene files give them."""

import dataclasses
import re
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace.bodies import BodyState
from jaxspace.cli import main
from jaxspace.cli._commands import show_page
from jaxspace.dispersion import disperse
from jaxspace.io import SceneError, listing, schema
from jaxspace.io._mission.building import replaced
from jaxspace.io._runs.outputs import Outputs
from jaxspace.scene import Scene
from jaxspace.simulation import Mission, Status, Trajectory, simulate_mission_batch
from jaxspace.vehicles.landings import landing_latitude, landing_longitude

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
sys.path.insert(0, str(EXAMPLES / "model_rockets"))

from rockets import CALISTO, recovery, vehicle  # noqa: E402

LANDING = EXAMPLES / "scenes" / "landing.toml"


@pytest.fixture(scope="module")
def landing():
    """The example, loaded once."""
    return jaxspace.load(LANDING)


def test_a_file_gives_the_vehicle_that_python_gives(landing):
    building = landing.parsed.building()
    # Without thrust Calisto has the drag that it has with thrust, which a file need not say.
    expected = dataclasses.replace(vehicle(CALISTO), coasting_drag=None)
    made = building.make("vehicle")
    # The file rounds the mass of the propellant to tenths of a gram.
    rounded = jax.tree.leaves(expected), jax.tree.leaves(made)
    for there, here in zip(*rounded, strict=True):
        np.testing.assert_allclose(here, there, rtol=2e-5)
    chutes = [building.make(f"vehicle.parachutes.{k}") for k in range(2)]
    for there, here in zip(recovery(CALISTO), chutes, strict=True):
        assert jax.tree.leaves(there) == jax.tree.leaves(here)


def test_a_factor_of_the_thrust_keeps_the_propellant_and_one_of_the_drag_the_body(landing):
    building = landing.parsed.building()
    names = "vehicle.impulse_factor", "vehicle.axial_factor"
    factors = dict(zip(names, jnp.array([1.1, 1.2]), strict=True))
    made = building._replace(values=replaced(landing.values, factors)).make("vehicle")
    plain = building.make("vehicle")
    flow = made.motor.mass_rate(jnp.asarray(1.0), 20.0)
    np.testing.assert_allclose(flow, plain.motor.mass_rate(jnp.asarray(1.0), 20.0), rtol=1e-14)
    thrust = made.motor.thrust(jnp.asarray(1.0), 20.0)
    expected = 1.1 * plain.motor.thrust(jnp.asarray(1.0), 20.0)
    np.testing.assert_allclose(thrust, expected, rtol=1e-14)
    air = building.make("site").air
    areas = [rocket.as_body(air)[1].area for rocket in (made, plain)]
    np.testing.assert_allclose(areas[0] / areas[1], 1.2, rtol=1e-14)


def test_a_file_is_flown_in_the_phases_of_its_parachutes(landing):
    names = ["rail", "ascent", "wait 1", "parachute 1", "wait 2", "parachute 2"]
    assert landing.kind == "flight"
    assert [phase.name for phase in landing.mission.phases] == names
    # On the rail it rests, and points along it.
    axis = landing.y0.attitude.rotate(jnp.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(axis, landing.parsed.building().make("site").direction, atol=1e-15)


def changed(tmp_path, *changes):
    """The example with other words, in a file of its own."""
    text = LANDING.read_text().replace("../model_rockets", str(EXAMPLES / "model_rockets"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "changed.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            'tube_length = "1.915 m"',
            'tube_length = "50 cm"',
            "vehicle.tube_length is 0.5: it must be at least 0.757 m, the length of the motor",
        ),
        (
            'radius = "0.0635 m"',
            'radius = "30 mm"',
            "vehicle.radius is 0.03: it must be at least 0.0375 m, the radius of the motor",
        ),
        (
            'rail_length = "5.2 m"',
            "rail_length = 0",
            "site.rail_length is 0: it must be a positive",
        ),
        (
            '"3 m/s", "6 m/s"',
            '"3 m/s", "200 m/s"',
            'site.wind.east.1 is "200 m/s": it must be a number at least -150 and at most 150',
        ),
        (
            'height = "800 m"',
            'height = "20 km"',
            r"vehicle.parachutes.1.height is 20000.0: it must be below 7\d\d\d m, .* never opens",
        ),
        (
            'height = "800 m"',
            "",
            "vehicle.parachutes.1.height is missing: it must be the height of its opening",
        ),
        (
            'height = "800 m"',
            'height = "800 m"\ntime = "60 s"',
            r"vehicle.parachutes.1.time is given together with a height: omit one",
        ),
        (
            'lag = "1.5 s"\nheight = "800 m"',
            'time = "50 s"\n[[vehicle.parachutes]]\ndrag_area = 1\ntime = "40 s"',
            r"vehicle.parachutes.2.time is 40.0: it must be above 50 s, when the previous one",
        ),
        (
            'drag_area = "10 m^2"',
            "drag_area = 0",
            "vehicle.parachutes.1.drag_area is 0: it must be a positive number in m",
        ),
        ("m1670.eng", "m1.eng", "vehicle.motor: .*m1.eng cannot be read: No such file"),
        ('"33 mm", "15 mm"', '"13 mm", "15 mm"', "vehicle.grain is .* an outer radius above"),
        ("[site.wind]", "[site.wnd]", "site.wnd is not a known key: .* Did you mean wind?"),
        ("[waiting]", "[planet]", "planet is not a known key"),
    ],
)
def test_what_cannot_fly_is_a_sentence(old, new, sentence, tmp_path):
    with pytest.raises(SceneError, match=sentence):
        jaxspace.load(changed(tmp_path, (old, new)))


def test_a_second_parachute_opens_below_the_first(tmp_path):
    low = ('lag = "1.5 s"\n', 'lag = "1.5 s"\nheight = "500 m"\n')
    with pytest.raises(SceneError, match=r"height is 800\.0: it must be below 500 m, where"):
        jaxspace.load(changed(tmp_path, low))


def test_listing_and_schema_know_vehicles(capsys):
    forms = [form["properties"] for form in schema()["anyOf"]]
    (form,) = [form for form in forms if "vehicle" in form]
    assert {"vehicle", "site", "waiting", "dispersion"} <= set(form)
    assert {"motor", "nose", "fins", "tail", "parachutes"} <= set(form["vehicle"]["properties"])
    assert main(["list", "vehicle"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"^    tube_length \[m\]", shown, re.MULTILINE)
    assert "parachutes: a list of tables" in shown
    assert shown.count("\n  vehicle: ") == 1
    assert listing(word="flights").startswith("flights\n  vehicle: ")
    assert main(["list", "vehicel"]) == 2
    assert "Did you mean vehicle?" in capsys.readouterr().err


def test_the_page_of_a_flight_needs_no_planet(landing, monkeypatch, capsys):
    monkeypatch.setattr("jaxspace.plots.show_run", lambda run, path, **options: options)
    # A run whose numbers nobody reads.
    show_page(landing, object.__new__(Trajectory), "run.html")
    assert "'planet_radius': None" in capsys.readouterr().out


def test_many_flights_are_built_at_once(landing):
    scatter = {"vehicle.axial_factor": jnp.array([1.0, 1.1]), "site.inclination": jnp.ones(2)}
    mission, y0 = landing.build(scatter)
    assert y0.position.shape == (3, 2)
    assert y0.attitude.wxyz.shape == (4, 2)
    np.testing.assert_allclose(mission.phases[1].moving.effects[3].area[1], 1.1 * np.pi * 0.0635**2)
    # Where nothing of the start scatters, every run has it all the same.
    _, y0 = landing.build({"vehicle.parachutes.1.drag_area": jnp.array([9.0, 10.0])})
    assert {x.shape[-1] for x in jax.tree.leaves(y0)} == {2}


def test_outputs_of_a_landing_are_those_of_its_place(landing):
    assert [spec.name for spec in landing.outputs][:3] == ["east", "north", "distance"]
    began = BodyState(jnp.array([[100.0, 0.0], [0.0, 0.0], [800.0, 800.0]]), jnp.zeros((3, 2)))
    end = BodyState(jnp.array([[400.0, 3.0], [-400.0, 4.0], [0.0, 0.0]]), 2.0 * jnp.ones((3, 2)))
    places = range(-1, 6)
    numbers = Outputs(landing.parsed, landing.outputs, replaced(landing.values, {}), None).numbers(
        dict.fromkeys(places, end),
        dict.fromkeys(places, jnp.ones(2)),
        {},
        {},
        {1: began, 3: end, 5: began},
    )
    np.testing.assert_allclose(numbers["east"], [400.0, 3.0])
    np.testing.assert_allclose(numbers["distance"], [400.0 * np.sqrt(2.0), 5.0], rtol=1e-14)
    np.testing.assert_allclose(numbers["drift_of_the_ascent"], [500.0, 5.0], rtol=1e-14)
    # A run that stays where it was has drifted nowhere.
    np.testing.assert_array_equal(numbers["drift_under_the_drogue"], [0.0, 0.0])
    np.testing.assert_allclose(numbers["impact_speed"], np.sqrt(12.0), rtol=1e-14)


def test_latitude_and_longitude_are_those_of_geodesics():
    """Against the radii of curvature of the ellipsoid, WGS 84."""
    latitude, longitude, height = np.radians(32.99), np.radians(-106.97), 1400.0
    e2 = 0.00669437999014
    w2 = 1.0 - e2 * np.sin(latitude) ** 2
    meridian = 6378137.0 * (1.0 - e2) / w2**1.5 + height
    normal = 6378137.0 / np.sqrt(w2) + height
    there = jnp.array([[0.0, 1000.0, 0.0], [0.0, 0.0, 1000.0], [0.0, 0.0, 0.0]])
    found = landing_latitude(there, latitude, longitude, height)
    # Of second order: a square over twice the radius, some 1e-8 rad.
    np.testing.assert_allclose(found - latitude, [0.0, 0.0, 1000.0 / meridian], atol=2e-8)
    found = landing_longitude(there, latitude, longitude, height)
    expected = [0.0, 1000.0 / (normal * np.cos(latitude)), 0.0]
    np.testing.assert_allclose(found - longitude, expected, atol=2e-8)


def test_a_flight_that_never_leaves_its_rail_marks_its_own_row(landing):
    # Full thrust, thrust below the weight, and a burnout on a rail that is long enough.
    factors = {"vehicle.impulse_factor": jnp.array([1.0, 0.08, 0.25])}
    mission, y0 = landing.build({**factors, "site.rail_length": jnp.array([5.2, 5.2, 130.0])})
    phase = mission.phases[0]
    # Gravity, thrust and rail: what else acts is no matter here, and would be compiled.
    scene = phase.moving
    scene = Scene([scene.effects[k] for k in (0, 2, -1)], scene.body, scene.carry)
    rail = Mission([dataclasses.replace(phase, system=scene)])
    run = simulate_mission_batch(rail, y0, 0.0, accuracy=1e-6, num_saved=2, throw=False)
    good = [Status(int(status)).good for status in run.status]
    assert good == [True, False, True]
    assert float(run.end[2]) > 3.9
    np.testing.assert_allclose(
        jnp.linalg.norm(run.final.position[:, jnp.array([0, 2])], axis=0), [5.2, 130.0], rtol=1e-9
    )


@pytest.mark.sweep
def test_a_height_that_is_passed_opens_its_parachute_at_once(tmp_path):
    """Of a heavy Calisto whose apogee is often below the 800 m of its main; and a main alone opens
    at its height and not at the apogee."""
    heavy = jaxspace.load(changed(tmp_path, ('mass = "14.426 kg"', 'mass = "37.5 kg"')))
    result = disperse(heavy.campaign(), 16, accuracy=heavy.accuracy)
    assert result.status.tolist() == [Status.EVENT] * 16
    low = result.outputs["apogee"] < 800.0
    assert 0 < np.sum(low) < 16
    # The lag of the drogue and then of the main pass: 3 s after the apogee it is open.
    drift = result.outputs["drift_under_the_drogue"]
    assert np.all(drift[low] == 0.0) and np.all(drift[~low] > 0.0)
    assert np.all(np.abs(result.outputs["impact_speed"] - 9.0) < 2.0)
    drogue = (
        '[[vehicle.parachutes]] # the drogue, at the apogee\ndrag_area = "1 m^2"\nlag = "1.5 s"\n'
    )
    area = '"vehicle.parachutes.1.drag_area" = { deviation = "10 %" }\n'
    alone = jaxspace.load(
        changed(
            tmp_path,
            (drogue, ""),
            (area, ""),
            ("parachute 1", "fall"),
            ("parachute 2", "parachute 1"),
        )
    )
    run = alone.simulate()
    np.testing.assert_allclose(run["fall"].final.position[2], 800.0, rtol=1e-9)
    assert run["fall"].ts[-1] - run["ascent"].ts[-1] > 10.0

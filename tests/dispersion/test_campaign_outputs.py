"""What the outputs of a campaign may be: numbers of single runs, each of which depends on that run
alone."""

import re
from typing import final

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_campaign_commands import COAST
from test_campaigns import INPUTS, fly, last, raising, swing

import jaxspace
from jaxspace.cli import main
from jaxspace.core import AbstractSystem, InputError, output
from jaxspace.dispersion import (
    Campaign,
    Constant,
    Normal,
    _batch_runner,
    _independence,
    disperse,
    moments,
)
from jaxspace.dispersion._independence import outputs_to_check
from jaxspace.simulation import Event, Mission, Phase, SimulationError, Status
from jaxspace.vehicles.landings import landing

# Where no run is refused.
SCENE = COAST.replace("deviation = 0.05", "deviation = 0.01")


def of(outputs, **options):
    return Campaign(swing, INPUTS, outputs, **options)


@pytest.mark.parametrize(
    "mixed",
    [
        lambda r, s: r.final["x"] - jnp.mean(r.final["x"]),
        lambda r, s: jnp.max(r.final["x"]),
        lambda r, s: jnp.argsort(s["w"]),
        lambda r, s: r.final["x"] / jnp.linalg.norm(r.final["x"]),
        # Not of other runs, but of the place of a run among them.
        lambda r, s: r.final["x"] + jnp.arange(s["w"].size, dtype=float),
        lambda r, s: jax.random.normal(jax.random.key(0), s["w"].shape),
        # Reads states between the ends of a phase, which the first runs have none of.
        lambda r, s: jnp.sum(r.phases[0].states["x"][2]) * s["w"],
    ],
)
def test_outputs_that_mix_runs_are_refused_before_the_campaign_flies(mixed, monkeypatch):
    def never(*_):
        raise AssertionError("a call has flown")

    monkeypatch.setattr(_batch_runner.BatchRunner, "_call", never)
    campaign = of(lambda r, s: {**last(r, s), "mixed": mixed(r, s)}, num_saved=5)
    words = r"The output 'mixed' mixes runs: (run 0|the nominal run) gives .* among other runs and "
    with pytest.raises(InputError, match=words):
        fly(campaign=campaign, runs=64)


def test_outputs_of_single_runs_pass():
    def outputs(result, samples):
        x, w = result.final["x"], samples["w"]
        # All runs iterate until the last one is there: the digits of a run are those of others.
        root = jax.lax.while_loop(
            lambda y: jnp.max(jnp.abs(y * y - w)) > 1e-13, lambda y: 0.5 * (y + w / y), w
        )
        return {
            "constant": 3.0,
            "array": jnp.array([2.0]),
            "whole": (x > 0.0).astype(int),
            "often_nan": jnp.sqrt(w - 2.0),
            "infinite": 1.0 / (0.0 * w),
            "root": root,
            "energy": jnp.sum(jnp.stack([result.final["v"], w * x]) ** 2, axis=0),
            "along": jnp.max(result.phases[0].states["x"], axis=0),
        }

    found = fly(campaign=of(outputs, num_saved=5), runs=64)
    np.testing.assert_array_equal(found.outputs["constant"], 3.0)
    np.testing.assert_array_equal(found.outputs["array"], 2.0)
    np.testing.assert_allclose(found.outputs["root"], np.sqrt(found.inputs["w"]), rtol=1e-13)
    np.testing.assert_array_equal(np.isnan(found.outputs["often_nan"]), found.inputs["w"] < 2.0)


@pytest.mark.parametrize(
    ("outputs", "words"),
    [
        (lambda r, s: {"a": jnp.stack([s["w"]] * 3)}, "output 'a' has the shape (3, 64): it must"),
        (lambda r, s: r.final["x"], "Campaign.outputs returns an array: it must return a dict"),
        (lambda r, s: None, "Campaign.outputs returns None: it must return a dict"),
        (lambda r, s: {"a": None}, "output 'a' is None: it must be one real number for each run"),
        (lambda r, s: {"a": "x"}, "output 'a' is 'x': it must be one real number"),
        (
            lambda r, s: {"a": jax.lax.complex(s["w"], s["w"])},
            "output 'a' is complex: it must be",
        ),
        (lambda r, s: {"..": s["w"]}, "has the name '..': it must be text"),
        (lambda r, s: {"__a": s["w"]}, "has the name '__a': it must be text"),
        (lambda r, s: {1: s["w"]}, "has the name 1: it must be text"),
    ],
)
def test_wrong_outputs_are_named_before_anything_flies(outputs, words, monkeypatch):
    def never(*_):
        raise AssertionError("the first runs have flown")

    monkeypatch.setattr(_batch_runner, "check_outputs", never)
    with pytest.raises(InputError, match=re.escape(words)):
        fly(campaign=of(outputs), runs=64)


def test_wrong_outputs_are_named_wherever_they_are_computed():
    campaign = of(lambda r, s: {"a": jnp.stack([s["w"]] * 3)})
    with pytest.raises(InputError, match="output 'a' has the shape"):
        moments(campaign, "unscented")
    with pytest.raises(InputError, match="output 'a' has the shape"):
        campaign.replay(0)


def test_a_name_of_an_input_that_no_store_can_hold_is_refused():
    with pytest.raises(InputError, match=r"Campaign.inputs has the name '\.\.'"):
        Campaign(swing, {**INPUTS, "..": INPUTS["w"]}, last)


def refusing(limit):
    """The output "rate" raises an error above the limit."""

    def refuse(w):
        if np.any(w > limit):
            raise ValueError("too fast")
        return w

    def outputs(result, samples):
        w = samples["w"]
        rate = jax.pure_callback(refuse, jax.ShapeDtypeStruct(w.shape, w.dtype), w)
        return {**last(result, samples), "rate": rate}

    return of(outputs)


def test_an_output_that_always_raises_is_named():
    words = (
        "nominal run cannot be evaluated: the output 'rate' raises an error (ValueError: too fast)"
    )
    with pytest.raises(SimulationError, match=re.escape(words)) as raised:
        fly(campaign=refusing(-1.0), runs=64)
    assert "\n" not in str(raised.value)


def test_a_mission_that_always_raises_is_a_failure():
    words = (
        "nominal run cannot be simulated: a function of the campaign raises an error (ValueError"
    )
    with pytest.raises(SimulationError, match=re.escape(words)):
        fly(campaign=raising(-1.0), runs=64)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (raising, "simulated: a function of the campaign raises an error"),
        (refusing, "evaluated: the output 'rate'"),
    ],
)
def test_the_replay_of_a_run_that_raises_says_what_was_raised(make, words):
    # Two deviations above the mean: few, since each of them is sought in halves of its call.
    limit = 2.2
    campaign = make(limit)
    found = disperse(campaign, 64)
    fast = found.inputs["w"] > limit
    assert 0 < fast.sum() < 64
    np.testing.assert_array_equal(found.status == Status.RAISED, fast)
    number = int(np.flatnonzero(fast)[0])
    with pytest.raises(SimulationError, match=f"Run {number} cannot be {words}") as raised:
        campaign.replay(number)
    assert "ValueError: too fast" in str(raised.value) and "\n" not in str(raised.value)


# ------------------------------------------------------------------------------------- scene files


@pytest.fixture
def coast(tmp_path):
    path = tmp_path / "coast.toml"
    path.write_text(SCENE)
    return path


def distance(result, samples):
    """m"""
    del samples
    return {"distance": jnp.linalg.norm(result.final.position, axis=0)}


def test_a_scene_campaign_takes_more_outputs(coast, tmp_path, capsys):
    file = jaxspace.load(coast)
    store = tmp_path / "more.zarr"
    found = disperse(file.campaign(outputs=distance), 64, accuracy=file.accuracy, store=store)
    # By the tolerance of the file, which the campaign brings.
    alone = disperse(file.campaign(), 64)
    assert alone.attributes["rtol"] == found.attributes["rtol"] == float(file.accuracy.rtol)
    assert list(found.outputs) == [*alone.outputs, "distance"]
    for name, x in alone.outputs.items():
        np.testing.assert_allclose(found.outputs[name], x, rtol=1e-9)
    # Ten minutes after periapsis a run is higher.
    low = found.inputs["initial.orbit.periapsis_altitude"] + 6378.137e3
    good = found.good
    assert np.all(found.outputs["distance"][good] > low[good])
    # The command line knows of no nominal value of what was given in Python.
    assert main(["report", str(store)]) == 0
    lines = [x.split() for x in capsys.readouterr().out.splitlines()]
    assert [x[1] for x in lines if x[:1] == ["distance"]][0] == "-"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            lambda r, s: {"periapsis_altitude": r.end},
            "'periapsis_altitude', which is already an output of",
        ),
        (lambda r, s: {"mean": jnp.mean(r.final.position)}, "The output 'mean' mixes runs"),
        (lambda r, s: None, "outputs returns an object of type NoneType: it must return a dict"),
    ],
)
def test_more_outputs_of_a_scene_campaign_are_checked(given, words, coast):
    file = jaxspace.load(coast)
    with pytest.raises(InputError, match=words):
        disperse(file.campaign(outputs=given), 64, accuracy=file.accuracy)


@output("m", doc="distance from the middle of all runs")
def off_centre(position):
    return jnp.linalg.norm(position - jnp.mean(position, axis=-1, keepdims=True), axis=0)


def test_an_output_that_a_file_may_name_is_checked(coast):
    coast.write_text(SCENE.replace('outputs = ["', 'outputs = ["off_centre", "'))
    file = jaxspace.load(coast, also=[off_centre])
    with pytest.raises(InputError, match="The output 'off_centre' mixes runs"):
        disperse(file.campaign(), 64, accuracy=file.accuracy)


@final
class Thrown(AbstractSystem):
    """x' = 1 and z'' = -1: at the height z = 0 again after the time 2 z'(0)."""

    def vector_field(self, t, y):
        one = jnp.ones_like(y["x"])
        return {"x": one, "z": y["w"], "w": -one}

    def invariants(self, t, y):
        return {}


def thrown(samples):
    w = samples["w"]
    # Not a number where `one` is zero.
    y0 = {"x": 0.0 * w, "z": 0.0 / samples["one"], "w": w}
    fall = Event(lambda t, y: y["z"], -1, 10.0)
    rise = Phase(Thrown(), 0.25, name="rise")
    return Mission([rise, Phase(Thrown(), fall, name="flight"), Phase(Thrown(), 0.5)]), y0


class Way:
    """An output that needs no check."""

    to_check = None

    def __call__(self, result, samples):
        return {"x": result.final["x"]}


def test_the_nominal_run_is_checked_where_the_outputs_are_not(monkeypatch):
    """No program beside that of all runs is compiled."""
    monkeypatch.setattr(_independence, "run_inputs", None)
    inputs = {"w": Normal(3.0, 0.3), "one": Constant(1.0)}
    outputs = Way()
    kept = disperse(Campaign(thrown, inputs, outputs), 600, seed=1, accuracy=1e-9)
    # The steps of a parabola are exact but for rounding.
    np.testing.assert_allclose(kept.outputs["x"], 2.0 * kept.inputs["w"] + 0.5, rtol=1e-12)
    assert kept.good.all()
    assert kept.attributes["nominal"] == {"x": pytest.approx(6.5, rel=1e-12)}
    few = disperse(Campaign(thrown, inputs, outputs), 40, seed=1, accuracy=1e-9)
    np.testing.assert_array_equal(few.outputs["x"], kept.outputs["x"][:40])
    inputs["one"] = Constant(0.0)
    with pytest.raises(SimulationError, match="The nominal run cannot be (simulated|evaluated)"):
        disperse(Campaign(thrown, inputs, outputs), 40, seed=1, accuracy=1e-9)


def test_outputs_of_the_library_are_not_checked():
    inputs = {"w": Normal(3.0, 0.3)}
    assert outputs_to_check(Campaign(thrown, inputs, landing).outputs) is None
    assert outputs_to_check(Campaign(thrown, inputs, last).outputs) is last

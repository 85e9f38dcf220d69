"""Campaigns that keep the states of their runs at chosen times."""

import subprocess
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from test_campaigns import CAMPAIGN, CHUNK, INPUTS, SEED, Swinging, files_of, fly, last

import jaxspace
from jaxspace.core import InputError
from jaxspace.dispersion import Campaign, Normal, ProcessPool, StoreError, disperse, greatest
from jaxspace.simulation import Accuracy, Event, Mission, Phase, simulate

KICK_STAGE = Path(__file__).parents[1] / "examples" / "scenes" / "kick_stage.toml"
TIMES = [0.3, 2.0, 1.0, 3.0, 5.0]
ONE_RUN = 4


def halve(t, y):
    return {"x": y["x"], "v": 0.5 * y["v"]}


def swings(samples):
    """Three phases, two of them with a jump behind."""
    system = Swinging(samples["w"])
    durations = {"first": 1.0, "second": 1.5, "third": 2.5}
    phases = [Phase(system, d, halve, name) for name, d in durations.items()]
    return Mission(phases), {"x": samples["x0"], "v": 0.0 * samples["x0"]}


def highest(result, samples):
    """The outputs read states of their own, whatever else is kept."""
    phases = result.phases
    x = greatest([p.ts for p in phases], [p.states["x"] for p in phases])
    return {"x": result.final["x"], "top": x.value, "when": x.time}


LONG = Campaign(swings, INPUTS, highest, start=0.25, along=9)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The runs of a mission of three phases, with states at chosen times."""
    path = tmp_path_factory.mktemp("times") / "s.zarr"
    flown = disperse(LONG, 600, seed=SEED, chunk=CHUNK, store=path, times=TIMES)
    return path, flown


def test_states_are_those_of_a_run_saved_at_these_times(kept):
    """Each time lies in the phase that covers it: of x at all of them, run by run, and at a border
    (1.25 s, 2.75 s) before the jump."""
    path, flown = kept
    with xarray.open_zarr(path) as data:
        times = {name: data[f"{name}.time"].values for name in ("first", "second", "third")}
        states = {name: data[f"{name}.x"].values for name in times}
        assert data["second.v"].dims == ("run", "second.sample")
    expected = {"first": [0.3, 1.0], "second": [2.0], "third": [3.0, 5.0]}
    for name, ts in expected.items():
        np.testing.assert_allclose(times[name], np.broadcast_to(ts, (600, len(ts))), rtol=1e-15)
    assert all(np.all(np.isfinite(x)) for x in states.values())
    system = Swinging(flown.inputs["w"][ONE_RUN])
    y, t = {"x": jnp.asarray(flown.inputs["x0"][ONE_RUN]), "v": jnp.zeros(())}, 0.25
    accuracy = Accuracy(rtol=1e-11)
    for name, duration in (("first", 1.0), ("second", 1.5), ("third", 2.5)):
        ts = jnp.array([t, *expected[name], t + duration])
        run = simulate(system, y, ts, accuracy=accuracy)
        # Both to 1e-9 a step, in some ten steps.
        np.testing.assert_allclose(states[name][ONE_RUN], run.states["x"][1:-1], atol=1e-8)
        y, t = halve(t, {k: x[-1] for k, x in run.states.items()}), t + duration


def test_outputs_do_not_see_what_is_kept(kept):
    flown, alone = kept[1], disperse(LONG, 600, seed=SEED, chunk=CHUNK)
    for name in ("x", "top", "when"):
        # By other save times the compiled operations round otherwise.
        np.testing.assert_allclose(flown.outputs[name], alone.outputs[name], rtol=0.0, atol=1e-12)


def test_a_store_of_other_times_is_refused_and_of_the_same_completed(kept, tmp_path):
    path = tmp_path / "copy.zarr"
    subprocess.run(["cp", "-r", kept[0], path], check=True)
    (path / ".manifest" / "1.json").unlink()
    how = {"seed": SEED, "chunk": CHUNK, "store": path, "resume": True}
    with pytest.raises(StoreError, match="the times of the states kept: "):
        disperse(LONG, 600, times=[0.3], **how)
    disperse(LONG, 600, times=TIMES, engine=ProcessPool(1), **how)
    assert files_of(path) == files_of(kept[0])


def test_borders_belong_to_the_phase_that_ends(tmp_path):
    disperse(LONG, 8, store=tmp_path / "s.zarr", times=[0.25, 1.25, 0.25 + 1.0 + 1.5 + 2.5])
    with xarray.open_zarr(tmp_path / "s.zarr") as data:
        np.testing.assert_array_equal(data["first.time"][0], [0.25, 1.25])
        np.testing.assert_array_equal(data["third.time"][0], [5.25])
        assert "second.time" not in data
        np.testing.assert_array_equal(data["third.x"].values[:, 0], data["x"].values)


def by_event(samples):
    fixed, y0 = swings(samples)
    turn = Event(lambda t, y: y["v"], within=3.0)
    return Mission([fixed.phases[0], Phase(Swinging(samples["w"]), turn, name="turn")]), y0


def scattering(samples):
    return Mission([Phase(Swinging(samples["w"]), samples["x0"], name="swing")]), swings(samples)[1]


@pytest.mark.parametrize(
    "campaign, given, words",
    [
        (LONG, [0.2], "0.2 s: it must be a time of the mission, from 0.25 s to 5.25 s"),
        (LONG, [1.0, 5.3], "5.3 s: it must be a time of the mission"),
        (LONG, [], "a list of one or more times"),
        (LONG, [np.nan], "a list of one or more times"),
        (
            Campaign(by_event, INPUTS, last),
            [0.5, 1.5],
            "at most 1 s, where the phase 'turn'",
        ),
        (Campaign(scattering, INPUTS, last), [0.5], "at most 0 s, where the phase 'swing' begins"),
    ],
)
def test_times_that_not_all_runs_pass_are_refused(campaign, given, words, tmp_path):
    with pytest.raises(InputError, match=words):
        disperse(campaign, 8, store=tmp_path / "s.zarr", times=given)


def test_times_before_an_event_are_kept(tmp_path):
    store = tmp_path / "s.zarr"
    flown = disperse(Campaign(by_event, INPUTS, last), 8, store=store, times=[0.5])
    with xarray.open_zarr(store) as data:
        x = flown.inputs["x0"] * np.cos(0.5 * flown.inputs["w"])
        np.testing.assert_allclose(data["first.x"].values[:, 0], x, rtol=0.0, atol=1e-8)
    for options in ({"times": [0.5]}, {"times": [0.5], "samples": 4, "store": tmp_path / "b"}):
        with pytest.raises(InputError, match="with a store, and without samples"):
            fly(campaign=CAMPAIGN, runs=8, **options)


@pytest.mark.sweep
def test_states_of_runs_with_breaks_of_their_own(tmp_path):
    """A motor whose burn time scatters: steps end at save times, too, which the plan must know."""
    text = KICK_STAGE.read_text().replace('until = "burnout"', 'duration = "100 s"')
    (tmp_path / "kick.toml").write_text(text)
    file, burn = jaxspace.load(tmp_path / "kick.toml"), "effects.thrust.burn_time"
    campaign = file.campaign(inputs={burn: Normal(84.1, 0.5)}, warn=False)
    for k, kept in enumerate(({"samples": 5}, {"times": [50.0, 150.0]})):
        store = tmp_path / str(k)
        flown = disperse(campaign, 64, accuracy=file.accuracy, store=store, **kept)
        with xarray.open_zarr(store) as data:
            mass = data["burn.mass"].values
        assert flown.good.all() and np.all(mass[:, 0] > mass[:, -1] - 1e-9)
        assert np.all(np.isfinite(mass))

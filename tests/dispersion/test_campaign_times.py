"""Campaigns that keep the states of their runs at chosen times."""

import subprocess
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from test_campaigns import CAMPAIGN, CHUNK, INPUTS, SEED, Swinging, files_of, fly, last

import jaxspace
from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem, InputError
from jaxspace.dispersion import Campaign, Normal, ProcessPool, StoreError, Uniform, disperse
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.scene import Scene
from jaxspace.simulation import Accuracy, Event, Mission, Phase, simulate
from jaxspace.solvers import AdaptiveRegularised, Stormer
from jaxspace.statistics.extremes import greatest

KICK_STAGE = Path(__file__).parents[2] / "examples" / "scenes" / "kick_stage.toml"
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


LONG = Campaign(swings, INPUTS, highest, start=0.25, num_saved=9)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """The runs of a mission of three phases, with states at chosen times."""
    path = tmp_path_factory.mktemp("times") / "s.zarr"
    flown = disperse(LONG, 600, seed=SEED, chunk=CHUNK, store=path, times=TIMES)
    return path, flown


def test_states_are_those_of_a_run_saved_at_these_times(stored):
    """Each time lies in the phase that covers it: of x at all of them, run by run, and at a border
    (1.25 s, 2.75 s) before the jump."""
    path, flown = stored
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


def test_outputs_do_not_see_what_is_kept(stored):
    flown, alone = stored[1], disperse(LONG, 600, seed=SEED, chunk=CHUNK)
    for name in ("x", "top", "when"):
        # By other save times the compiled operations round otherwise.
        np.testing.assert_allclose(flown.outputs[name], alone.outputs[name], rtol=0.0, atol=1e-12)


def test_a_store_of_other_times_is_refused_and_of_the_same_completed(stored, tmp_path):
    path = tmp_path / "copy.zarr"
    subprocess.run(["cp", "-r", stored[0], path], check=True)
    (path / ".manifest" / "1.json").unlink()
    how = {"seed": SEED, "chunk": CHUNK, "store": path, "resume": True}
    with pytest.raises(StoreError, match="the times of the stored states: "):
        disperse(LONG, 600, times=[0.3], **how)
    disperse(LONG, 600, times=TIMES, engine=ProcessPool(1), **how)
    assert files_of(path) == files_of(stored[0])


def test_borders_belong_to_the_phase_that_ends(tmp_path):
    disperse(LONG, 8, store=tmp_path / "s.zarr", times=[0.25, 1.25, 0.25 + 1.0 + 1.5 + 2.5])
    with xarray.open_zarr(tmp_path / "s.zarr") as data:
        np.testing.assert_array_equal(data["first.time"][0], [0.25, 1.25])
        np.testing.assert_array_equal(data["third.time"][0], [5.25])
        assert "second.time" not in data
        np.testing.assert_array_equal(data["third.x"].values[:, 0], data["x"].values)


def by_event(samples):
    """The second phase ends where the body turns back, in each run at a time of its own, and so the
    third begins there."""
    fixed, y0 = swings(samples)
    turn = Event(lambda t, y: y["v"], within=3.0)
    system = Swinging(samples["w"])
    phases = [fixed.phases[0], Phase(system, turn, name="turn"), Phase(system, 1.0, name="back")]
    return Mission(phases), y0


def scattering(samples):
    """The first phase lasts x0, about one second, and the second begins then."""
    system = Swinging(samples["w"])
    phases = [Phase(system, samples["x0"], name="swing"), Phase(system, 1.0, halve, name="more")]
    return Mission(phases), swings(samples)[1]


def exact(t, start, x, v, w):
    """Position of a swing that has the state (x, v) at its start, of each run."""
    return x * np.cos(w * (t - start)) + v / w * np.sin(w * (t - start))


def times_by_phase(store):
    """Times and positions of the store by phase, (runs, times)."""
    with xarray.open_zarr(store) as data:
        names = [name.removesuffix(".time") for name in data if name.endswith(".time")]
        return {n: (data[f"{n}.time"].values, data[f"{n}.x"].values) for n in names}


# Phases of other durations in each run are in the test below.
@pytest.mark.sweep
def test_runs_that_end_at_times_of_their_own_keep_what_their_phases_cover(tmp_path):
    """x is x0 cos(w t) to t = 1 s, where the velocity is halved; the body turns back at t', where
    tan(w (t' - 1)) = v/(w x), behind half a turn; and x is x(t') cos(w (t - t')) from there on."""
    campaign = Campaign(by_event, INPUTS, highest, num_saved=5)
    ts = [0.5, 1.0, 1.2, 1.4, 1.45, 2.0, 2.4, 9.0]
    # Of the trial: that much is known before the campaign begins.
    with pytest.warns(UserWarning, match="times has 9 s, at which none of the first 512 runs"):
        flown = disperse(campaign, 600, seed=SEED, chunk=CHUNK, store=tmp_path / "a", times=ts)
    assert flown.good.all()
    with pytest.warns(UserWarning, match="times has 9 s"):
        disperse(campaign, 600, seed=SEED, chunk=2 * CHUNK, store=tmp_path / "b", times=ts)
    stored, again = times_by_phase(tmp_path / "a"), times_by_phase(tmp_path / "b")
    jax.tree.map(np.testing.assert_array_equal, stored, again)
    w, x0, left = flown.inputs["w"][:, None], flown.inputs["x0"][:, None], np.array([ts[2:]])
    x1, v1 = x0 * np.cos(w), -0.5 * w * x0 * np.sin(w)
    turn = 1.0 + np.mod(np.arctan2(v1, w * x1), np.pi) / w
    # Of some runs on either side of the event, or of the end.
    assert all(0 < np.sum((left < turn)[:, k]) < 600 for k in (1, 2))
    assert 0 < np.sum(left[:, 4] > turn + 1.0) < 600
    expected = {
        "turn": (left <= turn, exact(left, 1.0, x1, v1, w)),
        "back": (
            (left > turn) & (left <= turn + 1.0),
            exact(left, turn, exact(turn, 1.0, x1, v1, w), 0.0, w),
        ),
    }
    np.testing.assert_array_equal(stored["first"][0], np.broadcast_to([0.5, 1.0], (600, 2)))
    for name, (covered, x) in expected.items():
        times, found = stored[name]
        np.testing.assert_array_equal(times, np.where(covered, left, np.nan))
        # To 1e-9 a step, in some ten steps.
        np.testing.assert_allclose(found, np.where(covered, x, np.nan), rtol=0.0, atol=1e-8)
    # Steps that end at the times kept are other ones, to the tolerance.
    alone = disperse(campaign, 600, seed=SEED, chunk=CHUNK)
    for name in ("x", "top"):
        np.testing.assert_allclose(flown.outputs[name], alone.outputs[name], rtol=0.0, atol=1e-8)


def test_durations_that_scatter(tmp_path):
    campaign = Campaign(scattering, INPUTS, last)
    ts = [0.0, 0.5, 1.0, 1.5, 3.0]
    with pytest.warns(UserWarning, match="times has 3 s, at which none"):
        flown = disperse(campaign, 600, store=tmp_path / "s.zarr", times=ts)
    stored, x0 = times_by_phase(tmp_path / "s.zarr"), flown.inputs["x0"][:, None]
    covered = ts <= x0
    assert 0 < np.sum(covered[:, 2]) < 600
    np.testing.assert_array_equal(stored["swing"][0], np.where(covered, ts, np.nan))
    np.testing.assert_array_equal(
        stored["more"][0], np.where(~covered & (ts <= x0 + 1.0), ts, np.nan)
    )
    for _, x in stored.values():
        exactly = np.where(np.isfinite(x), x0 * np.cos(flown.inputs["w"][:, None] * ts), np.nan)
        # As above.
        np.testing.assert_allclose(x, exactly, rtol=0.0, atol=1e-8)
    with xarray.open_zarr(tmp_path / "s.zarr") as data:
        assert "NaN where" in data.attrs["times_kept"]


# A perturbation that does nothing keeps it from the closed form.
STEPPED = Scene((PointGravity(1.0), Oblateness(1.0, 1e-14, 1.0)))


class Circling(eqx.Module):
    """A circle at the speed 1, which is left at a time of its own."""

    system: AbstractSystem

    def __call__(self, samples):
        zero = jnp.zeros_like(samples["end"])
        y0 = BodyState(jnp.stack([1.0 + zero, zero, zero]), jnp.stack([zero, 1.0 + zero, zero]))
        return Mission([Phase(self.system, samples["end"], name="circle")]), y0


@pytest.mark.parametrize(
    "method",
    [
        None,
        pytest.param(AdaptiveRegularised(), marks=pytest.mark.sweep),
        pytest.param(Stormer(steps=64), marks=pytest.mark.sweep),
    ],
    ids=str,
)
def test_methods_that_take_no_steps_or_other_ones(method, tmp_path):
    """The closed form; steps that each run chooses for itself; and equal steps."""
    build = Circling(TwoBody(1.0) if method is None else STEPPED)
    inputs = {"end": Uniform(1.0, 3.0)}
    campaign = Campaign(build, inputs, lambda r, s: {"x": r.final.position[0]})
    how = {} if method is None else {"method": method}
    flown = disperse(
        campaign, 64, store=tmp_path / "s", times=[0.3, 2.0], accuracy=Accuracy(rtol=1e-9, **how)
    )
    with xarray.open_zarr(tmp_path / "s") as data:
        x, y, _ = np.moveaxis(data["circle.position"].values, 1, 0)
    covered = flown.inputs["end"][:, None] >= [0.3, 2.0]
    assert 0 < np.sum(covered[:, 1]) < 64
    # A third of a turn in steps of 1e-9 each, some ten of them.
    for found, exactly in ((x, np.cos([0.3, 2.0])), (y, np.sin([0.3, 2.0]))):
        np.testing.assert_allclose(found, np.where(covered, exactly, np.nan), rtol=0.0, atol=1e-7)


@pytest.mark.sweep
def test_times_of_the_demonstration(tmp_path):
    """In burn and coast of the kick stage, whose burn time scatters: the states of a run are those
    of its replay, which saves them within adaptive steps."""
    file = jaxspace.load(KICK_STAGE)
    campaign = file.campaign(warn=False)
    run = campaign.replay(ONE_RUN, seed=SEED, accuracy=file.accuracy, num_saved=7).trajectory
    picked = {"burn": [1, 3, 6], "coast": [2, 6]}
    times = [float(run[name].ts[n]) for name, k in picked.items() for n in k]
    flown = disperse(
        campaign, 64, seed=SEED, accuracy=file.accuracy, store=tmp_path / "s", times=times
    )
    assert flown.good.all()
    # What 1 km of height and 0.01 rad would be a thousandth of.
    tolerances = {"position": 1.0, "velocity": 1e-2, "mass": 1e-6, "omega": 1e-5}
    with xarray.open_zarr(tmp_path / "s") as data:
        for name, k in picked.items():
            ts = data[f"{name}.time"].values
            here = np.isin(times, np.asarray(run[name].ts)[k])
            np.testing.assert_array_equal(np.isfinite(ts[ONE_RUN]), here)
            # In other runs the time of burnout lies on either side.
            assert 0 < np.isfinite(ts[:, 2]).sum() < 64
            for part, atol in tolerances.items():
                states = data[f"{name}.{part}"].values[ONE_RUN][..., here]
                replayed = np.asarray(getattr(run[name].states, part))[..., np.array(k)]
                np.testing.assert_allclose(states, replayed, rtol=0.0, atol=atol)


@pytest.mark.parametrize(
    "campaign, given, words",
    [
        (LONG, [0.2], "0.2 s: it must be a time of the mission, from 0.25 s to 5.25 s"),
        (LONG, [1.0, 5.3], "5.3 s: it must be a time of the mission"),
        (LONG, [], "a list of one or more times"),
        (LONG, [np.nan], "a list of one or more times"),
        (Campaign(scattering, INPUTS, last), [-1.0, 0.5], "-1 s: it must be .* from 0 s on"),
    ],
)
def test_times_beside_the_mission_are_refused(campaign, given, words, tmp_path):
    with pytest.raises(InputError, match=words):
        disperse(campaign, 8, store=tmp_path / "s.zarr", times=given)


def test_times_need_a_store(tmp_path):
    for options in ({"times": [0.5]}, {"times": [0.5], "samples": 4, "store": tmp_path / "b"}):
        with pytest.raises(InputError, match="with a store, and without samples"):
            fly(campaign=CAMPAIGN, runs=8, **options)


@pytest.mark.sweep
def test_states_of_runs_with_breaks_of_their_own(tmp_path):
    """A motor whose burn time scatters: steps end at save times, too."""
    text = KICK_STAGE.read_text().replace('until = "burnout"', 'duration = "100 s"')
    (tmp_path / "kick.toml").write_text(text)
    file, burn = jaxspace.load(tmp_path / "kick.toml"), "effects.thrust.burn_time"
    campaign = file.campaign(inputs={burn: Normal(84.1, 0.5)}, warn=False)
    for k, stored in enumerate(({"samples": 5}, {"times": [50.0, 150.0]})):
        store = tmp_path / str(k)
        flown = disperse(campaign, 64, accuracy=file.accuracy, store=store, **stored)
        with xarray.open_zarr(store) as data:
            mass = data["burn.mass"].values
        assert flown.good.all() and np.all(mass[:, 0] > mass[:, -1] - 1e-9)
        assert np.all(np.isfinite(mass))

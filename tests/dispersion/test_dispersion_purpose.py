"""The tolerance of a campaign by its purpose: it is the loosest one whose errors, against closed
forms, are a twentieth of the sampling errors; a store keeps it; and any tolerance shows its
errors."""

import jax
import numpy as np
import pytest
from test_dispersion import UNITS, Oscillator, Swing, drifts, last
from test_io_final_error import ASKED
from test_io_final_error import SCENE as ORBIT

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import Campaign, Normal, Uniform, disperse, open_store
from jaxspace.dispersion._by_purpose import RUNGS, tolerance_by_purpose
from jaxspace.dispersion._engine import MEASURED
from jaxspace.dispersion.purpose import ByPurpose
from jaxspace.io import SceneError, load
from jaxspace.simulation import Accuracy, Mission, Phase, SimulationError
from jaxspace.stores.results import RunResults

DURATION, RUNS = 10.0, 1000
# So narrow that the loosest tolerances do not serve.
INPUTS = {
    "stiffness": Normal(4.0, 2e-4),
    "x0": Uniform(0.9999, 1.0001),
    "v0": Normal(0.0, 1e-4),
}


def swings(samples):
    system = Oscillator(jax.numpy.sqrt(samples["stiffness"]))
    return Mission([Phase(system, DURATION)]), Swing(samples["x0"], samples["v0"])


CAMPAIGN = Campaign(swings, INPUTS, last, UNITS, accuracy="by purpose")


def true_errors(d):
    """The errors of both outputs, by the closed form: in squares the mean over all runs."""
    w = np.sqrt(np.abs(d.inputs["stiffness"]))
    c, s = np.cos(w * DURATION), np.sin(w * DURATION)
    x0, v0 = d.inputs["x0"], d.inputs["v0"]
    exact = {"x": x0 * c + v0 * s / w, "v": v0 * c - x0 * w * s}
    return {n: float(np.sqrt(np.mean((d.outputs[n] - exact[n]) ** 2))) for n in exact}


def allowed(d):
    return {n: float(np.std(x, ddof=1)) / np.sqrt(d.runs) / 20.0 for n, x in d.outputs.items()}


@pytest.fixture(scope="module")
def found():
    return disperse(CAMPAIGN, RUNS, seed=3)


def test_the_loosest_tolerance_that_serves(found):
    rtol = found.purpose.tolerance
    assert 1e-9 < rtol < RUNGS[0] and found.attributes["rtol"] == rtol
    errors, limits = true_errors(found), allowed(found)
    assert all(errors[n] <= limits[n] for n in errors)
    # The estimate is that of the first 512 of these runs.
    for row in found.table():
        np.testing.assert_allclose(row.numerical_error, errors[row.name], rtol=0.1)
        share = 100.0 * row.numerical_error / row.std
        assert row.numerical_words == f"{share:.1g} % of std" and row.numerical_words in repr(found)
    # Of so many runs the errors at a given tolerance are measured.
    looser = disperse(CAMPAIGN, MEASURED, seed=3, accuracy=RUNGS[RUNGS.index(rtol) - 1])
    errors = true_errors(looser)
    assert any(errors[n] > limits[n] for n in errors)
    # A tolerance that is given stays what it is, and shows its errors.
    assert looser.purpose is None
    for row in looser.table():
        # To a tenth by the runs at a tenth of the tolerance, and to another by their number.
        np.testing.assert_allclose(row.numerical_error, errors[row.name], rtol=0.2)
    default = disperse(CAMPAIGN, RUNS, seed=3, accuracy=1e-9)
    share = np.sum(found.evaluations) / np.sum(default.evaluations)
    np.testing.assert_allclose(found.purpose.evaluations, share, rtol=0.05)
    assert f"{100.0 * (1.0 - found.purpose.evaluations):.0f} % fewer" in found.purpose.sentence


def test_a_store_keeps_it(found, tmp_path, monkeypatch):
    path = tmp_path / "swings.zarr"

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        disperse(CAMPAIGN, RUNS, seed=3, chunk=512, store=path, progress=stop)
    # Not searched again, for processors round differently.
    monkeypatch.setattr("jaxspace.dispersion._engine.tolerance_by_purpose", None)
    resumed = disperse(CAMPAIGN, RUNS, seed=3, chunk=512, store=path, resume=True)
    assert resumed.purpose == open_store(path).purpose == found.purpose
    np.testing.assert_array_equal(resumed.outputs["x"], found.outputs["x"])
    rtol = found.purpose.tolerance
    replayed = CAMPAIGN.replay(2, seed=3, accuracy=rtol)
    # Its steps are its own, and those of the campaign are shared.
    assert abs(replayed.outputs["x"] - found.outputs["x"][2]) < 0.01 * np.std(found.outputs["x"])
    assert replayed.trajectory.phases[0].accuracy.rtol == rtol


def test_of_a_closed_form_there_is_nothing_to_find():
    d = disperse(Campaign(drifts, INPUTS, last, UNITS), 600, accuracy="by purpose")
    assert d.purpose is not None and d.purpose.tolerance == 1e-9 and "default" in d.purpose.sentence
    assert "numerical_errors" not in d.attributes and "numerical error" not in repr(d)


def simulated(slope, fails=()):
    """Runs whose errors are as large as their tolerance times `slope`."""
    y = np.linspace(-1.0, 1.0, 512)

    def runs(rtol):
        if rtol in fails:
            raise SimulationError("The nominal run cannot be simulated.")
        outputs = {"y": y + slope * rtol, "same": np.full(512, 3.0) + rtol}
        steps = np.full(512, rtol ** (-1.0 / 8.0))
        return RunResults({}, outputs, np.zeros(512, int), steps, {})

    return runs


@pytest.mark.parametrize("slope", [1e-3, 1.0, 30.0, 1e3, 1e6])
def test_the_search_ends_at_the_loosest_of_those_tried(slope):
    tolerance = tolerance_by_purpose(simulated(slope), 10_000).purpose.tolerance
    # The deviation of these numbers is 1/sqrt(3) of their half range.
    limit = np.std(np.linspace(-1.0, 1.0, 512), ddof=1) / 100.0 / 20.0
    assert tolerance == max(r for r in RUNGS if slope * r <= limit)


def test_where_none_serves_and_where_the_tightest_cannot_be_run():
    with pytest.warns(
        UserWarning, match="tightest .* times the allowed one.* limiting output is y"
    ):
        found = tolerance_by_purpose(simulated(1e9), 10_000)
    assert found.purpose.tolerance == 1e-11 and found.purpose.excess > 1.0
    # Then with the tightest that can, if only the default.
    for fails in ((1e-12, 1e-11), (1e-12, 1e-11, 1e-10)):
        found = tolerance_by_purpose(simulated(1.0, fails), 10_000)
        assert found.purpose.tolerance == 1e-4 and found.purpose.excess < 1.0
    with pytest.raises(SimulationError):
        tolerance_by_purpose(simulated(1.0, fails=(1e-12, 1e-11, 1e-10, 1e-9)), 10_000)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: disperse(CAMPAIGN, 10, accuracy="by purpos"), 'accuracy is .by purpos.* "by purp'),
        (lambda: Campaign(swings, INPUTS, last, accuracy="best"), "accuracy is 'best': it must be"),
        (lambda: ByPurpose(Accuracy(1e-9)), "ByPurpose.accuracy sets a tolerance"),
    ],
)
def test_what_makes_no_sense_is_refused(make, said):
    with pytest.raises(InputError, match=said):
        make()


SCENE = ORBIT.replace(ASKED, 'accuracy = "by purpose"\nmax_steps = 5000')
SCENE = SCENE.replace('"10 h"', '"2 h"').replace("outputs =", "runs = 600\noutputs =")


def test_a_scene_file_asks_for_it_and_the_commands_take_it(tmp_path, capsys):
    path = tmp_path / "orbit.toml"
    path.write_text(SCENE)
    file = load(path)
    accuracy = file.campaign().accuracy
    assert isinstance(accuracy, ByPurpose) and accuracy.accuracy.max_steps == 5000
    # The nominal run has the default tolerance.
    assert file.tolerance == file.accuracy.rtol == 1e-9
    assert main(["disperse", str(path), "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    stored = open_store(tmp_path / "orbit.zarr")
    assert stored.purpose is not None and stored.purpose.tolerance > 1e-9
    assert stored.purpose.sentence in told and stored.table()[0].numerical_words in told
    page = (tmp_path / "orbit.html").read_text()
    assert "numerical error" in page and stored.purpose.sentence in page
    assert main(["replay", str(tmp_path / "orbit.zarr"), "--run", "7", "--out", str(tmp_path)]) == 0
    # To the digits that the report shows the speed is that of the campaign.
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("speed")]
    np.testing.assert_allclose(*map(float, line.split()[-2:]), rtol=1e-5)


def test_a_file_without_a_campaign_has_no_purpose():
    without = SCENE[: SCENE.index("[dispersion]")]
    with pytest.raises(SceneError, match=r'accuracy is "by purpose": .* without \[dispersion\]'):
        load("orbit.toml", text=without)
    with pytest.raises(SceneError, match='accuracy is "by purpos": .*, or "by purpose"'):
        load("orbit.toml", text=SCENE.replace('"by purpose"', '"by purpos"'))

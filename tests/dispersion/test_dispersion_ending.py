"""Campaigns that end themselves, and those that make no runs: the stop rule through every way in
and out, the cheaper methods by the same call."""

import dataclasses
import warnings

import numpy as np
import pytest
from test_campaign_commands import COAST
from test_campaigns import CAMPAIGN, CHUNK, SEED, files_of
from unchecked import unchecked

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import (
    DamagedStore,
    Dispersion,
    ProcessPool,
    StopRule,
    StoreError,
    disperse,
    moments,
    open_store,
)
from jaxspace.dispersion.covariance import Moments
from jaxspace.io import SceneError, load
from jaxspace.io.reports.campaign_tables import status_lines

# Some 2000 runs know that much of x.
RULE = StopRule("x", 0.95, 0.03)
MOST = 20 * CHUNK


def fly(store=None, **options):
    return disperse(CAMPAIGN, MOST, seed=SEED, chunk=CHUNK, store=store, until=RULE, **options)


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    path = tmp_path_factory.mktemp("ended") / "s.zarr"
    fly(path)
    return path


def test_a_campaign_ends_when_its_limit_is_known(ended):
    kept = open_store(ended)
    assert 2 * CHUNK <= kept.runs < MOST / 2 and kept.runs % CHUNK == 0
    assert kept.enough == kept.planned_runs == kept.runs
    limit = kept.percentile("x", 0.95)
    distance = abs(limit.value - kept.table()[0].mean)
    assert 0.5 * (limit.high - limit.low) <= 0.03 * distance
    # One checkpoint before it was not known so well.
    fewer = {"x": kept.outputs["x"][: kept.runs - CHUNK]}
    assert not RULE.met(fewer["x"])
    in_memory = fly()
    assert in_memory.enough == kept.runs
    np.testing.assert_array_equal(in_memory.outputs["x"], kept.outputs["x"])


def test_other_libraries_see_the_runs_that_there_are(ended):
    import xarray
    import zarr

    runs = open_store(ended).runs
    with xarray.open_zarr(ended) as data:
        assert data.sizes["run"] == runs and np.isfinite(data["x"]).all()
    assert zarr.open_array(ended / "x").shape == (runs,)
    assert not [f for f in files_of(ended) if int(f.split("/")[2]) >= runs // CHUNK]


def test_a_restart_ends_with_the_same_run(ended, tmp_path):
    """Stopped after its first chunk, and once more after the end has been written in part."""
    store = tmp_path / "s.zarr"

    def stop(done, total):
        if done >= 2 * CHUNK:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly(store, progress=stop)
    assert open_store(store).runs == 2 * CHUNK and open_store(store).planned_runs == MOST
    fly(store, resume=True)
    assert files_of(store) == files_of(ended)
    # A chunk that is lost comes back, and the end stays where it was.
    (store / "x" / "c" / "1").unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedStore)
        fly(store, resume=True)
    assert files_of(store) == files_of(ended)


def test_an_end_that_was_not_written_is_written_by_resume(ended, tmp_path, monkeypatch):
    from jaxspace.stores import writer as _store_writer

    store, write = tmp_path / "s.zarr", _store_writer.write_whole

    def dying(path, data):
        # The head of the store says that it has ended; no array knows it yet.
        if path.parent.name == "run" and b"zarr_format" in data and (store / "zarr.json").exists():
            raise KeyboardInterrupt
        write(path, data)

    monkeypatch.setattr(_store_writer, "write_whole", dying)
    with pytest.raises(KeyboardInterrupt):
        fly(store)
    monkeypatch.undo()
    fly(store, resume=True)
    assert files_of(store) == files_of(ended)
    import zarr

    assert zarr.open_array(store / "run").shape == (open_store(ended).runs,)


def test_other_processes_end_at_the_same_run(ended, tmp_path):
    fly(tmp_path / "s.zarr", engine=ProcessPool(1))
    assert files_of(tmp_path / "s.zarr") == files_of(ended)


def test_another_rule_is_another_campaign(ended):
    for until in (None, dataclasses.replace(RULE, precision=0.04)):
        with pytest.raises(StoreError, match="the rule that ends it"):
            disperse(
                *(CAMPAIGN, MOST),
                **{"seed": SEED, "chunk": CHUNK, "store": ended, "until": until, "resume": True},
            )


@pytest.mark.parametrize(
    "rule, words",
    [
        (("z",), "until.output is 'z': it must be one of x, v"),
        (("x", 1.5), "StopRule.share is 1.5"),
        (("x", 0.9, 0.0), "StopRule.precision is 0.0"),
        (("x", "99 %"), "StopRule.share is '99 %': it must be a number"),
    ],
)
def test_an_impossible_rule_is_refused(rule, words):
    with unchecked(), pytest.raises(InputError, match=words):
        disperse(CAMPAIGN, CHUNK, seed=SEED, chunk=CHUNK, until=StopRule(*rule))


# -------------------------------------------------------------------------- methods without runs


def test_disperse_by_a_method_without_runs():
    with pytest.warns(UserWarning, match="lincov is not reliable for"):
        found = disperse(CAMPAIGN, method="lincov")
    assert isinstance(found, Moments) and found.runs == 1
    np.testing.assert_array_equal(found.covariance, moments(CAMPAIGN, check=0).covariance)
    with pytest.raises(InputError, match="method is 'guess'"):
        disperse(CAMPAIGN, method="guess")
    for given in ({"store": "s.zarr"}, {"runs": 500}, {"seed": 1}, {"until": StopRule("b")}):
        with pytest.raises(InputError, match="the method 'lincov' computes no runs"):
            disperse(CAMPAIGN, method="lincov", **given)


@pytest.mark.usefixtures("settings_stay")
def test_file_and_command_line(tmp_path, capsys):
    """The rule of the file, that of the command line, the methods beside the runs."""
    own = 'compare = ["lincov"]\nuntil = { output = "periapsis_altitude", precision = 0.2 }\n'
    path = tmp_path / "coast.toml"
    path.write_text(COAST.replace("seed = 3", f"seed = 3\n{own}").replace("1200", "20000"))
    given = ["disperse", str(path), "--out", str(tmp_path), "--chunk", "512"]
    assert main(given) == 0
    printed = capsys.readouterr().out
    assert "at most 20000 runs, seed 3, until the 99th percentile of periapsis_altitude" in printed
    kept = open_store(tmp_path / "coast.zarr")
    assert kept.enough and f"Stopped after {kept.enough} runs: " in printed
    rows = [line.split() for line in printed.splitlines()]
    (row,) = [r for r in rows if r[:2] == ["periapsis_altitude", "lincov"]]
    (reference,) = [r for r in rows if r[:2] == ["periapsis_altitude", "monte_carlo"]]
    # Of a linear output both agree to five standard errors, which stand beside it.
    assert abs(float(row[3])) < 5.0 * float(reference[3].strip("±")) and row[-2] == "1"


@pytest.mark.sweep
@pytest.mark.usefixtures("settings_stay")
def test_the_command_line_goes_before_the_file(tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(COAST.replace("1200", "20000"))
    given = ["disperse", str(path), "--out", str(tmp_path), "--chunk", "512"]
    assert main([*given, "--until", "periapsis_altitude:0.9:0.3"]) == 0
    words = "until the 90th percentile of periapsis_altitude is known to 30 %"
    assert words in capsys.readouterr().out
    kept = open_store(tmp_path / "coast.zarr")
    assert main(["resume", str(tmp_path / "coast.zarr")]) == 0
    assert f"of {kept.enough} runs succeeded" in capsys.readouterr().out
    assert main([*given[:-2], "--method", "unscented"]) == 0
    printed = capsys.readouterr().out
    assert "A coast: unscented" in printed and "5 runs" in printed


@pytest.mark.parametrize("rule", ["x:2", "x:0.9:0.1:3", ":0.9", "x:a"])
def test_a_rule_that_cannot_be_read(rule, capsys):
    with pytest.raises(SystemExit):
        main(["disperse", "coast.toml", "--until", rule])
    assert "between 0 and 1" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line, words",
    [
        ('until = { output = "apogee" }', 'dispersion.until.output = "apogee"'),
        ('until = { output = "apoapsis_altitude", share = 1.0 }', "dispersion.until.share"),
        ('compare = ["guess"]', "dispersion.compare"),
    ],
)
def test_what_is_wrong_in_a_file(tmp_path, line, words):
    path = tmp_path / "coast.toml"
    path.write_text(COAST.replace("seed = 3", f"seed = 3\n{line}"))
    with pytest.raises(SceneError, match=words):
        load(path)


def test_the_report_says_when_a_hypercube_is_not_complete():
    def told(runs):
        attributes = {"planned_runs": 20, "inputs": "w [rad/s]: normal\ndesign: LatinHypercube"}
        x = {"x": np.arange(float(runs))}
        kept = Dispersion(x, x, np.zeros(runs, int), np.ones(runs, int), {}, 0, 1.0, attributes)
        return status_lines(kept)

    assert told(20) == "20 of 20 runs succeeded."
    assert told(8).endswith(
        "8 of 20 runs of a Latin hypercube: only the complete set is evenly distributed."
    )


def test_every_report_says_that_a_campaign_has_ended_itself(ended):
    kept = open_store(ended)
    words = f"Stopped after {kept.runs} runs: the 95th percentile of x is known to 3 %."
    assert kept.ending == words and status_lines(kept).splitlines()[-1] == words

"""The commands of campaigns: resume, replay, failures, and the end of a campaign by a signal."""

import dataclasses
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.stats import binomtest
from test_campaigns import child, write

from jaxspace.cli import main
from jaxspace.cli._parser import parser, with_joined_runs
from jaxspace.core import InputError
from jaxspace.dispersion import Dispersion, disperse, open_store
from jaxspace.io import SceneError, SceneFile, load
from jaxspace.io.reports.campaign import failures_report
from jaxspace.io.reports.campaign_tables import dispersion_report
from jaxspace.simulation import Status
from jaxspace.statistics.requirements import Requirement

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")

ROOT = Path(__file__).resolve().parents[2]
COAST = """
title = "A coast"
accuracy = 1e-6

[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[initial.orbit]
periapsis_altitude = "400 mi"
eccentricity = 0.1

[[phase]]
name = "coast"
effects = ["point_gravity"]
duration = "10 min"

[dispersion]
runs = 1200
seed = 3
outputs = ["periapsis_altitude", "apoapsis_altitude"]

[dispersion.inputs]
"initial.orbit.periapsis_altitude" = { deviation = "2 km" }
"initial.orbit.eccentricity" = { deviation = 0.05 }
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Path:
    """The store of the coast, flown by the command line; the scene file is gone since."""
    folder = tmp_path_factory.mktemp("coast")
    (folder / "coast.toml").write_text(COAST)
    assert main(["disperse", str(folder / "coast.toml"), "--out", str(folder)]) == 0
    (folder / "coast.toml").unlink()
    return folder / "coast.zarr"


@pytest.fixture
def store(flown, tmp_path) -> Path:
    return Path(shutil.copytree(flown, tmp_path / "coast.zarr"))


def test_disperse_refuses_a_store_that_is_there(store, tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(COAST)
    given = ["disperse", str(path), "--out", str(tmp_path), "--runs", "40"]
    assert main(given) == 2
    assert "already contains 1200 of 1200 runs" in capsys.readouterr().err
    there = open_store(store)
    assert there.runs == 1200
    # By the program of the runs: 400 mi.
    nominal = there.attributes["nominal"]["periapsis_altitude"]
    assert nominal == pytest.approx(400.0, rel=1e-9)
    assert main([*given, "--overwrite"]) == 0
    assert open_store(store).runs == 40


@pytest.mark.parametrize("options", [[], ["--overwrite"]])
def test_a_stop_before_the_first_run_leaves_what_is_there(
    options, store, tmp_path, capsys, monkeypatch
):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(SceneFile, "nominal_mission", stop)
    path = tmp_path / "coast.toml"
    path.write_text(COAST)
    assert main(["disperse", str(path), "--out", str(tmp_path), *options]) == 130
    told = capsys.readouterr().err
    assert f"stopped before the first run: nothing was computed, and {store} is unchanged" in told
    assert "resume" not in told
    # Of a campaign that is resumed the runs are its own.
    assert main(["resume", str(store)]) == 130
    assert "1200 of 1200 runs are stored" in capsys.readouterr().err


RUN = "import sys; from jaxspace.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.mark.parametrize("engine", ["processes", pytest.param("dask", marks=pytest.mark.sweep)])
def test_engines_of_the_command_line(flown, tmp_path, engine):
    """Three chunks on other processes: the runs are those of this one, to the bit."""
    if engine == "dask":
        pytest.importorskip("distributed")
    (tmp_path / "coast.toml").write_text(COAST)
    given = ["disperse", str(tmp_path / "coast.toml"), "--out", str(tmp_path), "--chunk", "512"]
    # In a process of its own: the types that tests check cannot be sent to another one.
    process = child(RUN, *given, "--engine", engine)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    found, expected = open_store(tmp_path / "coast.zarr"), open_store(flown)
    assert found.attributes["chunk"] == 512 and found.runs == 1200
    for name in expected.units:
        np.testing.assert_array_equal(found.values(name), expected.values(name))


def test_an_engine_that_is_not_known_ends_with_status_2(store, capsys):
    assert main(["resume", str(store), "--engine", "desk"]) == 2
    assert "engine is 'desk': it must be one of local, processes" in capsys.readouterr().err


def test_resume_computes_what_is_missing_or_damaged(flown, store, capsys):
    """The scene is in the store, which needs no file beside it."""
    chunk = store / "apoapsis_altitude" / "c" / "0"
    data = bytearray(chunk.read_bytes())
    data[5] ^= 16
    chunk.write_bytes(data)
    assert main(["resume", str(store)]) == 0
    printed = capsys.readouterr()
    assert (
        "apoapsis_altitude/c/0 does not match its checksum. The chunk is computed again."
        in printed.err
    )
    assert "of 1200 runs succeeded" in printed.out and "% of" in printed.out
    assert chunk.read_bytes() == (flown / "apoapsis_altitude" / "c" / "0").read_bytes()
    assert store.with_suffix(".png").exists()


def test_replay_flies_one_run_again(store, tmp_path, capsys, monkeypatch):
    titles = []
    campaigns = "jaxspace.cli._campaigns"
    drawn = importlib.import_module(campaigns).draw
    monkeypatch.setattr(f"{campaigns}.draw", lambda *a: titles.append(a[3]) or drawn(*a))
    monkeypatch.setattr(f"{campaigns}.show_page", lambda *a: titles.append(a[3]))
    assert main(["replay", str(store), "--run", "17", "--out", str(tmp_path / "a"), "--show"]) == 0
    # Those of the picture of each phase, and of the page with all of them.
    assert titles == ["A coast, run 17: coast", "A coast, run 17"]
    printed = capsys.readouterr().out
    kept = open_store(store)
    assert "A coast: run 17, seed 3" in printed and "reached its end" in printed
    rows = [line.split() for line in printed.splitlines()]
    (row,) = [r for r in rows if r[:1] == ["periapsis_altitude"]]
    assert row[2] == row[3] == f"{kept.outputs['periapsis_altitude'][17]:.6g}"
    assert (tmp_path / "a" / "coast_run_17_coast.png").exists()
    # In the units of the file, which gives the height in miles.
    (row,) = [r for r in rows if r[:1] == ["initial.orbit.periapsis_altitude"]]
    height = kept.inputs["initial.orbit.periapsis_altitude"][17] / 1609.344
    assert row[1:] == ["mi", "400", f"{height:.6g}"] and "coast: from 0 min to 10 min" in printed
    extreme = ["replay", str(store), "--run", "greatest", "apoapsis_altitude"]
    assert main([*extreme, "--out", str(tmp_path / "a")]) == 0
    values = np.where(kept.good, kept.outputs["apoapsis_altitude"], -np.inf)
    assert f"run {np.argmax(values)}, seed 3" in capsys.readouterr().out
    assert main(["replay", str(store), "--run", "1200"]) == 2
    assert "--run is 1200: it must be from 0 to 1199." in capsys.readouterr().err
    # One that `failures` lists: it cannot be flown, and the reason is the one that stands there.
    refused = np.flatnonzero(kept.status == Status.REFUSED)[0]
    assert main(["replay", str(store), "--run", str(refused)]) == 2
    told = capsys.readouterr().err
    value = f"{kept.inputs['initial.orbit.eccentricity'][refused]:.6g}"
    assert f"Run {refused} is rejected: initial.orbit.eccentricity is {value}: it must be" in told


def test_states_at_chosen_times(tmp_path, capsys):
    """Stored by `disperse`, and asked for once more by `resume`."""
    import xarray

    (tmp_path / "coast.toml").write_text(COAST)
    given = ["disperse", str(tmp_path / "coast.toml"), "--out", str(tmp_path), "--runs", "8"]
    assert main([*given, "--times", "0, 1 min,599.5"]) == 0
    store = tmp_path / "coast.zarr"
    with xarray.open_zarr(store) as data:
        np.testing.assert_allclose(data["coast.time"][3], [0.0, 60.0, 599.5], rtol=1e-15)
        # Along the orbit at perigee, 10 km/s times a minute: the chord of one minute in m.
        way = data["coast.position"].sel(run=3).values
        assert np.linalg.norm(way[:, 1] - way[:, 0]) == pytest.approx(4.7e5, rel=0.02)
    (store / ".manifest" / "0.json").unlink()
    assert main(["resume", str(store)]) == 0
    assert main([*given, "--overwrite", "--times", "601"]) == 2
    assert "must be a time of the mission, from 0 s to 600 s" in capsys.readouterr().err
    for text in ("0,now", "0,2 km", "0,,1", "nan"):
        assert main([*given, "--overwrite", "--times", text]) == 2
        told = capsys.readouterr().err
        assert "--times is" in told and 'with a unit of time, such as "90 min".' in told


def test_failures_gives_the_reason_of_each(store, capsys):
    kept = open_store(store)
    bad = np.flatnonzero(kept.inputs["initial.orbit.eccentricity"] < 0.0)
    # Two deviations below the mean: 2.3 % of 1200 runs, 27 +- 5.
    assert 5 < bad.size < 55
    assert main(["failures", str(store), "--all"]) == 0
    printed = capsys.readouterr().out
    assert f"{bad.size} runs, REFUSED" in printed
    for number in bad:
        assert f"  run {number}: initial.orbit.eccentricity is -0.0" in printed
    assert main(["failures", str(store)]) == 0
    printed = capsys.readouterr().out
    assert printed.count("\n  run ") == min(bad.size, 20)


def test_a_campaign_from_python_is_not_the_command_line_s(tmp_path, capsys):
    file = tmp_path / "coast.toml"
    file.write_text(COAST)
    campaign = load(file).campaign(warn=False)
    disperse(campaign, 20, store=tmp_path / "s.zarr", accuracy=1e-6)
    assert main(["resume", str(tmp_path / "s.zarr")]) == 2
    assert "campaign defined in Python" in capsys.readouterr().err
    assert main(["failures", str(tmp_path / "s.zarr")]) == 0


# That a store is not whole, is mended, and what violates a requirement, smaller tests show as well.
@pytest.mark.sweep
def test_a_store_that_is_not_whole_says_so_everywhere(tmp_path, capsys):
    """A chunk that was not finished, and one that is damaged; with a requirement, whose violations
    count both kinds of limits and the failed runs."""
    limit = '{ output = "periapsis_altitude", at_least = "-1 km", at_most = "643.7376 km" }'
    (tmp_path / "coast.toml").write_text(COAST.replace('"periapsis_altitude",', f"{limit},", 1))
    given = ["disperse", str(tmp_path / "coast.toml"), "--out", str(tmp_path), "--chunk", "512"]
    assert main([*given, "--runs", "1536"]) == 0
    printed = capsys.readouterr().out
    store = tmp_path / "coast.zarr"
    found = open_store(store).violations()["periapsis_altitude"]
    (row,) = [line for line in printed.splitlines() if "643.738" in line]
    # At most the mean: about one half, to five standard errors.
    assert found.value == pytest.approx(0.5, abs=0.07)
    shares = " to ".join(f"{100.0 * x:.3g} %" for x in (found.low, found.high))
    assert row.split()[1:7] == ["≥", "-1", "and", "≤", "643.738", "km"]
    assert f"{found.count} of 1536" in row and shares in row
    (store / ".manifest" / "0.json").unlink()
    damaged = store / "apoapsis_altitude" / "c" / "1"
    damaged.write_bytes(damaged.read_bytes()[:-9])
    for command in ("report", "failures"):
        assert main([command, str(store)]) == 0
        printed = capsys.readouterr()
        assert "of 512 runs succeeded" in printed.out
        assert (
            f"512 of 1536 planned runs are in the store: `jaxspace resume {store}` computes the "
            f"rest." in printed.out
        )
        # One line, without the place in the source.
        (line,) = printed.err.splitlines()
        assert line.startswith(f"{store}: Chunk 1 (runs 512 to 1023): apoapsis_altitude/c/1 has")
    page = (tmp_path / "coast.html").read_text(encoding="utf-8")
    assert "512 of 1536 planned runs are in the store" in page
    assert main(["resume", str(store)]) == 0
    assert "planned runs" not in capsys.readouterr().out


def small(**outputs):
    """Eight runs with these outputs, of which the second one has failed."""
    inputs = {"a": np.arange(8.0)}
    status = np.array([0, 5, *6 * [0]])
    record = {"requirements": {"x": [None, 3.0]}, "inputs": ""}
    return Dispersion(inputs, outputs, status, np.ones(8, int), {"x": "km"}, 0, attributes=record)


def judged(count, runs, **required):
    """Runs of which so many violate x <= 0, with what is required besides."""
    x = np.where(np.arange(runs) < count, 1.0, -1.0 - np.arange(runs))
    record = {"requirements": {"x": Requirement(high=0.0, **required).record}, "inputs": ""}
    zero = np.zeros(runs, int)
    return Dispersion({"a": x}, {"x": x}, zero, zero, {"x": "km"}, 0, attributes=record)


def test_a_requirement_with_an_allowed_share_has_a_verdict():
    """By the interval of Clopper and Pearson: without a violation its end is 1 - 0.025^(1/n)."""
    # 1 - 0.025^(1/368) is 0.00997, and 1 - 0.025^(1/366) is 0.01003.
    words = {(0, 368): "pass", (0, 366): "not yet known", (5, 100): "fail"}
    for (count, runs), word in words.items():
        (verdict,) = judged(count, runs, allowed=0.01).verdicts.values()
        low, high = binomtest(count, runs).proportion_ci(0.95, "exact")
        assert verdict.word == word and verdict.allowed == 0.01
        np.testing.assert_allclose(verdict.violation[1:3], (low, high), rtol=1e-10, atol=1e-15)
    # More confidence makes the interval wider.
    assert judged(0, 368, allowed=0.01, confidence=0.99).verdicts["x"].word == "not yet known"
    assert judged(0, 9).verdicts == {} and judged(0, 9).requirements == {"x": (None, 0.0)}
    report = dispersion_report(judged(0, 368, allowed=0.01), {})
    (row,) = [line for line in report.splitlines() if "≤" in line]
    assert row.split()[-3:] == ["1", "%", "pass"]
    assert "verdict" not in dispersion_report(judged(0, 9), {})


@pytest.mark.parametrize("count, runs, allowed", [(0, 100, 0.01), (6, 1000, 0.01), (13, 999, 0.01)])
def test_an_open_verdict_names_the_number_of_runs_that_decides(count, runs, allowed):
    """By SciPy's interval at the present share of violations: it excludes the allowed share at the
    number that the verdict names, and does not at nine tenths of it."""
    verdict = judged(count, runs, allowed=allowed).verdicts["x"]
    assert verdict.word == "not yet known"

    def decides(n):
        side = np.ceil if count / runs < allowed else np.floor
        low, high = binomtest(int(side(n * count / runs)), n).proportion_ci(0.95, "exact")
        return high <= allowed or low > allowed

    assert decides(verdict.runs_needed) and not decides(int(0.9 * verdict.runs_needed))
    report = dispersion_report(judged(count, runs, allowed=allowed), {})
    assert f"x: about {verdict.runs_needed} runs decide" in report


def test_no_number_of_runs_is_named_where_none_decides():
    assert judged(0, 368, allowed=0.01).verdicts["x"].runs_needed is None
    assert judged(10, 1000, allowed=0.01).verdicts["x"].runs_needed is None
    assert "more runs do not decide" in dispersion_report(judged(10, 1000, allowed=0.01), {})


def test_disperse_prints_the_command_that_decides_an_open_verdict(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    required = '{ output = "apoapsis_altitude", at_most = "2200 km", allowed = "40 %" }'
    text = COAST.replace('"apoapsis_altitude"]', required + "]").replace("1200", "24")
    (tmp_path / "coast.toml").write_text(text)
    assert main(["disperse", "coast.toml"]) == 0
    (command,) = re.findall(r"next   jaxspace (resume .*)", capsys.readouterr().out)
    assert main(command.split()) == 0
    assert open_store("out/coast.zarr").runs == int(command.split()[-1]) > 24


def test_a_file_gives_the_share_and_the_confidence_of_a_requirement(tmp_path):
    path = tmp_path / "coast.toml"
    given = '{{ output = "apoapsis_altitude"{} }}'
    limits = ', at_most = "3000 km", allowed = "5 %", confidence = 0.99'
    path.write_text(COAST.replace('"apoapsis_altitude"]', given.format(limits) + "]"))
    required = load(path).campaign(warn=False).requirements
    assert required == (("apoapsis_altitude", Requirement(None, 3000.0, 0.05, 0.99)),)
    wrong = {
        ', at_most = "3000 km", allowed = 5': "allowed is 5: it must be between 0 and 1, both excl",
        ', at_most = "3000 km", confidence = "x"': 'outputs.1.confidence is "x": it must be a numb',
        ', allowed = "5 %"': "outputs.1.allowed belongs to a requirement: give at_least or at_most",
    }
    for entries, sentence in wrong.items():
        path.write_text(COAST.replace('"apoapsis_altitude"]', given.format(entries) + "]"))
        with pytest.raises(SceneError, match=re.escape(sentence)):
            load(path)


def test_extremes_name_their_runs():
    """In tables; the worst run is that farthest outside of the requirement."""
    kept = judged(1, 6)
    kept = dataclasses.replace(kept, numbers=np.arange(40, 46), status=np.array([0, 0, 0, 0, 0, 5]))
    # The last run has failed; the least of the others is that before it.
    assert [kept.run_of(which, "x") for which in ("worst", "least", "greatest")] == [40, 44, 40]
    report = dispersion_report(kept, {}).splitlines()
    row = report[report.index("extremes and their runs") + 2].split()
    assert row[0] == "x" and row[3] == "44" and row[-1] == "40"
    with pytest.raises(InputError, match="a has no requirement that defines the worst"):
        kept.run_of("worst", "a")
    with pytest.raises(InputError, match="must be one of worst, least, greatest"):
        kept.run_of("best", "x")
    lost = dataclasses.replace(kept, outputs={"x": np.full(6, np.nan)})
    with pytest.raises(InputError, match="x is not finite in any"):
        lost.run_of("least", "x")


def test_the_two_words_of_a_run_are_read_as_one():
    """Wherever the store stands."""
    read = parser().parse_args(with_joined_runs(["replay", "--run", "worst", "x y", "s.zarr"]))
    assert read.run == ("worst", "x y") and read.file == "s.zarr"
    assert parser().parse_args(with_joined_runs(["replay", "--run", "7", "s"])).run == 7
    for words in (["--run", "worst", "--show"], ["--run", "best", "x"]):
        with pytest.raises(SystemExit):
            parser().parse_args(with_joined_runs(["replay", "s.zarr", *words]))


def test_tables_tell_what_is_not_finite_and_what_is_violated():
    x = np.array([1.0, np.nan, 2.0, np.inf, 1.0, np.nan, 3.0, 4.0])
    kept = small(x=x, y=np.where(x == 1.0, np.nan, 0.5 * x))
    report = dispersion_report(kept, {}).splitlines()
    row = next(line for line in report if line.startswith("x "))
    # Without a nominal value, and with an infinite limit.
    assert row.split()[:3] == ["x", "km", "-"] and row.split()[-1] == "∞"
    assert "x is ∞ in 1, not a number in 1 of 7 successful runs." in "\n".join(report)
    (row,) = [line for line in report if "≤" in line]
    # Infinite, not a number, failed and 4.
    low, high = binomtest(4, 8).proportion_ci(0.95, "exact")
    assert row.split("km")[1].split() == (
        f"4 of 8 50 % {100 * low:.3g} % to {100 * high:.3g} % 95 %".split()
    )
    printed = failures_report(None, kept, 2)
    assert "3 runs succeeded with an output that is not finite:" in printed
    assert "  run 0: y is not finite." in printed and "  and 1 more (use --all" in printed
    assert "  run 5: x, y are not finite." in failures_report(None, kept)
    whole = small(z=np.ones(8))
    assert "requirements" not in dispersion_report(whole, {})
    assert "not a number" not in failures_report(None, whole)


@pytest.mark.parametrize(
    "option", [["--compare"], ["--until", "apoapsis_altitude"], ["--runs", "5"], ["--seed", "0"]]
)
def test_options_about_runs_are_refused_where_there_are_none(tmp_path, capsys, option):
    (tmp_path / "coast.toml").write_text(COAST)
    given = ["disperse", str(tmp_path / "coast.toml"), "--method", "lincov", *option]
    assert main(given) == 2
    told = capsys.readouterr().err
    assert f"{option[0]} applies to the runs of a campaign, and --method lincov" in told


def test_a_method_without_runs_has_the_rows_of_the_file(tmp_path, capsys):
    """The eccentricity, 0.1 with a deviation of 0.05, falls below zero in 2 runs of 100, of which
    the derivatives know nothing: the table says so."""
    (tmp_path / "coast.toml").write_text(COAST)
    assert main(["disperse", str(tmp_path / "coast.toml"), "--method", "lincov"]) == 0
    told = capsys.readouterr()
    rows = [line.split() for line in told.out.splitlines() if " mi " in line or " km " in line]
    assert [row[0] for row in rows] == ["periapsis_altitude", "apoapsis_altitude"]
    assert all(row[-1] == "warning" for row in rows)
    assert "warning: apoapsis_altitude: 7 of 256 runs fail" in told.out
    # The table has said it.
    assert "not reliable" not in told.err


def test_report_of_a_campaign_from_python_prints_its_table(tmp_path, capsys):
    write(tmp_path / "s.zarr")
    assert main(["report", str(tmp_path / "s.zarr")]) == 0
    printed = capsys.readouterr().out
    row = next(line.split() for line in printed.splitlines() if line.startswith("b "))
    # Twice 0 to 24, whose mean is 24; no nominal run.
    assert row[:3] == ["b", "-", "24.0"] and "25 of 25 runs succeeded." in printed


@pytest.mark.parametrize("command", [["resume"], ["failures"], ["replay", "--run", "1"]])
def test_what_is_no_store_is_refused_in_a_sentence(tmp_path, capsys, command):
    assert main([*command, str(tmp_path / "none.zarr")]) == 2
    printed = capsys.readouterr().err
    assert "it must be the Zarr store of a dispersion" in printed and printed.count("\n") == 1
    assert printed.count("none.zarr") == 1


def test_a_picture_that_fails_costs_no_number(tmp_path, capsys, monkeypatch):
    def broken(*_, **__):
        raise ValueError("no ink")

    monkeypatch.setattr("jaxspace.plots.dispersion_figure", broken)
    path = tmp_path / "coast.toml"
    path.write_text(COAST)
    assert main(["disperse", str(path), "--out", str(tmp_path), "--runs", "40"]) == 0
    printed = capsys.readouterr()
    assert "coast.png is left out: ValueError: no ink" in printed.err
    assert "store " in printed.out
    assert open_store(tmp_path / "coast.zarr").runs == 40


@pytest.mark.parametrize("place", ["disperse_campaign", "load"])
def test_a_stop_that_a_library_has_met_in_a_callback(tmp_path, capsys, monkeypatch, place):
    def met(*_, **__):
        raise RuntimeError("Exception raised in callback: Traceback ...\nKeyboardInterrupt:")

    monkeypatch.setattr(f"jaxspace.cli._campaigns.{place}", met)
    path = tmp_path / "coast.toml"
    path.write_text(COAST)
    assert main(["disperse", str(path), "--out", str(tmp_path), "--runs", "40"]) == 130
    assert "Traceback" not in capsys.readouterr().err


# Stops that are raised, and a signal to a process of its own, are in the tests beside it.
@pytest.mark.sweep
def test_a_stop_within_text_that_python_was_compiling(tmp_path):
    """As in the making of a dataclass: Python 3.13 would end the process by the signal."""
    (tmp_path / "coast.toml").write_text(COAST)
    (tmp_path / "interrupted.py").write_text(
        "import sys\n"
        "from jaxspace.cli import _campaigns, main\n"
        "_campaigns.disperse_campaign = lambda *_, **__: exec('raise KeyboardInterrupt')\n"
        "sys.exit(main(['disperse', 'coast.toml', '--out', '.', '--runs', '40']))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-m", "interrupted"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 130, ended.stderr
    assert "Traceback" not in ended.stderr


LONG, LONG_CHUNK = 20_000, 512


def stopped(folder: Path, number: signal.Signals, chunk: int | None, delay: float) -> Path:
    """The store of a campaign that was sent a signal so many seconds after this chunk was finished,
    or after the store was locked, before the campaign was compiled."""
    (folder / "coast.toml").write_text(COAST)
    store = folder / "coast.zarr"
    program = [sys.executable, "-m", "jaxspace.cli", "disperse", "coast.toml", "--out", "."]
    # What a shell runs in its background ignores Ctrl-C, and so would all that it starts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(
        [*program, "--runs", str(LONG), "--chunk", str(LONG_CHUNK)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        # To the bit what this process computes.
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "JAX_DISABLE_MOST_OPTIMIZATIONS": str(
                int(jax.config.values["jax_disable_most_optimizations"])
            ),
        },
    )
    signal.signal(signal.SIGINT, before)
    sign = store / (".lock" if chunk is None else f".manifest/{chunk}.json")
    while process.poll() is None and not sign.exists():
        time.sleep(0.001)
    time.sleep(delay)
    process.send_signal(number)
    _, errors = process.communicate()
    # Whole sentences, and no traceback of whatever was under way.
    assert "Traceback" not in errors, errors
    if number != signal.SIGKILL and process.returncode != 0:
        assert process.returncode == 130, errors
        if chunk is not None:
            assert "runs are stored in" in errors and "`jaxspace resume" in errors
    return store


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_in_a_sentence_and_a_store_that_resumes(tmp_path, number):
    store = stopped(tmp_path, number, 2, 0.002)
    # All of them where the machine is busy, and the signal comes late.
    assert 0 < open_store(store).runs <= LONG
    assert main(["resume", str(store)]) == 0
    kept = open_store(store)
    assert kept.runs == LONG
    # In point gravity the periapsis is what went in, to the tolerance.
    good = kept.good
    # The file gives it in miles.
    altitude = kept.inputs["initial.orbit.periapsis_altitude"][good] / 1609.344
    np.testing.assert_allclose(kept.outputs["periapsis_altitude"][good], altitude, atol=0.05)

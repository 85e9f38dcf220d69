"""`jaxspace report`: what it writes of a store, and that no picture costs a number."""

import json
import re

import numpy as np
import pandas
import pytest
from test_cli import CHEAP

from jaxspace.cli import main
from jaxspace.dispersion import Campaign, Normal, disperse, open_store


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of a dispersed scene, with its title and a requirement."""
    folder = tmp_path_factory.mktemp("campaign")
    limit = '{ output = "periapsis_altitude", at_least = "642 km" }'
    (folder / "coast.toml").write_text(CHEAP.replace('"periapsis_altitude",', f"{limit},", 1))
    assert main(["disperse", str(folder / "coast.toml"), "--runs", "64", "--out", str(folder)]) == 0
    return folder


def test_report_of_a_store(folder, capsys):
    assert main(["report", str(folder / "coast.zarr"), "--out", str(folder / "b")]) == 0
    printed = capsys.readouterr().out
    for name in ("coast.png", "coast.html", "coast.csv", "coast.parquet"):
        assert (folder / "b" / name).exists() and name in printed
    page = (folder / "b" / "coast.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r"const data = (.*);\n", page).group(1))
    assert "<h1>A coast</h1>" in page and "≥\u00a0398.92" in page
    # 400 miles, as the scene says, and in its unit what is required, 642 km.
    assert data["nominal"]["periapsis_altitude"] == pytest.approx(400.0, abs=1e-3)
    required = data["histograms"]["periapsis_altitude"]["required"]
    assert required == pytest.approx([642.0 / 1.609344], rel=1e-12)
    assert len(data["trajectories"]["runs"]) == 24 and data["trajectories"]["unit"] == "km"
    # The radius of the periapsis, where the run starts, and the mean of the runs beside it.
    start = [point[0] for point in data["trajectories"]["nominal"]]
    assert sum(x * x for x in start) ** 0.5 == pytest.approx(6378.137 + 643.7376, abs=0.2)
    # Processor time is told beside the parts of the wall time, and is none of them.
    kept = open_store(folder / "coast.zarr")
    assert list(data["time"]) == ["compilation and start-up", "running", "storing"]
    wall = kept.seconds + kept.attributes["storing_seconds"]
    assert sum(data["time"].values()) == pytest.approx(wall, rel=1e-12)
    assert data["time"]["running"] > 0.0
    busy = kept.attributes["cpu_seconds"]
    assert busy > 0.0 and f"and {busy:.3g} s of processor time" in page
    lines = (folder / "b" / "coast.csv").read_text().splitlines()
    assert len(lines) == 65 and "periapsis_altitude [mi]" in lines[0]
    table = pandas.read_parquet(folder / "b" / "coast.parquet")
    assert len(table) == 64 and list(table.columns) == lines[0].split(",")[1:]
    np.testing.assert_array_equal(
        table["periapsis_altitude [mi]"], kept.outputs["periapsis_altitude"]
    )


def test_a_picture_that_fails_costs_no_number(folder, capsys, monkeypatch):
    def fail(*args, **options):
        raise ValueError("no colour is left")

    monkeypatch.setattr("jaxspace.plots.dispersion_figure", fail)
    given = ["disperse", str(folder / "coast.toml"), "--runs", "64", "--out", str(folder / "c")]
    assert main(given) == 0
    printed = capsys.readouterr()
    assert "64 of 64 runs succeeded" in printed.out and "coast.html" in printed.out
    assert "coast.png is left out: ValueError: no colour is left" in printed.err


@pytest.mark.sweep
def test_report_of_a_campaign_made_in_python(tmp_path, capsys):
    from test_dispersion import drifts, last

    inputs = {"x0": Normal(1.0, 2.0), "v0": Normal(0.0, 1.0)}
    disperse(Campaign(drifts, inputs, last), 64, store=tmp_path / "drift.zarr")
    assert main(["report", str(tmp_path / "drift.zarr")]) == 0
    printed = capsys.readouterr()
    assert "defined in Python" in printed.err and "drift.html" in printed.out
    assert main(["report", str(tmp_path / "nothing.zarr")]) == 2
    assert "store" in capsys.readouterr().err

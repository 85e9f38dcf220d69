"""Campaigns that are extended: the runs of a store keep their bits, and the others are those of a
campaign that was planned for all of them."""

import json
import warnings

import numpy as np
import pytest
from test_campaign_commands import COAST
from test_campaigns import CAMPAIGN, CHUNK, INPUTS, RUNS, files_of, fly, last, swing, whole

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import (
    Campaign,
    DamagedStore,
    LatinHypercube,
    Sobol,
    StopRule,
    StoreError,
    open_store,
)
from jaxspace.stores import writer as store_writer

__all__ = ["whole"]
FEW = 700  # a chunk and a shorter one
settings_stay = pytest.mark.usefixtures("settings_stay")


@pytest.fixture
def few(tmp_path):
    path = tmp_path / "few.zarr"
    fly(path, runs=FEW)
    return path


def test_an_extended_store_equals_the_store_of_all_runs(few, whole):
    kept = (few / "x" / "c" / "0").stat()
    seen = []
    found = fly(few, resume=True, progress=lambda done, total: seen.append((done, total)))
    assert files_of(few) == files_of(whole)
    # The first chunk was neither computed nor written again.
    assert (few / "x" / "c" / "0").stat().st_mtime_ns == kept.st_mtime_ns
    assert seen[0][0] == 2 * CHUNK and seen[-1] == (RUNS, RUNS)
    assert found.runs == RUNS and found.missing_runs == ""
    import xarray

    with xarray.open_zarr(few, consolidated=True) as data:
        assert data["x"].size == RUNS
    # Nothing is left to do, and the array files have the new length as well.
    assert json.loads((few / "x" / "zarr.json").read_text())["shape"] == [RUNS]


@pytest.mark.parametrize("writes", range(1, 8))
def test_an_extension_that_is_cut_off_is_completed(few, whole, writes, monkeypatch):
    """The disk fails at the n-th file of metadata; then the extension is repeated."""
    write, count = store_writer.write_whole, iter(range(writes))

    def failing(path, data):
        if next(count, None) is None:
            raise OSError(28, "No space left on device")
        write(path, data)

    monkeypatch.setattr(store_writer, "write_whole", failing)
    with pytest.raises(StoreError, match="No space left on device"):
        fly(few, resume=True)
    monkeypatch.undo()
    # Readers see the runs of whole chunks, and each is what it was.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        there = open_store(few)
    assert CHUNK <= there.runs <= FEW
    np.testing.assert_array_equal(there.outputs["x"], open_store(whole).outputs["x"][: there.runs])
    with warnings.catch_warnings():
        # Of a head that has no copy yet.
        warnings.simplefilter("ignore", DamagedStore)
        fly(few, resume=True)
    assert files_of(few) == files_of(whole)
    assert open_store(few).runs == RUNS


def test_sobol_points_are_extended_by_powers_of_two(tmp_path):
    campaign = Campaign(swing, INPUTS, last, CAMPAIGN.units, design=Sobol())
    fly(tmp_path / "few", campaign, 512)
    fly(tmp_path / "few", campaign, 1024, resume=True)
    found = open_store(tmp_path / "few").inputs["x0"]
    np.testing.assert_array_equal(found, fly(None, campaign, 1024).inputs["x0"])
    # One point in each of 1024 equal layers.
    layers = np.sort(np.floor((found - 0.9) / 0.2 * 1024.0))
    np.testing.assert_array_equal(layers, np.arange(1024))


def test_extensions_that_are_not_possible_change_nothing(tmp_path):
    hypercube = Campaign(swing, INPUTS, last, CAMPAIGN.units, design=LatinHypercube(600))
    fly(tmp_path / "a", hypercube, 600)
    before = files_of(tmp_path / "a"), (tmp_path / "a" / "zarr.json").read_bytes()
    with pytest.raises(InputError, match="a Latin hypercube of 600 runs, whose layers depend"):
        fly(tmp_path / "a", hypercube, 1200, resume=True)
    assert (files_of(tmp_path / "a"), (tmp_path / "a" / "zarr.json").read_bytes()) == before
    rule = StopRule("x", precision=0.9)
    ended = fly(tmp_path / "b", runs=1200, until=rule)
    assert ended.enough is not None
    with pytest.raises(StoreError, match="by its stopping rule: it cannot be extended to 2200"):
        fly(tmp_path / "b", until=rule, resume=True)
    assert open_store(tmp_path / "b").runs == ended.runs


@settings_stay
def test_resume_extends_a_store(tmp_path, capsys):
    (tmp_path / "coast.toml").write_text(COAST)
    given = [str(tmp_path / "coast.toml"), "--out", str(tmp_path), "--chunk", "512"]
    assert main(["disperse", *given, "--runs", "600"]) == 0
    store = str(tmp_path / "coast.zarr")
    before = open_store(store).outputs["periapsis_altitude"]
    assert main(["resume", store, "--runs", "500"]) == 2
    assert "the store was planned for 600" in capsys.readouterr().err
    assert main(["resume", store, "--runs", "1100"]) == 0
    there = open_store(store)
    assert there.runs == 1100
    np.testing.assert_array_equal(there.outputs["periapsis_altitude"][:600], before)

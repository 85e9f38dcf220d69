"""`jaxspace diff`: the table, the figure and the page of two stored campaigns."""

import numpy as np
import pytest
from test_dispersion import drifts, last

from jaxspace.cli import main
from jaxspace.dispersion import Campaign, Normal, disperse, open_store


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two stores with the same seed and different standard deviations of the speed."""
    folder = tmp_path_factory.mktemp("stores")
    for name, deviation in (("wide", 0.5), ("narrow", 0.1)):
        inputs = {"x0": Normal(1.0, 2.0), "v0": Normal(1.0, deviation)}
        campaign = Campaign(drifts, inputs, last, {"x": "m"}, requirements={"x": (None, 3.0)})
        disperse(campaign, 64, seed=3, store=folder / f"{name}.zarr")
    return folder


def test_diff_prints_and_draws_both(folder, tmp_path, capsys):
    stores = [str(folder / f"{name}.zarr") for name in ("wide", "narrow")]
    assert main(["diff", *stores, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "pairs of runs with the same number, 95 % intervals" in printed
    assert "+ " in printed and "0.1" in printed
    page = (tmp_path / "wide_narrow.html").read_text(encoding="utf-8")
    assert "narrow compared with wide" in page and "<svg" in page
    # A requirement without an allowed share has no verdict.
    share = 1.0 - np.mean(open_store(stores[1]).outputs["x"] <= 3.0)
    assert f"→ {100.0 * share:.3g} % of the runs</li>" in page
    assert (tmp_path / "wide_narrow.png").stat().st_size > 1000


def test_diff_of_a_store_that_is_not_there(folder, tmp_path, capsys):
    stores = [str(folder / "wide.zarr"), str(tmp_path / "nothing.zarr")]
    assert main(["diff", *stores, "--out", str(tmp_path)]) == 2
    assert "nothing.zarr" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

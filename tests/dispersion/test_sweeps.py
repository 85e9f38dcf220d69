"""Sweeps: explicit rows of inputs, alone or crossed with the dispersion, in memory, in a store, in
a file and on the command line."""

import csv
import dataclasses

import numpy as np
import pytest
from test_campaign_commands import COAST
from test_campaigns import CAMPAIGN, DURATION, SEED, files_of, fly

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import (
    Constant,
    LatinHypercube,
    MultivariateNormal,
    Part,
    StopRule,
    StoreError,
    disperse,
    evaluate,
    moments,
    open_store,
)
from jaxspace.dispersion.rare import rare_event
from jaxspace.dispersion.sensitivity import sobol_indices
from jaxspace.io import SceneError, load
from jaxspace.plots import dispersion_page, sweep_figure
from jaxspace.sampling.sweeps import grid
from jaxspace.statistics.comparison import compare

ROWS = {"w": [1.5, 2.0, 2.5]}
SWEPT = CAMPAIGN.at(ROWS)
EACH = 300
settings_stay = pytest.mark.usefixtures("settings_stay")


@pytest.fixture(scope="module")
def swept():
    return fly(campaign=SWEPT, runs=EACH)


def test_each_row_has_its_value_and_all_rows_share_their_draws(swept):
    assert swept.runs == 3 * EACH and swept.rows == 3
    w, x0 = (swept.values(name).reshape(EACH, 3) for name in ("w", "x0"))
    np.testing.assert_array_equal(w, np.broadcast_to(ROWS["w"], w.shape))
    np.testing.assert_array_equal(x0, np.repeat(x0[:, :1], 3, axis=1))
    # The draws are those of the campaign without the sweep.
    np.testing.assert_array_equal(x0[:, 0], fly(runs=EACH).values("x0"))
    # x = x0 cos(w t), in closed form.
    np.testing.assert_allclose(
        swept.values("x").reshape(EACH, 3), x0 * np.cos(w * DURATION), rtol=0.0, atol=1e-7
    )


def test_the_table_has_the_statistics_of_each_row(swept):
    table = swept.by_row()
    np.testing.assert_array_equal(table.columns["w"], ROWS["w"])
    np.testing.assert_array_equal(table.runs, [EACH] * 3)
    for k in range(3):
        row = swept.row(k)
        (found,) = (line for line in row.table() if line.name == "x")
        assert table.mean["x"][k] == pytest.approx(found.mean, rel=1e-13)
        assert table.std["x"][k] == pytest.approx(found.std, rel=1e-11)
        assert row.runs == EACH and (row.values("w") == ROWS["w"][k]).all()
    assert "w [rad/s]" in repr(table) and len(repr(table).splitlines()) == 5
    with pytest.raises(InputError, match="^number is 3: it must be from 0 to 2"):
        swept.row(3)


def test_failed_and_violating_runs_count_in_their_row(swept):
    status = swept.status.copy()
    status[4] = 9  # draw 1 of row 1
    x = swept.values("x").copy()
    x[5] = np.inf
    changed = dataclasses.replace(
        swept,
        status=status,
        outputs={**swept.outputs, "x": x},
        attributes={**swept.attributes, "requirements": {"x": [None, 0.9]}},
    )
    table = changed.by_row()
    np.testing.assert_array_equal(table.good, [EACH, EACH - 1, EACH])
    shares = [np.mean((x > 0.9)[k::3] | (status[k::3] == 9)) for k in range(3)]
    np.testing.assert_allclose(table.violated["x"], shares)
    assert np.isfinite(table.mean["x"]).all() and "failed" in repr(table)
    with pytest.raises(InputError, match="^'v' is not an output with a requirement"):
        table.statistic("v", "violated")


def test_a_sweep_alone_has_one_run_in_each_row():
    alone = CAMPAIGN.at(grid({"w": [1.0, 2.0], "x0": [0.5, 1.0, 1.5]}))
    result = fly(campaign=alone)
    assert result.runs == 6
    found = result.by_row().grid("x", "w", "x0")
    expected = found.y[:, None] * np.cos(found.x * DURATION)
    np.testing.assert_allclose(found.values, expected, rtol=0.0, atol=1e-7)
    assert not np.isfinite(result.by_row().std["x"]).any()
    assert "std dev" not in repr(result.by_row())


def test_a_grid_at_other_values_and_places_without_a_row():
    rows = {"w": [1.0, 1.0, 2.0], "x0": [0.5, 1.0, 0.5]}
    table = fly(campaign=CAMPAIGN.at(rows)).by_row()
    found = table.grid("x", "w", "x0")
    assert np.isnan(found.values[1, 1]) and np.isfinite(found.values).sum() == 3
    for given, sentence in (
        (("x", "w", "w"), "^x and y are both 'w'"),
        (("x", "w", "y"), "^'y' is not a swept input"),
        (("z", "w", "x0"), "^'z' is not an output"),
        (("x", "w", "x0", "median"), "^take is 'median'"),
    ):
        with pytest.raises(InputError, match=sentence):
            table.grid(*given)
    twice = fly(campaign=CAMPAIGN.at({"w": [1.0, 1.0], "x0": [0.5, 0.5]})).by_row()
    with pytest.raises(InputError, match="^Several rows have the same values of w and x0"):
        twice.grid("x", "w", "x0")


def test_a_store_of_a_sweep_is_resumed_and_extended(tmp_path, swept):
    """More draws continue every row; parts compute the same store."""
    store, parts = tmp_path / "sweep.zarr", tmp_path / "parts.zarr"
    fly(store, SWEPT, runs=200)
    extended = fly(store, SWEPT, runs=EACH, resume=True)
    for name in ("w", "x0", "x", "v"):
        np.testing.assert_array_equal(extended.values(name), swept.values(name))
    opened = open_store(store)
    np.testing.assert_array_equal(opened.by_row().mean["x"], swept.by_row().mean["x"])
    for number in (2, 1):
        fly(parts, SWEPT, runs=EACH, engine=Part(number, 2))
    np.testing.assert_array_equal(open_store(parts).values("x"), swept.values("x"))
    before = files_of(store)
    other = CAMPAIGN.at({"w": [1.5, 2.0, 2.6]})
    with pytest.raises(StoreError, match=r"sweep of w: 1.5, 2.0, 2.5 in the store, .* 2.6 here"):
        fly(store, other, runs=EACH, resume=True)
    with pytest.raises(StoreError, match="the inputs"):
        fly(store, CAMPAIGN, runs=3 * EACH, resume=True)
    assert files_of(store) == before


def test_a_run_of_a_sweep_is_replayed(swept):
    run = SWEPT.replay(301, seed=SEED, runs=3 * EACH)
    for name in ("x", "v"):
        assert run.outputs[name] == swept.values(name)[301]
    assert run.inputs["w"] == ROWS["w"][301 % 3]


def test_designs_cover_every_row():
    """A Latin hypercube is one in each row."""
    design = dataclasses.replace(SWEPT, design=LatinHypercube(EACH))
    x0 = fly(campaign=design, runs=EACH).values("x0").reshape(EACH, 3)
    layers = np.floor((x0[:, 1] - 0.9) / 0.2 * EACH).astype(int)
    np.testing.assert_array_equal(np.sort(layers), np.arange(EACH))


def test_sweeps_are_split_and_compared(swept):
    part = swept.where(swept.values("w") > 1.8)
    table = part.by_row()
    assert table.runs.tolist() == [0, EACH, EACH] and np.isnan(table.mean["x"][0])
    same = compare(swept, swept)
    assert same.paired and all(x.difference == 0.0 for x in same.differences)
    fewer = fly(campaign=CAMPAIGN.at({"w": [1.5, 2.0]}), runs=EACH)
    assert not compare(swept, fewer).paired


@pytest.mark.parametrize(
    "rows, sentence",
    [
        ({}, "^Sweep.columns is empty"),
        ({"w": []}, "^Sweep.columns have the shapes"),
        ({"w": 1.0}, "^Sweep.columns have the shapes"),
        ({"w": [1.0, 2.0], "x0": [1.0]}, r"^Sweep.columns have the shapes w \(2,\), x0 \(1,\)"),
        ({"w": [1.0, float("nan")]}, "^Sweep.columns.'w'. has values that are not finite"),
        ({"x": [1.0]}, "^rows has the column 'x': it must be one of the inputs w, x0"),
    ],
)
def test_wrong_rows_are_rejected(rows, sentence):
    with pytest.raises(InputError, match=sentence):
        CAMPAIGN.at(rows)


def test_part_of_a_joint_distribution_is_not_swept():
    joint = MultivariateNormal([2.0, 1.0], [[0.01, 0.0], [0.0, 0.01]])
    campaign = dataclasses.replace(CAMPAIGN, inputs=joint.inputs("w", "x0"))
    with pytest.raises(InputError, match="drawn together with x0: sweep all of them"):
        campaign.at({"w": [1.0]})
    both = campaign.at({"w": [1.0], "x0": [2.0]})
    assert all(isinstance(d, Constant) for d in both.inputs.values())


@pytest.mark.parametrize(
    "use",
    [
        lambda: moments(SWEPT),
        lambda: rare_event(SWEPT, "x", above=5.0),
        lambda: sobol_indices(SWEPT),
        lambda: evaluate.fixed_normals(SWEPT, 10, 0),
    ],
)
def test_methods_for_one_distribution_reject_a_sweep(use):
    with pytest.raises(InputError, match="^The campaign has a sweep"):
        use()


def test_a_stop_rule_rejects_a_sweep_and_other_results_have_no_rows():
    with pytest.raises(InputError, match="^until is given, and a sweep has no common quantile"):
        disperse(SWEPT, 10, until=StopRule("x"))
    with pytest.raises(InputError, match="^This campaign has no sweep"):
        fly(runs=10).by_row()


def test_figures_and_the_page_show_a_sweep(swept, tmp_path):
    axes = sweep_figure(swept).axes
    np.testing.assert_array_equal(axes[0].lines[0].get_xdata(), ROWS["w"])
    np.testing.assert_array_equal(axes[0].lines[0].get_ydata(), swept.by_row().mean["x"])
    cells = fly(campaign=CAMPAIGN.at(grid({"w": [1.0, 2.0], "x0": [0.5, 1.0, 1.5]})))
    drawn = sweep_figure(cells, ["x"]).axes[0]
    mesh = drawn.collections[0].get_array()
    np.testing.assert_array_equal(mesh, cells.by_row().grid("x", "w", "x0").values)
    assert drawn.get_xlabel() == "w [rad/s]" and len(drawn.texts) == 6
    with pytest.raises(InputError, match="^outputs is empty"):
        sweep_figure(swept, [])
    with pytest.raises(InputError, match="^take is 'mode'"):
        sweep_figure(swept, take="mode")
    text = dispersion_page(cells, tmp_path / "page.html").read_text()
    assert "<h2>Sweep</h2>" in text and "data:image/png" in text


# --------------------------------------------------------------------- files and the command line

ALONE = COAST.partition("[dispersion.inputs]")[0].replace("runs = 1200\n", "")
GRID = """
[sweep.grid]
initial.orbit.periapsis_altitude = ["300 mi", "400 mi"]
"initial.orbit.eccentricity" = { from = 0.1, to = 0.2, count = 3 }
"""


def scene(folder, text):
    path = folder / "coast.toml"
    path.write_text(text)
    return path


def test_a_file_has_a_grid_or_rows(tmp_path):
    file = load(scene(tmp_path, ALONE + GRID))
    altitude, e = file.sweep.values()
    mile = 1609.344
    np.testing.assert_allclose(altitude, mile * np.repeat([300.0, 400.0], 3), rtol=1e-15)
    np.testing.assert_allclose(e, [0.1, 0.15, 0.2] * 2, rtol=1e-15)
    assert file.rows == 6 and file.runs == 1 and file.sweeps_only
    rows = '[sweep.rows]\n"initial.orbit.eccentricity" = [0.1, 0.2]\n'
    crossed = ALONE + rows + '[dispersion.inputs]\n"planet.mu" = { deviation = "1 %" }\n'
    file = load(scene(tmp_path, crossed))
    assert file.rows == 2 and file.runs == 1000 and not file.sweeps_only
    assert list(file.campaign().inputs) == ["initial.orbit.eccentricity", "planet.mu"]
    assert load(scene(tmp_path, COAST)).rows == 1


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("[sweep]", "sweep is .*: it must be a table with either grid or rows"),
        ('[sweep.grid]\n"planet.mu" = []', r"sweep.grid.planet.mu is \[\]: it must be a list of"),
        ('[sweep.grid]\n"planet.mu" = ["1 km"]', "sweep.grid.planet.mu.0 is .*gravitational"),
        ('[sweep.grid]\n"planet.m" = [1.0]', "planet.m is not a known number.*Did you mean planet"),
        ('[sweep.rows]\n"accuracy" = [1.0]', "cannot be dispersed"),
        (
            '[sweep.rows]\n"planet.mu" = [1.0, 2.0]\n"initial.orbit.eccentricity" = [0.1]',
            "lists of different lengths: planet.mu 2, initial.orbit.eccentricity 1",
        ),
        (
            '[sweep.grid]\n"planet.mu" = { from = 1.0, to = 2.0 }',
            "sweep.grid.planet.mu.count is missing: it must be the number of values",
        ),
        (
            '[sweep.grid]\n"planet.mu" = { from = 1.0, to = 2.0, count = 1 }',
            "count is 1: it must be a whole number from 2",
        ),
        (
            '[sweep.grid]\n"planet.mu" = { from = 1.0, to = 2.0, count = 3, step = 1 }',
            "step is not a known key",
        ),
        (
            '[sweep.grid]\n"planet.mu" = { from = 1.0, to = 2.0, count = 1000000 }\n'
            '"initial.orbit.eccentricity" = [0.1, 0.2]',
            "sweep.grid has more than 1000000 combinations",
        ),
        (
            '[sweep.rows]\n"planet.mu" = [1.0]\n[dispersion.inputs]\n'
            '"planet.mu" = { deviation = 1.0 }',
            "sweep: planet.mu is also dispersed in dispersion.inputs: give it only once",
        ),
    ],
)
def test_a_wrong_sweep_is_rejected(tmp_path, text, sentence):
    with pytest.raises(SceneError, match=sentence):
        load(scene(tmp_path, ALONE + text + "\n"))


def test_a_sweep_needs_outputs(tmp_path):
    text = ALONE.partition("[dispersion]")[0] + GRID
    with pytest.raises(SceneError, match="dispersion is missing: it must be a table with the outp"):
        load(scene(tmp_path, text))


@settings_stay
def test_the_commands_of_a_sweep(tmp_path, capsys):
    """Run, print in the units of the file, extend, replay and report."""
    rows = '[sweep.rows]\n"initial.orbit.periapsis_altitude" = ["300 mi", "400 mi"]\n'
    inputs = '[dispersion.inputs]\n"initial.orbit.eccentricity" = { deviation = 0.01 }\n'
    path = scene(tmp_path, ALONE + rows + inputs)
    assert main(["disperse", str(path), "--runs", "20", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "sweep of 2 rows, 20 runs in each" in printed
    assert "initial.orbit.periapsis_altitude [mi]" in printed and " 300 " in printed
    store = tmp_path / "coast.zarr"
    with open(tmp_path / "coast_sweep.csv", newline="") as table:
        head, *lines = csv.reader(table)
    assert "mean of apoapsis_altitude [km]" in head and len(lines) == 2
    assert float(lines[1][1]) == pytest.approx(400.0, rel=1e-14)
    assert main(["resume", str(store), "--runs", "30"]) == 0
    assert open_store(store).runs == 60
    capsys.readouterr()
    assert main(["resume", str(store), "--runs", "10"]) == 2
    assert "--runs is 10: the store was planned for 30" in capsys.readouterr().err
    assert main(["replay", str(store), "--run", "3", "--out", str(tmp_path)]) == 0
    assert main(["report", str(store)]) == 0
    page = (tmp_path / "coast.html").read_text()
    assert "sweep of initial.orbit.periapsis_altitude [mi]: 300, 400" in page
    alone = scene(tmp_path, ALONE + rows)
    assert main(["disperse", str(alone), "--runs", "5", "--out", str(tmp_path)]) == 2
    assert "no input of the file is random besides the sweep" in capsys.readouterr().err

"""The page of a campaign: what it holds, and that it draws and its pickers work in a browser."""

import json
import re

import numpy as np
import pytest
from browser import BROWSER, open_page

from jaxspace.dispersion import Dispersion, RunPaths
from jaxspace.plots import dispersion_figure, dispersion_page
from jaxspace.plots._bins import bins
from jaxspace.simulation import Status

# A name that fits beside no small plot.
LONG = "altitude_of_periapsis_at_burnout"
NOMINAL = {"apoapsis": 46000.0, "constant": 1234.5}
# What the page shows, with three pickers moved and put back.
LOOK = """(() => {
  const all = (rule, of = document) => [...of.querySelectorAll(rule)];
  const root = document.documentElement, title = (id) => $(id).layout.xaxis.title.text;
  const pick = (id, value) => { $(id).value = value; $(id).dispatchEvent(new Event("change")); };
  const found = { wide: root.scrollWidth - root.clientWidth, before: title("histogram") };
  found.plots = {};
  for (const plot of all(".plot"))
    found.plots[plot.id] = [all(".main-svg", plot).length, (plot.data || []).length];
  // The share of the width and of the height that names and legends leave to what is plotted.
  found.left = all(".plot").map(({ id, _fullLayout: { _size, width, height } }) =>
    [id, _size.w / width, _size.h / height]);
  const seen = (e) => e.getBoundingClientRect();
  const within = (a, b) => a.left >= b.left - 1 && a.right <= b.right + 1 && a.top >= b.top - 1 &&
    a.bottom <= b.bottom + 1;
  // A number at the end of an axis that does not fit is not shown at all.
  const texts = all(".plot text").filter((e) => e.textContent.trim() && seen(e).width > 0);
  found.texts = texts.map((e) => e.dataset.unformatted || e.textContent);
  found.cut = texts.filter((e) => !within(seen(e), seen(e.closest(".plot"))));
  // The boxes of letters are two pixels higher than the letters.
  const apart = (a, b) => a.right <= b.left + 2 || b.right <= a.left + 2 || a.bottom <= b.top + 2 ||
    b.bottom <= a.top + 2;
  const boxes = [...all("select"), ...all(".modebar-group"), ...texts];
  found.over = [];
  boxes.forEach((a, i) => boxes.slice(0, i).forEach((b) => {
    if (!apart(seen(a), seen(b))) found.over.push([a, b]); }));
  const name = (e) => e.id || e.dataset.unformatted || e.textContent || e.className;
  found.cut = found.cut.map(name);
  found.over = found.over.map(([a, b]) => [name(a), name(b)]);
  found.bars = all(".modebar-btn").map((e) => e.dataset.title);
  const ranges = ["x", "y", "z"].map((k) => $("trajectories")._fullLayout.scene[k + "axis"].range);
  found.lengths = ranges.map(([a, b]) => b - a);
  pick("contributors-of", "altitude_of_periapsis_at_burnout");
  found.named = $("contributors").layout.yaxis.ticktext;
  pick("histogram-of", "constant");
  pick("across", "impulse");
  pick("contributors-of", "constant");
  found.after = [title("histogram"), title("scatter"), $("contributors-words").textContent];
  pick("histogram-of", "apoapsis");
  pick("across", "apoapsis");
  pick("contributors-of", "apoapsis");
  found.ground = getComputedStyle(document.body).backgroundColor;
  return found;
})()"""


def dispersion(runs, requirements=True):
    r = np.random.default_rng(1)
    a, b = r.standard_normal((2, runs))
    outputs = {
        "apoapsis": 46000.0 + 800.0 * a,
        LONG: 183.0 + b + 0.3 * a,
        # Constant but for rounding: a spread of 5e-11 in what is some 1e5.
        "constant": 123456.5 + 1.4551915228366852e-11 * np.round(2.0 * r.random(runs)),
    }
    status = np.where(np.arange(runs) % 97 == 3, Status.NOT_FINITE, 0)
    outputs = {name: np.where(status > 0, np.nan, x) for name, x in outputs.items()}
    record = {"preparation_seconds": 2.0, "rtol": 1e-9, "inputs": "impulse [N s]: normal"}
    if requirements:
        record["requirements"] = {LONG: [181.0, None]}
    units = {"apoapsis": "km", LONG: "km", "impulse": "N s"}
    inputs = {"impulse": a, "effects.thrust.nozzle_misalignment.1": b}
    return Dispersion(inputs, outputs, status, np.ones(runs, int), units, 5, 9.0, record)


def paths():
    t = np.linspace(0.0, 6.0, 40)
    circle = np.stack([7e6 * np.cos(t), 7e6 * np.sin(t), 0.0 * t])
    positions = np.stack([circle, 1.01 * circle, np.full_like(circle, np.nan)], axis=-1)
    return RunPaths(np.array([-1, 0, 3]), np.stack([t] * 3, axis=-1), positions)


def data_of(page):
    return json.loads(re.search(r"const data = (.*);\n", page).group(1))


def test_page_holds_card_limits_and_failures(tmp_path):
    page = dispersion_page(
        dispersion(1000), tmp_path / "d.html", title="Kick & <coast>", nominal=NOMINAL
    ).read_text(encoding="utf-8")
    assert "Kick &amp; &lt;coast&gt;" in page and "989 of 1000 succeeded" in page
    assert "3, 100, 197, 294, 391 …" in page and Status.NOT_FINITE.sentence in page
    data = data_of(page)
    shown = data["histograms"]["apoapsis"]
    assert sum(shown["counts"]) == 989 and shown["nominal"] == 46000.0
    assert shown["low"] < shown["mean"] < shown["high"]
    assert data["histograms"][LONG]["required"] == [181.0]
    found = dispersion(1000).violations()[LONG]
    assert all(f">{100.0 * x:.3g}\u00a0%</td>" in page for x in (found.value, found.high))
    # What only rounds has one bin, no contributors, and a table row.
    assert data["histograms"]["constant"]["counts"] == [989]
    assert data["contributors"]["constant"]["inputs"] == []
    assert data["matrix"] == ["apoapsis", LONG]
    assert data["time"] == {"compilation and start-up": 2.0, "running": 7.0}
    assert data["trajectories"] is None and 'id="trajectories"' not in page


def test_page_asks_nothing_of_a_network(tmp_path):
    page = dispersion_page(dispersion(50), tmp_path / "d.html").read_text(encoding="utf-8")
    # A link in a text would be followed by a person only.
    asking = r"""\b(src|srcset|data|action|poster)\s*=\s*["']?\s*(https?:)?//|<link\b|@import"""
    asking += r"""|url\(\s*["']?\s*(https?:)?//|\b(fetch|XMLHttpRequest|WebSocket|sendBeacon)\b"""
    assert re.search(asking, page) is None


def test_page_of_a_million_runs_is_small(tmp_path):
    path = dispersion_page(dispersion(1_000_000), tmp_path / "d.html")
    assert path.stat().st_size < 5e6
    page = path.read_text(encoding="utf-8")
    assert "The first 2000 of 989690 runs" in page
    # All of them are in the bins.
    assert sum(data_of(page)["histograms"]["apoapsis"]["counts"]) == 989690


def test_page_without_a_good_run(tmp_path):
    d = dispersion(50)
    lost = Dispersion(d.inputs, d.outputs, np.full(50, 5), d.evaluations, {}, 0)
    page = dispersion_page(lost, tmp_path / "d.html").read_text(encoding="utf-8")
    assert "0 of 50 succeeded" in page and data_of(page)["ellipses"] is None


def test_ellipses_of_the_page_are_those_of_the_statistics(tmp_path):
    """The numbers from which the script draws lie on the border that the ellipsoid has."""
    d = dispersion(1000)
    data = data_of(dispersion_page(d, tmp_path / "d.html").read_text(encoding="utf-8"))
    e, names = data["ellipses"], data["names"]
    t = np.linspace(0.0, 2.0 * np.pi, 17)
    for a, b in (("apoapsis", LONG), (LONG, "impulse"), ("impulse", "apoapsis")):
        i, j = names.index(a), names.index(b)
        x = e["centre"][i] + e["half"][i] * np.cos(t)
        y = e["centre"][j] + e["half"][j] * np.cos(t - e["phase"][i][j])
        expected = d.ellipsoid(a, b, probability=0.99)
        # On the border the whitened radius is one. "apoapsis" is "impulse" but for its scale, to
        # rounding: of a line the widths are left.
        if {a, b} == {"impulse", "apoapsis"}:
            np.testing.assert_allclose(
                [np.ptp(x) / 2, np.ptp(y) / 2], np.abs(expected.axes[:, 0]), rtol=1e-6
            )
            continue
        away = np.stack([x, y]) - expected.centre[:, None]
        radius = np.linalg.norm(np.linalg.solve(expected.axes, away), axis=0)
        np.testing.assert_allclose(radius, 1.0, rtol=1e-9)
    assert e["phase"][0][1] == e["phase"][1][0]


def test_page_says_what_is_no_normal_distribution(tmp_path):
    """Runs of one side of the mean: z^2 of a normal z has the skewness 2 sqrt(2). An input that
    explains 0.01 % has no row, for its share would read 0.0."""
    r = np.random.default_rng(2)
    a, b = r.standard_normal((2, 2000))
    d = Dispersion({"a": a, "b": b}, {"x": a + 0.01 * b, "y": a**2}, np.zeros(2000, int), b, {}, 1)
    data = data_of(dispersion_page(d, tmp_path / "d.html").read_text(encoding="utf-8"))
    assert data["ellipses"]["one_sided"] == ["y"]
    assert data["contributors"]["x"]["inputs"] == ["a"]


def test_page_of_runs_that_are_not_finite(tmp_path):
    """What is infinite is told, has no bin and no ellipse, and costs the other outputs nothing."""
    d = dispersion(1000, requirements=False)
    a, far = d.outputs["apoapsis"].copy(), d.outputs[LONG].copy()
    a[10:160], a[200] = np.inf, np.nan
    d.attributes["planned_runs"] = 2000
    outputs = {"apoapsis": a, LONG: far, "constant": d.outputs["constant"]}
    d = Dispersion(
        d.inputs, outputs, d.status, d.evaluations, d.units, 5, 9.0, d.attributes, store="s.zarr"
    )
    dispersion_figure(d).savefig(tmp_path / "d.png", dpi=40)
    page = dispersion_page(d, tmp_path / "d.html").read_text(encoding="utf-8")
    infinite = int(np.count_nonzero(d.good & np.isinf(a)))
    assert infinite == 149
    assert f"apoapsis is ∞ in {infinite}, not a number in 1 of 989 successful runs" in page
    assert "1000 of 2000 planned runs are in the store" in page and "1000 of 2000 planned" in page
    data = data_of(page)
    shown = data["histograms"]["apoapsis"]
    assert sum(shown["counts"]) == 989 - infinite - 1 and shown["high"] is None
    assert f"∞ in {infinite}" in shown["words"]
    assert data["convergence"]["apoapsis"]["limit"][-1] is None
    assert "∞ to ∞" in data["convergence"]["apoapsis"]["words"]
    # The points and ellipses of the others are those of all good runs.
    assert len(data["numbers"]) == 989 and data["points"][LONG][20] is not None
    assert data["points"]["apoapsis"].count(None) == infinite + 1
    i, j = (data["names"].index(name) for name in (LONG, "impulse"))
    r = np.corrcoef(d.outputs[LONG][d.good], d.inputs["impulse"][d.good])[0, 1]
    assert np.cos(data["ellipses"]["phase"][i][j]) == pytest.approx(r, rel=1e-9)
    finite = d.good & np.isfinite(a)
    r = np.corrcoef(far[finite], a[finite])[0, 1]
    assert np.cos(data["ellipses"]["phase"][i][data["names"].index("apoapsis")]) == pytest.approx(r)


def test_page_without_a_finite_value(tmp_path):
    d = dispersion(200)
    outputs = {"apoapsis": np.full(200, np.inf), LONG: np.full(200, np.nan)}
    lost = Dispersion(d.inputs, outputs, d.status, d.evaluations, d.units, 0)
    dispersion_figure(lost).savefig(tmp_path / "d.png", dpi=40)
    data = data_of(dispersion_page(lost, tmp_path / "d.html").read_text(encoding="utf-8"))
    assert data["histograms"] == {"apoapsis": None, LONG: None}
    assert data["ellipses"]["half"][:2] == [None, None]


def test_figure_of_what_only_rounds(tmp_path):
    figure = dispersion_figure(dispersion(400), nominal=NOMINAL)
    figure.savefig(tmp_path / "d.png", dpi=40)
    texts = " ".join(t.get_text() for axes in figure.axes for t in axes.texts)
    assert "nominal 46000" in texts and "no dispersion" in texts


@pytest.mark.parametrize(
    "x", [np.full(9, 5.0), 1e8 + 1.5e-8 * np.arange(9), np.zeros(4), np.arange(1000.0)]
)
def test_bins_hold_every_value(x):
    start, counts, width = bins(x)
    assert counts.sum() == x.size and width > 0.0
    assert start <= x.min() and start + width * counts.size >= x.max() * (1.0 - 1e-15)
    # Edges that differ.
    assert np.all(np.diff(start + width * np.arange(counts.size + 1)) > 0.0)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
def test_page_draws_and_its_pickers_work(tmp_path):
    path = dispersion_page(dispersion(1000), tmp_path / "d.html", nominal=NOMINAL, paths=paths())
    with open_page(path.as_uri(), tmp_path, 400) as page:
        # One thing changes at a time, and the page that is open follows.
        for width, dark in ((400, False), (400, True), (1600, True), (1600, False)):
            page.window(width, 900, dark)
            how = f"{'narrow' if width == 400 else 'wide'} {'dark' if dark else 'light'}"
            page.wait(f"document.body && document.body.dataset.drawn === '{how}'")
            check_look(page.run(LOOK), width, dark)
            # Of an orbit in the plane of the equator the nominal one is drawn over the runs; the
            # legend is above.
            picture = page.picture("trajectories")[60:]
            tint = np.array([240, 136, 62] if dark else [213, 94, 0]) / 255.0
            # A line so thin that it does not hide the runs beside it.
            assert 100 < np.sum(np.max(np.abs(picture - tint), axis=-1) < 0.1) < 1000
    assert page.console == []
    # The page alone, and nothing of a network.
    assert all(address.split(":")[0] in ("file", "data", "blob") for address in page.asked)


def check_look(found, width, dark):
    assert found["wide"] <= 0 and found["cut"] == [] and found["over"] == []
    drawn = {name: traces for name, (svg, traces) in found["plots"].items() if svg > 0}
    names = {"scatter", "histogram", "contributors", "convergence", "matrix", "trajectories"}
    assert set(drawn) == names | {"time"} and all(traces > 0 for traces in drawn.values())
    assert all(across > 0.6 and up > 0.3 for _, across, up in found["left"]), found["left"]
    # Names in full, on as many lines as they need.
    every = [*found["texts"], *found["named"]]
    words = {text.replace("<br>", " ").replace(". ", ".") for text in every}
    names = {text.partition(" [")[0] for text in words}
    assert {LONG.replace("_", " "), "effects.thrust.nozzle misalignment.1"} <= names
    assert not any("…" in word for word in words)
    # A telephone has no room for the tools; none of them sends the numbers away.
    assert (found["bars"] == []) == (width == 400)
    assert not any("hare" in title or "loud" in title for title in found["bars"])
    # Equal but for the rounding of their ends.
    assert np.ptp(found["lengths"]) < 1e-9 * found["lengths"][0]
    assert found["before"] == "apoapsis [km]"
    assert found["after"][:2] == ["constant", "impulse [N s]"]
    assert "no dispersion" in found["after"][2]
    assert found["ground"] == ("rgb(20, 24, 27)" if dark else "rgb(255, 255, 255)")

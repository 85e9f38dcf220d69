"""The page of a campaign: what it holds, and that it draws and its pickers work in a browser."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from jaxspace.dispersion import Dispersion, Flights
from jaxspace.plots import dispersion_figure, dispersion_page
from jaxspace.plots._bins import bins
from jaxspace.simulation import Status

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
NOMINAL = {"apoapsis": 46000.0, "constant": 1234.5}
# What is drawn, with two pickers moved.
WATCH = """<script>
const ready = setInterval(() => {
  if (!document.body.dataset.drawn && !document.body.dataset.error) return;
  clearInterval(ready);
  const root = document.documentElement, wide = root.scrollWidth - root.clientWidth;
  const found = { error: document.body.dataset.error || "", plots: {}, wide };
  const title = (id) => $(id).layout.xaxis.title.text;
  for (const plot of document.querySelectorAll(".plot"))
    found.plots[plot.id] = [plot.querySelectorAll(".main-svg").length, (plot.data || []).length];
  found.before = title("histogram");
  const pick = (id, value) => { $(id).value = value; $(id).dispatchEvent(new Event("change")); };
  pick("histogram-of", "constant");
  pick("across", "impulse");
  pick("contributors-of", "constant");
  setTimeout(() => {
    found.after = [title("histogram"), title("scatter"), $("contributors-words").textContent];
    const boxes = [...document.querySelectorAll("select")].map((e) => e.getBoundingClientRect());
    const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom <= b.top ||
      b.bottom <= a.top;
    found.apart = boxes.every((a, i) => boxes.every((b, j) => i === j || apart(a, b)));
    found.ground = getComputedStyle(document.body).backgroundColor;
    document.body.insertAdjacentHTML("beforeend", "<i id=found>" + JSON.stringify(found) + "</i>");
  }, 300);
}, 100);
</script></body>"""


def dispersion(runs, requirements=True):
    r = np.random.default_rng(1)
    a, b = r.standard_normal((2, runs))
    outputs = {
        "apoapsis": 46000.0 + 800.0 * a,
        "periapsis": 183.0 + b + 0.3 * a,
        # Constant but for rounding: a spread of 5e-11 in what is some 1e5.
        "constant": 123456.5 + 1.4551915228366852e-11 * np.round(2.0 * r.random(runs)),
    }
    status = np.where(np.arange(runs) % 97 == 3, Status.NOT_FINITE, 0)
    outputs = {name: np.where(status > 0, np.nan, x) for name, x in outputs.items()}
    record = {"preparation_seconds": 2.0, "rtol": 1e-9, "inputs": "impulse [N s]: normal"}
    if requirements:
        record["requirements"] = {"periapsis": [181.0, None]}
    units = {"apoapsis": "km", "periapsis": "km", "impulse": "N s"}
    inputs = {"impulse": a, "misalignment": b}
    return Dispersion(inputs, outputs, status, np.ones(runs, int), units, 5, 9.0, record)


def flights():
    t = np.linspace(0.0, 6.0, 40)
    circle = np.stack([7e6 * np.cos(t), 7e6 * np.sin(t), 0.0 * t])
    positions = np.stack([circle, 1.01 * circle, np.full_like(circle, np.nan)], axis=-1)
    return Flights(np.array([-1, 0, 3]), np.stack([t] * 3, axis=-1), positions)


def data_of(page):
    return json.loads(re.search(r"const data = (.*);\n", page).group(1))


def test_page_holds_card_limits_and_failures(tmp_path):
    page = dispersion_page(
        dispersion(1000), tmp_path / "d.html", title="Kick & <coast>", nominal=NOMINAL
    ).read_text(encoding="utf-8")
    assert "Kick &amp; &lt;coast&gt;" in page and "989 of 1000 ended well" in page
    assert "3, 100, 197, 294, 391 …" in page and Status.NOT_FINITE.sentence in page
    data = data_of(page)
    shown = data["histograms"]["apoapsis"]
    assert sum(shown["counts"]) == 989 and shown["nominal"] == 46000.0
    assert shown["low"] < shown["mean"] < shown["high"]
    assert data["histograms"]["periapsis"]["required"] == [181.0]
    # What only rounds has one bin, no contributors, and a table row.
    assert data["histograms"]["constant"]["counts"] == [989]
    assert data["contributors"]["constant"]["inputs"] == []
    assert data["time"] == {"compiling and planning": 2.0, "running": 7.0}
    assert data["trajectories"] is None and 'id="trajectories"' not in page


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
    assert "0 of 50 ended well" in page and data_of(page)["moments"] is None


def test_figure_of_what_only_rounds(tmp_path):
    figure = dispersion_figure(dispersion(400), nominal=NOMINAL)
    figure.savefig(tmp_path / "d.png", dpi=40)
    texts = " ".join(t.get_text() for axes in figure.axes for t in axes.texts)
    assert "nominal 46000" in texts and "nothing scatters" in texts


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
@pytest.mark.parametrize(
    "width, dark", [(400, True), pytest.param(1600, False, marks=pytest.mark.sweep)]
)
def test_page_draws_and_its_pickers_work(width, dark, tmp_path):
    page = dispersion_page(
        dispersion(1000), tmp_path / "d.html", nominal=NOMINAL, flights=flights()
    )
    page.write_text(page.read_text().replace("</body>", WATCH))
    # No window is as narrow as a telephone: a frame is.
    frame = tmp_path / "frame.html"
    frame.write_text(f'<iframe id=f src="d.html" width={width} height=4000></iframe>')
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += ["--allow-file-access-from-files", "--enable-unsafe-swiftshader", "--dump-dom"]
    command += [f"--user-data-dir={tmp_path / 'user'}", "--virtual-time-budget=9000"]
    command += [f"--blink-settings=preferredColorScheme={0 if dark else 1}"]
    copy = "onload=()=>setInterval(()=>{const i=f.contentDocument.getElementById('found');"
    copy += "if(i)document.body.append(i.cloneNode(true))},200)"
    frame.write_text(frame.read_text() + f"<script>{copy}</script>")
    done = subprocess.run([*command, frame.as_uri()], capture_output=True, text=True, timeout=120)
    errors = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    # Remarks of the graphics driver on its own speed are no errors.
    assert not [e for e in errors if "GL Driver Message" not in e and "Canvas2D" not in e], errors
    found = json.loads(re.search(r"<i id=\"found\">(.*?)</i>", done.stdout).group(1))
    assert found["error"] == "" and found["wide"] <= 0 and found["apart"]
    drawn = {name: traces for name, (svg, traces) in found["plots"].items() if svg > 0}
    names = {"scatter", "histogram", "contributors", "convergence", "matrix", "trajectories"}
    assert set(drawn) == names | {"time"} and all(traces > 0 for traces in drawn.values())
    assert found["before"] == "apoapsis [km]"
    assert found["after"][:2] == ["constant", "impulse [N s]"]
    assert "nothing scatters" in found["after"][2]
    assert found["ground"] == ("rgb(20, 24, 27)" if dark else "rgb(255, 255, 255)")

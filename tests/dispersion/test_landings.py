"""Where the runs of a campaign land: ellipses, their picture and page, and the rose of the wind."""

import dataclasses
import json
import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.bodies import BodyState
from jaxspace.cli._report import nominal_outputs
from jaxspace.core import InputError
from jaxspace.dispersion import Dispersion
from jaxspace.io import load
from jaxspace.io.reports.campaign_tables import dispersion_report
from jaxspace.plots import designs_figure, dispersion_figure, dispersion_page, footprint_figure
from jaxspace.plots.footprint import wind_rose
from jaxspace.simulation import MissionTrajectory, Trajectory
from jaxspace.vehicles.landings import landing

SCENE = Path(__file__).parents[2] / "examples" / "scenes" / "landing.toml"
# Long and short semi-axis of one deviation, m, and the bearing of the long one, deg.
LONG, SHORT, BEARING = 300.0, 100.0, 120.0
RUNS = 4000


def campaign(**changes):
    """Landings that are normally distributed about 1000 m east and 500 m north, one in a hundred of
    which failed; a degree of longitude is 100 km to the east, and one of latitude to the north."""
    r = np.random.default_rng(3)
    along, across = np.array([[LONG], [SHORT]]) * r.standard_normal((2, RUNS))
    s, c = np.sin(np.radians(BEARING)), np.cos(np.radians(BEARING))
    east, north = 1000.0 + s * along + c * across, 500.0 + c * along - s * across
    status = np.where(np.arange(RUNS) % 100 == 7, 9, 0)
    outputs = {"east": east, "north": north, "distance": np.hypot(east, north)}
    outputs |= {"landing_longitude": 7.0 + 1e-5 * east, "landing_latitude": 50.0 + 1e-5 * north}
    outputs = {name: np.where(status > 0, np.nan, x) for name, x in (outputs | changes).items()}
    units = dict.fromkeys(("east", "north", "distance"), "m")
    units |= dict.fromkeys(("landing_longitude", "landing_latitude"), "deg")
    record = {"requirements": {"distance": [None, 1500.0]}}
    inputs = {"a": along, "b": across}
    return Dispersion(inputs, outputs, status, np.ones(RUNS, int), units, 3, 1.0, record)


def test_the_outputs_of_a_campaign_in_python():
    """Of two flights, one of which comes down where it started."""
    top = jnp.array([[30.0, 0.0], [40.0, 0.0], [900.0, 100.0]])
    end = jnp.array([[330.0, 0.0], [-360.0, 0.0], [0.0, 0.0]])
    states = [BodyState(jnp.stack([0.0 * x, x], axis=1), x[:, None]) for x in (0.0 * top, top)]
    final = BodyState(end, jnp.array([[3.0, 0.0], [0.0, 0.0], [-4.0, -5.0]]))
    end_of_all, good = jnp.array([90.0, 20.0]), jnp.zeros(2, int)
    ts = jnp.zeros((2, 2))
    every = good, good, jnp.ones((0, 2), bool), {}, 1
    phases = tuple(Trajectory(ts, state, *every) for state in states)
    run = MissionTrajectory(phases, ("rail", "ascent"), final, end_of_all, good)
    found = landing(run, {})
    expected = {
        "east": [330.0, 0.0],
        "north": [-360.0, 0.0],
        "distance": [np.hypot(330.0, 360.0), 0.0],
        "drift_of_ascent": [50.0, 0.0],
        "drift_of_descent": [500.0, 0.0],
        "apogee": [900.0, 100.0],
        "impact_speed": [5.0, 5.0],
        "flight_time": [90.0, 20.0],
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-14, err_msg=name)


def test_ellipses_are_those_of_the_normal_distribution():
    found = campaign().footprint()
    assert found.points.shape == (2, RUNS - RUNS // 100)
    for share, (probability, east, north, long, short, bearing, inside) in zip(
        (0.5, 0.9, 0.99), found.rows, strict=True
    ):
        # P(chi^2_2 <= k^2) = 1 - exp(-k^2/2).
        k = np.sqrt(-2.0 * np.log(1.0 - share))
        assert probability == share
        # Four deviations of the sampling: of a mean s/sqrt(n), of a deviation s/sqrt(2 n).
        assert abs(east - 1000.0) < 4.0 * LONG / RUNS**0.5
        assert abs(north - 500.0) < 4.0 * LONG / RUNS**0.5
        np.testing.assert_allclose(
            [long / k, short / k], [LONG, SHORT], rtol=4.0 / (2 * RUNS) ** 0.5
        )
        assert abs(bearing - BEARING) < 2.0
        assert abs(inside - share) < 4.0 * (share * (1.0 - share) / RUNS) ** 0.5


def test_without_landings_there_is_no_footprint():
    there = campaign()
    for outputs in ({"east": there.outputs["east"]}, {}):
        with_less = Dispersion({}, outputs, there.status, there.evaluations, {}, 3)
        assert with_less.footprint() is None
    nowhere = campaign(east=np.full(RUNS, np.nan))
    assert nowhere.footprint() is None
    with pytest.raises(InputError, match="dispersion has no footprint: east and north must be"):
        footprint_figure(nowhere)
    assert "landing ellipses" not in dispersion_report(nowhere, {})


def test_landings_without_a_scatter_are_a_point():
    still = campaign(east=np.full(RUNS, 10.0), north=np.full(RUNS, -3.0))
    (_, east, north, long, short, _, inside), *_ = still.footprint().rows
    np.testing.assert_allclose([east, north, long, short], [10.0, -3.0, 0.0, 0.0], atol=1e-9)
    assert inside == 1.0
    footprint_figure(still).canvas.draw()


def test_a_report_has_the_ellipses_and_the_requirement():
    text = dispersion_report(campaign(), {})
    assert re.search(r"ellipse +east \[m\] +north \[m\] +long semi-axis \[m\] +short \[m\]", text)
    assert re.search(r"^50 % +\d+ +\d+ +\d+ +\d+ +1[12]\d +\d", text, re.MULTILINE)
    # A failed flight is outside.
    assert re.search(r"^distance +<= 1500 m|^distance +≤ 1500 m", text, re.MULTILINE)


def test_nominal_outputs_of_a_campaign_need_no_further_run():
    """The campaign itself has them: the file is asked for no run."""
    there = campaign()
    there.attributes["nominal"] = {"east": 900.0}
    assert nominal_outputs(load(SCENE), there) == {"east": (900.0, "m")}


def test_a_rose_points_to_where_the_wind_comes_from():
    # From the west with 3, from the north with 7, from the south-east with 1 m/s, and a calm.
    shares, edges = wind_rose([3.0, 0.0, -0.7071, 0.0], [0.0, -7.0, 0.7071, 0.0])
    np.testing.assert_array_equal(edges, [0.0, 2.0, 4.0, 6.0, 8.0])
    assert shares.shape == (4, 16)
    assert shares[1, 12] == shares[3, 0] == shares[0, 6] == 0.25
    # The calm comes from nowhere.
    assert shares.sum() == 0.75
    calm, _ = wind_rose(np.zeros(5), np.zeros(5))
    assert calm.sum() == 0.0


def test_figure_and_page_show_the_landings(tmp_path):
    there, wind = campaign(), (np.linspace(3.0, 8.0, 50), np.linspace(1.0, -2.0, 50))
    figure = footprint_figure(there, wind=wind, title="Landings", nominal=(1000.0, 500.0))
    axes, rose = figure.axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[0] == f"{RUNS - RUNS // 100} landings"
    assert labels[1].startswith("ellipse of 50 %")
    assert labels[-1] == "required: within 1500 m"
    assert axes.get_aspect() == 1.0
    assert axes.get_xlabel() == "east of the rail [m]"
    assert footprint_figure(dataclasses.replace(there, units={})).axes[0].get_ylabel() == (
        "north of the rail"
    )
    every = dispersion_figure(there, ("east", "north"))
    every.canvas.draw()
    assert every.axes[0].get_aspect() == 1.0
    assert dispersion_figure(there, ("distance", "north")).axes[0].get_aspect() == "auto"
    # No line of words is cut at the edge.
    for text in (text for axes in every.axes for text in axes.texts):
        assert text.get_window_extent().x1 <= every.bbox.x1
    assert rose.name == "polar"
    page = dispersion_page(there, tmp_path / "page.html", wind=wind).read_text()
    data = json.loads(re.search(r"const data = (\{.*\});\n", page)[1])
    assert data["footprint"]["radius"] == 1500.0
    assert [len(e["x"]) for e in data["footprint"]["ellipses"]] == [121] * 3
    # Degrees at the rail, and for a metre.
    np.testing.assert_allclose(data["footprint"]["degrees"], [[7.0, 1e-5], [50.0, 1e-5]], rtol=1e-9)
    np.testing.assert_allclose(np.sum(data["rose"]["shares"]), 100.0, atol=0.1)
    assert '<div class="plot tall" id="footprint">' in page


def test_what_is_drawn_together_has_one_unit(tmp_path):
    """A limit on the distance in km, landings in mm, latitudes in minutes of arc."""
    there = campaign()
    scaled = {name: 1e3 * there.outputs[name] for name in ("east", "north")}
    # A minute of arc is a nautical mile; at 60 degrees of latitude there are two to the east.
    degrees = {
        "landing_latitude": 3600.0 + there.outputs["north"] / 1852.0,
        "landing_longitude": there.outputs["east"] / 926.0,
    }
    distance = there.outputs["distance"] / 1e3
    units = {"east": "mm", "north": "mm", "distance": "km"} | dict.fromkeys(degrees, "arcmin")
    mixed = dataclasses.replace(
        there,
        outputs=there.outputs | scaled | degrees | {"distance": distance},
        units=there.units | units,
        attributes=there.attributes | {"requirements": {"distance": (None, 1.5)}},
    )
    axes = footprint_figure(mixed).axes[0]
    (circle,) = (line for line in axes.lines if str(line.get_label()).startswith("required"))
    np.testing.assert_allclose(np.hypot(*circle.get_data()), 1.5e6, rtol=1e-12)
    assert circle.get_label() == "required: within 1.5e+06 mm"
    page = dispersion_page(mixed, tmp_path / "d.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r"const data = (.*);\n", page).group(1))
    np.testing.assert_allclose(data["footprint"]["radius"], 1.5e6, rtol=1e-12)
    # Degrees at the rail, and for each mm.
    expected = [[0.0, 1.0 / (60.0 * 926e3)], [60.0, 1.0 / (60.0 * 1852e3)]]
    np.testing.assert_allclose(data["footprint"]["degrees"], expected, rtol=1e-9, atol=1e-12)
    # Of a unit without a known factor there is no circle.
    unknown = dataclasses.replace(mixed, units=mixed.units | {"distance": "furlong"})
    assert not any(
        str(line.get_label()).startswith("required")
        for line in footprint_figure(unknown).axes[0].lines
    )


def test_designs_are_compared_in_one_unit():
    there = campaign()
    far = {"distance": there.outputs["distance"] / 1e3}
    other = dataclasses.replace(there, outputs=far, units={"distance": "km"})
    axes = designs_figure({"first": there, "second": other}, "distance").axes[0]
    # Both histograms are the same.
    heights = [[bar.get_height() for bar in group] for group in axes.containers]
    assert heights[0] == heights[-1]
    wrong = dataclasses.replace(other, units={"distance": "kg"})
    with pytest.raises(InputError, match="distance is in kg in the design 'second', and in m in"):
        designs_figure({"first": there, "second": wrong}, "distance")

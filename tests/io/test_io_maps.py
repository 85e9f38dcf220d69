"""Landings of a campaign as KML and GeoJSON: each point in its place, both formats valid."""

import dataclasses
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from jaxspace.core import InputError
from jaxspace.dispersion import Dispersion
from jaxspace.io.maps import landings_geojson, landings_kml
from jaxspace.vehicles import LaunchSite

RUNS = 60
SITE = LaunchSite(
    5.0, 1.5, latitude=np.radians(45.0), longitude=np.radians(179.99), elevation=1200.0
)
KML = "{http://www.opengis.net/kml/2.2}"


def campaign(**changes) -> Dispersion:
    r = np.random.default_rng(5)
    east, north = 3.0 + r.standard_normal(RUNS), -1.0 + 0.5 * r.standard_normal(RUNS)
    status = np.where(np.arange(RUNS) == 7, 9, 0)
    outputs = {"east": east, "north": north, "distance": 1e3 * np.hypot(east, north)}
    outputs = {name: np.where(status > 0, np.nan, x) for name, x in outputs.items()}
    units = {"east": "km", "north": "km", "distance": "m"}
    record = {"requirements": {"distance": [None, 4000.0]}}
    found = Dispersion({"a": east}, outputs, status, np.ones(RUNS, int), units, 3, 1.0, record)
    return dataclasses.replace(found, **changes)


def radii(latitude: float, height: float) -> tuple[float, float]:
    """Lengths of a radian of longitude and of latitude, m (WGS 84)."""
    a, f = 6378137.0, 1.0 / 298.257223563
    e2 = f * (2.0 - f)
    w = np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    return (a / w + height) * np.cos(latitude), a * (1.0 - e2) / w**3 + height


def read_geojson(path: Path) -> dict[str, dict]:
    data = json.loads(path.read_text())
    assert data["type"] == "FeatureCollection"
    return {feature["properties"]["name"]: feature for feature in data["features"]}


def test_geojson_places_each_landing_beside_the_site(tmp_path):
    there = campaign()
    landings_geojson(there, tmp_path / "a.geojson", site=SITE)
    found = read_geojson(tmp_path / "a.geojson")
    across, along = radii(np.radians(45.0), 1200.0)
    runs = [f for f in found.values() if f["properties"]["kind"] == "landing"]
    assert [f["properties"]["run"] for f in runs] == [k for k in range(RUNS) if k != 7]
    for feature in runs:
        k = feature["properties"]["run"]
        longitude, latitude = feature["geometry"]["coordinates"]
        east = np.radians(longitude - 179.99) * across
        north = np.radians(latitude - 45.0) * along
        # The tangent plane departs from the ellipsoid by a few metres over 6 km.
        np.testing.assert_allclose(east, 1e3 * there.outputs["east"][k], atol=6.0)
        np.testing.assert_allclose(north, 1e3 * there.outputs["north"][k], atol=6.0)
    # Across the date line longitudes go on beyond 180 degrees.
    assert max(f["geometry"]["coordinates"][0] for f in runs) > 180.0
    assert found["Launch site"]["geometry"]["coordinates"] == pytest.approx([179.99, 45.0])


def test_geojson_outlines_are_closed_and_anticlockwise(tmp_path):
    landings_geojson(campaign(), tmp_path / "a.geojson", site=SITE)
    found = read_geojson(tmp_path / "a.geojson")
    across, along = radii(np.radians(45.0), 1200.0)
    areas = [f for f in found.values() if f["geometry"]["type"] == "Polygon"]
    assert len(areas) == 4
    for area in areas:
        (ring,) = area["geometry"]["coordinates"]
        assert ring[0] == ring[-1]
        x, y = (np.array(ring) - [179.99, 45.0]).T
        enclosed = 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
        enclosed *= np.radians(1.0) ** 2 * across * along
        given = area["properties"]
        if area["properties"]["kind"] == "area":
            expected = np.pi * given["long_semi_axis"] * given["short_semi_axis"]
        else:
            assert given["radius"] == 4000.0
            expected = np.pi * 4000.0**2
        np.testing.assert_allclose(enclosed, expected, rtol=5e-3)
    ellipse = found["Ellipse of 90 %"]["properties"]
    assert ellipse["probability"] == 0.9
    assert 0.75 < ellipse["inside"] <= 1.0


def test_kml_has_the_same_places(tmp_path):
    landings_geojson(campaign(), tmp_path / "a.geojson", site=SITE)
    landings_kml(campaign(), tmp_path / "a.kml", site=SITE, title="A & B")
    found = read_geojson(tmp_path / "a.geojson")
    root = ElementTree.parse(tmp_path / "a.kml").getroot()
    assert root.tag == f"{KML}kml"
    (document,) = root
    assert document.findtext(f"{KML}name") == "A & B"
    styles = {style.get("id") for style in document.iter(f"{KML}Style")}
    marks = {mark.findtext(f"{KML}name"): mark for mark in document.iter(f"{KML}Placemark")}
    points = [f for f in found.values() if f["properties"]["kind"] == "landing"]
    assert set(marks) == {name for name in found if not name.startswith("Run ")} | {
        f"{len(points)} landings"
    }
    for name, mark in marks.items():
        style = mark.findtext(f"{KML}styleUrl")
        assert style is None or style.removeprefix("#") in styles
        written = [
            [float(x) for x in place.split(",")]
            for text in mark.iter(f"{KML}coordinates")
            for place in (text.text or "").split()
        ]
        if name in found:
            geometry = found[name]["geometry"]
            expected = geometry["coordinates"]
            expected = expected[0] if geometry["type"] == "Polygon" else [expected]
        else:
            expected = [f["geometry"]["coordinates"] for f in points]
        np.testing.assert_allclose(written, expected, rtol=0.0, atol=1e-8)


def test_campaigns_without_a_place_are_refused(tmp_path):
    path = tmp_path / "a.kml"
    with pytest.raises(InputError, match="site is missing"):
        landings_kml(campaign(), path)
    with pytest.raises(InputError, match=r"LaunchSite\.longitude is missing"):
        landings_kml(campaign(), path, site=LaunchSite(5.0, 1.5, latitude=0.8))
    with pytest.raises(InputError, match="east and north must be outputs"):
        landings_geojson(campaign(outputs={}), path, site=SITE)
    angles = {"east": "rad", "north": "rad"}
    with pytest.raises(InputError, match="is rad: it must be a length"):
        landings_geojson(campaign(units=angles), path, site=SITE)
    assert not path.exists()

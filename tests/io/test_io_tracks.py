"""Tracks as GPX, KML and CZML: places, dates and attitudes, in the forms of their schemas."""

import json
from xml.etree import ElementTree

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxspace import Scene, simulate
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.core import InputError
from jaxspace.io.tracks import EarthTrack, earth_tracks, tracks_czml, tracks_gpx, tracks_kml
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.vehicles import LaunchSite
from jaxspace.vehicles.ground_gravity import GroundGravity

MU, RATE = 3.986004418e14, 7.292115e-5
RADIUS = 7e6
N = float(np.sqrt(MU / RADIUS**3))
GPX = "{http://www.topografix.com/GPX/1/1}"
KML = "{http://www.opengis.net/kml/2.2}"
EPOCH = "2026-03-01T12:00:00.5Z"


@pytest.fixture(scope="module")
def orbit():
    """A circle over the equator."""
    scene = Scene([PointGravity(MU)], RigidBody(1.0))
    y0 = BodyState(jnp.array([RADIUS, 0.0, 0.0]), jnp.array([0.0, N * RADIUS, 0.0]))
    return simulate(scene, y0, jnp.linspace(0.0, 3000.0, 60))


@pytest.fixture(scope="module")
def flight():
    """A throw to the north from a site, of a body that turns once about its axis to the east."""
    body = RigidBody(1.0, (1.0, 1.0, 1.0))
    scene = Scene([GroundGravity(9.8)], body, carry=("attitude", "omega"))
    y0 = BodyState(
        jnp.zeros(3),
        jnp.array([0.0, 100.0, 49.0]),
        Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0])),
        jnp.array([2.0 * np.pi / 10.0, 0.0, 0.0]),
    )
    return simulate(scene, y0, jnp.linspace(0.0, 10.0, 41))


SITE = LaunchSite(
    5.0, 1.5, latitude=np.radians(60.0), longitude=np.radians(179.999), elevation=100.0
)


def test_an_orbit_over_the_turning_earth(orbit):
    (track,) = earth_tracks(orbit, angle=0.3, name="circle")
    t = np.linspace(0.0, 3000.0, 60)
    expected = np.degrees((N - RATE) * t - 0.3)
    np.testing.assert_allclose(track.longitude, (expected + 180.0) % 360.0 - 180.0, atol=1e-6)
    np.testing.assert_allclose(track.latitude, 0.0, atol=1e-9)
    np.testing.assert_allclose(track.altitude, RADIUS - 6378137.0, atol=0.1)
    assert track.attitude is None


def test_gpx_has_the_form_of_its_schema(flight, tmp_path):
    """GPX 1.1: the version and the creator, the order of elements, the ranges of coordinates."""
    tracks_gpx(earth_tracks(flight, site=SITE), tmp_path / "a.gpx", epoch=EPOCH, title="A & B")
    root = ElementTree.parse(tmp_path / "a.gpx").getroot()
    assert root.tag == f"{GPX}gpx" and root.get("version") == "1.1" and root.get("creator")
    assert [child.tag for child in root] == [f"{GPX}metadata", f"{GPX}trk"]
    assert root[0].findtext(f"{GPX}name") == "A & B"
    assert [child.tag for child in root[1]] == [f"{GPX}name", f"{GPX}trkseg"]
    points = list(root.iter(f"{GPX}trkpt"))
    assert len(points) == 41
    for point in points:
        assert -90.0 <= float(point.get("lat", "nan")) <= 90.0
        assert -180.0 <= float(point.get("lon", "nan")) < 180.0
        assert [child.tag for child in point] == [f"{GPX}ele", f"{GPX}time"]
    # 500 m to the north after 5 s: by the radius of curvature of WGS 84 at 60 deg.
    middle = points[20]
    north = np.radians(float(middle.get("lat", "nan")) - 60.0) * (6383453.86 + 100.0)
    np.testing.assert_allclose(north, 500.0, atol=0.05)
    height = 49.0 * 5.0 - 0.5 * 9.8 * 25.0
    np.testing.assert_allclose(float(middle.findtext(f"{GPX}ele", "")), 100.0 + height, atol=0.05)
    assert middle.findtext(f"{GPX}time") == "2026-03-01T12:00:05.500000Z"
    tracks_gpx(earth_tracks(flight, site=SITE), tmp_path / "a.gpx")
    assert not list(ElementTree.parse(tmp_path / "a.gpx").getroot().iter(f"{GPX}time"))


def test_kml_has_a_line_for_each_track(flight, orbit, tmp_path):
    tracks = [*earth_tracks(flight, site=SITE, name="up"), *earth_tracks(orbit, name="around")]
    tracks_kml(tracks, tmp_path / "a.kml", title="Both")
    root = ElementTree.parse(tmp_path / "a.kml").getroot()
    (document,) = root
    assert root.tag == f"{KML}kml" and document.findtext(f"{KML}name") == "Both"
    marks = list(document.iter(f"{KML}Placemark"))
    assert [mark.findtext(f"{KML}name") for mark in marks] == ["up", "around"]
    for mark, track in zip(marks, tracks, strict=True):
        line = mark.find(f"{KML}LineString")
        assert line is not None
        assert [x.tag for x in line] == [f"{KML}altitudeMode", f"{KML}coordinates"]
        text = line.findtext(f"{KML}coordinates", "")
        found = np.array([[float(x) for x in place.split(",")] for place in text.split()])
        expected = np.stack(track[2:5], axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-3)
    styles = {style.get("id") for style in document.iter(f"{KML}Style")}
    assert {mark.findtext(f"{KML}styleUrl", "").removeprefix("#") for mark in marks} == styles


def test_czml_has_positions_and_attitudes_in_axes_of_the_earth(flight, orbit, tmp_path):
    tracks = [*earth_tracks(flight, site=SITE), *earth_tracks(orbit)]
    tracks_czml(tracks, tmp_path / "a.czml", epoch=EPOCH)
    document, first, second = json.loads((tmp_path / "a.czml").read_text())
    assert document["id"] == "document" and document["version"] == "1.0"
    interval = "2026-03-01T12:00:00.500000Z/2026-03-01T12:50:00.500000Z"
    assert document["clock"]["interval"] == interval
    assert first["availability"].endswith("T12:00:10.500000Z")
    samples = np.array(second["position"]["cartesian"]).reshape(-1, 4)
    assert second["position"]["referenceFrame"] == "FIXED" and "orientation" not in second
    angle = (N - RATE) * samples[:, 0]
    expected = RADIUS * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    np.testing.assert_allclose(samples[:, 1:], expected, atol=0.5)
    q = np.array(first["orientation"]["unitQuaternion"]).reshape(-1, 5)
    np.testing.assert_allclose(np.linalg.norm(q[:, 1:], axis=1), 1.0, atol=1e-8)
    # No change of sign between two times.
    assert np.all(np.sum(q[1:, 1:] * q[:-1, 1:], axis=1) > 0.9)
    # At the start the axes are those of the site: east, north and up.
    turn = Rotation.from_quat(q[:, 1:])
    s, c = np.sin(SITE.latitude), np.cos(SITE.latitude)
    a, b = np.sin(SITE.longitude), np.cos(SITE.longitude)
    np.testing.assert_allclose(turn[0].apply([1.0, 0.0, 0.0]), [-a, b, 0.0], atol=1e-8)
    np.testing.assert_allclose(turn[0].apply([0.0, 0.0, 1.0]), [c * b, c * a, s], atol=1e-8)
    # The axis of the turn stays, and after a quarter of it the body's y axis points up.
    np.testing.assert_allclose(turn[10].apply([1.0, 0.0, 0.0]), [-a, b, 0.0], atol=1e-6)
    np.testing.assert_allclose(turn[10].apply([0.0, 1.0, 0.0]), [c * b, c * a, s], atol=1e-6)


def plain(**changes):
    t = np.arange(3.0)
    return EarthTrack("a", t, 10.0 + t, 20.0 + t, 0.0 * t)._replace(**changes)


@pytest.mark.parametrize("write", [tracks_gpx, tracks_kml, tracks_czml])
def test_tracks_that_are_none_are_refused(tmp_path, write):
    path = tmp_path / "a"
    for track, sentence in (
        (plain(latitude=np.array([89.0, 90.5, 91.0])), "is 90.5 deg, beyond a pole"),
        (plain(longitude=np.array([1.0, np.nan, 2.0])), "EarthTrack.longitude of 'a' must be fin"),
        (plain(times=np.zeros(3)), "EarthTrack.times of 'a' must ascend"),
    ):
        with pytest.raises(InputError, match=sentence):
            write([track], path)
    with pytest.raises(InputError, match="tracks is empty"):
        write([], path)
    if write is not tracks_kml:
        with pytest.raises(InputError, match="epoch is 'soon': it must be a time such as"):
            write([plain()], path, epoch="soon")
    assert not path.exists()


def test_runs_without_a_track_are_refused(orbit):
    with pytest.raises(InputError, match=r"LaunchSite\.longitude is missing"):
        earth_tracks(orbit, site=LaunchSite(5.0, 1.5, latitude=0.8))

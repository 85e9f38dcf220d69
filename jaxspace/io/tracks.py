"""Trajectories as files for maps and globes: GPX and KML of the track, CZML of motion and attitude.

    phi, lam, h = geodetic coordinates of C_FN(t) r,   C_FN(t) = R_3(theta_0 + w t)      an orbit
    q_F = C_FN(t) q,  or the axes of the site times q                                    attitude

    symbol          meaning                                              unit
    r, q            position, and attitude of the body                   m, 1
    theta_0, w      angle of the prime meridian at t = 0, and rate       rad, rad/s
    F, N            axes fixed to the Earth, inertial axes

The Earth is the ellipsoid of WGS 84. Positions of a flight from a launch site count from the site:
to the east, to the north and up. All others are inertial, from the centre of the Earth.

Sources: Topografix, GPX 1.1 Schema; OGC 12-007r2, KML 2.3; AGI, CZML Guide.
"""

__all__ = ["EarthTrack", "earth_tracks", "tracks_gpx", "tracks_kml", "tracks_czml"]

import json
import os
from collections.abc import Iterable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import jax.numpy as jnp
import numpy as np

from ..control import LoopRun
from ..core import InputError
from ..core.printing import printed
from ..orbits.ground_track import GroundPoint, ground_point, position_of
from ..simulation import MissionTrajectory, Trajectory
from ..simulation.mission_result import Simulated
from ..vehicles import LaunchSite
from ..vehicles.landings import ground_place
from ._epochs import ALLOWED, Instant, instant

RADIUS, FLATTENING = 6378137.0, 1.0 / 298.257223563  # m, 1 (WGS 84)
RATE = 7.292115e-5  # rad/s (WGS 84)
MU_EARTH = 3.986004418e14  # m^3/s^2 (IERS Conventions 2010)
J2000 = "2000-01-01T12:00:00Z"
GPX = "http://www.topografix.com/GPX/1/1"
KML = "http://www.opengis.net/kml/2.2"
# As KML writes colours: opacity, blue, green, red.
LINE = "ffb27200"
# Of the line and the point in CZML: red, green, blue, opacity.
COLOUR = [0, 114, 178, 255]
DIGITS = 9


@printed(times="s", longitude="deg", latitude="deg", altitude="m")
class EarthTrack(NamedTuple):
    """A path over the Earth, at ascending times.

    - `name`: of the run, or of a branch.
    - `times`: s, (times,).
    - `longitude`, `latitude`: geodetic, deg, (times,); `altitude`: above the ellipsoid, m.
    - `attitude`: unit quaternion that maps body components to axes fixed to the Earth, scalar
      first, (4, times); `None` without an attitude."""

    name: str
    times: np.ndarray
    longitude: np.ndarray
    latitude: np.ndarray
    altitude: np.ndarray
    attitude: np.ndarray | None = None


def earth_tracks(
    run: Simulated | LoopRun,
    *,
    site: LaunchSite | None = None,
    angle: float = 0.0,
    name: str = "run",
) -> list[EarthTrack]:
    """The tracks of a single run: that of the mission, and one of each branch.

    **Arguments**

    - `run`: whose states have a position; at its save times.
    - `site`: the launch site with `latitude` and `longitude`, of a flight in its axes; without one
      positions are inertial, from the centre of the Earth.
    - `angle`: of the prime meridian to the x axis at t = 0, rad; for a date, the Greenwich sidereal
      time.
    - `name`: of the track of the mission.

    **Raises** `InputError` for a batch of runs, states without a position, and a site without
    latitude or longitude."""
    run = run.trajectory if isinstance(run, LoopRun) else run
    if np.ndim(run.status):
        raise InputError("run is a batch: it must be a single run, such as run.of(0).")
    if not isinstance(run, MissionTrajectory):
        return [_track(name, [run], site, angle)]
    tracks = [_track(name, list(run.without_branches().phases), site, angle)]
    for branch in run.branch_names:
        own = run[branch].without_branches()
        tracks.append(_track(f"{name}: {branch}", list(own.phases), site, angle))
    return tracks


def track_of_positions(
    name: str,
    times: np.ndarray,
    position: np.ndarray,
    *,
    site: LaunchSite | None = None,
    angle: float = 0.0,
    attitude: np.ndarray | None = None,
) -> EarthTrack:
    """The track of positions, (3, times), in the axes of `earth_tracks`."""
    good = np.isfinite(times) & np.all(np.isfinite(position), axis=0)
    # Phases share the time of their border, which a file must contain once.
    times, first = np.unique(times[good], return_index=True)
    if times.size < 2:
        raise InputError(f"{name} has fewer than two finite positions: there is no track.")
    r = jnp.asarray(position[:, good][:, first])
    turned = angle + RATE * times
    if site is not None:
        where = _coordinates(site)
        point = ground_place(r, *where)
    else:
        point = ground_point(r, jnp.asarray(turned), RADIUS, FLATTENING)
    q = None
    if attitude is not None:
        q = _to_earth(attitude[:, good][:, first], turned, site)
    longitude, latitude = (np.degrees(np.asarray(x, float)) for x in (point.longitude, point[0]))
    return EarthTrack(name, times, longitude, latitude, np.asarray(point.altitude, float), q)


def _coordinates(site: LaunchSite) -> tuple[float, float, float]:
    for name in ("latitude", "longitude"):
        if getattr(site, name) is None:
            raise InputError(f"LaunchSite.{name} is missing: a map needs both coordinates.")
    return float(site.latitude), float(site.longitude), float(site.elevation)  # type: ignore


def _track(
    name: str, phases: list[Trajectory], site: LaunchSite | None, angle: float
) -> EarthTrack:
    positions = [getattr(phase.states, "position", None) for phase in phases]
    if any(x is None or x.shape[0] != 3 for x in positions):
        raise InputError("run has states without a position of three components: no map shows it.")
    attitudes = [getattr(phase.states, "attitude", None) for phase in phases]
    attitude = None
    if all(x is not None for x in attitudes):
        parts = [np.asarray(getattr(x, "wxyz", x)) for x in attitudes]
        attitude = np.concatenate(parts, axis=1)
    times = np.concatenate([np.asarray(phase.ts) for phase in phases])
    position = np.concatenate([np.asarray(x) for x in positions], axis=1)
    return track_of_positions(name, times, position, site=site, angle=angle, attitude=attitude)


def _to_earth(wxyz: np.ndarray, turned: np.ndarray, site: LaunchSite | None) -> np.ndarray:
    """Attitudes relative to axes fixed to the Earth, without a change of sign between two times,
    through which a globe would interpolate."""
    from scipy.spatial.transform import Rotation

    own = Rotation.from_quat(wxyz.T, scalar_first=True)
    if site is None:
        earth = Rotation.from_euler("z", -turned)
    else:
        latitude, longitude, _ = _coordinates(site)
        # East, north and up as columns.
        s, c = np.sin(latitude), np.cos(latitude)
        across, along = np.sin(longitude), np.cos(longitude)
        east, up = (-across, along, 0.0), (c * along, c * across, s)
        earth = Rotation.from_matrix(np.stack([east, np.cross(up, east), up], axis=1))
    q = (earth * own).as_quat(scalar_first=True).T
    flips = np.cumprod(np.append(1.0, np.where(np.sum(q[:, 1:] * q[:, :-1], 0) < 0.0, -1.0, 1.0)))
    return q * flips


def _checked(tracks: Iterable[EarthTrack]) -> list[EarthTrack]:
    """The tracks, with longitudes from -180 to 180 deg. Raises `InputError` for coordinates that
    are none, and without tracks."""
    found = []
    for track in tracks:
        for field in ("times", "longitude", "latitude", "altitude"):
            x = getattr(track, field)
            if not np.all(np.isfinite(x)):
                raise InputError(f"EarthTrack.{field} of {track.name!r} must be finite.")
        beyond = np.abs(track.latitude) > 90.0
        if beyond.any():
            worst = track.latitude[np.argmax(beyond)]
            raise InputError(
                f"EarthTrack.latitude of {track.name!r} is {worst:.9g} deg, beyond a pole: it must "
                "be from -90 to 90 deg."
            )
        if np.any(np.diff(track.times) <= 0.0):
            raise InputError(f"EarthTrack.times of {track.name!r} must ascend.")
        found.append(track._replace(longitude=(track.longitude + 180.0) % 360.0 - 180.0))
    if not found:
        raise InputError("tracks is empty: there must be at least one track.")
    return found


def tracks_gpx(
    tracks: Sequence[EarthTrack],
    path: str | os.PathLike[str],
    *,
    epoch: str | None = None,
    title: str = "jaxspace",
) -> None:
    """Write tracks as GPX 1.1, for navigation programs.

    **Arguments**

    - `tracks`: of `earth_tracks`, of one run or of several.
    - `path`: the file to write; an existing one is replaced.
    - `epoch`: date at t = 0, text of ISO 8601 in UTC; without it the points have no times.
    - `title`: of the file.

    **Raises** `InputError` for coordinates beyond a pole or not finite, and for an epoch that is
    not a date."""
    checked = _checked(tracks)
    start = None if epoch is None else _instant(epoch)
    root = ElementTree.Element("gpx", version="1.1", creator="jaxspace", xmlns=GPX)
    _text(ElementTree.SubElement(root, "metadata"), "name", title)
    for track in checked:
        line = ElementTree.SubElement(root, "trk")
        _text(line, "name", track.name)
        segment = ElementTree.SubElement(line, "trkseg")
        for t, x, y, h in zip(*track[1:5], strict=True):
            place = {"lat": f"{y:.{DIGITS}f}", "lon": f"{_east(x):.{DIGITS}f}"}
            point = ElementTree.SubElement(segment, "trkpt", place)
            _text(point, "ele", f"{h:.3f}")
            if start is not None:
                _text(point, "time", _stamp(start, float(t)))
    _write(root, path)


def tracks_kml(
    tracks: Sequence[EarthTrack], path: str | os.PathLike[str], *, title: str = "jaxspace"
) -> None:
    """Write tracks as KML, for Google Earth and similar programs: lines at their altitudes.

    **Arguments**

    - `tracks`, `path`, `title`: as in `tracks_gpx`.

    **Raises** `InputError` for coordinates beyond a pole or not finite."""
    checked = _checked(tracks)
    root = ElementTree.Element("kml", xmlns=KML)
    document = ElementTree.SubElement(root, "Document")
    _text(document, "name", title)
    style = ElementTree.SubElement(
        ElementTree.SubElement(document, "Style", id="track"), "LineStyle"
    )
    _text(style, "color", LINE)
    _text(style, "width", "2")
    for track in checked:
        mark = ElementTree.SubElement(document, "Placemark")
        _text(mark, "name", track.name)
        _text(mark, "styleUrl", "#track")
        line = ElementTree.SubElement(mark, "LineString")
        _text(line, "altitudeMode", "absolute")
        points = zip(track.longitude, track.latitude, track.altitude, strict=True)
        places = " ".join(f"{x:.{DIGITS}f},{y:.{DIGITS}f},{h:.3f}" for x, y, h in points)
        _text(line, "coordinates", places)
    _write(root, path)


def tracks_czml(
    tracks: Sequence[EarthTrack],
    path: str | os.PathLike[str],
    *,
    epoch: str = J2000,
    title: str = "jaxspace",
) -> None:
    """Write motion and attitude as CZML, for Cesium and other globes.

    Each track is a moving point with its path; with an attitude, a model that a user adds is
    oriented by it.

    **Arguments**

    - `tracks`, `path`, `title`: as in `tracks_gpx`.
    - `epoch`: date at t = 0, text of ISO 8601 in UTC.

    **Raises** as `tracks_gpx`."""
    checked = _checked(tracks)
    start = _instant(epoch)
    first = min(float(track.times[0]) for track in checked)
    last = max(float(track.times[-1]) for track in checked)
    clock = {
        "interval": f"{_stamp(start, first)}/{_stamp(start, last)}",
        "currentTime": _stamp(start, first),
        # A minute for all of it, and not slower than the time.
        "multiplier": max((last - first) / 60.0, 1.0),
        "range": "LOOP_STOP",
    }
    packets: list[dict[str, object]] = [
        {"id": "document", "name": title, "version": "1.0", "clock": clock}
    ]
    packets += [_packet(k, track, start) for k, track in enumerate(checked)]
    text = json.dumps(packets, allow_nan=False, indent=1)
    Path(path).write_text(text + "\n", encoding="utf-8")


def _packet(number: int, track: EarthTrack, start: Instant) -> dict[str, object]:
    latitude, longitude = (jnp.asarray(np.radians(x)) for x in (track.latitude, track.longitude))
    place = GroundPoint(latitude, longitude, jnp.asarray(track.altitude))
    position = np.asarray(position_of(place, jnp.asarray(0.0), RADIUS, FLATTENING))
    epoch = _stamp(start, 0.0)
    degree = min(3, track.times.size - 1)
    how = {"interpolationAlgorithm": "LAGRANGE" if degree > 1 else "LINEAR"}
    packet: dict[str, object] = {
        "id": f"track_{number}",
        "name": track.name,
        "availability": f"{_stamp(start, float(track.times[0]))}/"
        f"{_stamp(start, float(track.times[-1]))}",
        "position": {
            "epoch": epoch,
            "referenceFrame": "FIXED",
            **how,
            "interpolationDegree": degree,
            "cartesian": _interleaved(track.times, position, 3),
        },
        "point": {"color": {"rgba": COLOUR}, "pixelSize": 8},
        "path": {"material": {"solidColor": {"color": {"rgba": COLOUR}}}, "width": 2},
    }
    if track.attitude is not None:
        # The scalar is the last one in this format.
        q = track.attitude[[1, 2, 3, 0]]
        packet["orientation"] = {
            "epoch": epoch,
            "interpolationAlgorithm": "LINEAR",
            "interpolationDegree": 1,
            "unitQuaternion": _interleaved(track.times, q, 9),
        }
    return packet


def _interleaved(times: np.ndarray, x: np.ndarray, digits: int) -> list[float]:
    """Each time followed by the components there, as CZML lists samples."""
    rows = np.concatenate([np.round(times[None], 9), np.round(x, digits)])
    return rows.T.ravel().tolist()


def _east(longitude: float) -> float:
    """A longitude that is less than 180 deg also in its last digit, as GPX requires."""
    x = round(float(longitude), DIGITS)
    return x - 360.0 if x >= 180.0 else x


def _instant(text: str) -> Instant:
    found = instant(text)
    if found is None:
        raise InputError(f"epoch is {text[:40]!r}: it must be {ALLOWED}.")
    return found


def _stamp(start: Instant, after: float) -> str:
    """The date `after` the start, s, to a microsecond."""
    second = start.second + timedelta(microseconds=round((after + start.fraction) * 1e6))
    return f"{second:%Y-%m-%dT%H:%M:%S.%f}Z"


def _text(parent: ElementTree.Element, tag: str, text: str) -> None:
    ElementTree.SubElement(parent, tag).text = text


def _write(root: ElementTree.Element, path: str | os.PathLike[str]) -> None:
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)

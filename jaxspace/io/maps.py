"""Landings of a campaign as files for maps: KML for Google Earth, GeoJSON for GIS programs.

Both hold the launch site, each landing, their mean, the ellipses of the footprint, and the circle
of a requirement on the distance. Coordinates are geodetic longitudes and latitudes of WGS 84, in
degrees.

Sources: OGC 12-007r2, KML 2.3; RFC 7946, The GeoJSON Format.
"""

__all__ = ["landings_geojson", "landings_kml"]

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import jax.numpy as jnp
import numpy as np

from ..core import InputError
from ..core.common_units import factor_between
from ..statistics import Dispersion, Footprint
from ..vehicles import LaunchSite
from ..vehicles.landings import landing_latitude, landing_longitude
from ._load import stored_scene

# Nanodegrees, a tenth of a millimetre.
DIGITS = 9
POINTS_OF_CIRCLE = 120
KML = "http://www.opengis.net/kml/2.2"
# Of lines, areas and points, as KML writes colours: opacity, blue, green, red.
STYLES = {"area": "ff a66500", "required": "ff 3b00a1", "landing": "b2 e9b456"}
ICON = "http://maps.google.com/mapfiles/kml/shapes/shaded_dot.png"


class _Feature(NamedTuple):
    """One thing on the map: its name, its places, and its properties.

    - `kind`: "landing", "area", "required" or "place".
    - `places`: longitudes and latitudes, deg, (points, 2); of an area its closed outline,
      anticlockwise."""

    name: str
    kind: str
    places: np.ndarray
    properties: Mapping[str, float]


def landings_geojson(
    dispersion: Dispersion, path: str | os.PathLike[str], *, site: LaunchSite | None = None
) -> None:
    """Write the landings of a campaign as GeoJSON.

    The file holds a `FeatureCollection`: a point for the site, the mean and each landing (with the
    number of its run as the property `run`), and a polygon for each ellipse (with `probability`,
    `inside`, the share of the runs inside, both semi-axes in m and the bearing of the long one in
    deg) and for the required circle (with its `radius`, m).

    **Arguments**

    - `dispersion`: the result of a campaign with the outputs `east` and `north`.
    - `path`: the file to write; an existing one is replaced.
    - `site`: the launch site, with `latitude` and `longitude`; by default the site of the scene
      file that a stored campaign contains.

    **Raises** `InputError` without landings in three successful runs or more, without a site, and
    for a site without latitude or longitude."""
    features = [
        {
            "type": "Feature",
            "geometry": _geometry(feature),
            "properties": {"name": feature.name, "kind": feature.kind, **feature.properties},
        }
        for feature in _features(dispersion, site)
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def landings_kml(
    dispersion: Dispersion,
    path: str | os.PathLike[str],
    *,
    site: LaunchSite | None = None,
    title: str = "Landings",
) -> None:
    """Write the landings of a campaign as KML, for Google Earth and similar programs.

    The contents are those of `landings_geojson`; the landings are one placemark of many points,
    which programs draw faster than a placemark for each.

    **Arguments**

    - `dispersion`, `path`, `site`: as in `landings_geojson`.
    - `title`: name of the document.

    **Raises** `InputError` as `landings_geojson` does."""
    features = list(_features(dispersion, site))
    landings = [feature for feature in features if feature.kind == "landing"]
    root = ElementTree.Element("kml", xmlns=KML)
    document = ElementTree.SubElement(root, "Document")
    _text(document, "name", title)
    for name, colour in STYLES.items():
        _style(document, name, colour.replace(" ", ""))
    for feature in features:
        if feature.kind != "landing":
            mark = _placemark(document, feature.name, feature.kind)
            _description(mark, feature)
            _kml_geometry(mark, feature)
    mark = _placemark(document, f"{len(landings)} landings", "landing")
    every = ElementTree.SubElement(mark, "MultiGeometry")
    for feature in landings:
        _kml_geometry(every, feature)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _features(dispersion: Dispersion, site: LaunchSite | None) -> Iterator[_Feature]:
    """Everything on the map, checked before the first feature is made."""
    footprint = dispersion.footprint()
    if footprint is None:
        raise InputError(
            "dispersion has no footprint: east and north must be outputs in the same unit, finite "
            "in at least three successful runs."
        )
    metre = factor_between(footprint.unit or "m", "m")
    if metre is None:
        raise InputError(f"The unit of east and north is {footprint.unit}: it must be a length.")
    return _all_features(dispersion, footprint, metre, _located(_site_of(dispersion, site)))


def _all_features(
    dispersion: Dispersion, footprint: Footprint, metre: float, site: LaunchSite
) -> Iterator[_Feature]:
    def places(points: np.ndarray) -> np.ndarray:
        return _places(site, metre * np.asarray(points, float).reshape(2, -1))

    yield _Feature("Launch site", "place", places(np.zeros(2)), {})
    for ellipse, row in zip(footprint.ellipses, footprint.rows, strict=True):
        share, _, _, long, short, bearing, inside = row
        properties = {
            "probability": share,
            "inside": inside,
            "long_semi_axis": metre * long,
            "short_semi_axis": metre * short,
            "bearing": bearing,
        }
        outline = places(_anticlockwise(ellipse.outline()))
        yield _Feature(f"Ellipse of {100.0 * share:g} %", "area", outline, properties)
    radius = footprint.required
    if radius is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, POINTS_OF_CIRCLE + 1)
        circle = places(radius * np.stack([np.cos(angle), np.sin(angle)]))
        name = f"Required: within {radius:g} {footprint.unit or 'm'}"
        yield _Feature(name, "required", circle, {"radius": metre * radius})
    yield _Feature("Mean landing", "place", places(footprint.ellipses[0].centre), {})
    for run, place in zip(_runs(dispersion), places(footprint.points), strict=True):
        yield _Feature(f"Run {run}", "landing", place[None], {"run": int(run)})


def _site_of(dispersion: Dispersion, site: LaunchSite | None) -> LaunchSite:
    """The site that is given, or that of the scene file in the record of the campaign."""
    if site is None and "description" in dispersion.attributes:
        site = stored_scene(dispersion).site
    if site is None:
        raise InputError("site is missing: the campaign has no scene file with a launch site.")
    return site


def _located(site: LaunchSite) -> LaunchSite:
    missing = [name for name in ("latitude", "longitude") if getattr(site, name) is None]
    if missing:
        raise InputError(f"LaunchSite.{missing[0]} is missing: a map needs both coordinates.")
    return site


def _places(site: LaunchSite, points: np.ndarray) -> np.ndarray:
    """Longitude and latitude, deg, (points, 2), of points to the east and north of a site, m."""
    assert site.latitude is not None
    assert site.longitude is not None
    position = jnp.asarray(np.concatenate([points, 0.0 * points[:1]]))
    where = (site.latitude, site.longitude, site.elevation)
    found = landing_longitude(position, *where), landing_latitude(position, *where)
    longitude, latitude = (np.degrees(np.asarray(x, float)) for x in found)
    # A footprint across the date line must not reach around the globe.
    longitude = np.degrees(float(site.longitude)) + _turned(
        longitude - np.degrees(float(site.longitude))
    )
    return np.stack([longitude, latitude], axis=1)


def _turned(angle: np.ndarray) -> np.ndarray:
    """Angles in degrees, from -180 to 180."""
    return (angle + 180.0) % 360.0 - 180.0


def _anticlockwise(outline: np.ndarray) -> np.ndarray:
    """A closed outline, (2, points), with its inside on the left, as both formats require."""
    x, y = outline
    area = np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
    return outline if area >= 0.0 else outline[:, ::-1]


def _runs(dispersion: Dispersion) -> np.ndarray:
    """Numbers of the runs in the footprint, in its order."""
    numbers = np.arange(dispersion.runs) if dispersion.numbers is None else dispersion.numbers
    east, north = (dispersion.values(name).astype(float) for name in ("east", "north"))
    return np.asarray(numbers)[dispersion.good & np.isfinite(east) & np.isfinite(north)]


def _geometry(feature: _Feature) -> dict[str, object]:
    places = np.round(feature.places, DIGITS).tolist()
    if feature.kind in ("area", "required"):
        return {"type": "Polygon", "coordinates": [places]}
    return {"type": "Point", "coordinates": places[0]}


def _kml_geometry(parent: ElementTree.Element, feature: _Feature) -> None:
    line = " ".join(f"{x:.{DIGITS}f},{y:.{DIGITS}f}" for x, y in feature.places)
    if feature.kind in ("area", "required"):
        polygon = ElementTree.SubElement(parent, "Polygon")
        _text(polygon, "tessellate", "1")
        boundary = ElementTree.SubElement(polygon, "outerBoundaryIs")
        _text(ElementTree.SubElement(boundary, "LinearRing"), "coordinates", line)
    else:
        _text(ElementTree.SubElement(parent, "Point"), "coordinates", line)


def _placemark(document: ElementTree.Element, name: str, kind: str) -> ElementTree.Element:
    mark = ElementTree.SubElement(document, "Placemark")
    _text(mark, "name", name)
    if kind in STYLES:
        _text(mark, "styleUrl", f"#{kind}")
    return mark


def _description(mark: ElementTree.Element, feature: _Feature) -> None:
    if feature.kind == "area":
        p = feature.properties
        text = (
            f"{100.0 * p['inside']:.3g} % of the runs; semi-axes "
            f"{p['long_semi_axis']:.4g} m and {p['short_semi_axis']:.4g} m; bearing of the long "
            f"axis {p['bearing']:.0f} deg"
        )
        # The schema fixes the order of the children: before the style.
        element = ElementTree.Element("description")
        element.text = text
        mark.insert(1, element)


def _style(document: ElementTree.Element, name: str, colour: str) -> None:
    style = ElementTree.SubElement(document, "Style", id=name)
    if name == "landing":
        icon = ElementTree.SubElement(style, "IconStyle")
        _text(icon, "color", colour)
        _text(icon, "scale", "0.3")
        _text(ElementTree.SubElement(icon, "Icon"), "href", ICON)
    else:
        line = ElementTree.SubElement(style, "LineStyle")
        _text(line, "color", colour)
        _text(line, "width", "2")
        _text(ElementTree.SubElement(style, "PolyStyle"), "fill", "0")


def _text(parent: ElementTree.Element, tag: str, text: str) -> None:
    ElementTree.SubElement(parent, tag).text = text

"""Files for maps and globes: the landings of a stored campaign, and tracks of its runs or of the
nominal run of a scene file."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core import InputError, argument
from ..core.status import Status
from ..dispersion.states import run_states
from ..io import SceneFile, load, stored_scene
from ..io.maps import landings_geojson, landings_kml
from ..io.tracks import (
    J2000,
    MU_EARTH,
    EarthTrack,
    earth_tracks,
    tracks_czml,
    tracks_gpx,
    tracks_kml,
)
from ..io.units import read_option
from ..statistics import Dispersion
from ..stores import open_store
from ._output import make_folder
from ._report import accuracy_of, attempt
from ._waiting import waiting
from ._warning_lines import warnings_as_lines

STATES = 400
"""States of each phase of a track."""


def write_map(
    path: str,
    folder: str | None,
    modules: Sequence[str] = (),
    runs: int | None = None,
    epoch: str | None = None,
    angle: str = "0",
) -> int:
    """Write the files and print their paths; returns the exit status.

    **Arguments**

    - `path`: of a store, whose landings and `runs` are written; or of a scene file, in TOML.
    - `epoch`: date at t = 0; `angle`: that of the prime meridian then."""
    turned = read_option("--angle", angle, argument("rad", doc="angle"))
    if path.endswith(".toml"):
        file = load(path, modules=modules)
        return _tracks(_start(path, folder), file, None, 0, epoch, turned)
    with warnings_as_lines():
        result = open_store(path)
    file = stored_scene(result, modules)
    if file.site is None and runs is None:
        raise InputError(
            f"{path}: the scene has no launch site, so its landings have no place. --tracks writes "
            "the tracks of runs."
        )
    start = _start(path, folder)
    statuses = [] if file.site is None else [_landings(start, file, result)]
    if runs is not None:
        statuses.append(_tracks(start, file, result, runs, epoch, turned))
    return max(statuses)


def _start(path: str, folder: str | None) -> str:
    """The beginning of the paths of all files, in a folder that is made."""
    folder = str(Path(path).parent) if folder is None else folder
    make_folder(folder)
    return os.path.join(folder, Path(path).name.removesuffix(".zarr").removesuffix(".toml"))


def _landings(start: str, file: SceneFile, result: Dispersion) -> int:
    def kml(unfinished: str) -> None:
        landings_kml(result, unfinished, site=file.site, title=file.title)

    def geojson(unfinished: str) -> None:
        landings_geojson(result, unfinished, site=file.site)

    return max(attempt("map", f"{start}.kml", kml), attempt("map", f"{start}.geojson", geojson))


def _tracks(
    start: str,
    file: SceneFile,
    result: Dispersion | None,
    runs: int,
    epoch: str | None,
    angle: float,
) -> int:
    """Write the tracks of the nominal run and of the first runs of a campaign."""
    mu = (file.values.get("planet") or {}).get("mu")
    if mu is not None and abs(float(mu) / MU_EARTH - 1.0) > 1e-3:
        raise InputError(
            f"planet.mu is {float(mu):.6g} m^3/s^2: tracks are drawn on the Earth, whose value is "
            f"{MU_EARTH:.9g} m^3/s^2."
        )
    with warnings_as_lines(), waiting("simulating the tracks"):
        nominal = file.nominal_mission(samples=STATES)
        tracks = earth_tracks(nominal, site=file.site, angle=angle, name="nominal run")
        if result is not None and runs:
            tracks += _of_runs(file, result, runs, angle)

    def gpx(unfinished: str) -> None:
        tracks_gpx(tracks, unfinished, epoch=epoch, title=file.title)

    def kml(unfinished: str) -> None:
        tracks_kml(tracks, unfinished, title=file.title)

    def czml(unfinished: str) -> None:
        tracks_czml(tracks, unfinished, epoch=J2000 if epoch is None else epoch, title=file.title)

    # A wrong date is an error of the command, and not of one of its files.
    gpx(os.devnull)
    return max(
        attempt("track", f"{start}_tracks.gpx", gpx),
        attempt("track", f"{start}_tracks.kml", kml),
        attempt("globe", f"{start}.czml", czml),
    )


def _of_runs(file: SceneFile, result: Dispersion, runs: int, angle: float) -> list[EarthTrack]:
    """The tracks of the first successful runs."""
    planned = int(result.attributes.get("planned_runs", result.runs))
    campaign = file.campaign(warn=False, runs=planned)
    if campaign.text() != result.attributes.get("inputs"):
        raise InputError("--tracks: the inputs of these runs were defined in Python.")
    numbers = np.arange(min(runs, planned))
    batch, _ = run_states(
        campaign,
        numbers,
        seed=result.seed,
        num_saved=STATES,
        accuracy=accuracy_of(file, result),
    )
    good = np.asarray(batch.status) <= Status.EVENT
    tracks = []
    for k in numbers[good].tolist():
        tracks += earth_tracks(batch.of(k), site=file.site, angle=angle, name=f"run {k}")
    return tracks

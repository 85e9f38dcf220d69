"""Report of a campaign: its figure, its page, its tables."""

import dataclasses
import importlib.util
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..core import InputError
from ..dispersion import RunPaths, run_paths
from ..io import SceneError, SceneFile, stored_scene
from ..io.reports.campaign_tables import dispersion_report
from ..simulation import Accuracy, MissionTrajectory
from ..statistics import Dispersion
from ..stores import open_store
from ..vehicles import LaunchSite
from ._commands import print_next
from ._output import make_folder, replacing, say
from ._waiting import waiting
from ._warning_lines import warnings_as_lines

PATHS = 24
"""Runs whose trajectories are drawn."""


def keep_pictures(
    result: Dispersion,
    title: str,
    nominal: Mapping[str, tuple[float, str]],
    start: str,
    paths: RunPaths | None = None,
    site: LaunchSite | None = None,
) -> int:
    """Draw the figures and write the page, at paths that begin with `start`; print where.

    A picture that cannot be drawn is reported on the error output; the numbers are written
    anyway. Returns the largest exit status of them."""
    import matplotlib

    from ..plots import dispersion_figure, dispersion_page, footprint_figure, sweep_figure

    if not result.good.any():
        return 0
    # No window: the command also runs without a display.
    matplotlib.use("Agg")
    values = {name: value for name, (value, _) in nominal.items()}

    def figure(path: str) -> None:
        dispersion_figure(result, title=title, nominal=values).savefig(path)

    wind = None if site is None or site.wind is None else site.winds(_top(result))

    def page(path: str) -> None:
        dispersion_page(result, path, title=title, nominal=values, paths=paths, wind=wind)

    def sweep(path: str) -> None:
        sweep_figure(result, title=title).savefig(path, dpi=150)

    def violated(path: str) -> None:
        sweep_figure(result, take="violated", title=title).savefig(path, dpi=150)

    def landings(path: str) -> None:
        there = (values["east"], values["north"]) if {"east", "north"} <= set(values) else None
        footprint_figure(result, wind=wind, title=title, nominal=there).savefig(path, dpi=150)

    statuses = [attempt("figure", f"{start}.png", figure)]
    if "sweep" in result.attributes:
        statuses.append(attempt("figure", f"{start}_sweep.png", sweep))
        if result.requirements:
            statuses.append(attempt("figure", f"{start}_violations.png", violated))
        statuses.append(attempt("table", f"{start}_sweep.csv", result.by_row().to_csv))
    if result.footprint() is not None:
        statuses.append(attempt("figure", f"{start}_landings.png", landings))
    return max(*statuses, attempt("page", f"{start}.html", page))


def nominal_outputs(
    file: SceneFile, result: Dispersion, nominal: MissionTrajectory | None = None
) -> dict[str, tuple[float, str]]:
    """The outputs of the nominal run, with their units: of `nominal`; without it as the campaign
    has them, or computed here."""
    there = result.attributes.get("nominal")
    if there is not None and nominal is None:
        return {name: (x, result.units.get(name, "")) for name, x in there.items()}
    return file.nominal_outputs(file.nominal_mission() if nominal is None else nominal)


def _top(result: Dispersion) -> float:
    """Height that the paths reach, m: the mean of an output `apogee`, or 3 km without one."""
    heights = result.outputs.get("apogee")
    if heights is None or result.units.get("apogee") != "m":
        return 3000.0
    return float(np.mean(heights[result.good]))


def report(path: str, folder: str | None, modules: Sequence[str] = ()) -> int:
    """Write the page of a store with trajectories, and its runs as tables. The exit status is 0 if
    all files are written, 1 if one cannot be created, 2 if one cannot be written."""
    with warnings_as_lines():
        result = open_store(path)
    file = _scene(result, modules)
    name = Path(path).name.removesuffix(".zarr")
    folder = str(Path(path).parent) if folder is None else folder
    make_folder(folder)
    nominal = {}
    paths = None
    site = None
    title = name
    if file is not None:
        with waiting("simulating the nominal run"):
            run = None if file.site is not None else file.nominal_mission()
        site = file.site
        title = file.title
        nominal = nominal_outputs(file, result, run)
        some = np.arange(min(PATHS, result.runs))
        # A hypercube is made for the runs that were planned, also where there are fewer.
        planned = int(result.attributes.get("planned_runs", result.runs)) // result.rows
        campaign = file.campaign(run, warn=False, runs=planned)
        if campaign.text() == result.attributes.get("inputs"):
            with waiting("simulating the runs whose trajectories are drawn"):
                accuracy = accuracy_of(file, result)
                paths = run_paths(campaign, some, seed=result.seed, accuracy=accuracy)
        else:
            print(
                "No trajectories: the inputs of these runs were defined in Python.", file=sys.stderr
            )
    with waiting("computing the statistics"):
        shown = result if file is None else file.in_units(result)
        tables = dispersion_report(shown, nominal)
    print(tables)
    start = os.path.join(folder, name)
    statuses = [keep_pictures(shown, title, nominal, start, paths, site)]
    statuses.append(attempt("table", f"{start}.csv", result.to_csv))
    # Parquet needs an extra; the table in CSV is there in any case.
    if importlib.util.find_spec("pyarrow") is not None:
        statuses.append(attempt("table", f"{start}.parquet", result.to_parquet))
    if file is not None:
        print_next(file, "replay", path, "--run", 0, "--show")
    return max(statuses)


def accuracy_of(file: SceneFile, result: Dispersion) -> Accuracy:
    """The accuracy of the runs of a store: that of its file, with the tolerance that was found
    where it asks for one by purpose."""
    if result.purpose is None:
        return file.accuracy
    return dataclasses.replace(file.accuracy, rtol=result.purpose.tolerance)


def _scene(result: Dispersion, modules: Sequence[str]) -> SceneFile | None:
    """The scene file in a store, or `None` with a message if the campaign was defined in Python or
    its file can no longer be read. Raises for `modules` that cannot be used."""
    if modules:
        # Files that the user names are not left out in silence.
        return stored_scene(result, modules)
    try:
        return stored_scene(result, modules)
    except (SceneError, InputError) as error:
        print(f"No nominal run and no trajectories: {error}", file=sys.stderr)
        return None


def attempt(what: str, path: str, write: Callable[[str], None]) -> int:
    """Write a file, and print its path or the reason of a failure. Returns its exit status: 1 for a
    file that cannot be made, 2 for one that cannot be written."""
    try:
        with waiting(f"writing {path}"), replacing(path) as unfinished:
            write(unfinished)
    except OSError as error:
        say(f"{path} cannot be written: {error.strerror or error}.")
        return 2
    # Any error of a plotting library, because the numbers are to be written anyway.
    except Exception as error:
        say(f"{path} is left out: {type(error).__name__}: {error}")
        return 1
    print(f"{what:<6} {path}")
    return 0

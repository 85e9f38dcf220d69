"""What the commands do with a checked scene file."""

import os
import sys
from typing import Any

import jax
import jax.numpy as jnp

from ..dispersion import disperse as disperse_campaign
from ..io import SceneFile
from ..simulation import Accuracy, Mission, MissionTrajectory, Status, simulate
from . import _report as report
from ._settings import settle


def run(file: SceneFile, folder: str) -> int:
    """Fly the nominal run, print how it ended, and draw it."""
    settle()
    system, y0, ts = file.nominal()
    print(file.title)
    if isinstance(system, Mission):
        status = _run_mission(file, system, y0, folder)
    else:
        flown = simulate(system, y0, ts, accuracy=file.accuracy, throw=False)
        rows = report.state_rows(flown.final) + report.orbit_rows(file, flown.final)
        print(report.columns([("time [s]", report.number(flown.ts[-1])), *rows]))
        print(
            report.columns([*report.drift_rows(flown.drift()), *report.error_rows(flown.error())])
        )
        print(report.status_line(flown.status))
        _draw(flown, _path(file, folder, ".png"))
        status = int(flown.status)
    return 0 if Status(status).good else 1


def _run_mission(file: SceneFile, mission: Mission, y0: Any, folder: str) -> int:
    flown = fly(file, mission, y0, samples=100)
    finer = fly(file, mission, y0, samples=100, factor=0.01)
    for name, phase in zip(flown.names, flown.phases, strict=True):
        print(f"\n{name}: from {report.number(phase.ts[0])} s to {report.number(phase.ts[-1])} s")
        rows = (
            report.state_rows(phase.final)
            + report.orbit_rows(file, phase.final)
            + report.drift_rows(phase.drift())
        )
        print(report.columns(rows))
        _draw(phase, _path(file, folder, f"_{name}.png".replace(" ", "_")))
    print("\nat the end, after the last jump")
    rows = report.state_rows(flown.final) + report.orbit_rows(file, flown.final)
    error = jax.tree.map(lambda a, b: a - b, flown.final, finer.final)
    print(
        report.columns([("time [s]", report.number(flown.end)), *rows, *report.error_rows(error)])
    )
    print(report.status_line(flown.status))
    return int(flown.status)


def fly(
    file: SceneFile, mission: Mission, y0: Any, samples: int = 2, factor: float = 1.0
) -> MissionTrajectory:
    """The nominal mission of the file, at its own accuracy times `factor`."""
    rtol = max(file.accuracy * factor, 32.0 * float(jnp.finfo(jnp.result_type(float)).eps))
    start = 0.0 if file.kind == "mission" else file.values["times"]["start"]
    return simulate(mission, y0, start, accuracy=Accuracy(rtol=rtol), samples=samples, throw=False)


def disperse(file: SceneFile, runs: int, seed: int, chunk: int, folder: str) -> int:
    """Fly the file many times, print the table of its outputs, and keep the runs, a figure and a
    page."""
    from tqdm import tqdm

    settle()
    print(f"{file.title}: {runs} runs, seed {seed}")
    flown = fly(file, *file.nominal_mission())
    campaign = file.campaign(flown)
    store = _path(file, folder, ".zarr")
    with tqdm(total=runs, unit="run", file=sys.stderr, disable=None) as bar:

        def shown(done: int, total: int) -> None:
            bar.update(done - bar.n)

        result = disperse_campaign(
            campaign,
            runs,
            seed=seed,
            chunk=chunk,
            accuracy=file.accuracy,
            store=store,
            progress=shown,
        )
    print(report.dispersion_table(result, file.nominal_outputs(flown)))
    lines = report.contributor_lines(result)
    if lines:
        print(f"\nshares of the variance\n{lines}")
    print(f"\n{report.status_lines(result)}")
    ahead = result.attributes["preparation_seconds"]
    print(
        f"{result.seconds:.1f} s: {ahead:.1f} s to compile and to plan, then {runs / (result.seconds - ahead):.0f} runs/s"
    )
    _keep(file, result, folder)
    print(f"store  {store}")
    return 0 if result.good.any() else 1


def _keep(file: SceneFile, result: Any, folder: str) -> None:
    import matplotlib

    from ..plots import dispersion_figure, dispersion_page

    if result.good.any():
        matplotlib.use("Agg")
        figure, page = _path(file, folder, ".png"), _path(file, folder, ".html")
        dispersion_figure(result).savefig(figure)
        dispersion_page(result, page)
        print(f"figure {figure}\npage   {page}")


def _draw(trajectory: Any, path: str) -> None:
    import matplotlib

    from ..plots import trajectory_figure

    matplotlib.use("Agg")
    trajectory_figure(trajectory).savefig(path)
    print(f"figure {path}")


def _path(file: SceneFile, folder: str, ending: str) -> str:
    return os.path.join(folder, file.path.stem + ending)


def explain(file: SceneFile) -> int:
    """Print the table of effects of every scene of the file."""
    settle()
    scenes = file.scenes()
    print(file.title)
    if not scenes:
        print(f"{file.values['system']['name']} is a textbook system: it has no effects.")
    for name, scene in scenes.items():
        print(f"\n{name}\n{scene.explain()}")
    return 0

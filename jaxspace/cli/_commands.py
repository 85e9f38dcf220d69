"""What the commands do with a checked scene file."""

import json
import os
import sys

from ..control import LoopRun
from ..core import InputError
from ..dispersion import Dispersion
from ..dispersion import disperse as disperse_campaign
from ..io import (
    SceneFile,
    dispersion_report,
    listing,
    load,
    mission_report,
    read_size,
    run_report,
    schema,
)
from ..simulation import Mission, Status, Trajectory
from ..studies import AccuracyCost, EffectBudget, accuracy_cost, effect_budget
from ..verification import run_cases

TOLERANCES = tuple(10.0**-k for k in range(4, 13))


def run(path: str, folder: str, show: bool = False) -> int:
    """Simulate the nominal run, print how it ended, draw it, and show it in the browser."""
    file = load(path)
    make_folder(folder)
    if isinstance(file.system, Mission):
        result = file.nominal_mission(samples=100)
        # A mission has no error estimate of its own: the finer run gives one.
        print(mission_report(file, result, file.nominal_mission(samples=100, factor=0.01)))
        for name, phase in zip(result.names, result.phases, strict=True):
            _draw(phase, _path(file, folder, f"_{name}.png".replace(" ", "_")))
    else:
        result = file.simulate(throw=False)
        assert isinstance(result, Trajectory | LoopRun)
        print(run_report(file, result))
        result = result.trajectory if isinstance(result, LoopRun) else result
        _draw(result, _path(file, folder, ".png"))
    if show:
        print(f"page   {result.show(_path(file, folder, '.html'))}")
    return 0 if Status(int(result.status)).good else 1


def disperse(path: str, runs: int | None, seed: int | None, chunk: int, folder: str) -> int:
    """Run the file many times, print the table of its outputs, and keep the runs, a figure and a
    page."""
    # Late, like the plots below: commands that draw no bar do not wait for the import.
    from tqdm import tqdm

    file = load(path)
    runs, seed = file.runs if runs is None else runs, file.seed if seed is None else seed
    make_folder(folder)
    print(f"{file.title}: {runs} runs, seed {seed}")
    for doubt in file.doubts():
        print(doubt, file=sys.stderr)
    nominal = file.nominal_mission()
    campaign = file.campaign(nominal, warn=False)
    store = _path(file, folder, ".zarr")
    with tqdm(total=runs, unit="run", file=sys.stderr, disable=None) as bar:

        def show(done: int, total: int) -> None:
            # The bar counts steps, the campaign reports totals.
            bar.update(done - bar.n)

        result = disperse_campaign(
            campaign,
            runs,
            seed=seed,
            chunk=chunk,
            accuracy=file.accuracy,
            store=store,
            progress=show,
        )
    print(dispersion_report(result, file.nominal_outputs(nominal)))
    # Compiling is paid once, so that it must not spoil the rate that a longer campaign will see.
    ahead = result.attributes["preparation_seconds"]
    rate = runs / max(result.seconds - ahead, 1e-9)
    print(f"{result.seconds:.1f} s: {ahead:.1f} s to compile and to plan, then {rate:.0f} runs/s")
    _keep(file, result, folder)
    print(f"store  {store}")
    # Single failed runs are part of the result; a campaign of which all failed is none.
    return 0 if result.good.any() else 1


def _keep(file: SceneFile, result: Dispersion, folder: str) -> None:
    import matplotlib

    from ..plots import dispersion_figure, dispersion_page

    if result.good.any():
        # No window: the command also runs where there is no display.
        matplotlib.use("Agg")
        figure, page = _path(file, folder, ".png"), _path(file, folder, ".html")
        dispersion_figure(result).savefig(figure)
        dispersion_page(result, page)
        print(f"figure {figure}\npage   {page}")


def explain(path: str) -> int:
    """Print the table of effects of every scene of the file."""
    file = load(path)
    print(file.title)
    scenes = file.scenes()
    if not scenes:
        print(f"{type(file.system).__name__} is a system of its own: it has no effects.")
    for name, scene in scenes.items():
        print(f"\n{name}\n{scene.explain()}")
    return 0


def cost(path: str, error: float | None, gradient: bool, folder: str) -> int:
    """Print what accuracy costs, recommend a setting, and draw the diagram."""
    file = load(path)
    make_folder(folder)
    # The file's own setting is always among those measured, so that it can be compared.
    rtol = file.values["accuracy"]
    tolerances = sorted({*TOLERANCES, rtol}, reverse=True)
    table = accuracy_cost(file.system, file.y0, file.ts, tolerances=tolerances, gradient=gradient)
    print(f"{file.title}: what accuracy costs")
    print(table)
    print(f"\n{_recommendation(table, rtol if error is None else error)}")
    _draw_table(table, _path(file, folder, "_cost.png"))
    return 0


def _recommendation(table: AccuracyCost, error: float) -> str:
    """The cheapest setting for a relative error of the final state, in words."""
    try:
        row = table.cheapest_row(error)
    except InputError as problem:
        return f"no setting is good enough: {problem}"
    how = (
        "the closed form"
        if row.tolerance is None
        else f"accuracy = {row.tolerance:.3g} with {row.method}"
    )
    reached = f"which reaches {row.error:.1g} in {1e3 * row.seconds:.3g} ms"
    return f"for a relative error of {error:.1g} in the final state: {how}, {reached}"


def budget(path: str, output: str | None, tolerance: str | None, folder: str) -> int:
    """Print what each effect does to the output and which of them may go, and draw it."""
    file = load(path)
    if file.kind == "system":
        name = type(file.system).__name__
        raise InputError(f"{name} has no effects: the file must be of a scene or a mission.")
    make_folder(folder)
    output = file.y0.present()[0] if output is None else output
    size = None if tolerance is None else read_size("--tolerance", tolerance, output)
    table = effect_budget(
        file.system,
        file.y0,
        file.ts,
        output=output,
        tolerance=size,
        # Effects are told apart by differences, which a coarse tolerance would drown.
        accuracy=min(file.values["accuracy"], 1e-9),
    )
    print(f"{file.title}: which effects matter")
    print(table)
    _draw_table(table, _path(file, folder, "_budget.png"))
    return 0


def show_list() -> int:
    """Print what scene files may name."""
    print(listing())
    return 0


def show_schema() -> int:
    """Print the JSON schema of scene files."""
    print(json.dumps(schema(), indent=1))
    return 0


def verify(precision: str, device: str | None, path: str | None) -> int:
    """Evaluate the hard cases, print the table, and keep it as JSON; 1 where a case fails."""
    result = run_cases(precision=precision, device=device)
    print(result)
    if path is not None:
        with open(path, "w", encoding="utf-8") as file:
            file.write(result.json())
    return 0 if result.passed else 1


def make_folder(name: str) -> None:
    """Make the folder for results. Raises `InputError` where nothing can be written."""
    try:
        os.makedirs(name, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out is {name}: it cannot be made a folder: {error.strerror}."
        ) from error
    # Asked before the run: hours of computing must not end in a refused write.
    if not os.access(name, os.W_OK | os.X_OK):
        raise InputError(f"--out is {name}: it must be a folder in which files may be written.")


def _draw(trajectory: Trajectory, path: str) -> None:
    import matplotlib

    from ..plots import trajectory_figure

    matplotlib.use("Agg")
    trajectory_figure(trajectory).savefig(path)
    print(f"figure {path}")


def _draw_table(table: AccuracyCost | EffectBudget, path: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    table.plot().savefig(path)
    print(f"figure {path}")


def _path(file: SceneFile, folder: str, ending: str) -> str:
    return os.path.join(folder, file.path.stem + ending)

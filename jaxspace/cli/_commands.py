"""Commands on a checked scene file."""

import json
import os
import shlex
import sys
from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp
from jax.typing import ArrayLike

from ..bodies import BodyState
from ..control import LoopRun
from ..core import InputError, argument
from ..core.quantities import quantities
from ..io import Optimum, SceneFile, listing, load, schema
from ..io.by_numpy import by_numpy
from ..io.reports.optimum import optimum_report, sensitivity_report
from ..io.reports.run import mission_report, run_report
from ..io.units import read_option
from ..scene import Scene
from ..simulation import Mission, MissionTrajectory, Status, Trajectory
from ..studies import AccuracyCost, EffectBudget, accuracy_cost, effect_budget
from ..studies.budget_table import effect_names
from ..studies.cost_table import price_table
from ._ephemeris import EphemerisOptions, write_ephemeris
from ._optimize_design import optimize_design
from ._output import make_folder, replacing, write_text
from ._waiting import progress, waiting

# Largest growth of the steps of a search until a run confirms it: four repetitions.
MOST_REPEATED = 16
Confirmed: TypeAlias = tuple[Optimum, tuple[float, ...], MissionTrajectory]
# States that the pictures of a run, or of a phase, can show: some hundred turns as lines.
PICTURED = 4000
TOLERANCES = tuple(10.0**-k for k in range(4, 13))

# The options of a run that writes none.
NOT_WRITTEN = EphemerisOptions()


def run(
    path: str,
    folder: str,
    show: bool = False,
    modules: Sequence[str] = (),
    written: EphemerisOptions = NOT_WRITTEN,
) -> int:
    """Simulate the nominal run, print how it ended, draw it, show it in the browser, and write its
    states as a file of the kind of the options `written`."""
    written.check()
    file = load(path, modules=modules)
    make_folder(folder)
    if isinstance(file.system, Mission):
        with waiting("simulating the mission, and repeating it to estimate the error"), by_numpy():
            result = file.nominal_mission(samples=PICTURED)
            # A mission has no built-in error estimate: the finer run provides one.
            finer = file.nominal_mission(samples=PICTURED, factor=0.01)
            report = mission_report(file, result, finer)
        print(report)
        for name, phase in result.items():
            picture = path_of(file, folder, f"_{name}.png".replace(" ", "_"))
            draw(file, phase, picture, f"{file.title}: {name}")
    else:
        with waiting("simulating the run, and repeating it to estimate the error"), by_numpy():
            result = file.simulate(ts=_pictured_times(file), throw=False)
            assert isinstance(result, Trajectory | LoopRun)
            report = run_report(file, result)
        print(report)
        result = result.trajectory if isinstance(result, LoopRun) else result
        draw(file, result, path_of(file, folder, ".png"))
    if written.kind is not None:
        write_ephemeris(file.title, result, path_of(file, folder, ".oem"), written)
    if show:
        show_page(file, result, path_of(file, folder, "_run.html"))
    elif file.values["dispersion"] is not None:
        print_next(file, "disperse", path)
    else:
        print_next(file, "run", path, "--show")
    return 0 if Status(int(result.status)).good else 1


def _pictured_times(file: SceneFile) -> ArrayLike:
    """The times of the file, or more of them where a picture can show more. For a closed loop,
    those of the file: they are among the samples of its controller."""
    if file.loop is not None or len(file.ts) >= PICTURED:
        return file.ts
    return jnp.linspace(file.ts[0], file.ts[-1], PICTURED)


def optimize(
    path: str,
    folder: str,
    sensitivities: bool,
    modules: Sequence[str] = (),
    resume: bool = False,
) -> int:
    """Optimise the design variables, print their table, and save the file and the figures of its
    run and of the search."""
    file = load(path, modules=modules)
    if file.task is not None and file.task.dispersed:
        if sensitivities:
            raise InputError(
                "--sensitivities is not available for a search over dispersion, which has many "
                "runs."
            )
        return optimize_design(file, folder, resume)
    if resume:
        raise InputError('--resume requires optimize.over = "dispersion" in the file.')
    make_folder(folder)
    best = path_of(file, folder, "_optimum.toml")
    with progress("compiling the search", unit="step") as bar:

        def show(step: int, objective: float, violation: float, gradient: float) -> None:
            del step, objective
            bar.set_description_str(refresh=False)
            # One by one, because a search that is repeated counts from one again.
            bar.update(1)
            bar.set_postfix_str(f"violation {violation:.1e}, gradient {gradient:.1e}")

        def confirmed(found: Optimum) -> Confirmed:
            bar.set_description("verifying the optimum with a run")
            return _confirmed(file, found, best)

        result, numbers, run = confirmed(file.optimize(progress=show))
        most = MOST_REPEATED * result.steps
        # Both claim an end by the search's own run, and not that of an interruption.
        while result.warning and result.steps < most:
            if not (result.minimum.converged or result.infeasible):
                break
            sentence = f"{result.warning} The search continues with {2 * result.steps}."
            bar.write(sentence, file=sys.stderr)
            again = file.optimize(progress=show, start=result.values, steps=2 * result.steps)
            result, numbers, run = confirmed(again)
    print(optimum_report(result, numbers, run))
    # The report has already stated that no optimum was found.
    if sensitivities and not result.infeasible:
        print(f"\n{sensitivity_report(result)}")
    print(f"file   {best}")
    for name, phase in run.items():
        path = path_of(file, folder, f"_optimum_{name}.png".replace(" ", "_"))
        draw(file, phase, path, f"{file.title}, optimum: {name}")
    figure = path_of(file, folder, "_search.png")
    with replacing(figure) as unfinished:
        result.minimum.plot(file.title).savefig(unfinished)
    print(f"figure {figure}")
    print_next(file, "run", best)
    # The file is written in any case: the code tells a script whether it is an optimum.
    return 0 if result.converged else 1


def _confirmed(file: SceneFile, found: Optimum, best: str) -> Confirmed:
    """The optimum, compared with a run of its file, which is written to `best`; the outputs of that
    run, and the run."""
    write_text(best, found.text())
    # Read back, so that the verified values are those in the file, including rounding.
    optimum = load(best, modules=file.modules)
    # At the accuracy of the file, with adaptive steps, by which the optimum is confirmed.
    run = optimum.nominal_mission(samples=PICTURED)
    numbers = found.confirmed(run, optimum)
    return found.checked(run, numbers), numbers, run


def explain(path: str, modules: Sequence[str] = ()) -> int:
    """Print the table of effects of every scene of the file."""
    file = load(path, modules=modules)
    print(file.title)
    scenes = file.scenes()
    if not scenes:
        print(f"{type(file.system).__name__} is a complete system without separate effects.")
    for name, scene in scenes.items():
        print(f"\n{name}\n{scene.explain(_names_in(file, name, scene))}")
    return 0


def cost(
    path: str, error: float | None, gradient: bool, folder: str, modules: Sequence[str] = ()
) -> int:
    """Print the cost of accuracy, recommend a setting, and draw the diagram."""
    file = load(path, modules=modules)
    make_folder(folder)
    # The file's own setting is always among those measured, so that it can be compared.
    rtol = file.tolerance
    tolerances = sorted({*TOLERANCES, rtol}, reverse=True)
    with waiting("timing every method at every tolerance"):
        table = accuracy_cost(
            file.system,
            file.y0,
            file.ts,
            tolerances=tolerances,
            gradient=gradient,
            max_steps=file.accuracy.max_steps,
        )
    print(f"{file.title}: cost of accuracy")
    print(table)
    if not table.reference:
        # Nothing to recommend, and nothing to draw.
        return 1
    print(f"\ncost of each error\n{price_table(table.prices())}")
    print(f"\n{_recommendation(table, rtol if error is None else error)}")
    _draw_table(table, path_of(file, folder, "_cost.png"))
    return 0


def _recommendation(table: AccuracyCost, error: float) -> str:
    """The cheapest setting for a relative error of the final state, in words."""
    try:
        row = table.cheapest_row(error)
    except InputError as problem:
        return f"no setting is accurate enough: {problem}"
    how = (
        "the closed form"
        if row.tolerance is None
        else f"accuracy = {row.tolerance:.3g} with {row.method}"
    )
    # An error below that of the reference is not known: a zero would claim too much.
    bound = row.error < table.reference_error
    least = f"less than {table.reference_error:.1g}" if bound else f"{row.error:.1g}"
    reached = f"which reaches {least} in {1e3 * row.seconds:.3g} ms"
    return f"for a relative error of {error:.1g} in the final state: {how}, {reached}"


def budget(
    path: str,
    output: str | None,
    tolerance: str | None,
    folder: str,
    modules: Sequence[str] = (),
) -> int:
    """Print the influence of each effect on the output and those that may be left out, and draw
    it."""
    file = load(path, modules=modules)
    if file.kind == "system":
        name = type(file.system).__name__
        raise InputError(f"{name} has no effects: the file must define a scene or a mission.")
    make_folder(folder)
    parts = file.y0.present
    chosen = parts[0] if output is None else output
    if chosen in parts:
        # The difference of two attitudes is an angle.
        si = quantities(BodyState)[chosen].unit or "rad"
        factor = 1.0
    else:
        try:
            chosen, si, factor = file.final_output(chosen)
        except InputError as error:
            raise InputError(f"{error} Parts of the final state are {', '.join(parts)}.") from None
    size = None
    if tolerance is not None:
        size = factor * read_option(
            "--tolerance", tolerance, argument(si, positive=True, doc="size")
        )
    with waiting("simulating without each effect"):
        table = effect_budget(
            file.system,
            file.y0,
            file.ts,
            output=chosen,
            tolerance=size,
            # The influences are differences of runs, for which a coarse tolerance is not enough.
            accuracy=min(file.tolerance, 1e-9),
        )
    table = table.renamed(_effects_by_class(file))
    print(f"{file.title}: influence of each effect")
    print(table)
    _draw_table(table, path_of(file, folder, "_budget.png"))
    return 0


def _effects_by_class(file: SceneFile) -> dict[str, str]:
    """The names that the file gives its effects, by those of their classes in a budget: several
    where the phases have different ones of a class."""
    found: dict[str, list[str]] = {}
    for phase, scene in file.scenes().items():
        names = _names_in(file, phase, scene)
        for label, name in zip(effect_names(scene), names, strict=False):
            found.setdefault(label, []).append(name)
    # Each once, in the order of the file.
    return {label: ", ".join(dict.fromkeys(names)) for label, names in found.items()}


def _names_in(file: SceneFile, phase: str, scene: Scene) -> list[str]:
    """The names that the file gives the effects of a phase; empty where it does not name each."""
    legs = [leg for leg in file.parsed.legs if leg.name == phase]
    names = list(legs[0].phase["effects"]) if legs else []
    return names if len(names) == len(scene.effects) else []


def show_list(word: str = "", modules: Sequence[str] = ()) -> int:
    """Print the names available in scene files, or the entries that contain this word with their
    fields."""
    print(listing(modules=modules, word=word, fields=bool(word)))
    if not word:
        print("\nnext   jaxspace list NAME   prints the fields of an entry or of a group")
    return 0


def show_schema(modules: Sequence[str] = ()) -> int:
    """Print the JSON schema of scene files."""
    print(json.dumps(schema(modules=modules), indent=1))
    return 0


def verify(precision: str, device: str | None, path: str | None) -> int:
    """Run the singularity and edge-case checks, print the table, and save it as JSON; 1 if a case
    fails."""
    # Imported here, because no other command needs the cases.
    from ..verification import run_cases

    result = run_cases(precision=precision, device=device)
    print(result)
    if path is not None:
        write_text(path, result.json())
    return 0 if result.passed else 1


def draw(file: SceneFile, trajectory: Trajectory, path: str, title: str = "") -> None:
    """Draw a trajectory of a scene to a picture at `path`, in the units of the scene; by default
    with the `title` of the file."""
    # Imported late: commands that draw nothing do not wait for it.
    import matplotlib

    from ..plots import trajectory_figure

    # Draws to files only, so that no display is required.
    matplotlib.use("Agg")
    title = title or file.title
    with replacing(path) as unfinished:
        trajectory_figure(trajectory, scale=file.shown_unit, title=title).savefig(unfinished)
    print(f"figure {path}")


def show_page(
    file: SceneFile, run: Trajectory | MissionTrajectory, path: str, title: str = ""
) -> None:
    """Open a run of a scene in the browser, as a page at `path`; by default with the `title` of the
    file."""
    # Imported late, as in `draw`.
    from ..plots import show_run

    # A flight from a rail has no table of a planet.
    radius = (file.values.get("planet") or {}).get("radius")
    print(f"page   {show_run(run, path, planet_radius=radius, title=title or file.title)}")


def print_next(file: SceneFile, *command: object) -> None:
    """Print the command that most readers of a result give next, as a shell reads it.

    **Arguments**

    - `file`: whose modules it names.
    - `command`: its words."""
    modules = [word for module in file.modules for word in ("--with", str(module))]
    print(f"next   jaxspace {shlex.join([*map(str, command), *modules])}")


def _draw_table(table: AccuracyCost | EffectBudget, path: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    with replacing(path) as unfinished:
        table.plot().savefig(unfinished)
    print(f"figure {path}")


def path_of(file: SceneFile, folder: str, ending: str) -> str:
    """A path in the folder by the name of the file."""
    return os.path.join(folder, file.path.stem + ending)

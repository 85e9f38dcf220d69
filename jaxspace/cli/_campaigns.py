"""Commands of campaigns: disperse, resume, replay, failures."""

import contextlib
import functools
import os
import shlex
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ..core import InputError, argument
from ..dispersion import disperse as disperse_campaign
from ..dispersion import moments
from ..dispersion.automatic import MethodChoice, choose_method
from ..dispersion.comparison import compare_methods
from ..dispersion.covariance import AUTO, METHODS, MONTE_CARLO, Moments
from ..engines import AbstractEngine, Part
from ..io import SceneFile, load, stored_scene
from ..io.reports.campaign import comparison_table, failures_report, moments_report, replay_report
from ..io.reports.campaign_tables import dispersion_report
from ..io.units import read_option
from ..sampling import LatinHypercube, Sobol
from ..sampling.designs import AbstractDesign
from ..statistics import Dispersion, StopRule
from ..stores import DamagedStore, StoreError, open_store
from ..stores.part_writer import unfinished_parts
from ..stores.store import Store
from ._commands import draw, path_of, print_next, show_page
from ._output import make_folder
from ._report import accuracy_of, keep_pictures, nominal_outputs
from ._stopping import Stopped, is_stop
from ._waiting import progress, waiting
from ._warning_lines import UNFINISHED, warnings_as_lines


class Options(NamedTuple):
    """Options of a campaign on the command line."""

    runs: int | None = None
    seed: int | None = None
    chunk: int = 8192
    samples: int = 0
    times: str | None = None
    engine: str = "local"
    overwrite: bool = False
    until: StopRule | None = None
    method: str | None = None
    compare: bool = False
    part: tuple[int, int] | None = None


def disperse(path: str, options: Options, folder: str, modules: Sequence[str] = ()) -> int:
    """Run the campaign of the file, print the table of its outputs, and save the runs, a figure and
    a page."""
    file = load(path, modules=modules)
    runs = file.runs if options.runs is None else options.runs
    if file.sweeps_only and runs > 1:
        raise InputError(
            f"--runs is {runs}: no input of the file is random besides the sweep, so each row has "
            "one run: omit it, or disperse an input."
        )
    seed = file.seed if options.seed is None else options.seed
    method = file.method if options.method is None else options.method
    if method not in (MONTE_CARLO, AUTO):
        _refuse_options_of_runs(options, method)
        return _without_runs(file, method)
    if method == AUTO:
        choice = _chosen(file, runs)
        print(f"method: {choice.reason}")
        if choice.moments is not None:
            return _report_moments(file, choice.moments)
    times = None
    if options.times is not None:
        parts = options.times.split(",")
        time = argument("s", doc="time")
        times = tuple(read_option("--times", part.strip(), time) for part in parts)
    make_folder(folder)
    until = file.until if options.until is None else options.until
    print(_head(file, runs, seed, until))
    for warning in file.warnings:
        print(warning, file=sys.stderr)
    how = {"overwrite": options.overwrite, "chunk": options.chunk, "samples": options.samples}
    how |= {"until": until, "seed": seed, "times": times}
    store = path_of(file, folder, ".zarr")
    engine: str | AbstractEngine = options.engine
    if options.part is not None:
        if engine != "local":
            raise InputError(
                f"--engine is {engine}, and each part is computed by the local engine: omit it, or "
                "--part."
            )
        engine = Part(*options.part)
    return _run(file, store, runs, engine, METHODS if options.compare else None, **how)


def _chosen(file: SceneFile, runs: int) -> MethodChoice:
    """The method that is as accurate as so many runs."""
    campaign = file.campaign(warn=False, runs=runs)
    with waiting("choosing the method"):
        return choose_method(campaign, runs, accuracy=file.accuracy)


def _refuse_options_of_runs(options: Options, method: str) -> None:
    """Raise `InputError` for an option about runs with a method that has none."""
    for name, default in Options._field_defaults.items():
        if name != "method" and getattr(options, name) != default:
            raise InputError(
                f"--{name} applies to the runs of a campaign, and --method {method} "
                "computes none: omit one of the two options."
            )


def _without_runs(file: SceneFile, method: str) -> int:
    """Print mean and standard deviation from a method without a campaign of runs."""
    nominal = file.nominal_mission()
    campaign = file.campaign(nominal, warn=False)
    with waiting(f"computing the moments with {method}"), warnings_as_lines():
        # The report marks this in its table.
        warnings.filterwarnings("ignore", ".*is not reliable")
        result = moments(campaign, method, accuracy=file.accuracy)
    print(moments_report(file.title, result, campaign.units, file.nominal_outputs(nominal)))
    return 0


def _report_moments(file: SceneFile, result: Moments) -> int:
    """Print the mean and the standard deviation of a method that was chosen."""
    with waiting("simulating the nominal run"):
        outputs = file.nominal_outputs(file.nominal_mission())
    units = {spec.name: spec.unit for spec in file.outputs}
    print(moments_report(file.title, result, units, outputs))
    return 0


def _head(file: SceneFile, runs: int, seed: int, until: StopRule | None) -> str:
    if file.sweep:
        each = "1 run" if runs == 1 else f"{runs} runs"
        return f"{file.title}: sweep of {file.rows} rows, {each} in each, seed {seed}"
    if until is None:
        return f"{file.title}: {runs} runs, seed {seed}"
    return f"{file.title}: at most {runs} runs, seed {seed}, {until.text()}"


def resume(store: str, engine: str, modules: Sequence[str] = (), runs: int | None = None) -> int:
    """Compute the missing runs of a store, and report on all of them.

    `runs`: the number of runs to which the campaign is extended; by default the planned number."""
    dispersion = _opened_quietly(store)
    file = _scene(store, dispersion, modules)
    there = {**dispersion.attributes, "seed": dispersion.seed}
    # From the store, because another seed would be another campaign.
    stored = {"seed": there["seed"], "chunk": there["chunk"], "samples": there.get("samples", 0)}
    stored["times"] = there.get("times")
    stored["until"] = StopRule(**there["until"]) if there.get("until") else None
    # Of each row of a sweep, as given to `disperse`.
    planned = int(there["planned_runs"]) // dispersion.rows
    if runs is not None and runs < planned:
        raise InputError(
            f"--runs is {runs}: the store was planned for {planned}; give at least that."
        )
    planned = planned if runs is None else runs
    print(_head(file, planned, there["seed"], stored["until"]))
    return _run(file, store, planned, engine, resume=True, **stored)


def _run(
    file: SceneFile,
    store: str,
    runs: int,
    engine: str | AbstractEngine,
    compare: tuple[str, ...] | None = None,
    **how: object,
) -> int:
    before = _head_of(store)
    try:
        return _run_and_report(file, store, runs, engine, compare, **how)
    except (KeyboardInterrupt, RuntimeError) as error:
        if not is_stop(error):
            raise
        # Unless the campaign is resumed, an existing store is that of another one.
        untouched = not how.get("resume") and before is not None and before == _head_of(store)
        raise Stopped(_left(store, untouched, engine)) from None


def _run_and_report(
    file: SceneFile,
    store: str,
    runs: int,
    engine: str | AbstractEngine,
    compare: tuple[str, ...] | None,
    **how: Any,
) -> int:
    began = time.perf_counter()
    # The campaign of a flight from a rail flies the nominal one, too: a program for it alone would
    # take a third of the wait.
    stages = _Stages()
    with stages.of("the nominal run"), waiting("simulating the nominal run"):
        nominal = None if file.site is not None else file.nominal_mission()
    campaign = file.campaign(nominal, warn=False, runs=runs)
    total = campaign.total_runs(runs)
    with progress("compiling and starting up", total=total, unit="run") as bar:
        # Through the bar, which moves down: a plain print would tear it.
        write = functools.partial(bar.write, file=sys.stderr)

        def show(done: int, total: int) -> None:
            bar.set_description_str(refresh=False)
            # The bar counts steps, the campaign reports totals.
            bar.update(done - bar.n)

        with stages.of(CAMPAIGN), warnings_as_lines(write):
            result = disperse_campaign(
                campaign,
                runs,
                method="monte_carlo",
                store=store,
                engine=engine,
                notes={"title": file.title, "scene_file": str(file.path)},
                progress=show,
                **how,
            )
    if isinstance(engine, Part) and result.runs < total:
        print(_parts_left(store, result, engine))
        return 0
    shown = file.in_units(result)
    with stages.of("the statistics"), waiting("computing the statistics"):
        outputs = nominal_outputs(file, result, nominal)
        tables = dispersion_report(shown, outputs)
    print(tables)
    methods = file.compare if compare is None else compare
    if methods:
        words = "computing the moments with the other methods"
        with stages.of("the other methods"), waiting(words), warnings_as_lines():
            table = compare_methods(campaign, result, methods, accuracy=file.accuracy)
        print(f"\ncomparison of methods with these runs\n{comparison_table(table)}\n")
    with stages.of("the figures and the page"):
        written = keep_pictures(
            shown, file.title, outputs, os.path.splitext(store)[0], site=file.site
        )
    whole = time.perf_counter() - began
    print(_times(result, stages.seconds, whole, resumed=bool(how.get("resume"))))
    print(f"store  {store}")
    runs_that_decide = _runs_that_decide(result, how.get("until"), campaign.design)
    if runs_that_decide is not None:
        print_next(file, "resume", store, "--runs", runs_that_decide)
    # The cause of a failure comes first.
    print_next(file, "report" if result.good.all() else "failures", store)
    # A picture that cannot be drawn costs no number; a disk on which nothing more fits is told.
    if written == 2:
        return 2
    # Single failed runs are part of the result; a campaign of which all failed is none.
    return 0 if result.good.any() else 1


def _parts_left(store: str, result: Dispersion, engine: Part) -> str:
    """A message about a campaign of which other parts are missing."""
    parts = unfinished_parts(Store(store).read(), engine.parts)
    named = ", ".join(map(str, parts[:20])) + (", ..." if len(parts) > 20 else "")
    return (
        f"part {engine.part} of {engine.parts} is finished: {result.runs} of "
        f"{result.planned_runs} runs are in {store}. Unfinished parts: {named}."
    )


def _runs_that_decide(
    result: Dispersion, until: object, design: AbstractDesign | None
) -> int | None:
    """The number of runs to which the campaign is extended for its undecided verdicts; `None` if no
    verdict requires it, or the campaign cannot be extended."""
    needed = [verdict.runs_needed for verdict in result.verdicts.values()]
    most = max((runs for runs in needed if runs is not None), default=None)
    if (
        most is None
        or "sweep" in result.attributes
        or until is not None
        or isinstance(design, LatinHypercube)
    ):
        return None
    # Sobol points are evenly distributed for powers of two only.
    return 1 << (most - 1).bit_length() if isinstance(design, Sobol) else most


def _head_of(store: str) -> tuple[int, int] | None:
    """A mark that changes with the head of a store; `None` where there is none."""
    try:
        # Each is a new file, put in place of the last one.
        result = os.stat(os.path.join(store, "zarr.json"))
    except OSError:
        return None
    return result.st_ino, result.st_mtime_ns


def _left(store: str, untouched: bool, engine: str | AbstractEngine) -> str:
    """A message about the state of a stopped campaign.

    `untouched`: whether `store` is the one of an earlier campaign."""
    if untouched:
        return f"stopped before the first run: nothing was computed, and {store} is unchanged."
    try:
        there = _opened_quietly(store)
    # Stopped before the first run.
    except StoreError:
        return "stopped before the first run: nothing was stored."
    planned = there.planned_runs
    if isinstance(engine, Part):
        return (
            f"stopped: {there.runs} of {planned} runs are stored in {store}. The same command "
            f"computes the rest of part {engine.part}."
        )
    return (
        f"stopped: {there.runs} of {planned} runs are stored in {store}. "
        f"`jaxspace resume {shlex.quote(store)}` computes the rest."
    )


CAMPAIGN = "the campaign"


class _Stages:
    """The seconds of the stages of a command, by name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextlib.contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Measure the stage with this name."""
        began = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - began


def _times(result: Dispersion, stages: Mapping[str, float], whole: float, *, resumed: bool) -> str:
    """A message about the time of the command, `whole`, s, with its `stages`; and about the rate of
    the runs.

    `resumed`: whether an earlier command computed a part of the runs."""
    ahead = result.attributes["preparation_seconds"]
    # Without the compilation, which does not grow with the number of runs.
    computing = max(result.seconds - ahead, 1e-9)
    campaign = stages[CAMPAIGN]
    parts = {"compilation and the missing runs": campaign}
    # A resumed store records the times of its first command.
    if not resumed:
        storing = float(result.attributes.get("storing_seconds", 0.0))
        runs = max(campaign - ahead - storing, 0.0)
        parts = {"compilation and start-up": ahead, "the runs": runs, "writing the store": storing}
    parts |= {name: seconds for name, seconds in stages.items() if name != CAMPAIGN}
    # Such as building the campaign, and opening the store.
    parts["the rest"] = whole - sum(parts.values())
    named = ", ".join(
        f"{seconds:.1f} s for {name}" for name, seconds in parts.items() if seconds >= 0.05
    )
    use = 100.0 * result.utilisation
    return (
        f"{whole:.1f} s in total: {named}.\n{result.runs / computing:.0f} runs/s, {use:.0f} % of "
        f"{result.cores} cores."
    )


def replay(
    store: str,
    which: int | tuple[str, str],
    samples: int,
    folder: str,
    show: bool,
    modules: Sequence[str] = (),
) -> int:
    """Run one sample of a store again, print it, and draw its phases.

    `which`: its number, or "worst", "least" or "greatest" and the name of an output."""
    dispersion = _opened_quietly(store)
    run = which if isinstance(which, int) else dispersion.run_of(*which)
    if run >= dispersion.planned_runs:
        raise InputError(f"--run is {run}: it must be from 0 to {dispersion.planned_runs - 1}.")
    file = _scene(store, dispersion, modules)
    make_folder(folder)
    # A hypercube is made for the runs that were planned, also where fewer were enough.
    runs = dispersion.attributes["planned_runs"]
    accuracy = accuracy_of(file, dispersion)
    with waiting(f"simulating run {run}"):
        result = file.campaign(warn=False, runs=runs // dispersion.rows).replay(
            run, seed=dispersion.seed, accuracy=accuracy, num_saved=samples, runs=runs
        )
    print(replay_report(file, result, dispersion))
    title = f"{file.title}, run {run}"
    for name, phase in result.trajectory.items():
        path = path_of(file, folder, f"_run_{run}_{name}.png".replace(" ", "_"))
        draw(file, phase, path, f"{title}: {name}")
    if show:
        show_page(file, result.trajectory, path_of(file, folder, f"_run_{run}.html"), title)
    else:
        print_next(file, "replay", store, "--run", run, "--show")
    return 0 if result.status.good else 1


def failures(store: str, every: bool, modules: Sequence[str] = ()) -> int:
    """List the failed runs of a store with their reasons."""
    with warnings_as_lines():
        dispersion = open_store(store)
    text = dispersion.attributes.get("description")
    file = None
    # A campaign from Python has no scene; its failures are listed all the same.
    if text and "scene_file" in dispersion.attributes:
        file = _scene(store, dispersion, modules)
    print(failures_report(file, dispersion, dispersion.runs if every else 20))
    return 0


def _opened_quietly(store: str) -> Dispersion:
    """The runs of a store, for a command that reports damaged or missing runs itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedStore)
        warnings.filterwarnings("ignore", UNFINISHED)
        return open_store(store)


def _scene(store: str, dispersion: Dispersion, modules: Sequence[str]) -> SceneFile:
    """The scene of a store. Raises `InputError` for a campaign that was built in Python."""
    if "scene_file" not in dispersion.attributes:
        raise InputError(
            f"{store} belongs to a campaign defined in Python, which the command line cannot "
            "rebuild: call disperse(campaign, ..., store=..., resume=True) or "
            "campaign.replay(number, seed=...)."
        )
    return stored_scene(dispersion, modules)

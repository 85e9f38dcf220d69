"""The parser of the command line: its commands and their arguments."""

import argparse
import math
from collections.abc import Callable, Sequence

import jaxspace

from . import _actions as actions

# In this order `--help` lists them.
COMMANDS: tuple[tuple[str, Callable[[argparse.Namespace], int], str], ...] = (
    ("examples", actions.show_examples, "list the bundled example scenes by topic"),
    ("new", actions.new, "copy an example scene into the current folder as a starting point"),
    ("run", actions.run, "simulate the nominal run of a scene file"),
    ("disperse", actions.disperse, "run a Monte Carlo campaign for a scene file"),
    ("resume", actions.resume, "compute missing or corrupted runs of a store"),
    ("replay", actions.replay, "simulate a single run of a store again in full detail"),
    ("failures", actions.failures, "list the failed runs of a store with their causes"),
    ("report", actions.report, "write the report page and tables of a stored campaign"),
    ("diff", actions.diff, "compare two stored campaigns: settings, outputs, verdicts"),
    (
        "reweight",
        actions.reweight,
        "estimate the effect of other input distributions from the runs of a store",
    ),
    ("compare", actions.compare, "compare a flight log with the nominal run of a scene file"),
    ("archive", actions.archive, "bundle a stored campaign into one file, or verify such a file"),
    ("map", actions.write_map, "write landings and tracks as KML, GeoJSON, GPX and CZML"),
    (
        "explain",
        actions.explain,
        "show the inputs, contributions and costs of the effects of a scene file",
    ),
    ("cost", actions.cost, "measure the cost of accuracy for the run of a scene file"),
    ("budget", actions.budget, "measure the influence of each effect of a scene file"),
    ("optimize", actions.optimize, "optimise the design variables of a scene file"),
    ("list", actions.show_list, "list the effects, bodies and outputs available in scene files"),
    ("schema", actions.show_schema, "print the JSON schema of scene files (for editors)"),
    ("programs", actions.programs, "list or remove the compiled programs that are stored"),
    ("verify", actions.verify, "run the singularity and edge-case checks on this machine"),
)
WITH_MODULES = (
    *("run", "disperse", "resume", "replay", "failures", "report", "reweight", "compare"),
    "map",
    *("explain", "cost", "budget", "optimize", "list", "schema"),
)
# Not from the package of campaigns, whose import takes time.
EXTREMES = ("worst", "least", "greatest")
METHODS = ("monte_carlo", "lincov", "second_order", "unscented", "auto")


def parser() -> argparse.ArgumentParser:
    """The parser of the command line: its commands and their arguments."""
    top = argparse.ArgumentParser(prog="jaxspace", description="Space dynamics from scene files.")
    top.add_argument("--version", action="version", version=f"jaxspace {jaxspace.__version__}")
    added = top.add_subparsers(required=True, metavar="COMMAND")
    commands: dict[str, argparse.ArgumentParser] = {}
    for name, action, text in COMMANDS:
        commands[name] = added.add_parser(name, help=text)
        commands[name].set_defaults(command=action)
    _new_options(commands["new"])
    _file_arguments(commands)
    _run_options(commands["run"])
    _disperse_options(commands["disperse"])
    _method_options(commands["disperse"])
    _engine_option(commands["disperse"])
    _engine_option(commands["resume"])
    _resume_options(commands["resume"])
    _replay_options(commands["replay"])
    _failures_options(commands["failures"])
    _report_options(commands["report"])
    _reweight_options(commands["reweight"])
    _map_options(commands["map"])
    _diff_options(commands["diff"])
    _compare_options(commands["compare"])
    _archive_options(commands["archive"])
    _cost_options(commands["cost"])
    _budget_options(commands["budget"])
    _optimize_options(commands["optimize"])
    _list_options(commands["list"])
    _programs_options(commands["programs"])
    _verify_options(commands["verify"])
    return top


def _programs_options(programs: argparse.ArgumentParser) -> None:
    programs.add_argument("--clear", action="store_true", help="remove all stored programs")


def _new_options(new: argparse.ArgumentParser) -> None:
    new.add_argument(
        "name", metavar="NAME", help="name of the example scene, as listed by `jaxspace examples`"
    )
    new.add_argument(
        "path", metavar="FILE", nargs="?", help="path of the copy (default: NAME.toml)"
    )


def _list_options(show: argparse.ArgumentParser) -> None:
    show.add_argument(
        "word",
        metavar="WORD",
        nargs="?",
        default="",
        help="show the entries that contain this word, or a group by its name, with all fields",
    )


def _file_arguments(commands: dict[str, argparse.ArgumentParser]) -> None:
    """Arguments of each command: the files that it reads and writes."""
    for name in ("run", "disperse", "compare", "explain", "cost", "budget", "optimize"):
        commands[name].add_argument("file", metavar="FILE", help="scene file (TOML)")
    for name in ("resume", "replay", "failures"):
        commands[name].add_argument("file", metavar="STORE", help="Zarr store of a campaign")
    for name in WITH_MODULES:
        # Only by options, and not by a file, because modules are run.
        commands[name].add_argument(
            "--with",
            dest="modules",
            action="append",
            default=[],
            metavar="FILE.py",
            help="run a Python file with user-defined effects, systems, outputs or controllers, "
            "which the scene file can then use",
        )
    for name in ("run", "disperse", "replay", "compare", "cost", "budget", "optimize"):
        commands[name].add_argument(
            "--out", default="out", metavar="DIR", help="output directory (default: out)"
        )


def _run_options(run: argparse.ArgumentParser) -> None:
    run.add_argument(
        "--show", action="store_true", help="open an animated 3-D view of the run in the browser"
    )
    run.add_argument(
        "--write",
        choices=("oem",),
        help="also write the states as a file of this kind: oem, a CCSDS orbit ephemeris message "
        "with a segment for each phase (requires --epoch)",
    )
    run.add_argument(
        "--epoch", metavar="DATE", help="UTC at t = 0 for --write, such as 2026-03-01T12:00:00"
    )
    run.add_argument(
        "--centre",
        metavar="NAME",
        default="EARTH",
        help="central body for --write (default: EARTH)",
    )
    run.add_argument(
        "--frame", metavar="NAME", default="EME2000", help="axes for --write (default: EME2000)"
    )


def _resume_options(resume: argparse.ArgumentParser) -> None:
    resume.add_argument(
        "--runs",
        type=_count,
        help="extend the campaign to this number of runs; existing runs keep their values "
        "(default: the planned number)",
    )


def _failures_options(failures: argparse.ArgumentParser) -> None:
    failures.add_argument(
        "--all", action="store_true", help="list all failed runs instead of at most 20 of each kind"
    )


def _report_options(report: argparse.ArgumentParser) -> None:
    report.add_argument("file", metavar="STORE", help="Zarr store of a campaign")
    report.add_argument(
        "--out", metavar="DIR", help="output directory (default: the folder of STORE)"
    )


def _diff_options(diff: argparse.ArgumentParser) -> None:
    diff.add_argument("before", metavar="STORE", help="the Zarr store of a campaign")
    diff.add_argument("after", metavar="OTHER", help="the store that is compared with it")
    diff.add_argument("--out", default="out", metavar="DIR", help="output directory (default: out)")


def _reweight_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("file", metavar="STORE", help="Zarr store of a campaign")
    command.add_argument(
        "changes",
        metavar="INPUT.KEY=VALUE",
        nargs="+",
        help="a changed key of the table of an input in [dispersion.inputs], such as "
        '"initial.orbit.periapsis_altitude.deviation=2.5 km" or "body.mass.mean=51 kg"',
    )


def _compare_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("log", metavar="LOG", help="flight log (CSV with names and units)")
    command.add_argument(
        "--align",
        default="0",
        metavar="OFFSET | EVENT | fit",
        help="seconds to add to the times of the log; or an event of both, such as "
        '"greatest altitude" or "altitude > 30 m"; or fit, for the offset of least squares '
        "(default: 0)",
    )
    command.add_argument(
        "--channel",
        dest="channels",
        type=_channel,
        action="append",
        default=[],
        metavar="COLUMN=OUTPUT",
        help="compare a column of the log with an output or a number of the state, such as "
        "Altitude=position.2 (default: all columns with the name of one)",
    )
    command.add_argument(
        "--runs",
        type=_count,
        help="number of runs of [dispersion] for the scatter of each channel (default: none)",
    )


def _channel(text: str) -> tuple[str, str]:
    column, equals, output = (x.strip() for x in text.rpartition("="))
    if not (column and equals and output):
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be the name of a column and what it is, such as "
            "Altitude=position.2."
        )
    return column, output


def _archive_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "file", metavar="STORE", help="Zarr store of a campaign, or the archive to verify"
    )
    command.add_argument(
        "--out", metavar="FILE", help="path of the archive (default: NAME.zip beside the store)"
    )
    command.add_argument(
        "--verify", action="store_true", help="verify all checksums and runs of an archive"
    )
    command.add_argument(
        "--digest", metavar="SHA256", help="checksum that the whole archive must have; verifies it"
    )
    command.add_argument(
        "--extract", metavar="DIR", help="verify an archive and extract it to a new folder"
    )


def _map_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "file", metavar="STORE", help="Zarr store of a campaign, or scene file (TOML)"
    )
    command.add_argument(
        "--out", metavar="DIR", help="output directory (default: the folder of STORE)"
    )
    command.add_argument(
        "--tracks",
        type=_whole,
        metavar="N",
        help="also write the tracks of the nominal run and of the first N runs of a store; those "
        "of a scene file are always written",
    )
    command.add_argument(
        "--epoch",
        metavar="DATE",
        help="date at t = 0, such as 2026-03-01T12:00:00Z (default: no dates; in CZML, which "
        "needs one, noon of 2000-01-01)",
    )
    command.add_argument(
        "--angle",
        default="0",
        help='angle of the prime meridian at t = 0 for orbits, such as "100.5 deg" (default: 0)',
    )


def _optimize_options(optimize: argparse.ArgumentParser) -> None:
    optimize.add_argument(
        "--sensitivities",
        action="store_true",
        help="show the sensitivity of the optimum to the other parameters of the file",
    )
    optimize.add_argument(
        "--resume",
        action="store_true",
        help="continue an interrupted search over a dispersion",
    )


def _disperse_options(disperse: argparse.ArgumentParser) -> None:
    disperse.add_argument("--runs", type=_count, help="number of runs (default: from the file)")
    disperse.add_argument(
        "--seed", type=_whole, help="seed of the random inputs (default: from the file)"
    )
    # Larger chunks write less often, and lose more when a campaign is interrupted.
    disperse.add_argument(
        "--chunk",
        type=_count,
        default=8192,
        help="number of runs per stored chunk, which bounds the memory (default: 8192)",
    )
    disperse.add_argument(
        "--samples",
        type=_whole,
        default=0,
        help="number of states to store for every phase of every run (default: none)",
    )
    disperse.add_argument(
        "--times",
        metavar="TIME[,TIME...]",
        help="times at which to store the state of every run, instead of --samples, such as "
        '"0, 90 s, 10 min"; NaN for the phases that do not cover a time',
    )
    disperse.add_argument("--overwrite", action="store_true", help="replace an existing store")
    disperse.add_argument(
        "--part",
        type=_part,
        metavar="K/N",
        help="compute part K of N, for tasks that share the store without a scheduler, such as "
        "those of an array job; the task that completes the store reports on all runs",
    )


def _method_options(disperse: argparse.ArgumentParser) -> None:
    disperse.add_argument(
        "--until",
        type=_rule,
        metavar="OUTPUT[:SHARE[:PRECISION]]",
        help="stop when the percentile SHARE (default: 0.99) of OUTPUT is known to PRECISION "
        "(default: 0.01), or after --runs",
    )
    disperse.add_argument(
        "--method",
        choices=METHODS,
        help="method for mean and standard deviation; only monte_carlo writes a store; auto "
        "chooses the cheapest one that is as accurate as --runs (default: from the file, or "
        "monte_carlo)",
    )
    disperse.add_argument(
        "--compare",
        action="store_true",
        help="compare the Monte Carlo result with the cheaper methods",
    )


def _part(text: str) -> tuple[int, int]:
    part, _, parts = text.partition("/")
    numbers = [int(x) if x.isascii() and x.isdigit() and len(x) < 10 else 0 for x in (part, parts)]
    if not 1 <= numbers[0] <= numbers[1]:
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be the number of a part and that of all parts, such as 3/40."
        )
    return numbers[0], numbers[1]


def _rule(text: str) -> tuple[str, float, float]:
    output, *numbers = text.split(":")
    try:
        # Missing numbers are filled in; an extra number fails in the unpacking.
        share, precision = (*map(float, numbers), *(0.99, 0.01)[len(numbers) :])
    except ValueError:
        # NaN fails the comparisons below, which then name the text.
        share = precision = math.nan
    if not (output and 0.0 < share < 1.0 and 0.0 < precision < 1.0):
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be the name of an output, optionally with a share and a "
            "precision between 0 and 1, such as apoapsis_altitude:0.99:0.01."
        )
    return output, share, precision


def _engine_option(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--engine",
        default="local",
        help="engine that computes the runs: local, processes, dask, or the address of a Dask "
        "scheduler (default: local)",
    )


def with_joined_runs(arguments: Sequence[str]) -> list[str]:
    """The arguments, with the two words of `--run worst OUTPUT` as one: otherwise an option with
    one or two words would consume the store as its second."""
    result: list[str] = []
    for word in arguments:
        extreme = result[-2:-1] == ["--run"] and result[-1] in EXTREMES
        if extreme and not word.startswith("-"):
            result[-1] += f" {word}"
        else:
            result.append(word)
    return result


def _which_run(text: str) -> int | tuple[str, str]:
    which, space, output = text.partition(" ")
    if space and which in EXTREMES:
        return which, output
    if which in EXTREMES:
        raise argparse.ArgumentTypeError(f"{which!r} must be followed by the name of an output")
    return _whole(text)


def _replay_options(replay: argparse.ArgumentParser) -> None:
    replay.add_argument(
        "--run",
        type=_which_run,
        required=True,
        metavar="NUMBER | worst OUTPUT",
        help="number of the run; or `worst OUTPUT`, the run that violates the requirement on an "
        "output the most or comes closest to its limit; or `least OUTPUT`, `greatest OUTPUT`",
    )
    replay.add_argument(
        "--samples",
        type=_count,
        default=200,
        help="number of saved states per phase (default: 200)",
    )
    replay.add_argument(
        "--show", action="store_true", help="open an animated 3-D view of the run in the browser"
    )


def _cost_options(cost: argparse.ArgumentParser) -> None:
    cost.add_argument(
        "--error",
        type=_positive,
        help="relative error for which to recommend a setting (default: the accuracy of the file)",
    )
    cost.add_argument(
        "--gradient",
        action="store_true",
        help="also measure the gradient with respect to the initial state",
    )


def _budget_options(budget: argparse.ArgumentParser) -> None:
    budget.add_argument(
        "--output",
        help="quantity on which the influence is measured: a part of the final state (default: "
        "the first one), or any output available in scene files",
    )
    budget.add_argument(
        "--tolerance",
        metavar="SIZE",
        help='largest acceptable change of the output, such as "10 m"',
    )


def _verify_options(verify: argparse.ArgumentParser) -> None:
    verify.add_argument(
        "--precision",
        choices=("float64", "float32"),
        default="float64",
        help="floating-point precision of the inputs (default: float64)",
    )
    verify.add_argument(
        "--device", metavar="NAME", help="JAX device, such as cpu or gpu (default: chosen by JAX)"
    )
    verify.add_argument("--json", metavar="PATH", help="file to which the results are written")


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"it is {text}: it must be a positive number.")
    return number


def _count(text: str) -> int:
    return _whole(text, 1)


def _whole(text: str, least: int = 0) -> int:
    try:
        number = int(text)
    except ValueError:
        number = -1
    # Fits 32 bits, signed or not: without double precision jax has no wider integers.
    if not least <= number < 2**31:
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be a whole number from {least} to 2147483647."
        )
    return number

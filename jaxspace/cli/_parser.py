"""The parser of the command line: its commands, their arguments and what they mean."""

import argparse
import math
from collections.abc import Callable, Sequence

import jaxspace

from . import _actions as actions

# In this order `--help` lists them.
COMMANDS: tuple[tuple[str, Callable[[argparse.Namespace], int], str], ...] = (
    ("examples", actions.show_examples, "list the example scenes by goal"),
    ("new", actions.new, "copy an example scene into this folder, to begin with"),
    ("run", actions.run, "simulate the nominal run of a scene file"),
    ("disperse", actions.disperse, "simulate a scene file many times with its dispersions"),
    ("resume", actions.resume, "compute the runs that a store lacks, or has damaged"),
    ("replay", actions.replay, "simulate one run of a store again, in full detail"),
    ("failures", actions.failures, "list the failed runs of a store, each with why"),
    ("report", actions.report, "write the page and the tables of a stored campaign"),
    ("map", actions.write_map, "write the landings of a stored campaign as KML and GeoJSON"),
    ("explain", actions.explain, "show what the effects of a scene file read, add and cost"),
    ("cost", actions.cost, "measure what accuracy costs in the run of a scene file"),
    ("budget", actions.budget, "show which effects of a scene file matter"),
    ("optimize", actions.optimize, "find the best values of the free numbers"),
    ("list", actions.show_list, "list what scene files may name, with fields and units"),
    ("schema", actions.show_schema, "print the JSON schema of scene files, for editors"),
    ("verify", actions.verify, "evaluate the hard cases, in value and gradient, on this machine"),
)
WITH_MODULES = (
    *("run", "disperse", "resume", "replay", "failures", "report", "map"),
    *("explain", "cost", "budget", "optimize", "list", "schema"),
)
# Not from the package of campaigns, whose import takes time.
EXTREMES = ("worst", "least", "greatest")
METHODS = ("monte_carlo", "lincov", "second_order", "unscented")


def parser() -> argparse.ArgumentParser:
    """The parser of the command line: its commands, their arguments and what they mean."""
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
    _replay_options(commands["replay"])
    _failures_options(commands["failures"])
    _report_options(commands["report"])
    _map_options(commands["map"])
    _cost_options(commands["cost"])
    _budget_options(commands["budget"])
    _optimize_options(commands["optimize"])
    _list_options(commands["list"])
    _verify_options(commands["verify"])
    return top


def _new_options(new: argparse.ArgumentParser) -> None:
    new.add_argument("name", metavar="NAME", help="of the scene, as `jaxspace examples` lists it")
    new.add_argument("path", metavar="FILE", nargs="?", help="the copy (default: NAME.toml)")


def _list_options(show: argparse.ArgumentParser) -> None:
    show.add_argument(
        "word", metavar="WORD", nargs="?", default="", help="show only the entries with this word"
    )


def _file_arguments(commands: dict[str, argparse.ArgumentParser]) -> None:
    """Arguments of each command: the files that it reads and writes."""
    for name in ("run", "disperse", "explain", "cost", "budget", "optimize"):
        commands[name].add_argument("file", metavar="FILE", help="a scene file, in TOML")
    for name in ("resume", "replay", "failures"):
        commands[name].add_argument("file", metavar="STORE", help="the Zarr store of a campaign")
    for name in WITH_MODULES:
        # Only by options, and not by a file, because modules are run.
        commands[name].add_argument(
            "--with",
            dest="modules",
            action="append",
            default=[],
            metavar="FILE.py",
            help="run a Python file of own effects, systems, outputs or controllers, which the "
            "scene may then name",
        )
    for name in ("run", "disperse", "replay", "cost", "budget", "optimize"):
        commands[name].add_argument(
            "--out", default="out", metavar="DIR", help="where the files go (default: out)"
        )


def _run_options(run: argparse.ArgumentParser) -> None:
    run.add_argument(
        "--show", action="store_true", help="open the run in the browser as a page that moves"
    )


def _failures_options(failures: argparse.ArgumentParser) -> None:
    failures.add_argument(
        "--all", action="store_true", help="list all of them, and not 20 of a kind at most"
    )


def _report_options(report: argparse.ArgumentParser) -> None:
    report.add_argument("file", metavar="STORE", help="the store of a dispersion")
    report.add_argument("--out", metavar="DIR", help="where the files go (default: beside STORE)")


def _map_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("file", metavar="STORE", help="the Zarr store of a campaign")
    command.add_argument("--out", metavar="DIR", help="output directory (default: that of STORE)")


def _optimize_options(optimize: argparse.ArgumentParser) -> None:
    optimize.add_argument(
        "--sensitivities",
        action="store_true",
        help="show which other numbers of the file move the optimum",
    )
    optimize.add_argument(
        "--resume",
        action="store_true",
        help="go on with a search over a dispersion that was interrupted",
    )


def _disperse_options(disperse: argparse.ArgumentParser) -> None:
    disperse.add_argument("--runs", type=_count, help="how many runs (default: what the file says)")
    disperse.add_argument(
        "--seed", type=_whole, help="what the runs are drawn from (default: what the file says)"
    )
    # Larger chunks write less often, and lose more when a campaign is interrupted.
    disperse.add_argument(
        "--chunk",
        type=_count,
        default=8192,
        help="after how many runs results are stored; it bounds the memory (default: 8192)",
    )
    disperse.add_argument(
        "--samples",
        type=_whole,
        default=0,
        help="how many states of every phase are stored of every run (default: none)",
    )
    disperse.add_argument(
        "--times",
        metavar="TIME[,TIME...]",
        help='at which times, such as "0, 90 s, 10 min", states of every run are stored instead; '
        "NaN in the phases in which a run is not at a time",
    )
    disperse.add_argument(
        "--overwrite", action="store_true", help="replace the store that is there"
    )


def _method_options(disperse: argparse.ArgumentParser) -> None:
    disperse.add_argument(
        "--until",
        type=_rule,
        metavar="OUTPUT[:SHARE[:PRECISION]]",
        help="end when the limit below which this share of the runs lies (default: 0.99) is known "
        "to this precision (default: 0.01), or after --runs",
    )
    disperse.add_argument(
        "--method",
        choices=METHODS,
        default=METHODS[0],
        help="how mean and deviation are found; all but the first make no store (default: "
        "monte_carlo)",
    )
    disperse.add_argument(
        "--compare", action="store_true", help="put the cheaper methods beside the runs"
    )


def _rule(text: str) -> tuple[str, float, float]:
    output, *numbers = text.split(":")
    try:
        # What is left out is filled up; a number too many fails in the unpacking.
        share, precision = (*map(float, numbers), *(0.99, 0.01)[len(numbers) :])
    except ValueError:
        # NaN fails the comparisons below, which then name the text.
        share = precision = math.nan
    if not (output and 0.0 < share < 1.0 and 0.0 < precision < 1.0):
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be the name of an output, with a share and a precision between "
            f"0 and 1 if they are given, such as apoapsis_altitude:0.99:0.01."
        )
    return output, share, precision


def _engine_option(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--engine",
        default="local",
        help="where the runs are computed: local, processes, dask, or the address of a Dask "
        "scheduler (default: local)",
    )


def with_joined_runs(arguments: Sequence[str]) -> list[str]:
    """The arguments, with the two words of `--run worst OUTPUT` as one: an option of one or of two
    words would take the store for its second."""
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
        raise argparse.ArgumentTypeError(f"{which!r} needs the name of an output behind it")
    return _whole(text)


def _replay_options(replay: argparse.ArgumentParser) -> None:
    replay.add_argument(
        "--run",
        type=_which_run,
        required=True,
        metavar="NUMBER | worst OUTPUT",
        help="the number of the run; or `worst OUTPUT`, the run farthest outside of the "
        "requirement on an output, or nearest to its limit; `least OUTPUT`, `greatest OUTPUT`",
    )
    replay.add_argument(
        "--samples", type=_count, default=200, help="states of each phase (default: 200)"
    )
    replay.add_argument(
        "--show", action="store_true", help="open the run in the browser as a page that moves"
    )


def _cost_options(cost: argparse.ArgumentParser) -> None:
    cost.add_argument(
        "--error",
        type=_positive,
        help="the relative error to recommend for (default: the file's accuracy)",
    )
    cost.add_argument(
        "--gradient", action="store_true", help="measure the gradient in the initial state as well"
    )


def _budget_options(budget: argparse.ArgumentParser) -> None:
    budget.add_argument(
        "--output",
        help="what their influence is measured on: a part of the final state (default: the first "
        "one), or any output that a file may name",
    )
    budget.add_argument(
        "--tolerance", metavar="SIZE", help='how far the output may move, such as "10 m"'
    )


def _verify_options(verify: argparse.ArgumentParser) -> None:
    verify.add_argument(
        "--precision",
        choices=("float64", "float32"),
        default="float64",
        help="of the inputs (default: float64)",
    )
    verify.add_argument(
        "--device", metavar="NAME", help="such as cpu or gpu (default: what JAX chooses)"
    )
    verify.add_argument("--json", metavar="PATH", help="a file for the results")


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

"""The commands: run, disperse, explain, cost, budget."""

import argparse
import math
import os
import sys
from collections.abc import Sequence

from ..core import InputError
from ..io import SceneError
from ..simulation import SimulationError

BAD_INPUT, BAD_RUN = 2, 1
OUTPUTS = ("position", "velocity", "attitude", "omega", "mass")


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit status: 0, 1 for runs that failed, 2 for input that
    cannot be used."""
    given = _parser().parse_args(arguments)
    try:
        return given.command(given)
    except (SceneError, InputError) as error:
        text = str(error) if isinstance(error, SceneError) else f"{given.file}: {error}"
        print(text, file=sys.stderr)
        return BAD_INPUT
    except SimulationError as error:
        print(f"{given.file}: {error}", file=sys.stderr)
        return BAD_RUN


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxspace", description="Space dynamics from scene files."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="fly the nominal run of a scene file")
    disperse = commands.add_parser(
        "disperse", help="fly a scene file many times with its dispersions"
    )
    explain = commands.add_parser(
        "explain", help="say what the effects of a scene file read, add and cost"
    )
    cost = commands.add_parser("cost", help="say what accuracy costs in the run of a scene file")
    budget = commands.add_parser("budget", help="say which effects of a scene file matter")
    every = (
        (run, _run),
        (disperse, _disperse),
        (explain, _explain),
        (cost, _cost),
        (budget, _budget),
    )
    for command, action in every:
        command.add_argument("file", metavar="FILE", help="a scene file, in TOML")
        command.set_defaults(command=action)
    for command in (run, disperse, cost, budget):
        command.add_argument(
            "--out", default="out", metavar="DIR", help="where the files go (default: out)"
        )
    disperse.add_argument("--runs", type=_count, help="how many runs (default: what the file says)")
    disperse.add_argument(
        "--seed", type=_whole, help="what the runs are drawn from (default: what the file says)"
    )
    disperse.add_argument(
        "--chunk", type=_count, default=2048, help="after how many runs results are stored"
    )
    cost.add_argument(
        "--error",
        type=_positive,
        help="the relative error to recommend for (default: the file's accuracy)",
    )
    cost.add_argument(
        "--gradient", action="store_true", help="measure the gradient in the initial state as well"
    )
    budget.add_argument(
        "--output",
        choices=OUTPUTS,
        help="what they are judged by (default: the position, if there is one)",
    )
    budget.add_argument(
        "--tolerance", metavar="SIZE", help='how far the output may move, such as "10 m"'
    )
    return parser


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"it is {text}: it must be a positive number.")
    return number


def _count(text: str) -> int:
    number = _whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"it is {text}: it must be a whole number above zero.")
    return number


def _whole(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number < 2**31:
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be a whole number from zero to 2147483647."
        )
    return number


def _run(given: argparse.Namespace) -> int:
    from ._commands import run
    from ._registry import load

    return run(load(given.file), _folder(given.out))


def _disperse(given: argparse.Namespace) -> int:
    from ._commands import disperse
    from ._registry import load

    file = load(given.file)
    asked = file.values.get("dispersion")
    if asked is None:
        raise SceneError(
            given.file,
            "dispersion is missing: it must be a table with outputs and inputs for this command.",
        )
    runs = asked["runs"] if given.runs is None else given.runs
    seed = asked["seed"] if given.seed is None else given.seed
    return disperse(file, runs, seed, given.chunk, _folder(given.out))


def _explain(given: argparse.Namespace) -> int:
    from ._commands import explain
    from ._registry import load

    return explain(load(given.file))


def _cost(given: argparse.Namespace) -> int:
    from ._registry import load
    from ._study_commands import cost

    return cost(load(given.file), given.error, given.gradient, _folder(given.out))


def _budget(given: argparse.Namespace) -> int:
    from ._registry import load
    from ._study_commands import budget

    return budget(load(given.file), given.output, given.tolerance, _folder(given.out))


def _folder(name: str) -> str:
    try:
        os.makedirs(name, exist_ok=True)
    except OSError as error:
        raise SceneError(name, f"--out cannot be made a folder: {error.strerror}.") from error
    return name

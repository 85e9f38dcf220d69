"""The commands: run, disperse, explain, cost, budget, list, schema, verify."""

import argparse
import math
import os
import sys
from collections.abc import Sequence

from ..core import InputError
from ..io import SceneError
from ..simulation import SimulationError
from ._settings import settle

BAD_INPUT, BAD_RUN = 2, 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit status: 0, 1 for runs that failed, 2 for input that
    cannot be used."""
    given = parser().parse_args(arguments)
    file = getattr(given, "file", "jaxspace")
    try:
        status = given.command(given)
        # Here and not at exit, so that a closed pipe is met inside the `try`.
        sys.stdout.flush()
        return status
    except (SceneError, InputError) as error:
        print(str(error) if isinstance(error, SceneError) else f"{file}: {error}", file=sys.stderr)
        return BAD_INPUT
    except SimulationError as error:
        print(f"{file}: {error}", file=sys.stderr)
        return BAD_RUN
    except BrokenPipeError:
        # Whoever read the output has stopped. Python would fail once more when it flushes it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"{file}: the output was closed before its end.", file=sys.stderr)
        return BAD_RUN
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"{where}cannot be written or read: {error.strerror}.", file=sys.stderr)
        return BAD_INPUT


def parser() -> argparse.ArgumentParser:
    """The parser of the command line: its commands, their arguments and what they mean."""
    top = argparse.ArgumentParser(prog="jaxspace", description="Space dynamics from scene files.")
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="simulate the nominal run of a scene file")
    disperse = commands.add_parser(
        "disperse", help="simulate a scene file many times with its dispersions"
    )
    explain = commands.add_parser(
        "explain", help="show what the effects of a scene file read, add and cost"
    )
    cost = commands.add_parser(
        "cost", help="measure what accuracy costs in the run of a scene file"
    )
    budget = commands.add_parser("budget", help="show which effects of a scene file matter")
    with_file = (
        (run, _run),
        (disperse, _disperse),
        (explain, _explain),
        (cost, _cost),
        (budget, _budget),
    )
    for command, action in with_file:
        command.add_argument("file", metavar="FILE", help="a scene file, in TOML")
        command.set_defaults(command=action)
    commands.add_parser(
        "list", help="list what scene files may name, with fields and units"
    ).set_defaults(command=_list)
    commands.add_parser(
        "schema", help="print the JSON schema of scene files, for editors"
    ).set_defaults(command=_schema)
    verify = commands.add_parser(
        "verify", help="evaluate the hard cases, in value and gradient, on this machine"
    )
    verify.set_defaults(command=_verify)
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
    for command in (run, disperse, cost, budget):
        command.add_argument(
            "--out", default="out", metavar="DIR", help="where the files go (default: out)"
        )
    disperse.add_argument("--runs", type=_count, help="how many runs (default: what the file says)")
    disperse.add_argument(
        "--seed", type=_whole, help="what the runs are drawn from (default: what the file says)"
    )
    # Larger chunks write less often, and lose more when a campaign is interrupted.
    disperse.add_argument(
        "--chunk",
        type=_count,
        default=2048,
        help="after how many runs results are stored (default: 2048)",
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
        metavar="PART",
        help="the part of the state that they are judged by (default: the first one)",
    )
    budget.add_argument(
        "--tolerance", metavar="SIZE", help='how far the output may move, such as "10 m"'
    )
    return top


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
    # Fits 32 bits, signed or not: without double precision jax has no wider integers.
    if not 0 <= number < 2**31:
        raise argparse.ArgumentTypeError(
            f"it is {text}: it must be a whole number from zero to 2147483647."
        )
    return number


# The commands import what computes, which takes a while: `--help` and bad options do not wait for
# it. Settings of jax come first, for the first array fixes them.


def _run(given: argparse.Namespace) -> int:
    from ._commands import run

    settle()
    return run(given.file, given.out)


def _disperse(given: argparse.Namespace) -> int:
    from ._commands import disperse

    settle()
    return disperse(given.file, given.runs, given.seed, given.chunk, given.out)


def _explain(given: argparse.Namespace) -> int:
    from ._commands import explain

    settle()
    return explain(given.file)


def _cost(given: argparse.Namespace) -> int:
    from ._commands import cost

    settle()
    return cost(given.file, given.error, given.gradient, given.out)


def _budget(given: argparse.Namespace) -> int:
    from ._commands import budget

    settle()
    return budget(given.file, given.output, given.tolerance, given.out)


def _list(given: argparse.Namespace) -> int:
    from ._commands import show_list

    del given
    return show_list()


def _schema(given: argparse.Namespace) -> int:
    from ._commands import show_schema

    del given
    return show_schema()


def _verify(given: argparse.Namespace) -> int:
    from ._commands import verify

    settle()
    return verify(given.precision, given.device, given.json)

"""What each command does with its arguments.

The commands are imported within the functions, because they import what computes, which takes a
while: `--help` and bad options do not wait for it. Settings of jax come before the first array,
which fixes them.
"""

import argparse

from ._settings import settle


def run(given: argparse.Namespace) -> int:
    from . import _commands

    settle()
    return _commands.run(given.file, given.out)


def disperse(given: argparse.Namespace) -> int:
    from . import _commands

    settle()
    return _commands.disperse(given.file, given.runs, given.seed, given.chunk, given.out)


def explain(given: argparse.Namespace) -> int:
    from . import _commands

    settle()
    return _commands.explain(given.file)


def cost(given: argparse.Namespace) -> int:
    from . import _commands

    settle()
    return _commands.cost(given.file, given.error, given.gradient, given.out)


def budget(given: argparse.Namespace) -> int:
    from . import _commands

    settle()
    return _commands.budget(given.file, given.output, given.tolerance, given.out)


def show_list(given: argparse.Namespace) -> int:
    from . import _commands

    del given
    return _commands.show_list()


def show_schema(given: argparse.Namespace) -> int:
    from . import _commands

    del given
    return _commands.show_schema()


def verify(given: argparse.Namespace) -> int:
    from . import _commands

    settle()
    return _commands.verify(given.precision, given.device, given.json)

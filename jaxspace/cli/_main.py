"""The commands: examples, new, run, disperse, resume, replay, failures, report, explain, cost,
budget, optimize, list, schema, verify."""

import argparse
import gc
import sys
from collections.abc import Callable, Sequence

from ._parser import parser, with_joined_runs
from ._stopping import STOPPED, clear_interruption


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit status: 0, 1 for runs that failed, 2 for input that
    cannot be used, 130 for a command that was stopped."""
    words = sys.argv[1:] if arguments is None else arguments
    given = parser().parse_args(with_joined_runs(words))
    try:
        # Imports JAX, for which `--help` and a wrong option must not wait.
        carry_out = _imported()
    except KeyboardInterrupt:
        clear_interruption()
        print("jaxspace: stopped.", file=sys.stderr)
        return STOPPED
    return carry_out(given)


def _imported() -> Callable[[argparse.Namespace], int]:
    """`carry_out`."""
    collects = gc.isenabled()
    gc.disable()
    try:
        from ._carry_out import carry_out
    finally:
        # What is imported stays: to search it for what may go takes a twelfth of the imports.
        if not gc.get_freeze_count():
            gc.freeze()
        if collects:
            gc.enable()
    return carry_out

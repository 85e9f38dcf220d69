"""The commands: examples, new, run, disperse, resume, replay, failures, report, diff, compare,
archive, map, explain, cost, budget, optimize, list, schema, programs, verify."""

import argparse
import gc
import sys
from collections.abc import Callable, Sequence

from ._parser import parser, with_joined_runs
from ._stopping import STOPPED, clear_interruption, ignore_signals, stopped_afterwards


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit status: 0, 1 for runs that failed, 2 for input that
    cannot be used, 130 for a command that was stopped."""
    words = sys.argv[1:] if arguments is None else arguments
    given = parser().parse_args(with_joined_runs(words))
    try:
        # Imports JAX, for which `--help` and a wrong option must not wait.
        with stopped_afterwards() as came:
            carry_out = _imported()
        if came:
            raise KeyboardInterrupt
        return carry_out(given)
    except KeyboardInterrupt:
        clear_interruption()
        print("jaxspace: stopped.", file=sys.stderr)
        return STOPPED
    finally:
        # The program ends: an impatient Ctrl-C would print where Python was at that.
        if arguments is None:
            ignore_signals()


def _imported() -> Callable[[argparse.Namespace], int]:
    """`carry_out`."""
    collects = gc.isenabled()
    gc.disable()
    try:
        from ._carry_out import carry_out
    finally:
        # Imported objects are permanent: searching them for garbage takes a twelfth of the import
        # time.
        if not gc.get_freeze_count():
            gc.freeze()
        if collects:
            gc.enable()
    return carry_out

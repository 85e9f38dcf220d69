"""The commands: examples, new, run, disperse, resume, replay, failures, report, explain, cost,
budget, optimize, list, schema, verify."""

import sys
from collections.abc import Sequence

from ._parser import parser
from ._stopping import STOPPED, clear_interruption


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit status: 0, 1 for runs that failed, 2 for input that
    cannot be used, 130 for a command that was stopped."""
    given = parser().parse_args(arguments)
    try:
        # Imports JAX, for which `--help` and a wrong option must not wait.
        from ._carry_out import carry_out
    except KeyboardInterrupt:
        clear_interruption()
        print("jaxspace: stopped.", file=sys.stderr)
        return STOPPED
    return carry_out(given)

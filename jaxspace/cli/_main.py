"""The commands: run, disperse, resume, replay, failures, report, explain, cost, budget, optimize,
list, schema, verify."""

import os
import sys
from collections.abc import Sequence

from ..core import InputError, MissingExtra, extra
from ..io import SceneError
from ..simulation import SimulationError
from ._parser import parser
from ._stopping import Stopped, clear_interruption, is_stop, stopped_by_signals
from ._warning_lines import warnings_as_lines

BAD_INPUT, BAD_RUN = 2, 1
# As a shell reports a command that SIGINT has ended.
STOPPED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit status: 0, 1 for runs that failed, 2 for input that
    cannot be used, 130 for a command that was stopped."""
    given = parser().parse_args(arguments)
    file = getattr(given, "file", "jaxspace")
    try:
        with stopped_by_signals(), extra("app"), warnings_as_lines():
            status = given.command(given)
        # Here and not at exit, so that a closed pipe is met inside the `try`.
        sys.stdout.flush()
        return status
    except (KeyboardInterrupt, Stopped) as error:
        clear_interruption()
        print(f"{file}: {str(error) or 'stopped.'}", file=sys.stderr)
        return STOPPED
    except (SceneError, InputError) as error:
        # The sentences about scene files and stores begin with the file.
        named = isinstance(error, SceneError) or str(error).startswith(f"{file} ")
        print(str(error) if named else f"{file}: {error}", file=sys.stderr)
        return BAD_INPUT
    except MissingExtra as error:
        print(f"{file}: {error}", file=sys.stderr)
        return BAD_INPUT
    except SimulationError as error:
        print(f"{file}: {error}", file=sys.stderr)
        return BAD_RUN
    except RuntimeError as error:
        if not is_stop(error):
            raise
        clear_interruption()
        print(f"{file}: stopped.", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:
        # Whoever read the output has stopped. Python would fail once more when it flushes it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"{file}: the output was closed before its end.", file=sys.stderr)
        return BAD_RUN
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"{where}cannot be written or read: {error.strerror}.", file=sys.stderr)
        return BAD_INPUT

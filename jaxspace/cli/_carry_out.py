"""A command whose arguments are parsed, from its start to its exit status. Imports JAX."""

import argparse
import os
import sys

from ..core import InputError, MissingExtra
from ..core.extras import extra
from ..io import SceneError
from ..simulation import SimulationError
from ._stopping import STOPPED, Stopped, clear_interruption, is_stop, stopped_by_signals
from ._warning_lines import warnings_as_lines

BAD_INPUT, BAD_RUN = 2, 1


def carry_out(given: argparse.Namespace) -> int:
    """Carry out the command of these arguments and return its exit status, as `main` does."""
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
        # Whoever read the output has stopped. Python would fail again when it flushes it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"{file}: the output was closed before its end.", file=sys.stderr)
        return BAD_RUN
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"{where}cannot be written or read: {error.strerror}.", file=sys.stderr)
        return BAD_INPUT

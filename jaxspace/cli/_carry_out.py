"""A command whose arguments are parsed, from its start to its exit status. Imports JAX."""

import argparse
import sys

from ..core import InputError, MissingExtra
from ..core.extras import extra
from ..io import SceneError
from ..simulation import SimulationError
from ._output import drop_output, say
from ._stopping import STOPPED, Stopped, clear_interruption, is_stop, stopped_by_signals
from ._warning_lines import warnings_as_lines

BAD_INPUT, BAD_RUN = 2, 1


def carry_out(given: argparse.Namespace) -> int:
    """Carry out the command of these arguments and return its exit status, as `main` does."""
    # Around the sentences too, which a second signal must not interrupt.
    with stopped_by_signals():
        return _status(given, getattr(given, "file", "jaxspace"))


def _status(given: argparse.Namespace, file: str) -> int:
    try:
        with extra("app"), warnings_as_lines():
            status = given.command(given)
        # Here and not at exit, so that a closed pipe is met inside the `try`.
        sys.stdout.flush()
        return status
    except (KeyboardInterrupt, Stopped) as error:
        clear_interruption()
        say(f"{file}: {str(error) or 'stopped.'}")
        return STOPPED
    except (SceneError, InputError) as error:
        # The sentences about scene files and stores begin with the file.
        named = isinstance(error, SceneError) or str(error).startswith(f"{file} ")
        say(str(error) if named else f"{file}: {error}")
        return BAD_INPUT
    except MissingExtra as error:
        say(f"{file}: {error}")
        return BAD_INPUT
    except SimulationError as error:
        say(f"{file}: {error}")
        return BAD_RUN
    except RuntimeError as error:
        if not is_stop(error):
            raise
        clear_interruption()
        say(f"{file}: stopped.")
        return STOPPED
    except BrokenPipeError:
        # Whoever read the output has stopped.
        drop_output()
        say(f"{file}: the output was closed prematurely.")
        return BAD_RUN
    except OSError as error:
        drop_output()
        where = f"{error.filename}: " if error.filename else ""
        say(f"{where}cannot be written or read: {error.strerror or error}.")
        return BAD_INPUT

"""`python -m jaxspace.cli`."""

import sys

try:
    from ._main import main

    status = main()
except KeyboardInterrupt:
    # While the library was imported, or between two of its commands.
    print("jaxspace: stopped.", file=sys.stderr)
    status = 130
    # As `_stopping.clear_interruption`, which may not have been imported.
    exec("")
sys.exit(status)

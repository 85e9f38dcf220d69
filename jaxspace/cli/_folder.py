"""The folder for results."""

import os

from ..core import InputError


def make_folder(name: str) -> None:
    """Make the folder for results. Raises `InputError` where nothing can be written."""
    try:
        os.makedirs(name, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out is {name}: it cannot be made a folder: {error.strerror}."
        ) from error
    # Checked before the run, so that hours of computing do not end in a refused write.
    if not os.access(name, os.W_OK | os.X_OK):
        raise InputError(f"--out is {name}: it must be a folder in which files may be written.")

"""Replacement of an old store by a new one as a whole.

It is prepared in the folder `STAGED` of its path, where nobody reads it. When it has its first
chunk, this folder is renamed to `READY`: from this moment on, and not before, readers see the new
store, there. Then the old one is removed, the new one is put in its place, and `READY` goes.
However a process ends, the store remains consistent: the next writer completes a pending
replacement. A campaign that cannot begin leaves the old store as it was.
"""

import contextlib
import json
import os
import shutil
from pathlib import Path

from ..core.file_names import file_name_fault
from ._errors import StoreError
from ._head import COPY, HEAD, UNREADABLE, read_head

STAGED, READY = ".jaxspace-staged", ".jaxspace-ready"
MANIFEST = os.path.dirname(COPY)


def folder_of(path: Path) -> Path:
    """The folder with the files of the store at `path`."""
    ready = path / READY
    return ready if os.path.isfile(ready / HEAD) and not os.path.islink(ready) else path


def publish(path: Path) -> None:
    """Put the staged store in place of the one at `path`, if there is one."""
    os.replace(path / STAGED, path / READY)
    tidy(path)


def tidy(path: Path) -> None:
    """Complete a replacement that was interrupted, and remove a store that was staged in vain.

    Each step can be repeated, and leaves the whole new store in `READY` until it is in place."""
    ready = path / READY
    if folder_of(path) == ready:
        names = array_names(ready)
        remove_store(path, {*array_names(path), *names})
        for name in (*names, MANIFEST):
            shutil.copytree(
                ready / name, path / name, copy_function=_linked_or_copied, dirs_exist_ok=True
            )
        _linked_or_copied(ready / HEAD, path / HEAD)
        (ready / HEAD).unlink()
    for folder in (ready, path / STAGED):
        if folder.is_dir():
            shutil.rmtree(folder)


def array_names(folder: Path) -> list[str]:
    """The names of the arrays of a store of any format, from its head; none without a head."""
    try:
        found = json.loads(read_head(folder)[0])["consolidated_metadata"]["metadata"]
    except (*UNREADABLE, StoreError, LookupError, TypeError):
        return []
    # Names that are paths are not arrays of a store, and may point outside of it.
    return [name for name in found if not file_name_fault(name)] if isinstance(found, dict) else []


def remove_store(path: Path, names: set[str]) -> None:
    """Remove the arrays with these names, then the head, from which a repetition reads the names;
    and nothing else, because anything else is the user's."""
    for name in names:
        if (path / name).is_dir():
            (path / name / HEAD).unlink(missing_ok=True)
            _remove_folder(path / name / "c")
            with contextlib.suppress(OSError):
                (path / name).rmdir()
    (path / HEAD).unlink(missing_ok=True)
    _remove_folder(path / MANIFEST)


def size_of(path: Path, names: list[str]) -> int:
    """Bytes of the arrays of a store with these names."""
    files = (file for name in names for file in (path / name).rglob("*"))
    return sum(file.lstat().st_size for file in files)


def _remove_folder(folder: Path) -> None:
    if folder.is_dir():
        shutil.rmtree(folder)


def _linked_or_copied(source: str | Path, target: str | Path) -> None:
    """A hard link to the file, or a copy where the file system does not support them."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)

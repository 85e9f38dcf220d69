"""Files of a store, which may come from anybody: none is reached through a link, and none is
written in part.

A link in a store could lead a write, or a read, to any other file of the user. So only regular
files are opened, and the folders of a store are searched for links before anything is written.
"""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from ._errors import StoreError

UNFINISHED = ".unfinished-"
# Neither of them exists on every system.
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)


def read_plain(path: Path, top: Path) -> bytes:
    """The bytes of a regular file in the store `top`, or in one of its folders.

    **Raises** `OSError` also for a file behind a link, and for a pipe or a device, which may be
    endless."""
    check_plain(path)
    inside = os.path.relpath(path, top)
    if os.path.realpath(path) != os.path.join(os.path.realpath(top), inside):
        raise OSError(errno.EINVAL, f"{inside} is behind a symbolic link", str(path))
    handle = os.open(path, os.O_RDONLY | _NO_LINK | _NO_WAIT)
    with open(handle, "rb") as file:
        return file.read()


def check_plain(path: Path) -> None:
    """Raise `OSError` for an existing path that is not a regular file."""
    mode = os.lstat(path).st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        kind = "symbolic link" if stat.S_ISLNK(mode) else "pipe or device"
        raise OSError(errno.EINVAL, f"{path.name} is a {kind}", str(path))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is never there in part.

    It is not flushed to the disk: the checksums reveal damage after a loss of power."""
    # In the same folder: only within one file system a rename is atomic.
    temporary = path.with_name(f"{UNFINISHED}{os.getpid()}-{path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        # One of an earlier process with the same number.
        temporary.unlink(missing_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_LINK
        with open(os.open(temporary, flags, 0o666), "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def check_without_links(top: Path) -> list[Path]:
    """The files in the folder of a store that a process left unfinished.

    **Raises** `StoreError` for anything but regular files and folders."""
    unfinished = []
    for entry in _entries(top):
        plain = entry.is_dir(follow_symlinks=False) or entry.is_file(follow_symlinks=False)
        # Junctions of Windows lead elsewhere, too.
        if not plain or getattr(entry, "is_junction", lambda: False)():
            kind = "a symbolic link" if entry.is_symlink() else "neither a file nor a folder"
            name = os.path.relpath(entry.path, top)
            raise StoreError(
                f"{top} cannot be written: {name!r} in it is {kind}, and a store has regular files "
                f"and folders only. Remove it, or choose another folder."
            )
        if entry.name.startswith(UNFINISHED) and entry.is_file(follow_symlinks=False):
            unfinished.append(Path(entry.path))
    return unfinished


def _entries(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Everything in a folder and in its folders."""
    # A list in place of recursion: a store may come with folders of any depth.
    waiting = [str(folder)]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                # Before it is entered, so that the caller can reject a folder that is a link.
                yield entry
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(entry.path)

"""The locks of a store: one writer at a time, with its name for the others; or several tasks, each
of which writes its part of the chunks."""

import contextlib
import errno
import json
import os
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..core.text import is_printable
from ._errors import StoreError
from ._files import check_plain
from ._head import is_store

NAME = ".lock"
# Held by one of several tasks at a time, for what concerns the whole store.
TURN = ".turn"
# Held by a task for its part.
PART = re.compile(r"\.part-[1-9][0-9]*-of-[1-9][0-9]*")
# Longest time that a lock may be held without a name, s; then its owner counts as unknown.
PATIENCE = 1.0


class Owner(NamedTuple):
    """The process that holds a lock, and since when."""

    pid: int
    host: str
    since: str

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}"


def is_lock(name: str) -> bool:
    """Whether a file of a store with this name is one of its locks."""
    return name in (NAME, TURN) or PART.fullmatch(name) is not None


class Lock:
    """Held from `acquire`, or `share`, to `release`; the system releases it when its process dies,
    however that dies, so that no lock outlives its owner on the same machine.

    - `stale`: a message about a lock whose owner is gone; empty otherwise.
    - `created`: whether there was no file before."""

    def __init__(self, folder: Path, name: str = NAME):
        self.path = folder / name
        self.handle: int | None = None
        self.stale = ""
        self.created = False

    def acquire(self) -> None:
        """Take the lock.

        **Raises** `StoreError`, which names the owner, if another process holds it, and `OSError`
        where the file cannot be opened or written, or is not a separate regular file."""
        while self.handle is None:
            handle, self.created = _open(self.path)
            locked = False
            try:
                owner = self._wait(handle)
                locked = True
                # Its last owner may have removed it while this process waited.
                if _is_at(handle, self.path):
                    self._write_name(handle, owner)
                    self.handle = handle
            finally:
                if self.handle is None:
                    # As on a full disk, or by Ctrl-C: who has it open takes another one then.
                    if self.created and locked:
                        self.path.unlink(missing_ok=True)
                    os.close(handle)

    def share(self) -> None:
        """Take the lock together with other processes that share it. It has no owner.

        **Raises** as `acquire` does, if a process holds it that does not share it."""
        while self.handle is None:
            handle, self.created = _open(self.path)
            try:
                owner = _owner(handle)
                if not _lock(handle, shared=True):
                    host = socket.gethostname()
                    raise StoreError(
                        f"{self.path.parent} is in use{_named(owner)}{_advice(owner, host)}"
                    )
                # Another task may have removed it meanwhile, with a folder without runs.
                if _is_at(handle, self.path):
                    self.handle = handle
            finally:
                if self.handle is None:
                    os.close(handle)

    def _wait(self, handle: int) -> Owner | None:
        """Lock the file, and return the owner that it names: one that is gone."""
        free = _lock(handle)
        owner = _owner(handle)
        end = time.monotonic() + PATIENCE
        # The owner writes its name after taking the lock, and removes it before releasing it.
        while not free and not owner and time.monotonic() < end:
            time.sleep(0.01)
            free = _lock(handle)
            owner = _owner(handle)
        host = socket.gethostname()
        # Some network file systems do not share locks between machines: then the name decides.
        if not free or (owner and owner.host != host):
            raise StoreError(f"{self.path.parent} is in use{_named(owner)}{_advice(owner, host)}")
        return owner

    def _write_name(self, handle: int, before: Owner | None) -> None:
        if before:
            self.stale = f"The {before} ended without releasing the store."
        now = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        text = json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "since": now})
        # Emptied first, because the name of an earlier owner may be longer.
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
        os.write(handle, text.encode())

    def release(self, remove: bool = False) -> None:
        """Empty the file and release the lock. `remove`: whether the file goes, too."""
        if self.handle is not None:
            try:
                os.ftruncate(self.handle, 0)
                if remove:
                    # Windows removes no file that is open: there it stays.
                    with contextlib.suppress(OSError):
                        self.path.unlink()
            finally:
                handle, self.handle = self.handle, None
                os.close(handle)


@contextlib.contextmanager
def turn(folder: Path) -> Iterator[None]:
    """Wait until no other task is in this context for the same store."""
    mine = False
    while not mine:
        handle, _ = _open(folder / TURN)
        try:
            while not _lock(handle):
                time.sleep(0.05)
            # The last task of a folder without runs removes the file.
            mine = _is_at(handle, folder / TURN)
            if mine:
                yield
        finally:
            os.close(handle)


def _open(path: Path) -> tuple[int, bool]:
    """The file of a lock, opened for writing, and whether it is new.

    Never that of a link, which may lead anywhere, nor one with another content: it would be
    emptied."""
    flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    try:
        return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o644), True
    except FileExistsError:
        check_plain(path)
    handle = os.open(path, flags)
    fault = ""
    if os.fstat(handle).st_nlink > 1:
        fault = f"{path.name} is a hard link to another file"
    elif os.fstat(handle).st_size and not _owner(handle) and not is_store(path.parent):
        fault = f"{path.name} is not the lock of a store"
    if fault:
        os.close(handle)
        raise OSError(errno.EINVAL, fault, str(path))
    return handle, False


def _is_at(handle: int, path: Path) -> bool:
    """Whether the open file is still the one with this path."""
    try:
        return os.path.samestat(os.fstat(handle), os.lstat(path))
    except FileNotFoundError:
        return False


def _lock(handle: int, shared: bool = False) -> bool:
    """Whether the file could be locked, by this process alone or together with others."""
    try:
        import fcntl
    # On Windows.
    except ImportError:
        import msvcrt

        # Windows has no shared locks: there nothing keeps other writers away.
        if shared:
            return True
        try:
            # Far behind the text, because Windows does not let others read the locked part.
            os.lseek(handle, 2**20, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
            return True
        except OSError:
            return False
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        return True
    except BlockingIOError:
        return False


def _owner(handle: int) -> Owner | None:
    """The owner that the file names; `None` without one."""
    os.lseek(handle, 0, os.SEEK_SET)
    try:
        found = json.loads(os.read(handle, 4096))
        owner = Owner(found["pid"], found["host"], found["since"])
    # Empty, of a machine that lost its power while it was written, or of another content.
    except (ValueError, TypeError, LookupError, RecursionError):
        return None
    texts = all(isinstance(x, str) and is_printable(x) for x in owner[1:])
    return owner if texts and type(owner.pid) is int else None


def _named(owner: Owner | None) -> str:
    return f" by {owner} since {owner.since}" if owner else " by another process"


def _advice(owner: Owner | None, host: str) -> str:
    if owner and owner.host != host:
        return f". If that has ended, remove {NAME} in the store and try again."
    return ": wait until it has ended, or stop it."

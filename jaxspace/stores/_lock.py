"""The lock of a store: one writer at a time, with its name for the others."""

import json
import os
import socket
import time
from pathlib import Path

from ..core import InputError

NAME = ".lock"
# Longest time that a lock may be held without a name, s; then its owner counts as unknown.
PATIENCE = 1.0


class StoreError(InputError):
    """A store that refuses a request, or cannot be read or written; the message says why, and what
    to do."""


class Lock:
    """Held from `acquire` to `release`; the system releases it when its process dies, however that
    dies, so that no lock outlives its owner on the same machine.

    `stale`: a sentence about a lock whose owner is gone; empty otherwise."""

    def __init__(self, folder: Path):
        self.path = folder / NAME
        self.handle: int | None = None
        self.stale = ""

    def acquire(self) -> None:
        """Take the lock. Raises `StoreError`, which names the owner, if another process holds
        it."""
        handle = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
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
        if not free or (owner and owner["host"] != host):
            os.close(handle)
            raise StoreError(f"{self.path.parent} is in use{_named(owner)}{_advice(owner, host)}")
        if owner:
            self.stale = f"The {_process(owner)} ended without releasing the store."
        now = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        text = json.dumps({"pid": os.getpid(), "host": host, "since": now})
        # Emptied first, because the name of an earlier owner may be longer.
        os.ftruncate(handle, 0)
        os.pwrite(handle, text.encode(), 0)
        self.handle = handle

    def release(self) -> None:
        """Empty the file and release the lock. The file stays, because a waiting process has it
        open."""
        if self.handle is not None:
            os.ftruncate(self.handle, 0)
            os.close(self.handle)
            self.handle = None


def _lock(handle: int) -> bool:
    """Whether the file could be locked."""
    try:
        import fcntl
    # On Windows.
    except ImportError:
        import msvcrt

        try:
            # Far behind the text, because Windows does not let others read the locked part.
            os.lseek(handle, 2**20, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
            return True
        except OSError:
            return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    except BlockingIOError:
        return False


def _owner(handle: int) -> dict[str, str | int]:
    """Name of the owner in the file; empty without one."""
    try:
        os.lseek(handle, 0, os.SEEK_SET)
        return json.loads(os.read(handle, 4096))
    # Empty, or of a machine that lost its power while it was written.
    except ValueError:
        return {}


def _named(owner: dict[str, str | int]) -> str:
    if not owner:
        return " by another process"
    return f" by {_process(owner)} since {owner['since']}"


def _process(owner: dict[str, str | int]) -> str:
    return f"process {owner['pid']} on {owner['host']}"


def _advice(owner: dict[str, str | int], host: str) -> str:
    if owner and owner["host"] != host:
        return f". If that has ended, remove {NAME} in the store and try again."
    return ": wait for its end, or end it."

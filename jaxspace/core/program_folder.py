"""A folder of stored programs, which processes share.

Loading a program runs code. So the folder must belong to the user, and nobody else may write to it;
each file is checked in the same way, and against its digest, before its content is used.
"""

import hashlib
import os
import platform
import re
import stat
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple, final

# Of the form of the files: another one is not read.
_HEAD = b"jaxspace program 1\n"
_DIGEST = 32
_SUFFIX = ".program"
_PARTIAL = ".partial"
# Seconds after which a file that was not completed has no process any more.
_ABANDONED = 3600.0
# Part of the limit that remains after programs were removed, so that not every program removes one.
_KEPT_PART = 0.9
_OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


class StoredFile(NamedTuple):
    """A stored program in a folder.

    - `path`: of its file.
    - `size`: of its file, in bytes.
    - `used`: the time of its last use, s since the epoch."""

    path: Path
    size: int
    used: float

    @property
    def function(self) -> str:
        """The name of its function."""
        return self.path.name.rpartition("-")[0]

    @property
    def machine(self) -> str:
        """The type of processor and the version of jaxlib."""
        return self.path.parent.name


@final
class ProgramFolder:
    """The stored programs for the processor and the jaxlib of this process.

    - `root`: the folder for all processors.
    - `limit`: the greatest size of all programs in it, in bytes; those that were not used for the
      longest time are removed."""

    def __init__(self, root: Path, limit: int):
        self.root, self.limit = root, limit
        self.folder = root / machine_type()
        # After an error of the file system nothing is stored by this process.
        self.writes = limit > 0

    def read(self, name: str) -> bytes | None:
        """The content of a program; `None` without one, and for a file that is damaged or belongs
        to another user, with a warning."""
        path = self.folder / (name + _SUFFIX)
        try:
            if not _is_private(os.lstat(self.folder)):
                return self._ignored(f"{self.folder} may be written by other users")
            # A link may lead to a file of another user.
            handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
            with open(handle, "rb") as file:
                if not _is_private(os.fstat(handle)):
                    return self._ignored(f"{path} may be written by other users")
                content = file.read()
        except FileNotFoundError:
            return None
        except OSError as error:
            return self._ignored(f"{path}: {error.strerror}")
        start = len(_HEAD) + _DIGEST
        if not content.startswith(_HEAD) or _digest(content[start:]) != content[start - 32 : start]:
            self.discard(name, "its content is incomplete or of another release")
            return None
        try:
            os.utime(path)
        # Removed in the meantime, or a folder that may only be read.
        except OSError:
            pass
        return content[start:]

    def write(self, name: str, content: bytes) -> None:
        """Store the content of a program, if there is space; with a warning if it fails."""
        if not self.writes or len(content) > _KEPT_PART * self.limit:
            return
        partial = None
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _is_private(os.lstat(self.folder)):
                self._ignored(f"{self.folder} may be written by other users")
                return
            # Under another name, because other processes may read it at any moment.
            handle, partial = tempfile.mkstemp(_PARTIAL, dir=self.folder)
            with open(handle, "wb") as file:
                file.write(_HEAD + _digest(content) + content)
            os.replace(partial, self.folder / (name + _SUFFIX))
        except OSError as error:
            self._ignored(f"{self.folder}: {error.strerror}")
            if partial is not None:
                _remove(Path(partial))
            return
        self._make_space()

    def discard(self, name: str, reason: object) -> None:
        """Remove a program that cannot be loaded."""
        path = self.folder / (name + _SUFFIX)
        warnings.warn(f"The stored program {path} is compiled again: {_line(reason)}", stacklevel=2)
        _remove(path)

    def _ignored(self, reason: str) -> None:
        """Warn once that programs are not stored by this process."""
        if self.writes:
            warnings.warn(f"Compiled programs are not stored: {_line(reason)}", stacklevel=3)
        self.writes = False

    def _make_space(self) -> None:
        """Remove the programs that were not used for the longest time, beyond the limit."""
        files = stored_files(self.root)
        size = sum(file.size for file in files)
        if size <= self.limit:
            return
        for file in sorted(files, key=lambda file: file.used):
            if size <= _KEPT_PART * self.limit:
                return
            _remove(file.path)
            size -= file.size


def stored_files(root: Path) -> list[StoredFile]:
    """The stored programs in a folder, of all processors."""
    return [
        StoredFile(path, status.st_size, status.st_mtime)
        for path, status in _files(root)
        if path.suffix == _SUFFIX
    ]


def clear(root: Path) -> int:
    """Remove all stored programs in a folder, of all processors, and return their number."""
    files = list(_files(root))
    now = time.time()
    for path, status in files:
        if path.suffix == _SUFFIX or now - status.st_mtime > _ABANDONED:
            _remove(path)
    return sum(path.suffix == _SUFFIX for path, _ in files)


def _files(root: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """The files of stored programs, complete or not."""
    for path in root.glob("*/*"):
        try:
            status = path.lstat()
        # Removed in the meantime.
        except OSError:
            continue
        if path.suffix in (_SUFFIX, _PARTIAL) and stat.S_ISREG(status.st_mode):
            yield path, status


def machine_type() -> str:
    """The type of this processor with all of its features, and the version of jaxlib, as a name of
    a folder."""
    name, features = _processor()
    digest = hashlib.blake2b(f"{name}\n{features}".encode(), digest_size=4).hexdigest()
    words = re.sub(r"[^A-Za-z0-9]+", "_", f"{platform.machine()} {name}").strip("_")[:60]
    return f"{words}-{digest}-jaxlib-{version('jaxlib')}"


def _processor() -> tuple[str, str]:
    """The name of the processor and its features."""
    if sys.platform == "darwin":
        names = ["machdep.cpu", "hw.optional"]
        told = subprocess.run(["/usr/sbin/sysctl", *names], capture_output=True, text=True)
        name = re.search(r"brand_string: (.*)", told.stdout)
        return (name[1] if name else platform.processor()), told.stdout
    try:
        text = Path("/proc/cpuinfo").read_text(errors="replace")
    except OSError:
        return platform.processor(), platform.platform()
    lines = dict(re.findall(r"^(.*?)\s*: (.*)$", text, re.MULTILINE))
    rows = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features")
    parts = ("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision")
    told = "\n".join(f"{row}: {lines.get(row)}" for row in (*rows, *parts))
    return lines.get("model name", ""), told


def can_store() -> bool:
    """Whether the system tells to whom a file belongs."""
    return hasattr(os, "getuid")


def _is_private(status: os.stat_result) -> bool:
    return status.st_uid == os.getuid() and not status.st_mode & _OTHERS_MAY_WRITE


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST).digest()


def _line(reason: object) -> str:
    return (str(reason).splitlines() or [type(reason).__name__])[0]


def _remove(path: Path) -> None:
    try:
        path.unlink()
    # Removed by another process, or not ours to remove: it stays.
    except OSError:
        pass

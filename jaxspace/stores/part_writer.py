"""Writing a store by several tasks that know nothing of each other, such as those of an array job:
each of them computes its part of the chunks.

All of them share the lock of the store, so that no other process replaces or resumes it meanwhile.
What concerns the whole store, its creation and its completion, one of them does at a time. The
chunks of different parts are different files.
"""

import contextlib
import os
from collections.abc import Mapping, Sequence

from ..core.record import Record
from ._errors import StoreError
from ._files import check_without_links
from ._head import is_store
from ._lock import NAME, TURN, Lock, turn
from ._replacement import folder_of, tidy
from .columns import Column
from .store import Store
from .writer import ATTEMPTS, StoreWriter


class PartWriter(StoreWriter):
    """A store that is open for writing one part of its chunks; a context manager.

    **Arguments**

    - `path`: of the store, which is created by the first task, and joined by the others.
    - `part`, `parts`: the number of the part, from 1, and that of all parts.

    **Raises** `StoreError` before anything is computed: where another process computes the same
    part, or writes the whole store, and for a folder that cannot be written or contains something
    else."""

    def __init__(self, path: str | os.PathLike[str], part: int, parts: int):
        super().__init__(path)
        self.part, self.parts = part, parts
        self._part_lock = Lock(self.store.path, f".part-{part}-of-{parts}")

    def _lock(self) -> None:
        for attempt in range(ATTEMPTS):
            try:
                self.store.path.mkdir(parents=True, exist_ok=True)
                self._part_lock.acquire()
                break
            except StoreError as error:
                raise StoreError(f"Part {self.part} of {self.parts} of {error}") from None
            # Another task has just removed the folder, which was empty.
            except FileNotFoundError:
                if attempt == ATTEMPTS - 1:
                    raise
        self.lock.share()

    def _leave(self) -> None:
        # The files of the other locks remain, because other tasks may wait for them.
        held = self.lock.handle is not None
        self._part_lock.release(remove=True)
        self.lock.release()
        path = self.store.path
        # Unless no task has stored anything: then no folder remains.
        if held and not is_store(folder_of(path)):
            with contextlib.suppress(OSError), turn(path):
                if {x.name for x in path.iterdir()} <= {NAME, TURN}:
                    (path / NAME).unlink()
                    (path / TURN).unlink()
                    path.rmdir()

    def __exit__(self, *_: object) -> None:
        self._leave()

    def _check_content(self) -> None:
        # Not while another task creates the store.
        with turn(self.store.path):
            if is_store(folder_of(self.store.path)):
                check_without_links(self.store.path)
            else:
                super()._check_content()

    def prepare(self, columns: Mapping[str, Column], attributes: Record) -> Store:
        """The store that another task has created, or a new one without chunks."""
        with turn(self.store.path):
            if is_store(folder_of(self.store.path)):
                self.published = True
                store = self.store.read()
                self.check_identity(attributes, columns)
                return store
            # That of a task which was killed in the meantime.
            tidy(self.store.path)
            super().prepare(columns, attributes)
            self.publish()
        return self.store

    def missing(self) -> tuple[list[int], list[str]]:
        """The chunks of this part that have to be computed, and messages about corrupted ones."""
        own = range(self.part - 1, self.store.count, self.parts)
        return self.missing_of(own)

    def note(self, **attributes: object) -> None:
        """Add to the attributes of the store, once it is complete."""
        with turn(self.store.path):
            if not unfinished_parts(self.store, self.parts):
                super().note(**attributes)


def unfinished_parts(store: Store, parts: int) -> Sequence[int]:
    """The numbers of those of so many parts of a store that lack a chunk."""
    missing = set(range(store.count)) - set(store.finished())
    return sorted({chunk % parts + 1 for chunk in missing})

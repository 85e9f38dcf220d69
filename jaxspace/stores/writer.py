"""Writing a store: its lock, its preparation, chunk after chunk."""

import contextlib
import hashlib
import json
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..core.extras import extra
from ..core.processors import cores
from ..core.record import Record, resuming
from ._errors import DamagedStore, StoreError
from ._files import check_without_links, write_whole
from ._head import COPY, HEAD, differs_in_runs, is_store, read_head, sealed
from ._identity import difference, mark_of
from ._lock import NAME, TURN, Lock, is_lock
from ._replacement import (
    READY,
    STAGED,
    array_names,
    folder_of,
    publish,
    size_of,
    tidy,
)
from .columns import Column, arrays_of, encoded
from .results import RunResults
from .store import ENOUGH, FORM, MANIFEST, NUMBER, Store

# Free space that is required beyond the estimate for the chunks.
SPARE = 2**22
# How often a lock is opened whose folder its last owner removes at the same moment.
ATTEMPTS = 100


class StoreWriter:
    """A store that is open for writing, under its lock; a context manager.

    **Arguments**

    - `path`: of the store.
    - `overwrite`: whether an existing store may be replaced: by the first chunk of the new one.
    - `resume`: whether an existing store is completed.

    `host` is which of several that compute at one time this process is; `None` without other hosts.

    **Raises** `StoreError` before anything is computed: for a folder that cannot be written, that
    contains something else, that another process writes, or that may not be replaced."""

    def __init__(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, resume: bool = False
    ):
        self.store = Store(path)
        self.overwrite = overwrite
        self.resume = resume and not overwrite
        self.lock = Lock(self.store.path)
        self.host: int | None = None
        # Whether the new store is at its path, and no longer staged.
        self.published = self.resume
        # The files that an earlier process left unfinished.
        self._unfinished: list[Path] = []
        # Whether the folder is there for this store alone.
        self._own_folder = False

    def __enter__(self) -> "StoreWriter":
        path = self.store.path
        if "\0" in str(path):
            raise StoreError(
                f"{str(path)!r} cannot be written: a path must not contain a null byte."
            )
        try:
            self._lock()
            self._check_content()
        except OSError as error:
            self._leave()
            raise StoreError(
                f"{path} cannot be written ({error.strerror}): it must be a writable folder."
            ) from error
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            if not self.published:
                with contextlib.suppress(OSError):
                    tidy(self.store.path)
        finally:
            self._leave()

    def _lock(self) -> None:
        """Take the lock, in a new folder where there is none."""
        path = self.store.path
        self._own_folder = not os.path.lexists(path)
        for attempt in range(ATTEMPTS):
            try:
                path.mkdir(parents=True, exist_ok=True)
                self.lock.acquire()
                return
            # Its last owner has just removed the folder, which was empty.
            except FileNotFoundError:
                if attempt == ATTEMPTS - 1:
                    raise

    def _leave(self) -> None:
        """Release the lock; without a store, leave the folder unchanged, or remove it if it was
        created for the store."""
        path = self.store.path
        if self.lock.handle is None:
            if self._own_folder:
                with contextlib.suppress(OSError):
                    path.rmdir()
            return
        remove = only_lock = False
        try:
            # The second one is left by tasks that have stored nothing.
            only_lock = {x.name for x in path.iterdir()} <= {NAME, TURN}
            remove = only_lock or self.lock.created and not is_store(folder_of(path))
        finally:
            with contextlib.suppress(OSError):
                self.lock.release(remove)
        if only_lock and (self._own_folder or not self.lock.created):
            # Rejected by the system if another process has created it.
            with contextlib.suppress(OSError):
                (path / TURN).unlink(missing_ok=True)
                path.rmdir()

    def _check_content(self) -> None:
        path = self.store.path
        if is_store(folder_of(path)):
            self._unfinished = check_without_links(path)
            tidy(path)
            if self.overwrite:
                return
            store = self.store.read()
            if not self.resume:
                done = sum(store.extent(k)[1] for k in store.finished())
                raise StoreError(
                    f"{path} already contains {done} of {store.runs} runs: resume it, overwrite "
                    "it, or choose another folder (`jaxspace resume`, `--overwrite`; in Python "
                    "`resume=True`, `overwrite=True`)."
                )
            return
        # Anything else belongs to the user.
        names = {x.name for x in path.iterdir()} - {STAGED, READY}
        others = sorted(name for name in names if not is_lock(name))
        if others and not self.overwrite and (path / HEAD).exists():
            self.store.read()
        if others:
            raise StoreError(
                f"{path} contains {others[0]!r} and is not the store of a dispersion: choose a new "
                f"folder."
            )
        check_without_links(path)
        tidy(path)
        if self.resume:
            raise StoreError(f"{path} contains no runs: there is nothing to resume.")

    def _mend_metadata(self) -> None:
        """Remove the files that an earlier process left unfinished, and write the metadata again
        where they differ from those of the campaign."""
        store = self.store
        root = json.loads(read_head(store.folder)[0])
        heads = root["consolidated_metadata"]["metadata"]
        # A process that was killed where a campaign ended, or was extended, has changed the head
        # and not yet all arrays: this is not corruption.
        others = [n for n in store.damaged_arrays if differs_in_runs(store.folder, n, heads[n])]
        for damage in store.metadata_damages(but_for=others):
            warnings.warn(f"{store.path}: {damage}", DamagedStore, stacklevel=2)
        with self._disk():
            for path in self._unfinished:
                path.unlink(missing_ok=True)
            if store.head_damage:
                self._write_head(root)
            for name in store.damaged_arrays:
                write_whole(store.folder / name / HEAD, json.dumps(heads[name]).encode())

    def _write_head(self, root: Record) -> None:
        """Write the copy of the head with its checksum, then the head."""
        head = json.dumps(root).encode()
        with self._disk():
            write_whole(self.store.folder / COPY, sealed(head))
            write_whole(self.store.folder / HEAD, head)
        self.store.attributes = json.loads(head)["attributes"]

    def prepare(self, columns: Mapping[str, Column], attributes: Record) -> Store:
        """The store for these arrays and attributes: the existing one, or a new one, which is
        staged until its first chunk is committed.

        **Raises** `StoreError` where the existing one is of another campaign, naming the
        difference, and where the disk has too little space."""
        if self.resume:
            return self.join(columns, attributes)
        store = self.store
        path = store.path
        replaced = array_names(path)
        for name in columns:
            if name not in replaced and os.path.lexists(path / name):
                raise StoreError(
                    f"{path} contains {name!r}, which does not belong to a store: choose a new "
                    "folder."
                )
        store.folder = path / STAGED
        store.attributes = {**attributes, "form": FORM}
        store.columns = dict(columns)
        self._check_space(store, size_of(path, replaced))
        with self._disk():
            files = _metadata(store)
            head = json.loads(files.pop(HEAD))
            for name, data in files.items():
                write_whole(store.folder / name, data)
        self._write_head(head)
        return store

    def publish(self) -> None:
        """Put the new store in place of the old one, if there is one."""
        with self._disk():
            publish(self.store.path)
        self.write_to_path()

    def write_to_path(self) -> None:
        """Write the following chunks to the path, where the new store has been published."""
        self.store.folder = self.store.path
        self.published = True

    def join(self, columns: Mapping[str, Column], attributes: Record) -> Store:
        """The store that is there already: the one that is completed, extended if more runs are
        planned than it has, or a new one that another process has staged.

        **Raises** `StoreError` if its runs have different results here, and for fewer runs than
        the store was planned for."""
        store = self.store.read(None if self.resume else self.store.path / STAGED)
        runs = int(attributes["planned_runs"])
        extends = (
            self.resume and runs > store.attributes["planned_runs"] and self.lock.handle is not None
        )
        if extends and ENOUGH in store.attributes:
            raise StoreError(
                f"{store.path} ended after {store.runs} runs by its stopping rule: it cannot be "
                f"extended to {runs} runs."
            )
        self.check_identity(attributes, columns, {"planned_runs": runs} if extends else {})
        # Nothing is repaired in a store of another campaign, nor by two processes.
        if self.lock.handle is not None:
            self._mend_metadata()
        if extends:
            self._extend(runs)
        return store

    def check_identity(
        self, attributes: Record, columns: Mapping[str, Column], changed: Record | None = None
    ) -> None:
        """Raise `StoreError` unless the store is that of the campaign with these attributes and
        columns; `changed`: attributes that the store is about to have."""
        there = self.store.attributes | (changed or {})
        other = difference(there, self.store.columns, attributes, columns)
        if other:
            raise StoreError(f"{self.store.path} is the store of another campaign: {other}")

    def _extend(self, runs: int) -> None:
        """Plan more runs: the arrays become longer, and the chunks that are there remain.

        A last chunk that was short is computed again. Its entry is removed first, so that the store
        is valid whenever this ends, and a repetition completes it."""
        store = self.store
        longer = Store(store.path)
        longer.attributes = {**store.attributes, "planned_runs": runs}
        longer.columns = store.columns
        self._check_space(longer, size_of(store.path, array_names(store.path)))
        last = store.count - 1
        if store.extent(last)[1] < store.chunk:
            with self._disk():
                (store.folder / MANIFEST / f"{last}.json").unlink(missing_ok=True)
        root = json.loads(read_head(store.folder)[0])
        root["attributes"]["planned_runs"] = runs
        self._write_runs(root, runs)

    def _write_runs(self, root: Record, runs: int) -> None:
        """Write the head, and then the metadata of each array, with this number of runs."""
        heads = root["consolidated_metadata"]["metadata"]
        for head in heads.values():
            head["shape"][0] = runs
        self._write_head(root)
        with self._disk():
            for name, head in heads.items():
                write_whole(self.store.folder / name / HEAD, json.dumps(head).encode())

    def _check_space(self, store: Store, freed: int) -> None:
        """Raise `StoreError` unless the disk has room for all chunks of a store; `freed`: bytes of
        them that are there, or of the store that is replaced."""
        needed = store.count * store.chunk * sum(c.bytes_of_run for c in store.columns.values())
        needed += SPARE
        free = shutil.disk_usage(store.path).free + freed
        if free < needed:
            raise StoreError(
                f"{store.path} needs {needed / 1e6:.0f} MB for {store.runs} runs, and its disk has "
                f"{free / 1e6:.0f} MB: free some space, or choose another folder."
            )

    def missing(self) -> tuple[list[int], list[str]]:
        """The chunks that have to be computed, and messages about corrupted ones among them."""
        return self.missing_of(range(self.store.count))

    def missing_of(self, chunks: Sequence[int]) -> tuple[list[int], list[str]]:
        """As `missing`, of these chunks."""
        store = self.store
        todo = []
        damages = []
        finished = set(store.finished())
        for chunk in chunks:
            damage = store.damage(chunk) if chunk in finished else ""
            if damage:
                damages.append(damage)
            if damage or chunk not in finished:
                todo.append(chunk)
        return todo, damages

    def commit(self, chunk: int, results: RunResults, seconds: float, cpu: float) -> None:
        """Write the runs of a chunk, and then its entry."""
        store = self.store
        first, count = store.extent(chunk)
        columns = arrays_of(results, np.arange(first, first + count))

        def write(name: str) -> tuple[int, str]:
            data = encoded(columns[name], store.columns[name], store.chunk)
            write_whole(store.file(name, chunk), data)
            return len(data), hashlib.sha256(data).hexdigest()

        with self._disk():
            manifest = store.folder / MANIFEST
            # Removed first, because an entry must not exist for files that are about to change.
            (manifest / f"{chunk}.json").unlink(missing_ok=True)
            # On all cores: the runs of the next chunk wait for this.
            with ThreadPoolExecutor(cores()) as pool:
                files = dict(zip(store.columns, pool.map(write, store.columns), strict=True))
            entry = {"first": first, "runs": count, "campaign": mark_of(store.attributes)}
            entry |= {"seconds": seconds, "cpu_seconds": cpu, "pid": os.getpid(), "files": files}
            if self.host is not None:
                entry["host"] = self.host
            # Last, because an entry means that all files exist.
            write_whole(manifest / f"{chunk}.json", json.dumps(entry).encode())
        # Several hosts publish it together, when none of them is writing (`stored`).
        if not self.published and self.host is None:
            self.publish()

    def end_at(self, chunks: int) -> None:
        """End the campaign with this number of chunks: the arrays are shortened, and later chunks
        removed.

        In this order, so that whenever this ends a repetition completes it."""
        store = self.store
        runs = min(chunks * store.chunk, int(store.attributes["planned_runs"]))
        root = json.loads(read_head(store.folder)[0])
        root["attributes"][ENOUGH] = runs
        self._write_runs(root, runs)
        with self._disk():
            for entry in (store.folder / MANIFEST).glob("*.json"):
                if NUMBER.fullmatch(entry.stem) and int(entry.stem) >= chunks:
                    entry.unlink()
                    for name in store.columns:
                        store.file(name, int(entry.stem)).unlink(missing_ok=True)

    def note(self, **attributes: object) -> None:
        """Add to the attributes of the store."""
        root = json.loads(read_head(self.store.folder)[0])
        root["attributes"] |= attributes
        self._write_head(root)

    @contextlib.contextmanager
    def _disk(self) -> Iterator[None]:
        """Convert a disk error into a `StoreError` that reports the stored results."""
        try:
            yield
        except OSError as error:
            where = f"{self.store.path} cannot be written ({error.strerror})"
            raise StoreError(f"{where}: {self._kept()}") from error

    def _kept(self) -> str:
        store = self.store
        if not self.published:
            old = is_store(folder_of(store.path))
            return "the store is unchanged." if old else "no run was finished, and none is stored."
        done = sum(store.extent(k)[1] for k in store.finished())
        return (
            f"{done} of {store.runs} runs are stored. Once the cause is fixed, "
            f"`{resuming(store.attributes, store.path)}` computes the rest."
        )


def _metadata(store: Store) -> dict[str, bytes]:
    """The files of metadata."""
    with extra("app"):
        import zarr
        from zarr.codecs import BytesCodec, Crc32cCodec
        from zarr.storage import MemoryStore

    files: dict[str, Any] = {}
    memory = MemoryStore(files)
    group = zarr.create_group(memory, attributes=store.attributes)
    for name, column in store.columns.items():
        group.create_array(
            name,
            shape=(store.runs, *column.shape),
            chunks=(store.chunk, *column.shape),
            dtype=column.dtype,
            fill_value=column.fill,
            serializer=BytesCodec(endian="little"),
            compressors=[Crc32cCodec()],
            dimension_names=column.dims,
            attributes=column.attributes,
        )
    with warnings.catch_warnings():
        # zarr warns that other readers of format 3 may not know these metadata: they need not.
        warnings.filterwarnings("ignore", "Consolidated metadata")
        zarr.consolidate_metadata(memory)
    return {name: data.to_bytes() for name, data in files.items()}

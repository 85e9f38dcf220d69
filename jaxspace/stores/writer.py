"""Writing a store: its lock, its preparation, chunk after chunk."""

import contextlib
import hashlib
import json
import os
import shlex
import shutil
import warnings
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..core.extras import extra
from ..core.processors import cores
from ..core.record import Record
from ._head import COPY, HEAD, is_longer, read_head, sealed
from ._identity import difference
from ._lock import NAME, Lock, StoreError
from .columns import Column, arrays_of, encoded
from .results import RunResults
from .store import ENOUGH, FORM, MANIFEST, DamagedStore, Store

UNFINISHED = ".unfinished-"
# Free space that is required beyond the estimate for the chunks.
SPARE = 2**22


class StoreWriter:
    """A store that is open for writing, under its lock; a context manager.

    **Arguments**

    - `path`: of the store.
    - `overwrite`: whether a store that is there may be replaced.
    - `resume`: whether a store that is there is completed.

    `host` is which of several that compute at one time this process is; `None` where it is alone.

    **Raises** `StoreError` before anything is computed: for a folder that cannot be written, that
    holds something else, that another process writes, or that may not be replaced."""

    def __init__(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, resume: bool = False
    ):
        self.store = Store(path)
        self.overwrite = overwrite
        self.resume = resume
        self.lock = Lock(self.store.path)
        self.host: int | None = None
        self.prepared = False

    def __enter__(self) -> "StoreWriter":
        path = self.store.path
        try:
            path.mkdir(parents=True, exist_ok=True)
            self.lock.acquire()
        except OSError as error:
            raise StoreError(
                f"{path} cannot be written ({error.strerror}): it must be a folder in which files "
                f"may be written."
            ) from error
        try:
            self._check_content()
        except BaseException:
            self.lock.release()
            raise
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        # What was prepared in vain would refuse the next command, though it holds nothing.
        if error is not None and self.prepared and not self.store.finished():
            with contextlib.suppress(OSError):
                self._clear()
        self.lock.release()

    def _check_content(self) -> None:
        path = self.store.path
        # Files of a process that was killed: under the lock no other process writes.
        for left in path.rglob(f"{UNFINISHED}*"):
            left.unlink()
        others = {x.name for x in path.iterdir()} - {NAME, MANIFEST}
        if HEAD not in others and not (path / COPY).is_file():
            # Folders of arrays without the head: a preparation that was interrupted.
            strange = [x for x in sorted(others) if not _is_begun(path / x)]
            if strange:
                raise StoreError(
                    f"{path} holds {strange[0]}, which is of no store: choose a new folder."
                )
            if self.resume:
                raise StoreError(f"{path} holds no runs: there is nothing to resume.")
            return
        if self.overwrite:
            return
        # Anything else belongs to the user, and is not replaced.
        store = self.store.read()
        if self.resume:
            self._mend_metadata()
        else:
            done = sum(store.extent(k)[1] for k in store.finished())
            raise StoreError(
                f"{path} holds {done} of {store.runs} runs already: resume it, overwrite it, or "
                f"choose another folder (`jaxspace resume`, `--overwrite`; in Python "
                f"`resume=True`, `overwrite=True`)."
            )

    def _mend_metadata(self) -> None:
        """Write the metadata again where they differ from those of the campaign."""
        store = self.store
        root = json.loads(read_head(store.path)[0])
        heads = root["consolidated_metadata"]["metadata"]
        # A process that was killed where a campaign ended has shortened the head and not yet all
        # arrays: that is no damage.
        unended = [n for n in store.damaged_arrays if is_longer(store.path, n, heads[n])]
        for damage in store.metadata_damages(but_for=unended):
            warnings.warn(f"{store.path}: {damage}", DamagedStore, stacklevel=2)
        if store.head_damage:
            self._write_head(root)
        for name in store.damaged_arrays:
            write_whole(store.path / name / HEAD, json.dumps(heads[name]).encode())

    def _write_head(self, root: Record) -> None:
        """Write the copy of the head with its checksum, then the head."""
        head = json.dumps(root).encode()
        with _disk(self.store):
            write_whole(self.store.path / COPY, sealed(head))
            write_whole(self.store.path / HEAD, head)
        self.store.attributes = root["attributes"]

    def prepare(self, columns: Mapping[str, Column], attributes: Record) -> Store:
        """The store for these arrays and attributes: made, or the one that is there.

        **Raises** `StoreError` where that is of another campaign, naming the difference, and where
        the disk has too little space."""
        if self.resume and not self.overwrite:
            return self.join(columns, attributes)
        store = self.store
        self._clear()
        self.prepared = True
        store.attributes = {**attributes, "form": FORM}
        store.columns = dict(columns)
        self._check_space()
        with _disk(store):
            files = _metadata(store)
            head = json.loads(files.pop(HEAD))
            for name, data in files.items():
                write_whole(store.path / name, data)
        # The head is written last, so that an interrupted preparation is not taken for a store.
        self._write_head(head)
        return store

    def join(self, columns: Mapping[str, Column], attributes: Record) -> Store:
        """The store that another process has prepared, and holds.

        **Raises** `StoreError` where its runs come out differently there."""
        store = self.store.read()
        other = difference(store, columns, attributes)
        if other:
            raise StoreError(f"{store.path} is the store of another campaign: {other}")
        return store

    def _clear(self) -> None:
        # The head first, so that an interrupted removal leaves no valid store behind.
        for name in (HEAD, COPY):
            (self.store.path / name).unlink(missing_ok=True)
        for entry in self.store.path.iterdir():
            if entry.is_dir():
                shutil.rmtree(entry)

    def _check_space(self) -> None:
        store = self.store
        each = sum(
            np.dtype(c.dtype).itemsize * int(np.prod(c.shape, dtype=int))
            for c in store.columns.values()
        )
        needed = store.count * store.chunk * each + SPARE
        free = shutil.disk_usage(store.path).free
        if free < needed:
            raise StoreError(
                f"{store.path} needs {needed / 1e6:.0f} MB for {store.runs} runs, and its disk has "
                f"{free / 1e6:.0f} MB: free some space, or choose another folder."
            )

    def missing(self) -> tuple[list[int], list[str]]:
        """The chunks that have to be computed, and what is wrong with those of them that had been
        finished, a sentence each."""
        store = self.store
        todo = []
        damages = []
        finished = set(store.finished())
        for chunk in range(store.count):
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

        with _disk(store):
            # Removed first, because an entry must not exist for files that are about to change.
            (store.path / MANIFEST / f"{chunk}.json").unlink(missing_ok=True)
            # On all cores: the runs of the next chunk wait for this.
            with ThreadPoolExecutor(cores()) as pool:
                files = dict(zip(store.columns, pool.map(write, store.columns), strict=True))
            entry = {"first": first, "runs": count, "seconds": seconds, "cpu_seconds": cpu}
            entry |= {"pid": os.getpid(), "files": files}
            if self.host is not None:
                entry["host"] = self.host
            # Last, because an entry says that all files are there.
            write_whole(store.path / MANIFEST / f"{chunk}.json", json.dumps(entry).encode())

    def end_at(self, chunks: int) -> None:
        """End the campaign with this number of chunks: the arrays are shortened, and later chunks
        removed.

        In this order, so that whenever this ends a repetition completes it."""
        store = self.store
        runs = min(chunks * store.chunk, int(store.attributes["planned_runs"]))
        root = json.loads(read_head(store.path)[0])
        heads = root["consolidated_metadata"]["metadata"]
        for head in heads.values():
            head["shape"][0] = runs
        root["attributes"][ENOUGH] = runs
        self._write_head(root)
        with _disk(store):
            for name, head in heads.items():
                write_whole(store.path / name / HEAD, json.dumps(head).encode())
            for entry in (store.path / MANIFEST).glob("*.json"):
                if entry.stem.isdecimal() and int(entry.stem) >= chunks:
                    entry.unlink()
                    for name in store.columns:
                        store.file(name, int(entry.stem)).unlink(missing_ok=True)

    def note(self, **attributes: object) -> None:
        """Add to the attributes of the store."""
        root = json.loads(read_head(self.store.path)[0])
        root["attributes"] |= attributes
        self._write_head(root)


def _is_begun(path: Path) -> bool:
    """Whether this is the folder of an array, or will be one."""
    return path.is_dir() and ((path / HEAD).is_file() or not any(path.iterdir()))


class _disk:
    """Turn an error of the disk into a `StoreError` that says which chunks are safe."""

    def __init__(self, store: Store):
        self.store = store

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, OSError):
            store = self.store
            done = sum(store.extent(k)[1] for k in store.finished())
            command = f"jaxspace resume {shlex.quote(str(store.path))}"
            raise StoreError(
                f"{store.path} cannot be written ({error.strerror}): {done} of {store.runs} runs "
                f"are kept. Once that is mended, `{command}` computes the rest."
            ) from error


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is never there in part.

    It is not flushed to the disk: the checksums show what a loss of power has damaged."""
    # In the same folder: only within one file system a rename is atomic.
    temporary = path.with_name(f"{UNFINISHED}{os.getpid()}-{path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


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

"""A Zarr store of a campaign: one array for each input and output, along `run`, in chunks.

All arrays have their full length from the start, and the metadata are written once: a chunk adds
files and changes none. It counts from the moment when its entry in `.manifest` appears, a file with
the size and the checksum of each of its files, put in place by a single rename. Whatever ends a
campaign ends it between two such moments; what an entry does not vouch for is computed again.
"""

import hashlib
import json
import os
import shutil
import struct
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..simulation import Status
from ._batch_runner import RunResults
from ._lock import NAME, Lock, StoreError

MANIFEST, UNFINISHED, FORM = ".manifest", ".unfinished-", 1
# Of the status of a run that has not been run.
PENDING = -1
# What the chunks may lack to the free space of the disk besides what is reckoned.
SPARE = 2**22


class Column(NamedTuple):
    """An array of the store: its dtype, the names of its dimensions and their sizes behind `run`,
    and its attributes."""

    dtype: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    attributes: dict[str, Any]

    @property
    def fill(self) -> float | int:
        """What stands where nothing has been written."""
        return float("nan") if np.dtype(self.dtype).kind == "f" else PENDING


class Store:
    """The store at `path`, for reading; `writable` opens it for writing."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.attributes: dict[str, Any] = {}
        self.columns: dict[str, Column] = {}

    @property
    def runs(self) -> int:
        """How many runs are planned."""
        return int(self.attributes["planned_runs"])

    @property
    def chunk(self) -> int:
        """How many runs a chunk has."""
        return int(self.attributes["chunk"])

    @property
    def count(self) -> int:
        """How many chunks are planned."""
        return -(-self.runs // self.chunk)

    def extent(self, chunk: int) -> tuple[int, int]:
        """The first run of a chunk and the number of its runs."""
        first = chunk * self.chunk
        return first, min(self.chunk, self.runs - first)

    def read(self) -> "Store":
        """The same, with its metadata read. Raises `StoreError` where there is no such store."""
        if not self.path.is_dir():
            raise StoreError(
                f"{self.path} is no folder: it must be the Zarr store of a dispersion."
            )
        try:
            root = json.loads((self.path / "zarr.json").read_bytes())
            self.attributes = root["attributes"]
            arrays = root["consolidated_metadata"]["metadata"]
            form = self.attributes.get("form")
            if form != FORM:
                raise KeyError("form")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StoreError(
                f"{self.path} cannot be read: it must be the Zarr store of a dispersion "
                f"({type(error).__name__}: {error})."
            ) from error
        self.columns = {
            name: Column(
                np.dtype(x["data_type"]).str,
                tuple(x["dimension_names"]),
                tuple(x["shape"][1:]),
                x["attributes"],
            )
            for name, x in arrays.items()
        }
        return self

    def entry(self, chunk: int) -> dict[str, Any] | None:
        """What the manifest says of a chunk; `None` where it has not been finished."""
        try:
            entry = json.loads((self.path / MANIFEST / f"{chunk}.json").read_bytes())
            return entry if set(entry["files"]) == set(self.columns) else None
        # A rename that outlived a loss of power may leave an empty file.
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def finished(self) -> list[int]:
        """The numbers of the finished chunks."""
        names = (self.path / MANIFEST).glob("*.json")
        numbers = sorted(int(name.stem) for name in names if name.stem.isdecimal())
        return [k for k in numbers if k < self.count and self.entry(k) is not None]

    def damage(self, chunk: int, scalars: bool = False) -> str:
        """What is wrong with a finished chunk, in a sentence; empty if nothing is.

        `scalars`: whether to look at the numbers of runs alone, and not at trajectories."""
        for name, column in self.columns.items():
            if not (scalars and column.shape):
                sentence = self._checked(chunk, name)[1]
                if sentence:
                    return sentence
        return ""

    def _checked(self, chunk: int, name: str) -> tuple[bytes, str]:
        """The bytes of an array in a finished chunk, and what is wrong with them."""
        first, count = self.extent(chunk)
        what = f"Chunk {chunk} (runs {first} to {first + count - 1}): {name}/c/{chunk} "
        entry = self.entry(chunk)
        try:
            data = self._file(name, chunk).read_bytes()
        except OSError as error:
            return b"", f"{what}cannot be read ({error.strerror})."
        size, digest = (None, None) if entry is None else entry["files"][name]
        if len(data) != size:
            return data, f"{what}has {len(data)} bytes in place of {size}."
        if hashlib.sha256(data).hexdigest() != digest:
            return data, f"{what}differs from its checksum."
        return data, ""

    def values(self, name: str, chunks: list[int]) -> np.ndarray:
        """An array over the runs of these finished chunks, runs first.

        **Raises** `StoreError`, naming the chunk, where it is damaged."""
        column, parts = self.columns[name], []
        for chunk in chunks:
            data, damage = self._checked(chunk, name)
            if damage:
                raise StoreError(f"{self.path}: {damage} `jaxspace resume` computes it again.")
            # The last four bytes are the checksum by which Zarr recognises damage on its own.
            x = np.frombuffer(data[:-4], column.dtype).reshape(self.chunk, *column.shape)
            parts.append(x[: self.extent(chunk)[1]])
        return np.concatenate(parts) if parts else np.zeros((0, *column.shape), column.dtype)

    def _file(self, name: str, chunk: int) -> Path:
        inner = "/".join("0" for _ in self.columns[name].shape)
        return self.path / name / "c" / (f"{chunk}/{inner}" if inner else str(chunk))


class StoreWriter:
    """A store that is open for writing, under its lock; a context manager.

    **Arguments**

    - `path`: of the store.
    - `overwrite`: whether a store that is there may be replaced.
    - `resume`: whether a store that is there is completed.

    **Raises** `StoreError` before anything is computed: for a folder that cannot be written, that
    holds something else, that another process writes, or that may not be replaced."""

    def __init__(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, resume: bool = False
    ):
        self.store = Store(path)
        self.overwrite = overwrite
        self.resume = resume
        self.lock = Lock(self.store.path)

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

    def __exit__(self, *_: object) -> None:
        self.lock.release()

    def _check_content(self) -> None:
        path = self.store.path
        # Of a process that was killed: under the lock nobody else writes.
        for left in path.rglob(f"{UNFINISHED}*"):
            left.unlink()
        others = {x.name for x in path.iterdir()} - {NAME, MANIFEST}
        if not others or "zarr.json" not in others:
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
        # Whatever else it is, it is not ours to replace.
        store = self.store.read()
        if not self.resume:
            done = sum(store.extent(k)[1] for k in store.finished())
            raise StoreError(
                f"{path} holds {done} of {store.runs} runs already: resume it, overwrite it, or "
                f"choose another folder (`jaxspace resume`, `--overwrite`; in Python "
                f"`resume=True`, `overwrite=True`)."
            )

    def prepare(self, columns: Mapping[str, Column], attributes: Mapping[str, Any]) -> Store:
        """The store for these arrays and attributes: made, or the one that is there.

        **Raises** `StoreError` where that is of another campaign, naming the difference, and where
        the disk has too little space."""
        if self.resume and not self.overwrite:
            return self.join(columns, attributes)
        store = self.store
        self._clear()
        store.attributes = {**attributes, "form": FORM}
        store.columns = dict(columns)
        self._check_space()
        with _disk(store):
            for name, data in _metadata(store):
                write_whole(store.path / name, data)
        return store

    def join(self, columns: Mapping[str, Column], attributes: Mapping[str, Any]) -> Store:
        """The store that another process has prepared, and holds.

        **Raises** `StoreError` where its runs come out differently there."""
        store = self.store.read()
        difference = _difference(store, columns, attributes)
        if difference:
            raise StoreError(f"{store.path} is the store of another campaign: {difference}")
        return store

    def _clear(self) -> None:
        # The head first: what is left of an interrupted removal is no store any more.
        (self.store.path / "zarr.json").unlink(missing_ok=True)
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
        store, todo, damages = self.store, [], []
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
        store, files = self.store, {}
        first, count = store.extent(chunk)
        columns = arrays_of(results, np.arange(first, first + count))
        # An entry for files that are about to change would vouch for the wrong ones.
        with _disk(store):
            (store.path / MANIFEST / f"{chunk}.json").unlink(missing_ok=True)
            for name, column in store.columns.items():
                data = _encoded(columns[name], column, store.chunk)
                write_whole(store._file(name, chunk), data)
                files[name] = (len(data), hashlib.sha256(data).hexdigest())
            entry = {"first": first, "runs": count, "seconds": seconds, "cpu_seconds": cpu}
            entry |= {"pid": os.getpid(), "files": files}
            write_whole(store.path / MANIFEST / f"{chunk}.json", json.dumps(entry).encode())

    def note(self, **attributes: Any) -> None:
        """Add to the attributes of the store."""
        path = self.store.path / "zarr.json"
        root = json.loads(path.read_bytes())
        root["attributes"] |= attributes
        self.store.attributes = root["attributes"]
        with _disk(self.store):
            write_whole(path, json.dumps(root).encode())


def _is_begun(path: Path) -> bool:
    """Whether this is the folder of an array, or will be one."""
    return path.is_dir() and ((path / "zarr.json").is_file() or not any(path.iterdir()))


class _disk:
    """Turns an error of the disk into a sentence that says what is kept."""

    def __init__(self, store: Store):
        self.store = store

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, OSError):
            store = self.store
            done = sum(store.extent(k)[1] for k in store.finished())
            raise StoreError(
                f"{store.path} cannot be written ({error.strerror}): {done} of {store.runs} runs "
                f"are kept. Once that is mended, `jaxspace resume {store.path}` computes the rest."
            ) from error


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that is there as a whole or not at all.

    Not flushed to the disk: what a loss of power leaves behind, the checksums find."""
    temporary = path.with_name(f"{UNFINISHED}{os.getpid()}-{path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def arrays_of(results: RunResults, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """All arrays of a chunk by name, the runs first, as Zarr and xarray have them."""
    every = {**results.inputs, **results.outputs, "run": numbers, "status": results.status}
    every |= {"evaluations": results.evaluations}
    every |= {name: np.moveaxis(x, -1, 0) for name, x in results.trajectories.items()}
    return every


def columns_of(results: RunResults, units: Mapping[str, str]) -> dict[str, Column]:
    """The arrays that hold results like these."""
    meanings = ", ".join(f"{s.value} {s.name}" for s in Status)
    own: dict[str, dict[str, Any]] = {
        "run": {"long_name": "number of the run"},
        "status": {"units": "", "meanings": f"{PENDING} NOT RUN YET, {meanings}"},
        "evaluations": {"units": ""},
    }
    for kind, values in (("input", results.inputs), ("output", results.outputs)):
        # The place is kept, because a store sorts by name.
        for place, name in enumerate(values):
            own[name] = {"units": units.get(name, ""), "kind": kind, "place": place}
    columns = {}
    for name, x in arrays_of(results, np.zeros(1, np.int64)).items():
        if "/" in name:
            raise StoreError(f"{name!r} cannot be stored: a name must be without a slash.")
        inner = [f"{name}.{axis}" for axis in range(x.ndim - 2)]
        # The times of a phase are an axis that all of its parts share.
        inner += [f"{name.partition('.')[0]}.sample"] if x.ndim > 1 else []
        kept = own.get(name, {"kind": "trajectory"})
        columns[name] = Column(x.dtype.str, ("run", *inner), x.shape[1:], kept)
    return columns


def _encoded(x: np.ndarray, column: Column, chunk: int) -> bytes:
    """A chunk as Zarr's codecs `bytes` and `crc32c` write it."""
    import google_crc32c

    x = np.ascontiguousarray(x, column.dtype)
    if len(x) < chunk:
        # The last chunk is as long as the others in the file.
        rest = np.full((chunk - len(x), *column.shape), column.fill, column.dtype)
        x = np.concatenate([x, rest])
    data = x.tobytes()
    return data + struct.pack("<I", google_crc32c.value(data))


def _metadata(store: Store) -> Iterator[tuple[str, bytes]]:
    """The files of metadata, the head of the store last."""
    import zarr
    from zarr.codecs import BytesCodec, Crc32cCodec
    from zarr.storage import MemoryStore

    memory = MemoryStore()
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
        # That other readers of the third version need not know it: they can do without.
        warnings.filterwarnings("ignore", "Consolidated metadata")
        zarr.consolidate_metadata(memory)
    files = {name: data.to_bytes() for name, data in memory._store_dict.items()}
    head = files.pop("zarr.json")
    yield from files.items()
    yield "zarr.json", head


# What makes a campaign the one that it is, in the order in which a difference is named.
IDENTITY = {
    "planned_runs": "the number of runs",
    "seed": "the seed",
    "chunk": "the runs in a chunk",
    "rtol": "the relative tolerance",
    "atol": "the absolute tolerance",
    "method": "the method",
    "description": "the scene",
    "inputs": "the inputs",
    "samples": "the states kept of each phase",
    "digest": "what the first runs come to",
}


def _difference(store: Store, columns: Mapping[str, Column], attributes: Mapping[str, Any]) -> str:
    """In what a store differs from a campaign, in a sentence; empty if in nothing."""
    there = store.attributes
    changed = [name for name in IDENTITY if there.get(name) != attributes[name]]
    names = sorted(set(columns) ^ set(store.columns))
    if not changed:
        return f"only one of the two has {names[0]!r}." if names else ""
    if changed[0] == "digest":
        return _cause(there, attributes)
    was, now = _differing(str(there.get(changed[0])), str(attributes[changed[0]]))
    return f"{IDENTITY[changed[0]]}: {was} in the store, {now} here."


def _cause(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Why the same question has another answer."""
    for kind in ("versions", "machine"):
        old, new = there.get(kind, {}), here[kind]
        changed = [key for key in new if old.get(key) != new[key]]
        if changed:
            told = ", ".join(f"{key} {old.get(key)} has become {new[key]}" for key in changed)
            return f"the first runs come out differently, and {told}."
    return "the first runs come out differently, so that its functions must have changed."


def _differing(old: str, new: str) -> tuple[str, str]:
    """Of texts the first lines that differ."""
    lines = zip((old + "\n").split("\n"), (new + "\n").split("\n"), strict=False)
    pairs = [(a.strip(), b.strip()) for a, b in lines if a != b]
    return pairs[0] if pairs else (old, new)

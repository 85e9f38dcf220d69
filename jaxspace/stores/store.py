"""A Zarr store of a campaign: one array for each input and output, along `run`, in chunks.

All arrays have their full length from the start, and the metadata are written once: a chunk adds
files and changes none. It is valid from the moment when its entry in `.manifest` appears, a file
with the size and the checksum of each of its files, put in place by a single rename. Whatever ends
a campaign ends it between two such moments; chunks without a valid entry are computed again. The
metadata have a copy there, with its checksum (`_head.py`).
"""

import hashlib
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import jaxspace

from ..core.record import Record, resuming
from ..core.text import printable
from ._checks import ALWAYS, Entry, array_fault, attributes_fault, entry_of
from ._errors import StoreError
from ._files import read_plain
from ._head import HEAD, UNREADABLE, damaged_arrays, read_head
from ._identity import mark_of
from ._replacement import folder_of
from .columns import Column

MANIFEST = ".manifest"
FORM = 1
"""The form of stores that this version writes and reads. It increases when older readers would
misinterpret the data; an additional attribute or array does not change it."""
ENOUGH = "enough_runs"
"""The attribute of a campaign that ended itself: how many runs were enough."""
# The names of the entries of chunks.
NUMBER = re.compile(r"0|[1-9][0-9]{0,18}")


def runs_of(attributes: Record) -> int:
    """Number of runs that a campaign with these attributes has when complete."""
    return int(attributes.get(ENOUGH) or attributes["planned_runs"])


class Store:
    """The store at `path`, for reading.

    - `folder`: where its files are: `path`, or a folder in it during a replacement.
    - `attributes`, `columns`: of the campaign, and of its arrays by name.
    - `head_damage`: message about damage of the head; empty without any.
    - `damaged_arrays`: names of the arrays whose metadata files differ from the head."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.folder = self.path
        self.attributes: dict[str, Any] = {}
        self.columns: dict[str, Column] = {}
        self.head_damage = ""
        self.damaged_arrays: list[str] = []

    @property
    def runs(self) -> int:
        """Number of runs when complete: as planned, or as many as its stopping rule needed."""
        return runs_of(self.attributes)

    @property
    def chunk(self) -> int:
        """Number of runs in a chunk."""
        return int(self.attributes["chunk"])

    @property
    def count(self) -> int:
        """Number of chunks when complete."""
        # Rounded up: the last chunk may be short.
        return -(-self.runs // self.chunk)

    def extent(self, chunk: int) -> tuple[int, int]:
        """The first run of a chunk and the number of its runs."""
        first = chunk * self.chunk
        return first, min(self.chunk, self.runs - first)

    def read(self, folder: Path | None = None) -> "Store":
        """The same, with its metadata read, by default of the store that readers see, else of the
        one in a `folder` of its path. Raises `StoreError` if there is no such store."""
        if not os.path.isdir(self.path):
            raise StoreError(
                f"{printable(str(self.path))} is not a folder: it must be the Zarr store of a "
                "dispersion."
            )
        self.folder = folder_of(self.path) if folder is None else folder
        head, self.head_damage = read_head(self.folder)
        try:
            root = json.loads(head)
        except UNREADABLE as error:
            raise self._unreadable("is not valid JSON") from error
        try:
            attributes = root["attributes"]
            arrays = root["consolidated_metadata"]["metadata"]
            form = attributes["form"]
        except (LookupError, TypeError) as error:
            raise self._unreadable(_lacks(error)) from error
        if form != FORM:
            raise StoreError(self._another_form(form, attributes))
        if fault := attributes_fault(attributes):
            raise self._unreadable(fault)
        if not isinstance(arrays, dict) or not set(ALWAYS) <= set(arrays):
            raise self._unreadable(f"does not have one of the arrays {', '.join(ALWAYS)}")
        for name, array in arrays.items():
            if fault := array_fault(name, array, attributes):
                raise self._unreadable(fault)
        self.attributes = attributes
        self.columns = {name: Column.of(array) for name, array in arrays.items()}
        self.damaged_arrays = damaged_arrays(self.folder, arrays)
        return self

    def _unreadable(self, fault: str) -> StoreError:
        """The error for a head with this fault, the end of a message."""
        return StoreError(
            f"{self.path} cannot be read: it must be the Zarr store of a dispersion, and its head "
            f"{fault}."
        )

    def _another_form(self, form: object, attributes: Record) -> str:
        """The message that a store has another form: which version wrote it, and how to read it."""
        versions = attributes.get("versions")
        named = versions.get("jaxspace") if isinstance(versions, dict) else None
        writer = printable(str(named)) if named else "of an unnamed version"
        return (
            f"{self.path} is a store of format {form!r}, written by jaxspace {writer}, and "
            f"jaxspace {jaxspace.__version__} reads format {FORM}: read it with the version that "
            "wrote it, or its arrays with zarr or xarray."
        )

    def metadata_damages(self, but_for: Sequence[str] = ()) -> list[str]:
        """Messages about damaged metadata files; without the arrays `but_for`."""
        # Other readers of the store open an array from its own file only.
        arrays = [
            f"{name}/{HEAD} differs from {HEAD}, which is read in its place."
            for name in self.damaged_arrays
            if name not in but_for
        ]
        return ([self.head_damage] if self.head_damage else []) + arrays

    def entry(self, chunk: int) -> Entry | None:
        """Entry of a chunk in the manifest; `None` for an unfinished chunk."""
        try:
            found = read_plain(self.folder / MANIFEST / f"{chunk}.json", self.folder)
            entry = entry_of(json.loads(found))
        # A rename that outlived a loss of power may leave an empty file.
        except UNREADABLE:
            return None
        return entry if entry is not None and set(entry.files) == set(self.columns) else None

    def finished(self) -> list[int]:
        """The numbers of the finished chunks."""
        names = (self.folder / MANIFEST).glob("*.json")
        # As they are written: other texts may mean the same number, or none that Python reads.
        numbers = sorted(int(name.stem) for name in names if NUMBER.fullmatch(name.stem))
        # Chunks beyond the end are left from before the campaign ended itself.
        return [k for k in numbers if k < self.count and self.entry(k) is not None]

    def damage(self, chunk: int, scalars: bool = False) -> str:
        """A message about damage of a finished chunk; empty if it has none.

        `scalars`: whether to check only the numbers of runs, without trajectories."""
        for name, column in self.columns.items():
            if not (scalars and column.shape):
                sentence = self._checked(chunk, name)[1]
                if sentence:
                    return sentence
        return ""

    def _checked(self, chunk: int, name: str) -> tuple[np.ndarray, str]:
        """An array over the runs of a finished chunk, runs first, and a message about its
        damage."""
        first, count = self.extent(chunk)
        column = self.columns[name]
        x = np.empty((0, *column.shape), column.dtype)
        what = f"Chunk {chunk} (runs {first} to {first + count - 1}): {name}/c/{chunk} "
        entry = self.entry(chunk)
        if entry is None:
            return x, f"{what}has no entry in the manifest."
        # Each chunk is checked against its place, because files may have changed places, or come
        # from another store, together with an entry that is right about them.
        if (entry.first, entry.runs) != (first, count):
            last = entry.first + entry.runs - 1
            return x, f"{what}has the entry of runs {entry.first} to {last}."
        if entry.campaign != mark_of(self.attributes):
            return x, f"{what}has the entry of another campaign."
        try:
            data = read_plain(self.file(name, chunk), self.folder)
        except OSError as error:
            return x, f"{what}cannot be read ({error.strerror})."
        size, digest = entry.files[name]
        if len(data) != size:
            return x, f"{what}has {len(data)} bytes instead of {size}."
        if hashlib.sha256(data).hexdigest() != digest:
            return x, f"{what}does not match its checksum."
        # The last four bytes are the checksum by which Zarr recognises damage on its own.
        if size != self.chunk * column.bytes_of_run + 4:
            return x, f"{what}has the length of another array."
        x = np.frombuffer(data[:-4], column.dtype).reshape(self.chunk, *column.shape)[:count]
        if name == "run" and not np.array_equal(x, np.arange(first, first + count)):
            return x, f"{what}has the run numbers of other runs."
        return x, ""

    def values(self, name: str, chunks: list[int]) -> np.ndarray:
        """An array over the runs of these finished chunks, runs first.

        **Raises** `StoreError`, naming the chunk, where it is damaged."""
        parts = []
        for chunk in chunks:
            x, damage = self._checked(chunk, name)
            if damage:
                again = resuming(self.attributes, self.path)
                raise StoreError(f"{self.path}: {damage} `{again}` computes it again.")
            parts.append(x)
        column = self.columns[name]
        return np.concatenate(parts) if parts else np.zeros((0, *column.shape), column.dtype)

    def file(self, name: str, chunk: int) -> Path:
        """Path of the file with the numbers of an array in one chunk."""
        inner = "/".join("0" for _ in self.columns[name].shape)
        return self.folder / name / "c" / (f"{chunk}/{inner}" if inner else str(chunk))


def _lacks(error: Exception) -> str:
    """The end of the message about a head with a missing part."""
    return f"has no {error.args[0]}" if isinstance(error, KeyError) else "has unexpected content"

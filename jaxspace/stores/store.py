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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import jaxspace

from ..core.record import Record
from ._head import HEAD, damaged_arrays, read_head
from ._lock import StoreError
from .columns import Column

MANIFEST = ".manifest"
FORM = 1
"""The form of stores that this version writes and reads. It rises when what is read would be taken
wrongly; an attribute or an array that is added leaves it."""
ENOUGH = "enough_runs"
"""The attribute of a campaign that ended itself: how many runs were enough."""


def runs_of(attributes: Record) -> int:
    """Number of runs that a campaign with these attributes has when complete."""
    return int(attributes.get(ENOUGH) or attributes["planned_runs"])


class DamagedStore(UserWarning):
    """Files of a store differ from what was written; the message names them."""


# What a file of any content raises where it is read as the head of a store.
UNREADABLE = (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError)


def _fault_of(error: Exception) -> str:
    """What is wrong with a head, as the end of a sentence."""
    if isinstance(error, OSError):
        return f"cannot be read: {error.strerror}"
    if isinstance(error, KeyError):
        return f"has no {error.args[0]}"
    return "is no JSON" if isinstance(error, ValueError) else "holds something else"


class Store:
    """The store at `path`, for reading; `writable` opens it for writing."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.attributes: dict[str, Any] = {}
        self.columns: dict[str, Column] = {}
        # What is wrong with the head, in a sentence.
        self.head_damage = ""
        # The arrays whose own metadata differ from those in the head.
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

    def read(self) -> "Store":
        """The same, with its metadata read. Raises `StoreError` where there is no such store."""
        if not self.path.is_dir():
            raise StoreError(
                f"{self.path} is no folder: it must be the Zarr store of a dispersion."
            )
        try:
            head, self.head_damage = read_head(self.path)
            root = json.loads(head)
            self.attributes = root["attributes"]
            arrays = root["consolidated_metadata"]["metadata"]
            form = self.attributes["form"]
            if form != FORM:
                raise StoreError(self._another_form(form))
            self.columns = {name: Column.of(x) for name, x in arrays.items()}
            self.damaged_arrays = damaged_arrays(self.path, arrays)
        except StoreError:
            raise
        except UNREADABLE as error:
            raise StoreError(
                f"{self.path} cannot be read: it must be the Zarr store of a dispersion, and its "
                f"head {_fault_of(error)}."
            ) from error
        return self

    def _another_form(self, form: object) -> str:
        """The message that a store has another form: which version wrote it, and how to read it."""
        writer = self.attributes.get("versions", {}).get("jaxspace", "of an unnamed version")
        return (
            f"{self.path} is a store of form {form!r}, written by jaxspace {writer}, and jaxspace "
            f"{jaxspace.__version__} reads form {FORM}: read it by the version that wrote it, or "
            f"its arrays by zarr or xarray alone."
        )

    def metadata_damages(self, but_for: Sequence[str] = ()) -> list[str]:
        """Damages of the files of the metadata, a sentence each; without the arrays `but_for`."""
        # Other readers of the store open an array by its own file alone.
        arrays = [
            f"{name}/{HEAD} differs from {HEAD}, which is read in its place."
            for name in self.damaged_arrays
            if name not in but_for
        ]
        return ([self.head_damage] if self.head_damage else []) + arrays

    def entry(self, chunk: int) -> Record | None:
        """Entry of a chunk in the manifest; `None` for an unfinished chunk."""
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
        # Chunks beyond the end are left from before the campaign ended itself.
        return [k for k in numbers if k < self.count and self.entry(k) is not None]

    def damage(self, chunk: int, scalars: bool = False) -> str:
        """Damage of a finished chunk, in a sentence; empty if it has none.

        `scalars`: whether to look at the numbers of runs alone, and not at trajectories."""
        for name, column in self.columns.items():
            if not (scalars and column.shape):
                sentence = self._checked(chunk, name)[1]
                if sentence:
                    return sentence
        return ""

    def _checked(self, chunk: int, name: str) -> tuple[bytes, str]:
        """The bytes of an array in a finished chunk, and their damage in a sentence."""
        first, count = self.extent(chunk)
        what = f"Chunk {chunk} (runs {first} to {first + count - 1}): {name}/c/{chunk} "
        entry = self.entry(chunk)
        try:
            data = self.file(name, chunk).read_bytes()
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
        column = self.columns[name]
        parts = []
        for chunk in chunks:
            data, damage = self._checked(chunk, name)
            if damage:
                raise StoreError(f"{self.path}: {damage} `jaxspace resume` computes it again.")
            # The last four bytes are the checksum by which Zarr recognises damage on its own.
            x = np.frombuffer(data[:-4], column.dtype).reshape(self.chunk, *column.shape)
            parts.append(x[: self.extent(chunk)[1]])
        return np.concatenate(parts) if parts else np.zeros((0, *column.shape), column.dtype)

    def file(self, name: str, chunk: int) -> Path:
        """Path of the file with the numbers of an array in one chunk."""
        inner = "/".join("0" for _ in self.columns[name].shape)
        return self.path / name / "c" / (f"{chunk}/{inner}" if inner else str(chunk))

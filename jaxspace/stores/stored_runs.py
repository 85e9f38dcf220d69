"""The runs of a store as a `Dispersion`: its columns are read on demand."""

import os
import warnings
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import final

import numpy as np

from ..statistics import Dispersion
from ._checks import Entry
from ._errors import DamagedStore
from .store import Store

BOOKKEEPING = ("form", "seed", "preparation_seconds")


@final
class StoredColumns(Mapping[str, np.ndarray]):
    """Columns of a store by name, each (runs,). None is cached: only those in use are in memory."""

    def __init__(self, store: Store, chunks: list[int], names: list[str]):
        self.store = store
        self.chunks = chunks
        self.names = names

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.names:
            raise KeyError(name)
        return self.store.values(name, self.chunks)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


def open_store(path: str | os.PathLike[str]) -> Dispersion:
    """The runs of a store, also of an interrupted or running campaign: a warning then reports the
    number of available runs (`Dispersion.missing_runs`).

    Its columns are read from the disk on demand. Corrupted chunks are omitted, with a warning that
    names them: `disperse(..., resume=True)` or `jaxspace resume` computes them again, and mends the
    files of metadata.

    Raises `StoreError`, an `InputError`, if `path` is not a store of a dispersion."""
    store = Store(path).read()
    for damage in store.metadata_damages():
        warnings.warn(f"{path}: {damage}", DamagedStore, stacklevel=2)
    chunks = []
    for chunk in store.finished():
        # Scalars alone: opening a store must not read all of its trajectories.
        damage = store.damage(chunk, scalars=True)
        if damage:
            warnings.warn(f"{path}: {damage} Its runs are omitted.", DamagedStore, stacklevel=2)
        else:
            chunks.append(chunk)
    result = as_dispersion(store, chunks)
    # Without a warning, the statistics of a part would be taken for those of the whole.
    if result.missing_runs:
        warnings.warn(f"{path}: {result.missing_runs}", stacklevel=2)
    return result


def _computing(entries: list[Entry]) -> float:
    """Time, s, that it took to compute the chunks with these entries."""
    seconds: dict[int | None, float] = defaultdict(float)
    for entry in entries:
        seconds[entry.host] += entry.seconds
    alone = seconds.pop(None, 0.0)
    # Hosts compute at the same time: the slowest one sets the duration.
    return alone + max(seconds.values(), default=0.0)


def as_dispersion(store: Store, chunks: list[int]) -> Dispersion:
    """The runs of these chunks of a store."""
    kinds = {
        kind: sorted(
            (n for n, c in store.columns.items() if c.attributes.get("kind") == kind),
            key=lambda n: store.columns[n].attributes["place"],
        )
        for kind in ("input", "output")
    }
    inputs, outputs = (StoredColumns(store, chunks, names) for names in kinds.values())
    units = {name: store.columns[name].attributes["units"] for name in (*inputs, *outputs)}
    attributes = {k: v for k, v in store.attributes.items() if k not in BOOKKEEPING}
    entries = [entry for chunk in chunks if (entry := store.entry(chunk)) is not None]
    preparation = float(store.attributes["preparation_seconds"])
    computing = _computing(entries)
    attributes["preparation_seconds"] = preparation
    attributes["cpu_seconds"] = sum((e.cpu_seconds for e in entries), 0.0)
    # The store knows the cores of one host only: the others are taken to have as many.
    attributes["hosts"] = max(len({e.host for e in entries} - {None}), 1)
    return Dispersion(
        inputs,
        outputs,
        store.values("status", chunks),
        store.values("evaluations", chunks),
        units,
        int(store.attributes["seed"]),
        preparation + computing,
        attributes,
        store.values("run", chunks),
        str(store.path),
    )

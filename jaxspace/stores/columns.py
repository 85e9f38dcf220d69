"""The arrays of a store for the results of a campaign, and their encoding."""

import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..core.extras import extra
from ..core.file_names import file_name_fault
from ..core.record import Record
from ..statistics.datasets import PENDING, described
from ._errors import StoreError
from .results import RunResults


class Column(NamedTuple):
    """An array of the store: its dtype, the names of its dimensions and their sizes behind `run`,
    and its attributes."""

    dtype: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    attributes: dict[str, Any]

    @classmethod
    def of(cls, head: Record) -> "Column":
        """The array with these metadata of Zarr."""
        dtype = np.dtype(head["data_type"]).str
        dims = tuple(head["dimension_names"])
        return cls(dtype, dims, tuple(head["shape"][1:]), head["attributes"])

    @property
    def bytes_of_run(self) -> int:
        """Bytes of one run."""
        # In Python's numbers, which do not overflow.
        return math.prod(self.shape, start=np.dtype(self.dtype).itemsize)

    @property
    def fill(self) -> float | int:
        """The value of entries that have not been written."""
        return float("nan") if np.dtype(self.dtype).kind == "f" else PENDING


def arrays_of(results: RunResults, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """All arrays of a chunk by name, the runs first, as Zarr and xarray have them."""
    every = {**results.inputs, **results.outputs, "run": numbers, "status": results.status}
    every |= {"evaluations": results.evaluations}
    every |= {name: np.moveaxis(x, -1, 0) for name, x in results.trajectories.items()}
    return every


def columns_of(results: RunResults, units: Mapping[str, str]) -> dict[str, Column]:
    """The arrays for results like these."""
    attributes = described({"input": results.inputs, "output": results.outputs}, units)
    columns = {}
    for name, x in arrays_of(results, np.zeros(1, np.int64)).items():
        check_array_name(name)
        inner = [f"{name}.{axis}" for axis in range(x.ndim - 2)]
        # The times of a phase are an axis that all of its parts share.
        inner += [f"{name.partition('.')[0]}.sample"] if x.ndim > 1 else []
        own = attributes.get(name, {"kind": "trajectory"})
        columns[name] = Column(x.dtype.str, ("run", *inner), x.shape[1:], own)
    return columns


def check_array_name(name: str) -> None:
    """Raise `StoreError` for a name that no array of a store can have: its folder has this name."""
    if fault := file_name_fault(name):
        raise StoreError(f"{name!r} cannot be stored: its name must be {fault}.")


def encoded(x: np.ndarray, column: Column, chunk: int) -> bytes:
    """A chunk as Zarr's codecs `bytes` and `crc32c` write it."""
    with extra("app"):
        import google_crc32c

    x = np.ascontiguousarray(x, column.dtype)
    if len(x) < chunk:
        # The last chunk is padded to the length of the others.
        rest = np.full((chunk - len(x), *column.shape), column.fill, column.dtype)
        x = np.concatenate([x, rest])
    data = x.tobytes()
    return data + struct.pack("<I", google_crc32c.value(data))

"""A Zarr store of the runs of a campaign: one variable for each input and output, along `run`."""

import importlib.metadata
import json
import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core import InputError
from ._statistics import Dispersion

if TYPE_CHECKING:
    import xarray

LIBRARIES = ("jaxspace", "jax", "jaxlib", "equinox", "diffrax", "numpy", "xarray", "zarr")


def versions() -> dict[str, str]:
    """The versions of Python and of the libraries on which the numbers depend."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        # A library that is not needed for this campaign may be absent.
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


class Store:
    """A Zarr store at `path` that grows in chunks; the first chunk replaces whatever was there."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.runs = 0

    def append(self, chunk: Dispersion) -> None:
        """Write the runs of a chunk behind those already there."""
        data = chunk.to_dataset(self.runs)
        # Not consolidated, so that what has been written can be read after an interruption.
        if self.runs == 0:
            encoding = {str(name): {"chunks": (chunk.runs,)} for name in data.variables}
            data.to_zarr(self.path, mode="w", encoding=encoding, consolidated=False)
        else:
            data.to_zarr(self.path, append_dim="run", consolidated=False)
        self.runs += chunk.runs


def open_store(path: str | os.PathLike[str]) -> Dispersion:
    """The runs of a store, also of a campaign that was interrupted.

    Raises `InputError` where `path` holds no store of a dispersion."""
    import xarray

    # Checked first: the store library would report a missing folder in words of its own.
    if not Path(path).is_dir():
        raise InputError(f"{path} is no folder: it must be the Zarr store of a dispersion.")
    try:
        with xarray.open_zarr(path, consolidated=False) as data:
            data = data.load()
        inputs = _of_kind(data, "input")
        outputs = _of_kind(data, "output")
        units = {name: data[name].attrs["units"] for name in (*inputs, *outputs)}
        attributes = dict(data.attrs)
        seed = int(attributes.pop("seed"))
        seconds = float(attributes.pop("seconds"))
        status = data["status"].values
        evaluations = data["evaluations"].values
    except (KeyError, OSError, json.JSONDecodeError) as error:
        raise InputError(
            f"{path} cannot be read: it must be the Zarr store of a dispersion ({error})."
        ) from error
    return Dispersion(inputs, outputs, status, evaluations, units, seed, seconds, attributes)


def _of_kind(data: "xarray.Dataset", kind: str) -> dict[str, np.ndarray]:
    """The inputs or the outputs of a dataset, in the order in which they were written."""
    found = [str(name) for name, x in data.items() if x.attrs.get("kind") == kind]
    return {
        name: data[name].values
        for name in sorted(found, key=lambda name: data[name].attrs["place"])
    }

"""Where the runs of a campaign are kept: a Zarr store, one variable for each input and output along
the axis `run`."""

import importlib.metadata
import json
import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import InputError
from ..simulation import Status
from ._statistics import Dispersion

if TYPE_CHECKING:
    import xarray

LIBRARIES = ("jaxspace", "jax", "jaxlib", "equinox", "diffrax", "numpy", "xarray", "zarr")
MEANINGS = ", ".join(f"{s.value} {s.name}" for s in Status)


def versions() -> dict[str, str]:
    """The versions of Python and of the libraries that decide the numbers."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def dataset(result: Dispersion, first: int = 0) -> "xarray.Dataset":
    """The runs as a dataset; `first` is the number of the first run."""
    import xarray

    variables: dict[str, Any] = {}
    for kind, values in (("input", result.inputs), ("output", result.outputs)):
        for place, (name, x) in enumerate(values.items()):
            variables[name] = (
                "run",
                np.asarray(x),
                {"units": result.units.get(name, ""), "kind": kind, "place": place},
            )
    variables["status"] = ("run", np.asarray(result.status), {"units": "", "meanings": MEANINGS})
    variables["evaluations"] = ("run", np.asarray(result.evaluations), {"units": ""})
    numbers = np.arange(first, first + result.runs)
    attributes = {**result.attributes, "seed": result.seed, "seconds": result.seconds}
    return xarray.Dataset(
        variables, {"run": ("run", numbers, {"long_name": "number of the run"})}, attributes
    )


class Store:
    """A Zarr store at `path` that grows by chunks; whatever lay there is replaced with the first
    one."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.runs = 0

    def append(self, chunk: Dispersion) -> None:
        """Write the runs of a chunk behind those already there. What has been written survives
        whatever comes next."""
        data = dataset(chunk, self.runs)
        if self.runs == 0:
            pieces = {str(name): {"chunks": (chunk.runs,)} for name in data.variables}
            data.to_zarr(self.path, mode="w", encoding=pieces, consolidated=False)
        else:
            data.to_zarr(self.path, append_dim="run", consolidated=False)
        self.runs += chunk.runs


def open_store(path: str | os.PathLike[str]) -> Dispersion:
    """The runs that a store holds, complete or of a campaign that was interrupted.

    Raises `InputError` where there is no store of a dispersion."""
    import xarray

    if not Path(path).is_dir():
        raise InputError(f"{path} is no folder: it must be the Zarr store of a dispersion.")
    try:
        with xarray.open_zarr(path, consolidated=False) as data:
            data = data.load()
        inputs, outputs = _of_kind(data, "input"), _of_kind(data, "output")
        units = {name: data[name].attrs["units"] for name in (*inputs, *outputs)}
        attributes = dict(data.attrs)
        seed, seconds = attributes.pop("seed"), attributes.pop("seconds")
        status, evaluations = data["status"].values, data["evaluations"].values
    except (KeyError, OSError, json.JSONDecodeError) as error:
        raise InputError(
            f"{path} cannot be read: it must be the Zarr store of a dispersion ({error})."
        ) from error
    return Dispersion(
        inputs, outputs, status, evaluations, units, int(seed), float(seconds), attributes
    )


def _of_kind(data: "xarray.Dataset", kind: str) -> dict[str, np.ndarray]:
    """The inputs or the outputs of a dataset, in the order in which they were written (a store
    sorts by name)."""
    found = [str(name) for name, x in data.items() if x.attrs.get("kind") == kind]
    return {
        name: data[name].values
        for name in sorted(found, key=lambda name: data[name].attrs["place"])
    }

"""The runs of a dispersion as a table of pandas and as a dataset of xarray."""

from typing import TYPE_CHECKING

import numpy as np

from ..simulation import Status

if TYPE_CHECKING:
    import pandas
    import xarray

    # Of types alone: the dispersion itself calls these functions.
    from ._statistics import Dispersion


def as_frame(dispersion: "Dispersion") -> "pandas.DataFrame":
    """A line for each run: its status, its inputs and outputs with their units."""
    import pandas

    every = {**dispersion.inputs, **dispersion.outputs}
    columns = {
        name + (f" [{u}]" if (u := dispersion.units.get(name, "")) else ""): x
        for name, x in every.items()
    }
    words = np.array([s.name for s in Status])
    places = np.searchsorted([s.value for s in Status], dispersion.status)
    return pandas.DataFrame({"status": words[places], **columns})


def as_dataset(dispersion: "Dispersion", first: int) -> "xarray.Dataset":
    """A variable for each input and output along `run`; `first` is the number of the first run."""
    import xarray

    variables: dict[str, tuple[str, np.ndarray, dict[str, object]]] = {}
    for kind, values in (("input", dispersion.inputs), ("output", dispersion.outputs)):
        # The place of a variable is kept, because a store sorts by name.
        for place, (name, x) in enumerate(values.items()):
            attributes: dict[str, object] = {
                "units": dispersion.units.get(name, ""),
                "kind": kind,
                "place": place,
            }
            variables[name] = ("run", np.asarray(x), attributes)
    meanings = ", ".join(f"{s.value} {s.name}" for s in Status)
    variables["status"] = (
        "run",
        np.asarray(dispersion.status),
        {"units": "", "meanings": meanings},
    )
    variables["evaluations"] = ("run", np.asarray(dispersion.evaluations), {"units": ""})
    numbers = (
        np.arange(first, first + dispersion.runs)
        if dispersion.numbers is None
        else dispersion.numbers
    )
    return xarray.Dataset(
        variables,
        {"run": ("run", numbers, {"long_name": "number of the run"})},
        {**dispersion.attributes, "seed": dispersion.seed, "seconds": dispersion.seconds},
    )

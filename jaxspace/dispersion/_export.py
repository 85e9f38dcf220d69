"""The runs of a dispersion as a table of pandas and as a dataset of xarray."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.extras import extra
from ..simulation import Status

if TYPE_CHECKING:
    import pandas
    import xarray


def as_frame(
    columns: Mapping[str, np.ndarray], units: Mapping[str, str], status: np.ndarray
) -> "pandas.DataFrame":
    """A line for each run: its status, then `columns`, each named with its unit."""
    with extra("app"):
        import pandas

    named = {
        name + (f" [{unit}]" if (unit := units.get(name, "")) else ""): x
        for name, x in columns.items()
    }
    words = np.array([s.name for s in Status])
    places = np.searchsorted([s.value for s in Status], status)
    return pandas.DataFrame({"status": words[places], **named})


def as_dataset(
    kinds: Mapping[str, Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    status: np.ndarray,
    evaluations: np.ndarray,
    numbers: np.ndarray,
    attributes: dict[str, Any],
) -> "xarray.Dataset":
    """A variable for each value along `run`, whose coordinate are the `numbers` of the runs.

    `kinds`: inputs and outputs, as "input" and "output"."""
    with extra("app"):
        import xarray

    variables: dict[str, tuple[str, np.ndarray, dict[str, object]]] = {}
    for kind, values in kinds.items():
        # The place of a variable is kept, because a store sorts by name.
        for place, (name, x) in enumerate(values.items()):
            own = {"units": units.get(name, ""), "kind": kind, "place": place}
            variables[name] = ("run", np.asarray(x), own)
    meanings = ", ".join(f"{s.value} {s.name}" for s in Status)
    variables["status"] = ("run", np.asarray(status), {"units": "", "meanings": meanings})
    variables["evaluations"] = ("run", np.asarray(evaluations), {"units": ""})
    return xarray.Dataset(
        variables, {"run": ("run", numbers, {"long_name": "number of the run"})}, attributes
    )

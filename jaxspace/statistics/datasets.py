"""The runs of a dispersion as a table of pandas and as a dataset of xarray."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.extras import extra
from ..core.record import Record
from ..core.status import Status

if TYPE_CHECKING:
    import pandas
    import xarray

# Status of a run that has not been computed.
PENDING = -1


def as_frame(
    columns: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    status: np.ndarray,
    numbers: np.ndarray,
) -> "pandas.DataFrame":
    """A line for each run, by its number: its status, then `columns`, each named with its unit."""
    with extra("app"):
        import pandas

    named = {
        name + (f" [{unit}]" if (unit := units.get(name, "")) else ""): x
        for name, x in columns.items()
    }
    words = np.array([s.name for s in Status])
    places = np.searchsorted([s.value for s in Status], status)
    return pandas.DataFrame({"status": words[places], **named}, index=numbers)


def as_dataset(
    kinds: Mapping[str, Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    status: np.ndarray,
    evaluations: np.ndarray,
    numbers: np.ndarray,
    attributes: Record,
) -> "xarray.Dataset":
    """A variable for each value along `run`, whose coordinate are the `numbers` of the runs.

    `kinds`: inputs and outputs, as "input" and "output"."""
    with extra("app"):
        import xarray

    own = described(kinds, units)
    values = {name: x for part in kinds.values() for name, x in part.items()}
    values |= {"status": status, "evaluations": evaluations}
    variables = {name: ("run", np.asarray(x), own[name]) for name, x in values.items()}
    return xarray.Dataset(variables, {"run": ("run", numbers, own["run"])}, attributes)


def described(kinds: Mapping[str, Iterable[str]], units: Mapping[str, str]) -> dict[str, Record]:
    """The attributes of the arrays of a campaign in datasets and stores, by name.

    `kinds`: the names of inputs and outputs, as "input" and "output"."""
    meanings = ", ".join(f"{s.value} {s.name}" for s in Status)
    result: dict[str, dict[str, Any]] = {
        "run": {"long_name": "number of the run"},
        "status": {"units": "", "meanings": f"{PENDING} NOT RUN YET, {meanings}"},
        "evaluations": {"units": ""},
    }
    for kind, names in kinds.items():
        # With its position, because a store sorts by name.
        for place, name in enumerate(names):
            result[name] = {"units": units.get(name, ""), "kind": kind, "place": place}
    return result

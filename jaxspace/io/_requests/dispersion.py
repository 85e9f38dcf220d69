"""The table [dispersion] of a scene file: dispersed inputs, recorded outputs, and the rule that
ends the campaign.

The entries of its outputs and inputs are read after the rest of the file, whose names and numbers
they refer to."""

from typing import NamedTuple

from ...core import argument
from ...dispersion.covariance import AUTO, METHODS, MONTE_CARLO
from .._kinds.errors import unknown
from .._kinds.kind import Entry, Reading, Values
from .._kinds.tables import AnyTable, Table
from .._kinds.values import ListOf, Number, OneName, Text, Whole
from .._mission.control import scatter_errors
from .._mission.parsed import Parsed
from .inputs import Input, read_columns, read_inputs
from .joint_inputs import MadeInput
from .output_entries import OutputList, read_outputs
from .output_spec import OutputSpec

DESIGNS = ("random", "latin_hypercube", "sobol")
SHARE = Number(argument("", low=0.0, high=1.0, strict=True, fixed=True, doc="from 0 to 1"))
UNTIL = Table(
    {
        "output": Entry(Text(), doc="whose quantile is estimated"),
        "share": Entry(SHARE, 0.99, doc="of the runs below the quantile"),
        "precision": Entry(
            SHARE, 0.01, doc="relative to the distance of the quantile from the mean"
        ),
        "confidence": Entry(SHARE, 0.95, doc="confidence level"),
    }
)


def dispersion_table() -> Table:
    """The form of the table."""
    return Table(
        {
            # Enough for a mean and a deviation to a few percent.
            "runs": Entry(Whole(), 1000, doc="number of runs"),
            "seed": Entry(Whole(0), 1, doc="seed of the random inputs"),
            "outputs": Entry(OutputList(), doc="outputs recorded for each run"),
            # The paths that exist are known only after the rest of the file has been read.
            "inputs": Entry(AnyTable(), {}, doc="dispersed inputs by path"),
            "correlated": Entry(ListOf(AnyTable()), (), doc="correlated inputs, with a matrix"),
            "direction": Entry(ListOf(AnyTable()), (), doc="vectors with a dispersed direction"),
            "until": Entry(UNTIL, None, doc="rule that stops the campaign early"),
            "method": Entry(
                OneName((MONTE_CARLO, *METHODS, AUTO)),
                MONTE_CARLO,
                doc="runs, or a cheaper method; auto chooses by the second-order terms",
            ),
            "compare": Entry(
                ListOf(OneName(METHODS)), (), doc="cheaper methods to compare with these runs"
            ),
            "extreme_samples": Entry(
                Whole(5, 10**5),
                65,
                doc="number of states per phase among which extremes are searched",
            ),
            "sampling": Entry(OneName(DESIGNS), "random", doc="sampling design of the inputs"),
        }
    )


class Requested(NamedTuple):
    """The `inputs` and the columns of the `sweep`, SI, by path, and the `outputs`."""

    inputs: dict[str, Input | MadeInput]
    sweep: dict[str, tuple[float, ...]]
    outputs: tuple[OutputSpec, ...]


def read_dispersion(file: Parsed, reading: Reading) -> tuple[Requested, list[str]]:
    """The inputs and outputs of [dispersion], the sweep, and their errors; nothing without them.

    `reading`: that of the file, with its units and the files that it names."""
    sweep, errors = read_columns(file)
    if file.values["dispersion"] is None:
        return Requested({}, {}, ()), errors
    outputs, more = read_outputs(file, reading.units)
    errors += more
    inputs, more = read_inputs(file, reading.files, sweep)
    # A misspelt output would make the rule wrong, too.
    if not errors:
        more += _until_errors(file.values["dispersion"]["until"], outputs)
    # All at once: outputs and inputs do not depend on each other.
    dispersed = [path for path in inputs if path not in sweep]
    found = Requested(inputs, sweep, outputs)
    return found, errors + more + scatter_errors(file, dispersed)


def _until_errors(until: Values | None, outputs: tuple[OutputSpec, ...]) -> list[str]:
    """The error of a rule that ends a campaign by none of its outputs."""
    names = [spec.name for spec in outputs]
    if until is None or until["output"] in names:
        return []
    key = f'dispersion.until.output = "{until["output"]}"'
    return [unknown(key, until["output"], names, "output of this file")]

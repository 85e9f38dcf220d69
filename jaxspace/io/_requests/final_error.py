"""The error at the end of the nominal run that a file asks for, in place of a tolerance.

`final_error = 1e-9` is relative to every block of the final state; `final_error = { position =
"1 m", velocity = "1 mm/s" }` names blocks and their errors. Campaigns use the tolerance of the
nominal run.
"""

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core import argument
from ...core.quantities import Quantity, quantities
from ...simulation import Accuracy, FinalError, Trajectory
from .._kinds.errors import unknown, wrong
from .._kinds.kind import Entry, Maker, Reading, Value
from .._kinds.tables import Object
from .._kinds.values import Number
from .._mission.parsed import Parsed
from ..units import in_unit, read_number


class Written(float):
    """A number in SI, with the unit in which the file writes it and the SI unit."""

    unit: str
    si: str

    def text(self, factor: float = 1.0) -> str:
        """The number times a `factor`, in its unit."""
        shown = f"{factor * in_unit(self.si, self.unit) * self:.3g}"
        return f"{shown} {self.unit}" if self.unit else shown


@dataclass(frozen=True, eq=False)
class ErrorNumber(Number):
    """An error of a `quantity`. Its unit is not used for results: a position with an error of one
    millimetre is not shown in millimetres."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        try:
            number, unit = read_number(value, self.quantity)
        except ValueError as error:
            reading.errors.append(wrong(path, value, str(error)))
            return None
        written = Written(number)
        # Kept here and not in the units of the file, by which the results are shown.
        written.si, written.unit = self.quantity.unit, unit or self.quantity.unit
        return written


def final_error_kind(state: type, relative: Quantity) -> Object:
    """The file entries for the error, for states of this class; a single number is `relative`."""
    entries = {"relative": Entry(ErrorNumber(relative), doc="of every block of the final state")}
    blocks = {
        name: Entry(
            ErrorNumber(argument(declared.unit, positive=True, fixed=True, doc="error")),
            None,
            doc=f"error of the {name}",
        )
        for name, declared in quantities(state).items()
    }
    ways = (
        Maker("FinalError", FinalError, {"relative": "relative"}, entries, {}, bare=True),
        Maker("FinalError", FinalError, {name: name for name in blocks}, blocks, {}),
    )
    return Object(ways)


def final_error_errors(file: Parsed, parts: Set[str], with_accuracy: bool) -> list[str]:
    """Errors of `final_error` in this file.

    **Arguments**

    - `parts`: those of the state at the end.
    - `with_accuracy`: whether the file gives `accuracy`."""
    asked = file.values["final_error"]
    if asked is None:
        return []
    # Two tolerances would contradict each other.
    if with_accuracy:
        return [
            "final_error is given together with accuracy: omit one of them, because the tolerance "
            "is derived from the final error."
        ]
    if file.values.get("control") is not None:
        return [
            "final_error is not available with [control]: a closed loop uses a tolerance, "
            "accuracy, and jaxspace run prints the resulting error."
        ]
    if not isinstance(asked, Mapping):
        return []
    given = named_blocks(asked)
    if not given:
        return ["final_error is {}: it must name a part of the state, such as position."]
    return [
        unknown(f"final_error.{name}", name, sorted(parts), "part of the final state")
        for name in given
        if name not in parts
    ]


def requested_error(value: Value, accuracy: Accuracy) -> FinalError | None:
    """The error that is asked for by the value of `final_error`; `accuracy` has method and limits
    of the steps."""
    if value is None:
        return None
    if not isinstance(value, Mapping):
        return FinalError(float(value), accuracy=accuracy)
    return FinalError(None, accuracy=accuracy, **named_blocks(value))


def tolerance_of(run: Trajectory) -> float:
    """The tolerance that a run with an error at its end took."""
    return float(np.asarray(run.accuracy.rtol))


def rounded_down(tolerance: float) -> float:
    """A tolerance rounded to two digits, so that a campaign resumed on another machine has the same
    one."""
    unit = 10.0 ** (math.floor(math.log10(tolerance)) - 1)
    # By way of the text, because the multiple of a power of ten would show its roundings.
    return float(f"{math.floor(tolerance / unit) * unit:.1e}")


def named_blocks(blocks: Mapping[str, Written | None]) -> dict[str, Any]:
    """The errors of the blocks that the file names."""
    return {name: x for name, x in blocks.items() if x is not None}

"""Integration settings of the runs of a file: `accuracy`, the tolerance of the steps, a number or
"by purpose" for the campaign of the file, or `final_error`; their `method`, `max_step` and
`max_steps`."""

import inspect
from dataclasses import dataclass

import diffrax
import numpy as np

from ...core import argument
from ...core.quantities import REQUIRED
from ...dispersion.purpose import BY_PURPOSE
from ...simulation import Accuracy
from .._catalog.catalog import Catalog
from .._kinds.errors import hint, wrong
from .._kinds.kind import Entry, Maker, Reading, Schema, Value
from .._kinds.tables import Object
from .._kinds.values import Number, OneName, Whole
from .._mission.parsed import Parsed
from .._mission.states import parts_of_state
from .final_error import final_error_errors, final_error_kind


@dataclass(frozen=True, eq=False)
class Tolerance(Number):
    """A relative tolerance, or the keyword for one derived from the purpose of a campaign."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if value == BY_PURPOSE:
            return BY_PURPOSE
        if isinstance(value, str) and not any(map(str.isdigit, value)):
            reading.errors.append(wrong(path, value, self.expected()) + hint(value, [BY_PURPOSE]))
            return None
        return super().read(value, path, reading)

    def expected(self) -> str:
        return f'{super().expected()}, or "{BY_PURPOSE}"'

    def schema(self) -> Schema:
        return {"anyOf": [super().schema(), {"const": BY_PURPOSE}]}


LONGEST_STEP = Number(argument("s", positive=True, fixed=True, doc="longest step"))
# The engine resolves sixteen units in the last place of a state of 64 bits, and no tolerance above
# a half has a digit.
LEAST_ACCURACY = 16.0 * float(np.finfo(float).eps)
ACCURACY = Tolerance(argument("", low=LEAST_ACCURACY, high=0.5, fixed=True, doc="of each step"))


def accuracy_entries(catalog: Catalog, state: type) -> dict[str, Entry]:
    """Integration settings for states of this class."""
    return {
        # Far below the errors of the data of a flight, and within reach of every method in double
        # precision.
        "accuracy": Entry(
            ACCURACY, 1e-9, doc=f'relative tolerance of each step; of campaigns also "{BY_PURPOSE}"'
        ),
        "final_error": Entry(
            final_error_kind(state, ACCURACY.quantity),
            None,
            doc="that the nominal run may have at its end",
        ),
        "method": Entry(method_kind(catalog), None, doc="integrator; by default chosen by rules"),
        "max_step": Entry(LONGEST_STEP, None, doc="longest step"),
        "max_steps": Entry(Whole(), None, doc="maximum number of steps of a run"),
    }


def method_kind(catalog: Catalog) -> Object:
    """The names of the integrators; one with parameters is a table with `name` and whole
    numbers."""
    names = ["auto"]
    ways = []
    for name, cls in catalog.methods.items():
        whole = {
            key: Entry(Whole(), REQUIRED if p.default is inspect.Parameter.empty else p.default)
            for key, p in inspect.signature(cls).parameters.items()
            if p.annotation is int
        }
        # It has an argument that a file cannot give, such as a function.
        if any(
            p.default is inspect.Parameter.empty and key not in whole
            for key, p in inspect.signature(cls).parameters.items()
        ):
            continue
        if not any(entry.default is REQUIRED for entry in whole.values()):
            names.append(name)
        if whole:
            entries = {"name": Entry(OneName((name,)), doc="of the method"), **whole}
            ways.append(Maker(name, cls, {key: key for key in whole}, entries, {}))
    plain = {"name": Entry(OneName(tuple(names)), doc="of the method")}
    named = {name: cls for name, cls in catalog.methods.items() if name in names}

    def make(name: str) -> diffrax.AbstractSolver | str:
        return "auto" if name == "auto" else named[name]()

    return Object((Maker("method", make, {"name": "name"}, plain, {}, bare=True), *ways))


def accuracy_errors(file: Parsed, with_accuracy: bool) -> list[str]:
    """Errors of the accuracy that the file requests: of its `final_error`, or of a purpose without
    a campaign.

    `with_accuracy`: whether the file gives `accuracy` itself."""
    errors = final_error_errors(file, parts_of_state(file), with_accuracy)
    if file.values["accuracy"] == BY_PURPOSE and file.values["dispersion"] is None:
        errors.append(
            f'accuracy is "{BY_PURPOSE}": in a file without [dispersion] it must be a number, '
            "because the purpose is that of a campaign."
        )
    return errors


def steps_of(file: Parsed, rtol: float | None) -> Accuracy:
    """Method and limits of the steps of the file, with the relative tolerance `rtol`."""
    values = file.values
    given = {"max_step": values["max_step"], "max_steps": values["max_steps"]}
    if values["method"] is not None:
        given["method"] = file.building().make("method")
    # Omitted, so that the defaults are those of `Accuracy`.
    given = {key: value for key, value in given.items() if value is not None}
    return Accuracy(rtol=rtol, **given)

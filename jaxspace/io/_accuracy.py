"""The accuracy of the runs of a file: the tolerance of the steps, a number or "by purpose" for the
campaign of the file, and beside it their method and limits."""

from dataclasses import dataclass

from ..dispersion.purpose import BY_PURPOSE
from ..simulation import Accuracy
from ._errors import hint, wrong
from ._kinds import Reading, Schema, Value
from ._parsed import Parsed
from ._value_kinds import Number


@dataclass(frozen=True, eq=False)
class Tolerance(Number):
    """A relative tolerance, or the words for one that serves the purpose of a campaign."""

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


def tolerance_errors(file: Parsed) -> list[str]:
    """What is wrong with `accuracy` in this file: a purpose without a campaign that has it."""
    if file.values["accuracy"] != BY_PURPOSE or file.values["dispersion"] is not None:
        return []
    return [
        f'accuracy is "{BY_PURPOSE}": it must be a number in a file without [dispersion], for the '
        f"purpose is that of a campaign."
    ]


def steps_of(file: Parsed, rtol: float | None) -> Accuracy:
    """Method and limits of the steps of the file, with the relative tolerance `rtol`."""
    values = file.values
    given = {"max_step": values["max_step"], "max_steps": values["max_steps"]}
    if values["method"] is not None:
        given["method"] = file.building().make("method")
    # Omitted, so that the defaults are those of `Accuracy`.
    given = {key: value for key, value in given.items() if value is not None}
    return Accuracy(rtol=rtol, **given)

"""The accuracy of the runs of a file: method and limits of the steps, beside a tolerance."""

from ..simulation import Accuracy
from ._parsed import Parsed


def steps_of(file: Parsed, rtol: float | None) -> Accuracy:
    """Method and limits of the steps of the file, with the relative tolerance `rtol`."""
    values = file.values
    given = {"max_step": values["max_step"], "max_steps": values["max_steps"]}
    if values["method"] is not None:
        given["method"] = file.building().make("method")
    # Omitted, so that the defaults are those of `Accuracy`.
    given = {key: value for key, value in given.items() if value is not None}
    return Accuracy(rtol=rtol, **given)

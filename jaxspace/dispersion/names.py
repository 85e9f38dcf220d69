"""Names of inputs and outputs: of arrays of a store, columns of tables, and lines of a terminal."""

from collections.abc import Iterable

from ..core import InputError
from ..core.text import is_printable

RESERVED = ("run", "status", "evaluations")
"""Names of the variables that every store has."""
# Such names are reserved by Zarr and by the store.
HIDDEN = (".", "__", "zarr.json")
# Programs for tables take a text that begins so for a formula, which they evaluate.
FORMULAS = ("=", "+", "-", "@")


def check_names(field: str, names: Iterable[object]) -> None:
    """Raise `InputError` for a name that an array of a store or a column of a table cannot have.

    **Arguments**

    - `field`: the field with the names, for the message.
    - `names`: of inputs or outputs."""
    for name in names:
        if isinstance(name, tuple):
            raise InputError(
                f"{field} has the tuple {name!r} as a name: the inputs of a joint distribution are "
                "named by its method inputs, as in {**joint.inputs('a', 'b'), ...}."
            )
        if name in RESERVED:
            raise InputError(
                f"{field} has the reserved name {name!r}: it must differ from "
                f"{', '.join(RESERVED)}."
            )
        if not isinstance(name, str) or not name or name.startswith(HIDDEN):
            raise InputError(
                f"{field} has the name {name!r}: it must be text that does not begin with a dot, "
                "two underscores or zarr.json."
            )
        if name.startswith(FORMULAS) or not is_printable(name) or ".." in name.split("/"):
            raise InputError(
                f"{field} has the name {name!r}: it must be printable text that does not begin "
                f"with any of {' '.join(FORMULAS)} and is not a path."
            )

"""The table [sweep] of a scene file: numbers of the file at explicit values.

    [sweep.grid]    all combinations of the values
    [sweep.rows]    the values at the same place of each list together

Keys are paths of numbers of the file, as in [dispersion.inputs]; values are a list, or in a grid a
table with `from`, `to` and `count`. They are read after the rest of the file."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from ...sampling.distributions import fixed
from ...sampling.sweeps import grid
from .._kinds.errors import missing, unknown, wrong
from .._kinds.kind import Entry, Value, Values
from .._kinds.tables import AnyTable, Table
from .._kinds.values import Measure
from .._mission.parsed import Parsed
from ..units import expected, in_unit, read_number
from .joint_inputs import MadeInput

FORMS = ("grid", "rows")
SPAN = ("from", "to", "count")
# Each row is at least one run, and a line of the table.
MOST_ROWS = 10**6


def sweep_table() -> Table:
    """The form of the table."""
    return Table(
        {
            "grid": Entry(AnyTable(), {}, doc="values by path, of which all combinations are run"),
            "rows": Entry(AnyTable(), {}, doc="values by path, of which the k-th belong together"),
        }
    )


def read_sweep(
    file: Parsed, numbers: Mapping[str, Measure], refusal: Callable[[str, str], str]
) -> tuple[dict[str, tuple[float, ...]], list[str]]:
    """The columns of the sweep in SI by path, empty without one; and the errors of the table.

    `numbers`: those that may vary between runs; `refusal(key, path)`: the message about another
    path."""
    table = file.values["sweep"]
    if table is None:
        return {}, []
    if file.values["dispersion"] is None:
        return {}, [missing("dispersion", "a table with the outputs of the sweep")]
    given = [form for form in FORMS if table[form]]
    if len(given) != 1:
        what = "a table with either grid or rows, by path"
        return {}, [wrong("sweep", table, what)]
    (form,) = given
    columns: dict[str, list[float]] = {}
    errors = []
    for path, entry in _entries(table[form]):
        key = f"sweep.{form}.{path}"
        if path not in numbers:
            errors.append(refusal(key, path))
            continue
        try:
            columns[path] = _values(key, entry, numbers[path])
        except ValueError as error:
            errors.append(str(error))
    if errors:
        return {}, errors
    if form == "grid":
        if np.prod([len(x) for x in columns.values()], dtype=float) > MOST_ROWS:
            return {}, [f"sweep.grid has more than {MOST_ROWS} combinations: give fewer values."]
        return {path: tuple(x) for path, x in grid(columns).items()}, []
    lengths = {path: len(x) for path, x in columns.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{path} {n}" for path, n in lengths.items())
        return {}, [f"sweep.rows has lists of different lengths: {counts}; they must be equal."]
    return {path: tuple(x) for path, x in columns.items()}, []


def swept_inputs(paths: Iterable[str], numbers: Mapping[str, Measure]) -> dict[str, MadeInput]:
    """The swept numbers as inputs, whose nominal value is that of the file."""
    return {path: MadeInput(numbers[path], fixed(float(numbers[path]))) for path in paths}


def _entries(tables: Mapping[str, Value], path: str = "") -> Iterator[tuple[str, Value]]:
    """Path and values of every column; TOML reads an unquoted dotted key as a table in a table."""
    for name, value in tables.items():
        here = f"{path}.{name}" if path else name
        if isinstance(value, Mapping) and value and not set(value) & set(SPAN):
            yield from _entries(value, here)
        else:
            yield here, value


def _values(key: str, entry: Value, nominal: Measure) -> list[float]:
    """The values of a column, SI. Raises `ValueError` with the complete message."""
    if isinstance(entry, Mapping):
        return _span(key, dict(entry), nominal)
    if not (isinstance(entry, list) and entry):
        what = "a list of one or more values, or a table with from, to and count"
        raise ValueError(wrong(key, entry, what))
    return [_number(f"{key}.{k}", x, nominal) for k, x in enumerate(entry)]


def _span(key: str, entry: Values, nominal: Measure) -> list[float]:
    """Evenly spaced values."""
    for name in entry:
        if name not in SPAN:
            raise ValueError(unknown(f"{key}.{name}", name, SPAN))
    for name in SPAN:
        if name not in entry:
            what = expected(nominal.quantity) if name != "count" else "the number of values"
            raise ValueError(missing(f"{key}.{name}", what))
    count = entry["count"]
    if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= MOST_ROWS:
        raise ValueError(wrong(f"{key}.count", count, f"a whole number from 2 to {MOST_ROWS}"))
    first, last = (_number(f"{key}.{name}", entry[name], nominal) for name in SPAN[:2])
    # Spaced in the unit of the file, in which the values are round numbers.
    factor = in_unit(nominal.quantity.unit, nominal.unit or nominal.quantity.unit)
    values = np.linspace(factor * first, factor * last, count) / factor
    # Not beyond an end by rounding, which a class may reject.
    return np.clip(values, min(first, last), max(first, last)).tolist()


def _number(key: str, value: object, nominal: Measure) -> float:
    try:
        return read_number(value, nominal.quantity)[0]
    except ValueError as error:
        raise ValueError(wrong(key, value, str(error))) from None

"""The dispersed numbers of a file and their distributions: [dispersion.inputs], whose keys are
paths of numbers of the file, and those that are given in Python."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...core import InputError
from ...core.files import finite_number
from ...core.quantities import Quantity
from ...sampling import AbstractDistribution
from ...sampling.distributions import NOMINAL, SHARE_OF_INPUT
from .._kinds.errors import hint, missing, shown, unknown, wrong
from .._kinds.kind import Entry, Value, Values
from .._kinds.named_files import NamedFiles
from .._kinds.values import ListOf, Measure, Number
from .._mission.control import scatter_errors
from .._mission.parsed import Parsed
from ..units import expected, in_unit, read_number, split
from .joint_inputs import MadeInput, read_correlated, read_direction
from .sweep import read_sweep, swept_inputs

DEFAULT = "normal"
# One rejected run in a thousand changes no statistic; more are worth a warning.
RARE = 1e-3
FILE_KEYS = ("file", "column", "unit")


class Input(NamedTuple):
    """A dispersed number of the file: its nominal value, the name of its distribution, and the
    numbers of the distribution in SI."""

    nominal: Measure
    name: str
    numbers: dict[str, Any]
    cls: type[AbstractDistribution]

    def distribution(self) -> AbstractDistribution:
        """The distribution about the nominal value."""
        return self.cls(**self.numbers)  # type: ignore[call-arg]  # converted by its fields

    def warnings(self, path: str) -> list[str]:
        """Warnings about probable mistakes: a range without the nominal value, draws that the class
        of the number rejects."""
        quantity = self.nominal.quantity
        result = []
        made = self.distribution()
        low, high = self.numbers.get("low"), self.numbers.get("high")
        if low is not None and high is not None and not low <= self.nominal <= high:
            # In the unit of the file, because radians would be taken for its degrees.
            unit = self.nominal.unit or quantity.unit
            low, high, here = (in_unit(quantity.unit, unit) * x for x in (low, high, self.nominal))
            result.append(
                f"dispersion.inputs.{path} ranges from {low:.6g} to {high:.6g} {unit}".rstrip()
                + f", without the nominal value {here:.6g}."
            )
        share = made.outside(quantity.low, quantity.high)
        if share > RARE:
            result.append(
                f"dispersion.inputs.{path}: {100.0 * share:.2g} % of the runs will be rejected, "
                f"because {path} must be {quantity.allowed()}."
            )
        return result


def read_columns(file: Parsed) -> tuple[dict[str, tuple[float, ...]], list[str]]:
    """The columns of the sweep by path, SI; and errors."""
    columns, errors = read_sweep(file, _numbers(file), lambda key, x: _unknown_path(key, x, file))
    lines = (line.removeprefix("dispersion.inputs.") for line in scatter_errors(file, columns))
    return columns, errors + [f"sweep: {line}" for line in lines]


def read_inputs(
    file: Parsed, files: NamedFiles, swept: Iterable[str] = ()
) -> tuple[dict[str, Input | MadeInput], list[str]]:
    """The inputs and their distributions, or errors.

    `files`: those of values; `swept`: the paths of the sweep, which are inputs, too."""
    numbers = _numbers(file)
    result: dict[str, Input | MadeInput] = {}
    errors = []
    keys = {"distribution", *FILE_KEYS, *_fields(file)}
    for path, entry in _entries(file.values["dispersion"]["inputs"], keys):
        if path not in numbers:
            errors.append(_unknown_path(f"dispersion.inputs.{path}", path, file))
            continue
        try:
            result[path] = _read(f"dispersion.inputs.{path}", entry, numbers[path], file, files)
        except ValueError as error:
            errors.append(str(error))
    # After the single inputs, whose distributions a correlation uses.
    for table, read in (("correlated", read_correlated), ("direction", read_direction)):
        for k, entry in enumerate(file.values["dispersion"][table]):
            try:
                result |= read(f"dispersion.{table}.{k}", entry, numbers, result)
            except ValueError as error:
                errors.append(str(error))
    of_sweep = swept_inputs(swept, numbers)
    errors += [
        f"sweep: {path} is also dispersed in dispersion.inputs: give it only once."
        for path in of_sweep
        if path in result
    ]
    result = {**of_sweep, **result}
    # A campaign without inputs would repeat the nominal run.
    if not result and not errors:
        errors.append(
            missing("dispersion.inputs", "a table whose keys are paths of numbers of this file")
        )
    return result, errors


def with_distributions(
    known: Mapping[str, Input | MadeInput],
    given: Mapping[str, object],
    file: Parsed,
    files: NamedFiles,
) -> dict[str, Input | MadeInput]:
    """The inputs of the file and those `given` in Python, which override those of the file.

    `given`: by path a distribution, in SI, or a table as in [dispersion.inputs]; `files`: those of
    values. Raises `InputError`, with one line for each error."""
    numbers = _numbers(file)
    result = dict(known)
    errors = [line.removeprefix("dispersion.") for line in scatter_errors(file, given)]
    for path, entry in given.items():
        key = f"inputs.{path}"
        if path not in numbers:
            errors.append(_unknown_path(key, path, file))
        elif isinstance(entry, AbstractDistribution):
            result[path] = MadeInput(numbers[path], entry)
        elif isinstance(entry, Mapping):
            try:
                result[path] = _read(key, entry, numbers[path], file, files)
            except ValueError as error:
                errors.append(str(error))
        else:
            errors.append(
                f"{key} is {entry!r}: it must be a distribution, or a table such as "
                f'{{"deviation": ...}}.'
            )
    errors += [line for path in given if path in known for line in _torn(path, known, given)]
    if errors:
        raise InputError("\n".join(errors))
    return result


def changed_distributions(
    changes: Mapping[str, Mapping[str, object]],
    known: Mapping[str, Input | MadeInput],
    file: Parsed,
    files: NamedFiles,
) -> dict[str, AbstractDistribution]:
    """The distributions of inputs of the file with other values of some keys, by path.

    `changes`: the keys as in [dispersion.inputs], by path. Raises `InputError`, with one line for
    each error."""
    keys = {"distribution", *FILE_KEYS, *_fields(file)}
    written = dict(_entries(file.values["dispersion"]["inputs"], keys))
    result, errors = {}, []
    for path, entry in changes.items():
        how = known.get(path)
        if not isinstance(how, Input):
            together = [p for p in known if isinstance(known[p], Input)]
            errors.append(
                f"{path} is drawn together with other numbers: change it in Python."
                if how is not None and path not in written
                else unknown(path, path, together, "input of this file")
            )
            continue
        old = written[path]
        assert isinstance(old, Mapping)
        # The keys of another distribution would be unknown to it.
        kept = {} if "distribution" in entry else dict(old)
        try:
            result[path] = _read(path, {**kept, **entry}, how.nominal, file, files).distribution()
        except ValueError as error:
            errors.append(str(error))
    if errors:
        raise InputError("\n".join(errors))
    return result


def _torn(
    path: str, known: Mapping[str, Input | MadeInput], given: Mapping[str, object]
) -> Iterator[str]:
    """Errors for numbers that are replaced without the others with which the file disperses
    them."""
    source = known[path].distribution().source
    others = [p for p in known if source and known[p].distribution().source == source]
    left = [p for p in others if p not in given]
    # A direction would lose its length, and a correlation would quietly be another one.
    if left:
        yield (
            f"inputs.{path} is correlated with other inputs: {', '.join(left)} must also be given."
        )


def _numbers(file: Parsed) -> dict[str, Measure]:
    """The numbers of the file that may be dispersed, by path."""
    # Without the numbers of the distributions.
    return {p: m for p, m in measures(file.values) if not p.startswith("dispersion")}


def measures(values: Value, path: str = "") -> Iterator[tuple[str, Measure]]:
    """The path of every number that may be dispersed, and the number."""
    if isinstance(values, Measure):
        yield path, values
    items: Iterable[tuple[object, Value]] = ()
    if isinstance(values, Mapping):
        items = values.items()
    elif isinstance(values, list):
        items = enumerate(values)
    for name, value in items:
        yield from measures(value, f"{path}.{name}" if path else str(name))


def _fields(file: Parsed) -> set[str]:
    """The fields of all distributions."""
    kinds = [file.catalog.kinds[cls] for cls in file.catalog.distributions.values()]
    return {key for kind in kinds for way in kind.ways for key in way.entries}


def _entries(
    tables: Mapping[str, Value], keys: set[str], path: str = ""
) -> Iterator[tuple[str, Value]]:
    """Path and entry of every input; a path may be one quoted key or a table in a table."""
    for name, value in tables.items():
        here = f"{path}.{name}" if path else name
        # TOML reads an unquoted dotted key as a table in a table.
        nested = isinstance(value, dict) and any(isinstance(v, dict) for v in value.values())
        if nested and not set(value) & keys:
            yield from _entries(value, keys, here)
        else:
            yield here, value


def _unknown_path(key: str, path: str, file: Parsed) -> str:
    """The message about a path that is not that of a number that may be dispersed."""
    if _is_fixed(path, file.values):
        return (
            f"{key} cannot be dispersed: the number {path} sets the form of the program, such as "
            "the number of its samples, and is the same for all runs."
        )
    paths = list(_numbers(file))
    table = path.rpartition(".")[0]
    # The numbers of the same table; where that is unknown too, the tables.
    near = [p for p in paths if p.rpartition(".")[0] == table] or sorted(
        {p.partition(".")[0] + ".*" for p in paths}
    )
    sentence = unknown(key, path, near, "number of this file")
    return sentence.partition(" Did you mean")[0] + hint(path, paths)


def _is_fixed(path: str, values: Value) -> bool:
    """Whether the path is that of a number of the file that is the same for all runs."""
    for name in path.split("."):
        if (
            isinstance(values, list)
            and name.isascii()
            and name.isdigit()
            and int(name) < len(values)
        ):
            values = values[int(name)]
        else:
            values = values.get(name) if isinstance(values, Mapping) else None
    return isinstance(values, int | float) and not isinstance(values, bool)


def _read(key: str, entry: Value, nominal: Measure, file: Parsed, files: NamedFiles) -> Input:
    """An input and its distribution. Raises `ValueError` with the complete message."""
    if not isinstance(entry, Mapping):
        raise ValueError(wrong(key, entry, "a table, such as { deviation = ... }"))
    known = file.catalog.distributions
    name = entry.get("distribution", DEFAULT)
    if not isinstance(name, str) or name not in known:
        what = f"one of {', '.join(known)}"
        raise ValueError(wrong(f"{key}.distribution", name, what) + hint(name, known))
    cls = known[name]
    fields = file.catalog.kinds[cls].ways[0].entries
    # Measured values may be in a separate file.
    file_keys = FILE_KEYS if "values" in fields and "weights" not in fields else ()
    for given in entry:
        if given not in ("distribution", *fields, *file_keys):
            raise ValueError(unknown(f"{key}.{given}", given, fields, f"key of {name}"))
    numbers: dict[str, Any] = {}
    entry = _with_file(key, dict(entry), files) if "file" in entry else entry
    for field, declared in fields.items():
        if field in entry:
            numbers[field] = _value(f"{key}.{field}", entry[field], nominal, declared)
        # The mean is the value of the file, which need not be written twice.
        elif declared.shared == NOMINAL:
            numbers[field] = float(nominal)
        else:
            raise ValueError(missing(f"{key}.{field}", _expected(nominal, declared)))
    # Built once here, because only the class checks its numbers together.
    try:
        cls(**numbers)
    except InputError as error:
        owner, _, rest = str(error).partition(".")
        raise ValueError(f"{key}.{rest}" if owner == cls.__name__ else f"{key}: {error}") from None
    return Input(nominal, name, numbers, cls)


def _with_file(key: str, entry: Values, files: NamedFiles) -> Values:
    """The entry with the values of its file: a number a line, or a named column of a CSV file."""
    if "values" in entry or not isinstance(entry["file"], str):
        raise ValueError(wrong(f"{key}.file", entry["file"], "the name of a file, without values"))
    path = files.path(entry["file"])
    column = entry.get("column")
    for name in ("column", "unit"):
        if not isinstance(entry.get(name, ""), str):
            raise ValueError(wrong(f"{key}.{name}", entry[name], "text"))
    try:
        source = io.StringIO(files.text(entry["file"]), newline="")
    except ValueError as error:
        raise ValueError(f"{key}.file: {error}") from None
    unit = entry.get("unit", "")
    values = []
    try:
        for number, text in _column(path, source, column):
            value = finite_number(text)
            if value is None:
                raise ValueError(f"line {number} of {path} is {shown(text)}: it must be a number.")
            # Followed by its unit, as a number of the scene file is.
            values.append(f"{value!r} {unit}" if unit else value)
    except csv.Error as error:
        raise ValueError(f"{key}.file: {path} cannot be read as CSV: {error}.") from None
    except ValueError as error:
        raise ValueError(f"{key}.file: {error}") from None
    if not values:
        raise ValueError(f"{key}.file: {path} contains no numbers{f' in {column}' * bool(column)}.")
    parameters = {name: value for name, value in entry.items() if name not in FILE_KEYS}
    return {**parameters, "values": values}


def _column(path: Path, source: io.StringIO, column: str | None) -> Iterator[tuple[int, str]]:
    """The fields of a column, or of a file with one number a line, with the numbers of their lines.

    Raises `ValueError` for a line with another number of fields: with a decimal comma the number
    would be cut at it, and the columns behind it would be shifted."""
    reader = csv.reader(source)
    heads = None if column is None else [head.strip() for head in next(reader, [])]
    width, place = 1, 0
    if heads is not None:
        if column not in heads:
            return
        width, place = len(heads), heads.index(column)
    for fields in reader:
        if not fields:
            continue
        if any(field.strip() for field in fields[width:]):
            raise ValueError(
                f"line {reader.line_num} of {path} has {len(fields)} fields: it must have {width}."
            )
        if place < len(fields):
            yield reader.line_num, fields[place]


def _value(key: str, value: object, nominal: Measure, entry: Entry) -> float | list[float]:
    """A field of a distribution: a number, or a list of them."""
    declared = _declared(entry)
    if not isinstance(entry.kind, ListOf):
        return _number(key, value, nominal, declared)
    if not (isinstance(value, list) and value):
        raise ValueError(wrong(key, value, _expected(nominal, entry)))
    return [_number(f"{key}.{k}", v, nominal, declared) for k, v in enumerate(value)]


def _declared(entry: Entry) -> Quantity:
    """The quantity of each number of a field of a distribution."""
    kind = entry.kind.kind if isinstance(entry.kind, ListOf) else entry.kind
    assert isinstance(kind, Number)
    return kind.quantity


def _expected(nominal: Measure, entry: Entry) -> str:
    """Description of the allowed values of a field of a distribution, for a message."""
    one = expected(_quantity_in_unit(nominal, _declared(entry)))
    return f"a list of one or more entries, each {one}" if isinstance(entry.kind, ListOf) else one


def _quantity_in_unit(nominal: Measure, declared: Quantity) -> Quantity:
    """The quantity of a number of a distribution: that of the nominal value, with the range of the
    field."""
    # A pure number, such as a weight, does not have the unit of the input.
    if declared.unit == "1":
        return declared._replace(unit="")
    return nominal.quantity._replace(low=declared.low, high=declared.high, strict=declared.strict)


def _number(key: str, value: object, nominal: Measure, declared: Quantity) -> float:
    """A number in the unit of the nominal value; a difference may be a percentage of it."""
    quantity = _quantity_in_unit(nominal, declared)
    try:
        share = declared.unit == SHARE_OF_INPUT
        # A difference may be relative; a value of the input, such as a limit, may not.
        if share and isinstance(value, str) and value.rstrip().endswith("%"):
            percent = split(value, expected(quantity))[0] / 100.0
            if nominal == 0.0 or not percent > 0.0:
                what = "a positive percentage of a non-zero nominal value, or "
                raise ValueError(what + expected(quantity))
            return percent * abs(float(nominal))
        return read_number(value, quantity)[0]
    except ValueError as error:
        raise ValueError(wrong(key, value, str(error))) from None

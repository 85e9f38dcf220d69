"""Which numbers of a file scatter, and how: [dispersion.inputs], whose keys are paths of the file's
own numbers."""

from collections.abc import Iterator
from typing import Any

from ..dispersion import AbstractDistribution, Normal, TruncatedNormal, Uniform
from ._checks import unknown_path
from ._errors import missing, wrong
from ._quantities import Choice, Measure, Quantity, split
from ._tables import Key, checked
from ._values import measures

LIMITS = {"normal": (), "uniform": ("low", "high"), "truncated_normal": ("low", "high")}
FORM = {
    "distribution": Key(Choice(tuple(LIMITS)), "normal"),
    **{k: Key(object, None) for k in ("deviation", "low", "high")},
}


def entries(tables: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Path and entry of every input; a path may be one quoted key or a table in a table."""
    for name, value in tables.items():
        here = f"{path}.{name}" if path else name
        if isinstance(value, dict) and not (
            set(value) & set(FORM) or not any(isinstance(v, dict) for v in value.values())
        ):
            yield from entries(value, here)
        else:
            yield here, value


def distributions(
    values: dict[str, Any],
) -> tuple[dict[str, tuple[str, dict[str, float]]], list[str]]:
    """For every input the name of its distribution and its numbers in SI; or what is wrong."""
    numbers = {path: m for path, m in measures(values) if not path.startswith("dispersion")}
    found: dict[str, tuple[str, dict[str, float]]] = {}
    complaints = []
    for path, entry in entries(values["dispersion"]["inputs"]):
        if path not in numbers:
            complaints.append(unknown_path(path, list(numbers)))
            continue
        try:
            found[path] = _read(f"dispersion.inputs.{path}", entry, numbers[path])
        except ValueError as error:
            complaints.append(str(error))
    if not found and not complaints:
        complaints.append(
            missing("dispersion.inputs", "a table whose keys are paths of numbers of this file")
        )
    return found, complaints


def _read(key: str, entry: Any, nominal: Measure) -> tuple[str, dict[str, float]]:
    """Raises `ValueError` with the whole sentence."""
    form = {
        k: Key(str if spec.kind is object else spec.kind, spec.default) for k, spec in FORM.items()
    }
    texts = entry
    if isinstance(entry, dict):
        texts = {k: str(v) if k in form and k != "distribution" else v for k, v in entry.items()}
    _, wrongs = checked({"entry": Key(form)}, {"entry": texts})
    if wrongs:
        raise ValueError(wrongs[0].replace("entry", key, 1))
    name = entry.get("distribution", "normal")
    wanted = LIMITS[name] if name == "uniform" else ("deviation", *LIMITS[name])
    for k in wanted:
        if k not in entry:
            raise ValueError(missing(f"{key}.{k}", nominal.quantity.allowed()))
    for k in entry:
        if k not in ("distribution", *wanted):
            raise ValueError(
                f"{key}.{k} has no place in the distribution {name}: give {', '.join(wanted)}."
            )
    numbers = {k: _number(f"{key}.{k}", entry[k], nominal, k == "deviation") for k in wanted}
    if "low" in numbers and not numbers["low"] < numbers["high"]:
        raise ValueError(wrong(f"{key}.high", entry["high"], "above low"))
    if name == "truncated_normal" and not numbers["low"] <= nominal <= numbers["high"]:
        raise ValueError(
            f"{key}: the nominal value {float(nominal):.6g} lies outside of low and high."
        )
    return name, numbers


def _number(key: str, value: Any, nominal: Measure, deviation: bool) -> float:
    """A number in the unit of the nominal value; a deviation may be a percentage of it."""
    quantity = nominal.quantity
    if deviation:
        quantity = Quantity(quantity.name, quantity.unit, quantity.example, "positive")
    try:
        if deviation and isinstance(value, str) and value.rstrip().endswith("%"):
            share = split(value, quantity.allowed())[0] / 100.0
            if nominal == 0.0 or not share > 0.0:
                raise ValueError(
                    "a positive percentage of a nominal value that is not zero, or "
                    + quantity.allowed()
                )
            return share * abs(float(nominal))
        return float(quantity.read(value))
    except ValueError as error:
        raise ValueError(wrong(key, value, str(error))) from None


def distribution(name: str, numbers: dict[str, float], nominal: float) -> AbstractDistribution:
    """The distribution about the nominal value."""
    kind: Any = {"normal": Normal, "uniform": Uniform, "truncated_normal": TruncatedNormal}[name]
    return kind(**numbers) if name == "uniform" else kind(mean=float(nominal), **numbers)

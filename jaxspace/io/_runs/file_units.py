"""The inputs of a campaign in the units in which its scene file writes them, for tables and
pages."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...core.printing import units_of
from ...sampling.distributions import OF_INPUT, SHARE_OF_INPUT
from ...statistics import Dispersion
from .._file_content import FileContent
from .._kinds.values import Measure
from .._requests.inputs import Input
from ..units import in_unit


def in_file_units(file: FileContent, result: Dispersion) -> Dispersion:
    """The dispersion with its inputs in the units of the file: see `SceneFile.in_units`."""
    inputs, units = dict(result.inputs), dict(result.units)
    changed = {}
    for path, how in file.inputs.items():
        si, unit = how.nominal.quantity.unit, how.nominal.unit
        # Inputs of a campaign that was changed in Python may have other units.
        if path in inputs and unit and unit != si == units.get(path):
            changed[path] = in_unit(si, unit)
            inputs[path] = changed[path] * np.asarray(inputs[path], float)
            units[path] = unit
    text = "\n".join(_lines(file, str(result.attributes.get("inputs", "")), changed))
    return dataclasses.replace(
        result, inputs=inputs, units=units, attributes={**result.attributes, "inputs": text}
    )


def _lines(file: FileContent, text: str, factors: Mapping[str, float]) -> Iterator[str]:
    """The lines of the text of the inputs, those of the inputs with `factors` in their units."""
    known = {}
    for path, factor in factors.items():
        how = file.inputs[path]
        made = how.distribution().text()
        line = f"{path} [{how.nominal.quantity.unit}]: {made}"
        known[line] = line
        if isinstance(how, Input):
            known[line] = f"{path} [{how.nominal.unit}]: {_scaled(how, factor)}"
        elif path in file.sweep:
            shown = f"constant, value {factor * float(how.nominal):.9g}"
            known[line] = f"{path} [{how.nominal.unit}]: {shown}"
            values = [factor * x for x in file.sweep[path]]
            before = ", ".join(f"{x!r}" for x in file.sweep[path])
            known[f"sweep of {path}: {before}"] = _column(path, values, how.nominal)
    for line in text.split("\n"):
        yield known.get(line, line)


def _scaled(how: Input, factor: float) -> str:
    """The text of a distribution in another unit."""
    units = units_of(how.cls)
    numbers = {
        # A pure number, such as a weight, does not have the unit of the input.
        name: factor * np.asarray(x) if units.get(name) in (OF_INPUT, SHARE_OF_INPUT) else x
        for name, x in how.numbers.items()
    }
    return how.cls(**numbers).text()  # type: ignore[call-arg]  # converted by its fields


def _column(path: str, values: Sequence[float], nominal: Measure) -> str:
    return f"sweep of {path} [{nominal.unit}]: " + ", ".join(f"{x:.9g}" for x in values)

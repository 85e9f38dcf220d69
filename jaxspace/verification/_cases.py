"""The edge cases shipped with the library: rows of `cases.toml`, and the functions that they
name."""

import tomllib
from pathlib import Path
from types import ModuleType

from . import (
    _attitude_functions,
    _core_functions,
    _orbit_functions,
    _rocket_functions,
    _simulation_functions,
)
from ._case import Case

FUNCTIONS: dict[str, ModuleType] = {
    "core": _core_functions,
    "orbits": _orbit_functions,
    "attitude": _attitude_functions,
    "rockets": _rocket_functions,
    "simulation": _simulation_functions,
}
"""Modules of the functions of the rows, by the prefix of their name."""
ROWS = Path(__file__).parent / "cases.toml"


def _case_of(row: dict) -> Case:
    """The case of a row of the table."""
    place, _, name = row["function"].partition(".")
    # Tuples, because cases are compared and hashed.
    numbers = {key: tuple(row[key]) for key in ("inputs", "value") if key in row}
    slopes = tuple(tuple(slope) for slope in row.get("slopes", ()))
    return Case(**{**row, **numbers, "function": getattr(FUNCTIONS[place], name), "slopes": slopes})


CASES: tuple[Case, ...] = tuple(map(_case_of, tomllib.loads(ROWS.read_text())["case"]))
"""Every case that the library ships."""

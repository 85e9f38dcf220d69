"""Values of a scene file: numbers with or without a unit, read into SI and remembered with what
they measure."""

import functools
import math
import re
from typing import Any, NamedTuple

from ._errors import hint

NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*)?")
UNIT = re.compile(r"[A-Za-z°µ%0-9 */^().-]{1,40}")


class Quantity(NamedTuple):
    """A kind of number: its `name`, its `unit` in SI and an `example` with another unit, and which
    numbers are allowed.

    - `sign`: "positive", "not negative" or "" for any finite number.
    - `fixed`: not to be dispersed (it sets the shape of the computation)."""

    name: str
    unit: str
    example: str
    sign: str = ""
    fixed: bool = False

    def allowed(self) -> str:
        """What a value must be, for a sentence."""
        number = f"a {self.sign} number" if self.sign else "a number"
        if not self.unit:
            return f"{number} without unit ({self.name}), such as {self.example}"
        return (
            f'{number} in {self.unit} or text with a unit of {self.name}, such as "{self.example}"'
        )

    def read(self, value: Any) -> "Measure | float":
        """The value in SI. Raises `ValueError`, with what is allowed, for anything else."""
        if isinstance(value, str):
            number = self._with_unit(value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
        else:
            raise ValueError(self.allowed())
        self.check(number)
        return number if self.fixed else Measure.of(number, self)

    def check(self, number: float) -> None:
        """Raise `ValueError` unless the sign of `number` is allowed and it is finite."""
        good = {"positive": number > 0.0, "not negative": number >= 0.0, "": True}[self.sign]
        if not (good and math.isfinite(number)):
            raise ValueError(self.allowed())

    def _with_unit(self, text: str) -> float:
        number, unit = split(text, self.allowed())
        found = pint_unit(unit, self.allowed())
        # Cycles per second measure the same dimension as radians per second, and differ by 2 pi.
        cycles = (
            self.unit.startswith("rad")
            and re.search(r"hertz|counts|becquerel", str(found)) is not None
        )
        if cycles or not found.is_compatible_with(self.unit or "dimensionless"):
            raise ValueError(self.allowed())
        return float(units().Quantity(number, found).to(self.unit or "dimensionless").magnitude)


class Measure(float):
    """A number in SI that knows which `Quantity` it is."""

    quantity: Quantity

    @classmethod
    def of(cls, number: float, quantity: Quantity) -> "Measure":
        """The `number` as a measure of this quantity."""
        measure = cls(number)
        measure.quantity = quantity
        return measure


class Choice(NamedTuple):
    """One name out of several."""

    names: tuple[str, ...]

    def allowed(self) -> str:
        """What a value must be, for a sentence."""
        return f"one of {', '.join(self.names)}"

    def read(self, value: Any) -> str:
        """The name. Raises `ValueError`, with what is allowed, for any other."""
        if value not in self.names:
            raise ValueError(self.allowed() + ("." + hint(value, self.names)).rstrip("."))
        return value


def split(text: str, allowed: str) -> tuple[float, str]:
    """Number and unit of a text such as "400 mi". Raises `ValueError` with what is allowed."""
    found = NUMBER.fullmatch(text)
    unit = "" if found is None else (found[2] or "").strip()
    if found is None or (unit and not UNIT.fullmatch(unit)):
        raise ValueError(allowed)
    return float(found[1]), unit


def pint_unit(text: str, allowed: str) -> Any:
    """The unit named by a text. Only names and powers of units are read; nothing is evaluated.
    Raises `ValueError`."""
    import pint

    try:
        return units().parse_units(text)
    except (
        pint.PintError,
        ValueError,
        TypeError,
        AttributeError,
        ArithmeticError,
        AssertionError,
        SyntaxError,
    ) as error:
        raise ValueError(f"{allowed}; {text} is no unit") from error


@functools.cache
def units() -> Any:
    """The registry of units, read when the first value with a unit is met."""
    import pint

    return pint.UnitRegistry()

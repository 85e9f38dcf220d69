"""Units of a scene file: numbers with or without one, read into SI."""

import functools
import math
import re
from typing import TYPE_CHECKING, NamedTuple

from ..core import InputError
from ..core.common_units import factor_to
from ..core.extras import extra
from ..core.quantities import Quantity

if TYPE_CHECKING:
    import pint

NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*)?")
# A short alphabet, so that the unit parser gets nothing but units.
UNIT = re.compile(r"[A-Za-z°µ%0-9 */^().-]{1,40}")


class Dimension(NamedTuple):
    """The dimension of an SI unit, and an example with another unit."""

    name: str
    example: str


DIMENSIONS = {
    "": Dimension("a pure number", "0.01"),
    "m": Dimension("length", "400 mi"),
    "m/s": Dimension("speed", "7.8 km/s"),
    "m^2": Dimension("area", "2 ft^2"),
    "s": Dimension("time", "90 min"),
    "kg": Dimension("mass", "60 kg"),
    "N": Dimension("force", "68 kN"),
    "N s": Dimension("impulse", "5.8 MN s"),
    "N m": Dimension("moment of force", "3 ft lbf"),
    "rad": Dimension("angle", "28.5 deg"),
    "rad/s": Dimension("angular rate", "5.5 rpm"),
    "kg m^2": Dimension("moment of inertia", "12 slug ft^2"),
    "m^3/s^2": Dimension("gravitational parameter", "398600.4418 km^3/s^2"),
    "kg/m^3": Dimension("density", "1.2 kg/m^3"),
    "kg/m^2": Dimension("mass over area", "50 kg/m^2"),
    "m/s^2": Dimension("acceleration", "9.80665 m/s^2"),
}
# Units of which an SI unit has more than this many are those of small things only.
SMALL = 10.0
WHOLE_TURN = 2.0 * math.pi


class WrittenUnits:
    """The units in which a file gives its numbers, which are those of its reports.

    A result is given in the unit of the key with its name, else in the first one of its kind that
    is not small: the diameter of a tube in mm does not determine the unit of an altitude."""

    def __init__(self) -> None:
        self.of_keys: dict[tuple[str, str], str] = {}
        self.of_kinds: dict[str, str] = {}

    def add(self, path: str, si: str, unit: str) -> None:
        """The number at `path`, whose unit in SI is `si`, is written in `unit`."""
        self.of_keys.setdefault((_key(path), si), unit)
        # Dimensionless numbers are not a kind, because their units are not interchangeable.
        # A degree is small, and yet the unit of all angles.
        if si and ("rad" in si or in_unit(si, unit) <= SMALL):
            self.of_kinds.setdefault(si, unit)

    def take(self, other: "WrittenUnits") -> None:
        """Add the units of another part of the file; earlier ones stay."""
        self.of_keys = {**other.of_keys, **self.of_keys}
        self.of_kinds = {**other.of_kinds, **self.of_kinds}

    def of(self, path: str, si: str, default: str | None = None) -> str:
        """The unit for the result or number at `path`; `default` where the file has none of this
        kind, instead of that in SI."""
        default = si if default is None else default
        return self.of_keys.get((_key(path), si), self.of_kinds.get(si, default))


def _key(path: str) -> str:
    """The key of a path: its last step that is not a component number."""
    return [step for step in path.split(".") if not step.isdigit()][-1]


def dimension(unit: str) -> Dimension:
    """The dimension of the unit; the unit itself if the library has no name for it."""
    return DIMENSIONS.get(unit, Dimension(unit, f"1 {unit}"))


def expected(quantity: Quantity) -> str:
    """Description of the allowed values of the quantity, for a message."""
    number = "a number"
    if quantity.low == 0.0 and quantity.high == math.inf:
        number = "a positive number" if quantity.strict else "a number of zero or more"
    elif quantity.low > -math.inf or quantity.high < math.inf:
        number = f"a number {quantity.allowed().removesuffix(', and finite')}"
    name, example = dimension(quantity.unit)
    if not quantity.unit:
        return f"{number} without unit, such as {example}"
    return f'{number} in {quantity.unit} or text with a unit of {name}, such as "{example}"'


def read_number(value: object, quantity: Quantity) -> tuple[float, str]:
    """The value in SI, and the unit in which it is written (empty for a bare number).

    Raises `ValueError`, with the expected values, for anything else."""
    unit = ""
    if isinstance(value, str):
        number, unit = _with_unit(value, quantity)
    # In Python a truth value is a number: `true` must not mean one.
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
        if quantity.unit == "rad" and WHOLE_TURN < abs(number) < math.inf:
            # More than a turn in radians is most likely an angle in degrees without its unit.
            raise ValueError(
                f"an angle with its unit, because {number:g} rad is more than a turn: "
                f'"{number:g} deg" or "{number:g} rad"'
            )
    else:
        raise ValueError(expected(quantity))
    if not quantity.contains(number):
        raise ValueError(expected(quantity))
    return number, unit


def _with_unit(text: str, quantity: Quantity) -> tuple[float, str]:
    what = expected(quantity)
    number, unit = split(text, what)
    if not unit:
        return read_number(number, quantity)
    factor = factor_to(quantity.unit, unit)
    if factor is not None:
        return number * factor, unit
    result = parse_unit(unit, what)
    si = quantity.unit or "dimensionless"
    # Cycles per second have the dimension of radians per second, and differ by 2 pi.
    cycles = quantity.unit.startswith("rad") and re.search("hertz|counts|becquerel", str(result))
    if cycles or not result.is_compatible_with(si):
        raise ValueError(what)
    return float(units().Quantity(number, result).to(si).magnitude), unit


def split(text: str, what: str) -> tuple[float, str]:
    """Number and unit of a text such as "400 mi". Raises `ValueError` with the expected values."""
    result = NUMBER.fullmatch(text)
    unit = "" if result is None else (result[2] or "").strip()
    if result is None or (unit and not UNIT.fullmatch(unit)):
        raise ValueError(what)
    return float(result[1]), unit


def parse_unit(text: str, what: str) -> "pint.Unit":
    """The unit named by a text. Only names and powers of units are read; nothing is evaluated.
    Raises `ValueError`."""
    # Imported here, because the registry takes time, and most files have SI numbers alone.
    with extra("app"):
        import pint

    if not UNIT.fullmatch(text):
        raise ValueError(what)
    try:
        return units().parse_units(text)
    # The parser of pint raises internal errors for unusual texts, none of which may reach a user as
    # a traceback.
    except (
        pint.PintError,
        ValueError,
        TypeError,
        AttributeError,
        ArithmeticError,
        AssertionError,
        SyntaxError,
    ) as error:
        raise ValueError(f"{what}; {text} is not a unit") from error


def read_option(name: str, text: str, quantity: Quantity) -> float:
    """A number of the command line in SI, of which a bare one is in SI already.

    **Arguments**

    - `name`: of the value, for the message.
    - `quantity`: of the value, such as a positive length for "10 m".

    **Raises** `InputError` for another kind of number."""
    try:
        # The command line hands over text only.
        value = float(text)
    except ValueError:
        value = text
    try:
        return read_number(value, quantity)[0]
    except ValueError as error:
        raise InputError(f'{name} is "{text}": it must be {error}.') from error


def in_unit(si: str, unit: str) -> float:
    """The number of `unit` in one `si`. Raises `ValueError` for another dimension."""
    # Exactly 1, without the rounding of a conversion.
    if unit == si:
        return 1.0
    factor = factor_to(si, unit)
    if factor is not None:
        return 1.0 / factor
    what = f"a unit of {dimension(si).name}"
    result = parse_unit(unit, what)
    if not result.is_compatible_with(si or "dimensionless"):
        raise ValueError(what)
    return float(units().Quantity(1.0, si or "dimensionless").to(result).magnitude)


@functools.cache
def units() -> "pint.UnitRegistry":
    """The registry of units, read when the first value with a unit is met."""
    with extra("app"):
        import pint

    return pint.UnitRegistry()

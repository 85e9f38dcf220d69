"""The most common units of files, read without the units library, whose import takes as long as
that of a whole scene file."""

import functools
import math
import re
from collections import Counter
from typing import NamedTuple

DEGREE = math.pi / 180.0
# A factor, and the powers of SI base units, of which an angle has its own.
UNITS: dict[str, tuple[float, dict[str, int]]] = {
    "1": (1.0, {}),
    "%": (0.01, {}),
    **{name: (x, {"s": 1}) for name, x in {
        "s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "d": 86400.0, "day": 86400.0,
    }.items()},
    **{name: (x, {"m": 1}) for name, x in {
        "m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "mi": 1609.344, "ft": 0.3048, "nmi": 1852.0,
    }.items()},
    **{name: (x, {"kg": 1}) for name, x in {"kg": 1.0, "g": 1e-3, "t": 1e3}.items()},
    **{name: (x, {"kg": 1, "m": 1, "s": -2}) for name, x in {
        "N": 1.0, "kN": 1e3, "MN": 1e6,
    }.items()},
    **{name: (x, {"kg": 1, "m": -1, "s": -2}) for name, x in {"Pa": 1.0, "kPa": 1e3}.items()},
    **{name: (x, {"rad": 1}) for name, x in {
        "rad": 1.0, "deg": DEGREE, "arcmin": DEGREE / 60.0, "arcsec": DEGREE / 3600.0,
    }.items()},
    "rpm": (math.pi / 30.0, {"rad": 1, "s": -1}),
}  # fmt: skip
# A product, or one over a single unit: a further one would belong to either side.
ONE = r"[A-Za-z%]+(?:\^\d)?"
PRODUCT = re.compile(rf"(?P<above>1|{ONE}(?: {ONE})*)(?:/(?P<below>{ONE}))?")


class Unit(NamedTuple):
    """A `factor` to SI, and the powers of base units."""

    factor: float
    powers: dict[str, int]


def factor_to(si: str, text: str) -> float | None:
    """The number of units `si` in one unit `text`; `None` where one of them is not common,
    or of another kind."""
    unit, base = _unit(text), _unit(si or "1")
    if unit is None or base is None:
        return None
    # An angle is also accepted as a pure number.
    if unit.powers != base.powers and not (unit.powers == {"rad": 1} and not base.powers):
        return None
    return unit.factor / base.factor


def factor_between(given: str, shown: str) -> float | None:
    """The number of units `shown` in one unit `given`, for numbers of both that are drawn together;
    `None` where that is unknown, because one of them is not common, or of another kind."""
    # A unit that is not common is the same as itself.
    return 1.0 if given == shown else factor_to(shown, given)


@functools.lru_cache(maxsize=256)
def _unit(text: str) -> Unit | None:
    """A unit by its text; `None` for one that is not common."""
    parts = PRODUCT.fullmatch(text)
    if parts is None:
        return None
    factor = 1.0
    powers: Counter[str] = Counter()
    sides = [(name, 1) for name in parts["above"].split()]
    sides += [(parts["below"], -1)] if parts["below"] else []
    for name, sign in sides:
        name, _, power = name.partition("^")
        if name not in UNITS:
            return None
        own, bases = UNITS[name]
        power = sign * int(power or 1)
        factor *= own**power
        powers.update({base: power * each for base, each in bases.items()})
    return Unit(factor, {base: power for base, power in powers.items() if power})

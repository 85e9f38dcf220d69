"""Gravity fields from files of the International Centre for Global Earth Models (ICGEM, `.gfc`).

    product_type            gravity_field
    modelname               the name
    earth_gravity_constant  mu, m^3/s^2 (or gravity_constant)
    radius                  R, m
    max_degree              greatest degree of the file
    norm                    fully_normalized
    tide_system             tide_free, zero_tide, mean_tide or unknown
    end_of_head
    gfc  n  m  C  S         a line for each degree and order; errors may follow

Source: Barthelmes and Foerste, The ICGEM-format, GFZ Potsdam (2011). Such files are at
https://icgem.gfz.de, those of moons and planets included; their licence is that of each model.

Fields that vary with time (`gfct`, `trnd`, `acos`, `asin`) are rejected.
"""

__all__ = ["GravityField", "read_gfc"]

import os
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import InputError
from ..core.files import finite_number, read_text
from ..core.printing import printed

MU = ("earth_gravity_constant", "gravity_constant")
TIDES = ("tide_free", "zero_tide", "mean_tide", "unknown")
VARYING = ("gfct", "trnd", "dot", "acos", "asin")
# Beyond it the recursion of the harmonics leaves the range of the numbers.
GREATEST = 1400


@printed(mu="m^3/s^2", radius="m")
class GravityField(NamedTuple):
    """A gravity field, in NumPy.

    - `name`: of the model.
    - `mu`, m^3/s^2, and `radius`, m: to which the coefficients refer.
    - `coefficients`: C and S, fully normalised, by degree and order from zero on, (2, degrees,
      orders).
    - `tide_system`: "tide_free", "zero_tide", "mean_tide" or "unknown"."""

    name: str
    mu: float
    radius: float
    coefficients: Float[np.ndarray, "2 degrees orders"]
    tide_system: str = "unknown"


def read_gfc(
    path: str | os.PathLike[str], degree: int | None = None, order: int | None = None
) -> GravityField:
    """The gravity field of an ICGEM file.

    **Arguments**

    - `path`: of the file.
    - `degree`, `order`: the greatest of the coefficients; by default all of the file, and as many
      orders as degrees.

    **Raises** `InputError` with the line of a file that is of another type, truncated, not fully
    normalised or varying with time, of a number that is not one and of a coefficient that is twice
    in it; and for a degree beyond that of the file."""
    lines = read_text(path).splitlines()
    head, first = _head(path, lines)
    for key, allowed in (
        ("product_type", ("gravity_field",)),
        ("norm", ("fully_normalized",)),
        ("tide_system", TIDES),
    ):
        where, word = head.get(key, (0, allowed[-1]))
        if word not in allowed:
            raise InputError(
                f"{path}, line {where}: {key} is {word[:40]!r}: it must be {' or '.join(allowed)}."
            )
    mu = _positive(path, head, *MU)
    radius = _positive(path, head, "radius")
    greatest = _greatest(path, head)
    degree = greatest if degree is None else degree
    order = degree if order is None else order
    if not 0 <= degree <= greatest:
        raise InputError(
            f"degree is {degree}: it must be from 0 to {greatest}, that of {path}, "
            f"line {head['max_degree'][0]}."
        )
    if not 0 <= order <= degree:
        raise InputError(f"order is {order}: it must be from 0 to {degree}, the degree.")
    coefficients = _coefficients(path, lines, first, greatest, degree, order)
    name = head.get("modelname", (0, ""))[1]
    tide = head.get("tide_system", (0, "unknown"))[1]
    return GravityField(name, mu, radius, coefficients, tide)


def _head(path: str | os.PathLike[str], lines: list[str]) -> tuple[dict[str, tuple[int, str]], int]:
    """The entries of the head by their key, each with its line, and the number of its lines."""
    head: dict[str, tuple[int, str]] = {}
    for number, line in enumerate(lines, 1):
        key, *words = line.split() or [""]
        if key == "end_of_head":
            return head, number
        # Free text may precede the entries, and comments have keys of their own.
        if words and key not in head:
            head[key] = number, words[0]
    raise InputError(
        f"{path} is not a gravity field of ICGEM, or is truncated: it must have a line end_of_head."
    )


def _positive(path: str | os.PathLike[str], head: dict[str, tuple[int, str]], *keys: str) -> float:
    """The number of the first of the `keys` that the head has."""
    for key in keys:
        if key in head:
            where, word = head[key]
            value = _number(word)
            if value is None or value <= 0.0:
                raise InputError(
                    f"{path}, line {where}: {key} is {word[:40]!r}: it must be positive and finite."
                )
            return value
    raise InputError(f"{path} has no {keys[0]}: its head must contain it.")


def _greatest(path: str | os.PathLike[str], head: dict[str, tuple[int, str]]) -> int:
    """The greatest degree of the file."""
    if "max_degree" not in head:
        raise InputError(f"{path} has no max_degree: its head must contain it.")
    where, word = head["max_degree"]
    value = _whole(word)
    if value is None or value > GREATEST:
        raise InputError(
            f"{path}, line {where}: max_degree is {word[:40]!r}: it must be a whole number up to "
            f"{GREATEST}."
        )
    return value


def _coefficients(
    path: str | os.PathLike[str],
    lines: list[str],
    first: int,
    greatest: int,
    degree: int,
    order: int,
) -> np.ndarray:
    """C and S, (2, degree + 1, order + 1), from the lines after the `first` ones."""
    found = np.full((2, degree + 1, order + 1), np.nan)
    # The centre of mass is at the origin in most files, which leave the first degree out.
    found[:, :2] = 0.0
    found[0, 0, 0] = 1.0
    seen: set[tuple[int, int]] = set()
    for number, line in enumerate(lines[first:], first + 1):
        words = line.split()
        if not words:
            continue
        where = f"{path}, line {number}"
        if words[0] in VARYING:
            raise InputError(
                f"{where} begins with {words[0]}: fields that vary with time are not read, only "
                "lines that begin with gfc."
            )
        if words[0] != "gfc" or len(words) < 5:
            raise InputError(
                f"{where} is {line.strip()[:60]!r}: it must be gfc, a degree, an order and two "
                "coefficients."
            )
        n, m = _whole(words[1]), _whole(words[2])
        if n is None or m is None or not m <= n <= greatest:
            raise InputError(
                f"{where} has the degree {words[1][:20]} and the order {words[2][:20]}: the degree "
                f"must be at most {greatest}, and the order at most the degree."
            )
        if (n, m) in seen:
            raise InputError(f"{where} repeats the degree {n} and the order {m}.")
        seen.add((n, m))
        if n > degree or m > order:
            continue
        for kind, word in enumerate(words[3:5]):
            value = _number(word)
            if value is None:
                raise InputError(
                    f"{where}: {'CS'[kind]} is {word[:40]!r}: it must be a finite number."
                )
            found[kind, n, m] = value
        if m == 0 and found[1, n, 0] != 0.0:
            raise InputError(f"{where}: S is {words[4][:40]!r}: it must be zero for order 0.")
        if n == 0 and found[0, 0, 0] != 1.0:
            raise InputError(f"{where}: C is {words[3][:40]!r}: it must be 1 for degree 0.")
    rows, columns = np.ogrid[: degree + 1, : order + 1]
    missing = np.argwhere(np.isnan(found[0]) & (columns <= rows))
    if missing.size:
        n, m = missing[0]
        raise InputError(
            f"{path} has no coefficients of degree {n} and order {m} in its {len(lines)} lines: it "
            f"is truncated, or its max_degree of {greatest} is wrong."
        )
    return np.where(columns <= rows, found, 0.0)


def _number(word: str) -> float | None:
    """A finite number, with the exponents of Fortran too, such as 0.1D-03."""
    return finite_number(word.replace("D", "E").replace("d", "e"))


def _whole(word: str) -> int | None:
    """A whole number of at most six digits, zero or positive."""
    return int(word) if word.isascii() and word.isdigit() and len(word) <= 6 else None

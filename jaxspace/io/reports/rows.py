"""Rows of reports: names with their units, and numbers with the digits that they have."""

import math
from collections.abc import Mapping
from typing import SupportsFloat, SupportsInt

import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import PyTree

from ...core import State
from ...core.quantities import quantities
from ...rotations import Quaternion, to_euler_angles
from ...simulation import Status
from ..units import WrittenUnits, in_unit

Row = tuple[str, ...]
# One program: outside of `jit` each of its operations would be compiled by itself.
_euler_angles = jax.jit(to_euler_angles)
# Smallest relative error that is shown, because of the rounding of a long run.
MOST_DIGITS = 12


def number(x: SupportsFloat, error: float = math.nan) -> str:
    """A number with the digits that it has: down to its `error`, or six significant ones if that
    is not known."""
    x = float(x)
    # Digits below the error have no meaning.
    if math.isfinite(x) and 0.0 < error < math.inf and abs(x) < 1e15:
        whole = math.floor(math.log10(abs(x))) + 1 if x else 0
        decimals = min(math.ceil(-math.log10(error)), MOST_DIGITS - max(whole, 0))
        text = f"{x:.{max(decimals, 0)}f}"
        # Not "-0.00", which a rounded negative number gives.
        return "0" if float(text) == 0.0 else text
    return "0" if abs(x) < 1e-10 else f"{x:.6g}"


def state_rows(
    y: State, units: WrittenUnits, error: PyTree[ArrayLike] | None = None
) -> list[tuple[str, str]]:
    """Names with units, and values, of the parts of a state.

    **Arguments**

    - `units`: those of the file, to report in.
    - `error`: the error of the state, if it is known: it decides on the digits.
    """
    rows = []
    for name, declared in quantities(type(y)).items():
        part = getattr(y, name)
        if part is None:
            continue
        unit = units.of(name, declared.unit)
        factor = in_unit(declared.unit, unit)
        miss = math.nan if error is None else factor * _largest(getattr(error, name))
        if isinstance(part, Quaternion):
            # With Euler's angles, in the angle unit of the file, because a quaternion is hard to
            # read.
            angle = units.of(name, "rad")
            turned = in_unit("rad", angle) * np.asarray(_euler_angles(part))
            rows.append((name, _listed(part.wxyz, miss)))
            rows.append((f"Euler angles 3-1-3 [{angle}]", _listed(turned)))
        else:
            rows.append((label(name, unit), _listed(factor * np.asarray(part), miss)))
    return rows


def error_rows(error: PyTree[ArrayLike], units: WrittenUnits) -> list[tuple[str, str]]:
    """The largest component of the error of every part, with its unit."""
    rows = []
    for name, declared in quantities(type(error)).items():
        part = getattr(error, name)
        if part is not None:
            unit = units.of(name, declared.unit)
            size = in_unit(declared.unit, unit) * _largest(part)
            rows.append((label(f"error of {name}", unit), _rough(size)))
    return rows


def drift_rows(drift: Mapping[str, ArrayLike]) -> list[tuple[str, str]]:
    """The largest relative change of every invariant."""
    return [
        (f"drift of {name.replace('_', ' ')}", _rough(float(np.max(np.abs(d)))))
        for name, d in drift.items()
    ]


def output_rows(outputs: Mapping[str, tuple[float, str]]) -> list[tuple[str, str]]:
    """Names with units, and values, of outputs."""
    return [(label(name, unit), number(value)) for name, (value, unit) in outputs.items()]


def status_line(status: SupportsInt) -> str:
    """The message of a status."""
    return Status(int(status)).sentence


def label(name: str, unit: str) -> str:
    """A name in words, with its unit."""
    name = name.replace("_", " ")
    return f"{name} [{unit}]" if unit else name


def _rough(x: float) -> str:
    """The size of an error; zero for exact results."""
    return f"{x:.1e}" if x else "0"


def _largest(tree: PyTree[ArrayLike]) -> float:
    return max(float(np.max(np.abs(np.asarray(leaf)))) for leaf in jax.tree.leaves(tree))


def _listed(xs: ArrayLike, error: float = math.nan) -> str:
    return ", ".join(number(x, error) for x in np.asarray(xs).reshape(-1))

"""Numbers that are dispersed together: [[dispersion.correlated]] and [[dispersion.direction]]."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np

from ...core import InputError
from ...core.quantities import Quantity
from ...sampling import (
    AbstractDistribution,
    AbstractJoint,
    ConeDirection,
    Correlated,
    MultivariateNormal,
)
from .._kinds.errors import hint, missing, unknown, wrong
from .._kinds.kind import Values
from .._kinds.values import Measure
from ..units import read_number

MATRICES = ("correlation", "covariance", "factor")
# Share of rejected draws without a warning, because every normal distribution has tails.
RARE = 1e-3
ANGLE = Quantity("rad", "half angle", 0.0, math.pi, False)


@runtime_checkable
class Scattering(Protocol):
    """An input: its nominal value and its distribution."""

    @property
    def nominal(self) -> Measure: ...

    def distribution(self) -> AbstractDistribution: ...


class MadeInput(NamedTuple):
    """A number of the file with its nominal value and its distribution, which may be one number of
    a joint one."""

    nominal: Measure
    made: AbstractDistribution

    def distribution(self) -> AbstractDistribution:
        """The distribution of this number."""
        return self.made

    def warnings(self, path: str) -> list[str]:
        """A warning if the class of the number rejects more than one draw in a thousand."""
        quantity = self.nominal.quantity
        share = self.made.outside(quantity.low, quantity.high)
        if share <= RARE:
            return []
        return [
            f"dispersion: {100.0 * share:.2g} % of the runs will be rejected, because {path} must "
            f"be {quantity.allowed()}."
        ]


Numbers = Mapping[str, Measure]
Known = Mapping[str, Scattering]


def read_correlated(
    key: str, entry: Values, numbers: Numbers, known: Known
) -> dict[str, MadeInput]:
    """The inputs of one table of [[dispersion.correlated]].

    Raises `ValueError` with the complete message."""
    _check_keys(key, entry, ("inputs", *MATRICES))
    paths = entry.get("inputs")
    if not (isinstance(paths, list) and len(paths) > 1 and all(isinstance(p, str) for p in paths)):
        raise ValueError(wrong(f"{key}.inputs", paths, "a list of two or more paths"))
    for path in paths:
        _check_path(f"{key}.inputs", path, numbers)
    given = [name for name in MATRICES if name in entry]
    if len(given) != 1:
        raise ValueError(wrong(f"{key}", given, f"a table with one of {', '.join(MATRICES)}"))
    name, matrix = given[0], entry[given[0]]
    if name == "correlation":
        # The width of each is given with its input.
        for path in paths:
            if path not in known:
                raise ValueError(missing(f"dispersion.inputs.{path}", "given for a correlation"))
        marginals = tuple(known[path].distribution() for path in paths)

    # Called by `_together`, which puts the key of the file before what the classes reject.
    def make() -> AbstractJoint:
        if name == "correlation":
            return Correlated.of(marginals, matrix)
        for path in paths:
            if path in known:
                raise InputError(
                    f"{path} is also dispersed in dispersion.inputs: give it only once."
                )
        mean = np.array([float(numbers[path]) for path in paths])
        if name == "covariance":
            return MultivariateNormal(mean, matrix)
        return MultivariateNormal.from_factor(mean, np.asarray(matrix, float))

    return _together(f"{key}.{name}", make, paths, numbers)


def read_direction(key: str, entry: Values, numbers: Numbers, known: Known) -> dict[str, MadeInput]:
    """The inputs of one table of [[dispersion.direction]]: a vector of constant length.

    Raises `ValueError` with the complete message."""
    _check_keys(key, entry, ("of", "within"))
    of = entry.get("of")
    # Exactly three entries: four are a quaternion, or no direction at all.
    vectors = sorted({p[:-2] for p in numbers if p.endswith(".2") and f"{p[:-2]}.3" not in numbers})
    if of not in vectors:
        raise ValueError(unknown(f"{key}.of", of, vectors, "vector of this file"))
    paths = [f"{of}.{k}" for k in range(3)]
    if any(path in known for path in paths):
        raise ValueError(
            f"{key}.of: {of} is also dispersed in dispersion.inputs: give it only once."
        )
    # A cone of this half-angle is the whole sphere.
    angle = math.pi
    if "within" in entry:
        try:
            angle = read_number(entry["within"], ANGLE)[0]
        except ValueError as error:
            raise ValueError(wrong(f"{key}.within", entry["within"], str(error))) from None
    vector = jnp.asarray([float(numbers[path]) for path in paths])
    return _together(key, lambda: ConeDirection(vector, angle), paths, numbers)


def _together(
    key: str, make: Callable[[], AbstractJoint], paths: list[str], numbers: Numbers
) -> dict[str, MadeInput]:
    try:
        made = make().inputs(*paths)
    # For a ragged matrix, or one with words, NumPy raises other errors.
    except (InputError, ValueError, TypeError) as error:
        raise ValueError(f"{key}: {error}") from None
    return {path: MadeInput(numbers[path], made[path]) for path in paths}


def _check_path(key: str, path: str, numbers: Numbers) -> None:
    if path not in numbers:
        raise ValueError(f"{key}: {path} is not a number of this file.{hint(path, numbers)}")


def _check_keys(key: str, entry: object, keys: tuple[str, ...]) -> None:
    if not isinstance(entry, Mapping):
        raise ValueError(wrong(key, entry, f"a table with the keys {', '.join(keys)}"))
    for name in entry:
        if name not in keys:
            raise ValueError(unknown(f"{key}.{name}", name, keys))

"""Explicit values of inputs: the rows of a sweep, alone or crossed with random inputs.

Run i of a campaign belongs to the row i mod r of r rows, and has the random inputs of draw
floor(i / r): all rows share their draws, so that their differences are not due to chance, and a
campaign with more draws continues the one with fewer.
"""

__all__ = ["Sweep", "grid"]

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Integer

from ..core import InputError
from ..core.checks import is_concrete
from ..core.printing import printed
from ..core.structure import HashedModule
from ..core.types import as_float

T = TypeVar("T")


def _columns(columns: Mapping[str, ArrayLike | Sequence[float]]) -> dict[str, Array]:
    # An empty list has no type to convert.
    return {
        name: as_float(x) if np.size(x) else jnp.zeros(np.shape(x)) for name, x in columns.items()
    }


@final
@printed()
class Sweep(HashedModule):
    """The rows of a sweep.

    - `columns`: the values of each swept input, (rows,), by name.

    Raises `InputError` without columns, for columns of different lengths and without rows, and for
    values that are not finite."""

    columns: dict[str, Float[Array, " rows"]] = eqx.field(converter=_columns)

    def __check_init__(self):
        if not self.columns:
            raise InputError("Sweep.columns is empty: it must name at least one input.")
        shapes = {name: np.shape(x) for name, x in self.columns.items()}
        # A placeholder of a tree transformation passes.
        if not all(is_concrete(x) for x in self.columns.values()):
            return
        for name, shape in shapes.items():
            if len(shape) != 1 or shape == (0,) or shape != next(iter(shapes.values())):
                every = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
                raise InputError(
                    f"Sweep.columns have the shapes {every}: each must be a list of one or more "
                    "values, and all of equal length."
                )
            if not np.isfinite(np.asarray(self.columns[name])).all():
                raise InputError(f"Sweep.columns[{name!r}] has values that are not finite.")

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(next(iter(self.columns.values())).shape[0])

    def values(self, numbers: Integer[Array, " runs"]) -> dict[str, Float[Array, " runs"]]:
        """The swept inputs of the runs with these numbers, each (runs,)."""
        return {name: x[numbers % self.rows] for name, x in self.columns.items()}

    def text(self) -> str:
        """The values of each column, with all digits, one column on each line."""
        return "\n".join(
            f"sweep of {name}: " + ", ".join(f"{x!r}" for x in np.asarray(column).tolist())
            for name, column in self.columns.items()
        )


def grid(axes: Mapping[str, Iterable[T]]) -> dict[str, list[T]]:
    """The rows of all combinations of values, the last input fastest.

    **Arguments**

    - `axes`: the values of each input, by name.

    **Returns** the columns by name, each as long as the product of the numbers of values."""
    combinations = list(itertools.product(*axes.values()))
    return {name: [row[k] for row in combinations] for k, name in enumerate(axes)}

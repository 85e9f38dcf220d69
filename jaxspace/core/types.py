"""The types shared by all formulas: components first, batch axis last (`*runs`, empty for one run).

Along a trajectory the time axis precedes the batch axes; `*runs` then means both.
"""

__all__ = ["SingleNumberField", "as_float", "as_optional_float"]

from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, PyTree

T = TypeVar("T")

if TYPE_CHECKING:
    # A formula accepts a Python float as well as an array, and returns an array if it got one: more
    # than a static type can express.
    Scalar: TypeAlias = Any

    class NumberField:
        """A declared number of a module: an array, converted from any number or array.

        A descriptor, because the constructor of a class accepts more types than its field has, and
        type checkers read the accepted types from `__set__`."""

        def __get__(self, instance: object, owner: object = None) -> Array: ...

        def __set__(self, instance: object, value: ArrayLike) -> None: ...

    class OptionalNumberField:
        """The same, or `None` if absent."""

        def __get__(self, instance: object, owner: object = None) -> Array | None: ...

        def __set__(self, instance: object, value: ArrayLike | None) -> None: ...

    # One for all runs.
    SingleNumberField = NumberField
else:
    Scalar: TypeAlias = Float[Array, "*#runs"] | float
    NumberField: TypeAlias = Float[Array, "*#runs"]
    OptionalNumberField: TypeAlias = Float[Array, "*#runs"] | None
    SingleNumberField: TypeAlias = Float[Array, ""]
Vector: TypeAlias = Float[Array, "3 *#runs"]
Matrix: TypeAlias = Float[Array, "3 3 *#runs"]
Flag: TypeAlias = Bool[Array, "*#runs"] | bool
State: TypeAlias = PyTree[Float[Array, "..."]]


REAL = ("real floating", "integral")


def as_float(x: object) -> Any:
    """Convert `x` to a floating-point array, for the fields of a module.

    Python numbers remain weakly typed, individually and in lists, so that the precision follows the
    state. Integers become floats. Anything but real numbers passes unchanged, for the check of the
    field: a placeholder of a tree transformation, a text, complex numbers, rows of different
    lengths."""
    if isinstance(x, Array) and x.dtype.kind == "f":
        # Nothing to convert: most calls are such.
        return x
    if isinstance(x, bool | int):
        x = float(x)
    if isinstance(x, list | tuple):
        x = _stacked(x)
    if not isinstance(x, float | np.ndarray | np.generic | Array) or not _is_real(x):
        return x
    x = jnp.asarray(x)
    return x if jnp.issubdtype(x.dtype, jnp.floating) else x.astype(float)


def _is_real(x: PyTree) -> bool:
    return isinstance(x, float) or x.dtype == bool or jnp.isdtype(x.dtype, REAL)


def _stacked(x: PyTree) -> PyTree:
    """Numbers in a list as an array; the list itself if it contains anything else."""
    parts = [as_float(v) for v in x]
    arrays = all(isinstance(v, np.ndarray | Array) and _is_real(v) for v in parts)
    if not arrays or len({v.shape for v in parts}) > 1:
        return x
    return jnp.stack(parts)


def precision_of(*numbers: PyTree) -> np.dtype:
    """The precision in which the numbers of these trees meet, for constants that meet them.

    Python numbers follow the others, so that a time of 0.3 does not raise single precision."""
    leaves = jax.tree.leaves(numbers)
    return jnp.result_type(*(x for x in leaves if isinstance(x, float) or eqx.is_inexact_array(x)))


def follow_precision(tree: T, *numbers: PyTree) -> T:
    """The tree with its Python numbers in the precision in which they meet other numbers.

    A sum over an array forgets that it was made of Python numbers, and would raise single precision
    afterwards.

    **Arguments**

    - `tree`: parameters.
    - `numbers`: trees, such as the state."""
    kind = precision_of(tree, *numbers)

    def converted(x: object) -> object:
        weak = eqx.is_inexact_array(x) and getattr(x, "weak_type", False)
        return jnp.asarray(x, kind) if weak else x

    return jax.tree.map(converted, tree)


def as_optional_float(x: object) -> Any:
    """`as_float`, with `None` for absent values."""
    return None if x is None else as_float(x)

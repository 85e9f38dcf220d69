"""The initial state of a run, as given by a user and as a run needs it.

Every question that does not involve the system is asked here, once for each run: the types of the
leaves, their precision, and whether the numbers are valid.
"""

from typing import NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import InputError, State
from ..core.checks import check_finite, is_concrete


@final
class InitialState(NamedTuple):
    """An initial state that has been checked.

    - `y`: the state, with plain numbers as arrays of its precision.
    - `dtype`: its precision."""

    y: State
    dtype: jnp.dtype

    @classmethod
    def of(cls, y0: PyTree, *, batch: bool = False) -> "InitialState":
        """The initial state `y0` of one run, or of a `batch`.

        Raises `InputError` for leaves that are not numbers, and for mixed precision. For one run
        also for a state that is not finite and for values that are invalid at the start of a run,
        by the `check_start` of every part that has it; in a batch such a state fails only its own
        run. Traced numbers are not checked."""
        y = as_state(y0)
        dtype = state_dtype(y)
        if not batch:
            _check_values(y)
        return cls(y, dtype)


def as_state(y0: PyTree) -> PyTree:
    """The state with its plain numbers and arrays of integers as arrays of floats, in the precision
    of its other arrays.

    No array is weakly typed. `jnp.asarray(1.0)` is, and the end of a run is not: a run that starts
    there would be compiled again."""

    def is_plain(x: object) -> bool:
        if isinstance(x, Array | np.ndarray):
            return getattr(x, "weak_type", False) or jnp.issubdtype(x.dtype, jnp.integer)
        return isinstance(x, float | int | np.number) and not isinstance(x, bool)

    leaves = jax.tree.leaves(y0)
    if not any(map(is_plain, leaves)):
        return y0
    given = {x.dtype for x in leaves if hasattr(x, "dtype") and not is_plain(x)}
    dtype = next(iter(given)) if len(given) == 1 else jnp.result_type(float)

    def converted(x: object) -> jax.Array:
        # By NumPy where it is known: even this conversion would run two programs.
        return jax.device_put(np.asarray(x, dtype)) if is_concrete(x) else jnp.asarray(x, dtype)

    return jax.tree.map(lambda x: converted(x) if is_plain(x) else x, y0)


def state_dtype(y: PyTree) -> jnp.dtype:
    """The precision of a state.

    Raises `InputError` if it is not a pytree of floating-point arrays, or if their types differ."""
    leaves = jax.tree.leaves(y)
    for leaf in leaves:
        if not isinstance(leaf, Array | np.ndarray | jax.ShapeDtypeStruct):
            raise InputError(
                f"y0 contains {leaf!r} of type {type(leaf).__name__}: its leaves must be arrays."
            )
    dtypes = {leaf.dtype for leaf in leaves}
    if len(dtypes) != 1 or not jnp.issubdtype(next(iter(dtypes)), jnp.floating):
        raise InputError(
            f"y0 contains arrays of the types {sorted(map(str, dtypes))}: they must share one "
            "floating-point type."
        )
    return next(iter(dtypes))


def _check_values(y0: PyTree) -> None:
    """Raise `InputError` for known values of one run that are not finite, or that a part of the
    state rejects."""
    known = [x for x in jax.tree.leaves(y0) if is_concrete(x)]
    if not all(np.isfinite(np.asarray(x)).all() for x in known):
        # Only now by name: to build the names takes longer than the check.
        for path, leaf in jax.tree_util.tree_flatten_with_path(y0)[0]:
            check_finite("y0" + jax.tree_util.keystr(path), leaf)

    def knows(x: object) -> bool:
        # By its class: an object of a user may answer to any name, and the method of an instance is
        # a separate module, slow to create.
        return hasattr(type(x), "check_start")

    for part in jax.tree.leaves(y0, is_leaf=knows):
        if knows(part):
            type(part).check_start(part)

"""Array layout: components first, then times, batch axis last.

A position is (3, *runs), along a trajectory (3, times, *runs). A check of the first axis reads
nothing but the static shape of an array, so that it costs nothing when the program runs and works
under every transformation of jax.
"""

__all__ = ["check_components", "runs_first", "runs_last", "with_rank"]

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .checks import InputError

RULE = "(components first, then times, batch axis last)"


def check_components(name: str, x: object, count: int, axes: int = 1) -> None:
    """Check that the leading axes of an array have the number of components.

    **Arguments**

    - `name`: of the array, as the message shows it: "dot: a".
    - `x`: the array. Other objects pass: `None`, a placeholder of a tree transformation, a
      `jax.ShapeDtypeStruct`, a Python number or list.
    - `count`: the number of components, 3 or 4.
    - `axes`: number of leading axes of this length, 2 for a matrix.

    **Raises** `InputError` for any other shape.
    """
    # Tracers are instances of `jax.Array`; lists of scalars and placeholders are not.
    if not isinstance(x, jax.Array | np.ndarray) or x.shape[:axes] == (count,) * axes:
        return
    held = (
        f"its first axis must have the {count} components"
        if axes == 1
        else f"its first two axes must have the {count} x {count} components"
    )
    raise InputError(f"{name} has the shape {x.shape}: {held} {RULE}.")


def with_rank(x: Array, rank: int, axes: int = 1) -> Array:
    """An array of components with `rank` axes of times and runs, the new ones of length one.

    The new axes follow the `axes` component axes: (3, runs) becomes (3, 1, runs), which broadcasts
    with (3, times, runs). JAX itself would prepend them to the components.

    **Arguments**

    - `x`: the array, components first.
    - `rank`: number of axes behind the components.
    - `axes`: number of the component axes."""
    missing = rank - (x.ndim - axes)
    if missing <= 0:
        # The same array, so that nothing is added to the program where the ranks agree.
        return x
    return x.reshape(*x.shape[:axes], *(1,) * missing, *x.shape[axes:])


def runs_last(tree: PyTree) -> PyTree:
    """Turn a tree of runs-first arrays, a neural network's layout, to the rule of this library.

    The first axis of every array becomes its last: (runs, 3) becomes (3, runs), and
    (runs, times, 3) becomes (times, 3, runs), whose components the caller moves to the front.
    Arrays without axes, `None` and other objects are unchanged.
    """
    return jax.tree.map(functools.partial(_move, source=0, target=-1), tree)


def runs_first(tree: PyTree) -> PyTree:
    """Turn a tree of runs-last arrays to the layout of a neural network; undoes `runs_last`.

    The last axis of every array becomes its first: (3, runs) becomes (runs, 3).
    """
    return jax.tree.map(functools.partial(_move, source=-1, target=0), tree)


def _move(x: object, source: int, target: int) -> object:
    # Shared values are often plain numbers.
    if not isinstance(x, jax.Array | np.ndarray) or x.ndim == 0:
        return x
    return jnp.moveaxis(x, source, target)

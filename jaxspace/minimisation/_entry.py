"""Checks of the arguments of `minimise`, before anything is compiled."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import keystr, tree_leaves_with_path
from jaxtyping import PyTree

from ..core import InputError
from ..core.checks import is_concrete
from ..core.user_functions import user_function
from ._criterion import Criterion, Point


def as_point(start: PyTree, name: str = "start") -> Point:
    """The start as a tree of arrays of floats; Python floats are accepted.

    Raises `InputError` for a part that is not a float, or a start without parts."""
    for path, leaf in tree_leaves_with_path(start):
        kind = getattr(leaf, "dtype", None)
        kind = np.asarray(leaf).dtype if kind is None else kind
        if not jnp.issubdtype(kind, jnp.floating):
            # An integer is rarely meant as an unknown: a search would change a number of steps.
            raise InputError(
                f"{name}{keystr(path)} is of type {kind}: unknowns must be floats. Write 1.0 "
                "instead of 1, or let problem close over values that are not unknowns."
            )
    point = jax.tree.map(jnp.asarray, start)
    if not sum(x.size for x in jax.tree.leaves(point)):
        raise InputError(f"{name} contains no numbers: it must have at least one unknown.")
    return point


def shapes_of(problem: Callable[[Point], Criterion], start: Point) -> Criterion:
    """The shapes of the values that the problem returns. Raises `InputError` where it is not a
    `Criterion`."""
    # A function, which has a name: of any other callable jax would print the whole content.
    with user_function("problem"):
        returned = jax.eval_shape(lambda x: problem(x), start)
    if not isinstance(returned, Criterion):
        raise InputError(
            f"problem returns {_kind(returned)}: it must return a Criterion, such as "
            "Criterion(objective) or Criterion(objective, equal_zero=..., non_negative=...)."
        )
    for name in ("objective", "equal_zero", "non_negative"):
        part = getattr(returned, name)
        if part is None and name != "objective":
            continue
        if part is None or not hasattr(part, "dtype"):
            raise InputError(
                f"problem returns {name} as {_kind(part)}: it must be an array, such as "
                f"jnp.stack([...])."
            )
        if not jnp.issubdtype(part.dtype, jnp.floating):
            raise InputError(f"problem returns {name} of type {part.dtype}: it must be of floats.")
    if returned.objective.shape:
        raise InputError(
            f"problem returns an objective of shape {returned.objective.shape}: "
            "it must be one number."
        )
    return returned


def check_scale(scale: PyTree, start: Point) -> None:
    """Raise `InputError` for a scale of another structure than the start, or one that is not
    positive."""
    if jax.tree.structure(scale) != jax.tree.structure(start):
        raise InputError("scale must have the structure of the start.")
    for (path, size), x in zip(tree_leaves_with_path(scale), jax.tree.leaves(start), strict=True):
        if np.shape(size) != x.shape:
            raise InputError(
                f"scale{keystr(path)} has the shape {np.shape(size)}: it must be {x.shape}."
            )
        if is_concrete(size) and not np.all(np.isfinite(size) & (np.asarray(size) > 0.0)):
            raise InputError(f"scale{keystr(path)} is {size}: scales must be positive and finite.")


def check_steps(max_steps: int) -> None:
    """Raise `InputError` for a number of steps below one."""
    if max_steps < 1:
        raise InputError(f"max_steps is {max_steps}: it must be at least 1.")


def _kind(value: PyTree) -> str:
    if hasattr(value, "shape"):
        return f"an array of shape {value.shape}"
    return f"a {type(value).__name__}"

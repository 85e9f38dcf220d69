"""Unknowns of a design that are named by their paths in the mission of a campaign."""

__all__ = ["Free", "FreeDesign", "free_by_path"]

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import InputError, Scalar, State
from ..core.suggestions import suggests
from ..dispersion import Campaign
from ..dispersion.evaluate import fixed_normals, inputs_at
from ..simulation import Mission

# In the order in which `build` returns them.
ROOTS = ("mission", "state")


@suggests
class Free(NamedTuple):
    """Bounds of a design variable, a table or a module, and its typical change (`scale`); by
    default without bounds, and with the scale of `minimise`."""

    low: float = -np.inf
    high: float = np.inf
    scale: float | None = None


@suggests
class FreeDesign(NamedTuple):
    """Inputs of `optimise_design` and `train_design`: `campaign`, `start`, `bounds`, `scale`. The
    designs are dictionaries by path."""

    campaign: Callable[[dict[str, PyTree]], Campaign]
    start: dict[str, PyTree]
    bounds: tuple[dict[str, PyTree], dict[str, PyTree]]
    scale: dict[str, PyTree] | None


@final
class _BuildWith(eqx.Module):
    """The `build` of a campaign, with the values `x` at their paths: a module instead of a closure,
    so that the campaigns of several designs share their compiled programs."""

    build: Callable[[dict[str, Array]], tuple[Mission, State]]
    x: dict[str, PyTree]

    def __call__(self, samples: dict[str, Array]) -> tuple[Mission, State]:
        built = self.build(samples)
        for path, value in self.x.items():
            built = eqx.tree_at(
                lambda b, path=path: _at_path(b, path), built, _like(value, built, path)
            )
        return built


def free_by_path(campaign: Campaign, free: Mapping[str, Free]) -> FreeDesign:
    """The design of the free parts of a campaign, each named by its path.

    **Arguments**

    - `campaign`: whose `build` gives the mission and the initial state of the start.
    - `free`: by path, such as `"mission.phases.1.system.thrust"` or `"state.v"`: a number, an array
      or any module, of which all floats are free.

    **Returns** a `FreeDesign`. **Raises** `InputError` for an unknown path, a part without floats,
    one that is set by a random input, and invalid bounds.
    """
    if not free:
        raise InputError("free is empty: it must name at least one design variable.")
    # Of two runs and of four: an array that is longer for four carries the runs.
    normals = fixed_normals(campaign, 2, 0)
    built = campaign.build(inputs_at(campaign, normals))
    wider = campaign.build(inputs_at(campaign, jnp.concatenate([normals, normals])))
    start = {path: _start(path, built, wider) for path in free}
    for path, one in free.items():
        # In this form, so that NaN is rejected, too.
        if not one.low < one.high:
            raise InputError(
                f"free {path!r} has low = {one.low:g} and high = {one.high:g}: the lower one must "
                f"be below."
            )

    def filled(name: str) -> dict[str, PyTree]:
        return {
            path: jax.tree.map(lambda x, path=path: jnp.full_like(x, getattr(free[path], name)), x)
            for path, x in start.items()
        }

    scale = None
    if any(one.scale is not None for one in free.values()):
        # `minimise` takes a scale for all unknowns or for none.
        scale = {
            path: jax.tree.map(lambda x, one=free[path]: jnp.full_like(x, _size(x, one)), x)
            for path, x in start.items()
        }
    return FreeDesign(
        lambda x: dataclasses.replace(campaign, build=_BuildWith(campaign.build, x)),
        start,
        (filled("low"), filled("high")),
        scale,
    )


def _at_path(built: PyTree, path: str) -> PyTree:
    """The part at a path of mission and state, or of a tree like them. Raises `InputError` if there
    is none."""
    root, *names = path.split(".")
    if root not in ROOTS:
        raise InputError(
            f"free {path!r} begins with {root!r}: it must begin with mission or state."
        )
    part: PyTree = built[ROOTS.index(root)]
    for depth, name in enumerate(names):
        inside = _inside(part)
        if name not in inside:
            before = ".".join([root, *names[:depth]])
            raise InputError(
                f"free {path!r} does not exist: {before} has {', '.join(inside) or 'no parts'}."
                f"{InputError.hint(name, tuple(inside))}"
            )
        part = inside[name]
    return part


def _inside(part: PyTree) -> dict[str, PyTree]:
    """The parts of a module, a dictionary or a sequence, by name."""
    if isinstance(part, Mapping):
        return {str(name): value for name, value in part.items()}
    # Of a named tuple; of a dataclass below.
    names = getattr(part, "_fields", None)
    if names is not None:
        return {name: getattr(part, name) for name in names}
    if isinstance(part, list | tuple):
        return {str(k): value for k, value in enumerate(part)}
    if dataclasses.is_dataclass(part):
        return {field.name: getattr(part, field.name) for field in dataclasses.fields(part)}
    return {}


def _start(path: str, built: tuple[Mission, State], wider: tuple[Mission, State]) -> PyTree:
    """The free floats at a path, of a single run, from missions of two runs and of four."""
    floats, more = (eqx.filter(_at_path(b, path), eqx.is_inexact_array) for b in (built, wider))
    if not jax.tree.leaves(floats):
        raise InputError(
            f"free {path!r} contains no floats: it must be a number, an array or a module."
        )

    def alone(x: Array, y: Array) -> Array:
        # As long for two runs as for four: it carries no runs.
        if x.shape == y.shape:
            return x
        # The last axis is that of the runs. Two runs are sufficient to detect dispersion: random
        # numbers are equal with probability zero.
        if np.any(np.asarray(x[..., 0]) != np.asarray(x[..., 1])):
            raise InputError(
                f"free {path!r} differs between runs: a number cannot be both a design variable "
                "and random."
            )
        return x[..., 0]

    return jax.tree.map(alone, floats, more)


def _like(value: PyTree, built: tuple[Mission, State], path: str) -> PyTree:
    """The part at a path with the floats of `value`, of all runs where they were."""
    floats, rest = eqx.partition(_at_path(built, path), eqx.is_inexact_array)

    def every(new: Array, old: Array) -> Array:
        return (
            new if jnp.ndim(old) == new.ndim else jnp.broadcast_to(new[..., None], jnp.shape(old))
        )

    return eqx.combine(jax.tree.map(every, value, floats), rest)


def _size(x: Array, one: Free) -> Scalar:
    """The given scale, or the default of `minimise`."""
    if one.scale is not None:
        return one.scale
    # The defaults of `minimise`, because a tree of scales has no gaps.
    if np.isfinite(one.low) and np.isfinite(one.high):
        return one.high - one.low
    return jnp.maximum(jnp.abs(x), 1.0)

"""Trajectories as data sets with named axes and units."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TypeAlias

import jax
import numpy as np
from jaxtyping import Array, PyTree

from ..core import State
from ..core.extras import extra
from ..core.quantities import quantities

if TYPE_CHECKING:
    import xarray

# Names of the axes, values, attributes: as xarray takes them.
Variable: TypeAlias = tuple[str | tuple[str, ...], np.ndarray, dict[str, str]]


def blocks_of(states: PyTree) -> Iterator[tuple[str, str, Any]]:
    """Name, declared unit (empty without one) and array of each block of a state, in order."""
    for path, leaf in jax.tree_util.tree_flatten_with_path(states)[0]:
        yield _name(path), _unit(states, path), leaf


def _unit(tree: PyTree, path: jax.tree_util.KeyPath) -> str:
    """The unit of the leaf at `path`, as its field declares it; empty if it does not."""
    unit = ""
    for key in path:
        match key:
            case jax.tree_util.GetAttrKey(name=name):
                declared = quantities(type(tree)).get(name)
                unit = unit if declared is None else declared.unit
                tree = getattr(tree, name)
            case jax.tree_util.DictKey(key=entry) | jax.tree_util.SequenceKey(idx=entry):
                tree = tree[entry]
            case _:
                # The keys of a tree of another library may not be attributes.
                return unit
    return unit


def _name(path: jax.tree_util.KeyPath) -> str:
    """The name of a block: "position", "attitude", "parts.damper"."""
    names = [
        str(getattr(key, "name", getattr(key, "key", getattr(key, "idx", "")))) for key in path
    ]
    return ".".join(name for name in names if name != "wxyz") or "state"


def dataset_of(ts: Array, states: State, status: Array, run_axes: int) -> "xarray.Dataset":
    """The arrays of a trajectory as a data set: a variable for each block, named axes, units."""
    with extra("app"):
        import xarray

    # An axis of components has the name of its variable: blocks of different length share none.
    runs = ("run",) * run_axes
    variables: dict[str, Variable] = {}
    for name, unit, leaf in blocks_of(states):
        components = tuple(f"{name}_{k}" for k in range(leaf.ndim - 1 - run_axes))
        attributes = {"units": unit} if unit else {}
        variables[name] = ((*components, "time", *runs), np.asarray(leaf), attributes)
    variables["status"] = (runs, np.asarray(status), {})
    times = np.asarray(ts)
    coordinates: dict[str, Variable] = {}
    if times.ndim == 1:
        coordinates["time"] = ("time", times, {"units": "s"})
    # Times that all runs share are an axis, even if each run has its copy.
    elif np.all(times == times[:, :1]):
        coordinates["time"] = ("time", times[:, 0], {"units": "s"})
    else:
        # Runs whose times differ have no common axis of times: these are a variable.
        variables["t"] = (("time", *runs), times, {"units": "s"})
    return xarray.Dataset(variables, coords=coordinates)

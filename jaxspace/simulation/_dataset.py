"""Trajectories as data sets with named axes and units."""

from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..core import quantities

if TYPE_CHECKING:
    import xarray

    from ._trajectory import Trajectory


def _unit(tree: Any, path: tuple[Any, ...]) -> str:
    """The unit that the field which holds the leaf at `path` declares; empty if it declares none."""
    unit = ""
    for key in path:
        name = getattr(key, "name", None)
        if name is None:
            return ""
        declared = quantities(type(tree)).get(name)
        unit = unit if declared is None else declared.unit
        tree = getattr(tree, name)
    return unit


def _name(path: tuple[Any, ...]) -> str:
    """The name of a block: "position", "attitude", "parts.damper"."""
    names = [
        str(getattr(key, "name", getattr(key, "key", getattr(key, "idx", "")))) for key in path
    ]
    return ".".join(name for name in names if name != "wxyz") or "state"


def dataset_of(trajectory: "Trajectory") -> "xarray.Dataset":
    """A trajectory as a data set: a variable for each block of the state, named axes, units."""
    import xarray

    runs = ("run",) * trajectory.run_axes
    variables = {}
    for path, leaf in jax.tree_util.tree_flatten_with_path(trajectory.states)[0]:
        name = _name(path)
        components = [f"{name}_{k}" for k in range(leaf.ndim - 1 - len(runs))]
        axes = components[1:] and components or [name + "_component"] * len(components)
        unit = _unit(trajectory.states, path)
        attributes = {"units": unit} if unit else {}
        variables[name] = ((*axes, "time", *runs), np.asarray(leaf), attributes)
    variables["status"] = (runs, np.asarray(trajectory.status))
    ts = np.asarray(trajectory.ts)
    # Runs whose times differ have no common axis of times: they are numbered, and a variable.
    common = ts.ndim == 1 or bool(np.all(ts == ts[:, :1]))
    coordinates = {}
    if common:
        coordinates["time"] = ("time", ts if ts.ndim == 1 else ts[:, 0], {"units": "s"})
    else:
        variables["t"] = (("time", *runs), ts, {"units": "s"})
    return xarray.Dataset(variables, coords=coordinates)

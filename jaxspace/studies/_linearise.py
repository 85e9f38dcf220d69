"""The linearisation of a system about a state: matrices from derivatives of its vector field.

The coordinates of the linear system are the components of the state in the order of its fields,
flattened; a block on a group, such as a quaternion, has its local coordinates (a small rotation).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.groups import on_group
from ..core.layout import add_batch_axis, component_axes_of, run_axes_of

Input = str | Callable[[Any, Array], AbstractSystem]
Output = str | Callable[[Any], Array]


class Blocks(NamedTuple):
    """Layout of the components of a state in one vector (n, *runs)."""

    blocks: tuple[PyTree, ...]
    structure: jax.tree_util.PyTreeDef
    shapes: tuple[tuple[int, ...], ...]
    labels: tuple[str, ...]
    runs: tuple[int, ...]

    @classmethod
    def of(cls, system: AbstractSystem, y: State, t: Scalar) -> "Blocks":
        carried = jax.tree.leaves(run_axes_of(system, lambda _: 0))
        if any(carried):
            # Shared arrays are broadcast to the runs of the parameters.
            system, y = add_batch_axis((system, y))
        # The shape of the rates, because a shared state under parameters of many runs has rates of
        # each run.
        rate = jax.eval_shape(system.vector_field, t, y)
        paths, structure = jax.tree_util.tree_flatten_with_path(y, is_leaf=on_group)
        blocks = tuple(block for _, block in paths)
        axes = jax.tree.unflatten(jax.tree.structure(y), jax.tree.leaves(component_axes_of(y)))
        axes = jax.tree.leaves(axes, is_leaf=on_group)
        rates = jax.tree.leaves(rate, is_leaf=on_group)
        declared = [
            _first_leaf(x).shape[k:]
            for x, k in zip(rates, map(_first_leaf, axes), strict=True)
            if k >= 0
        ]
        # Only declared blocks define where their components end; the others follow from them.
        runs = np.broadcast_shapes(*declared) if declared else ()
        shapes, labels = [], []
        for (path, block), k in zip(paths, map(_first_leaf, axes), strict=True):
            name = jax.tree_util.keystr(path, simple=True, separator=".")
            if on_group(block):
                # Three for a quaternion of four numbers: the fourth is not a direction in which it
                # can move.
                shape = jax.eval_shape(lambda b=block: b.coordinates()).shape[:1]
            else:
                shape = block.shape[:k] if k >= 0 else block.shape[: block.ndim - len(runs)]
            shapes.append(shape)
            count = int(np.prod(shape, dtype=int))
            labels += [name] if shape == () else [f"{name}[{i}]" for i in range(count)]
        return cls(blocks, structure, tuple(shapes), tuple(labels), runs)

    @property
    def count(self) -> int:
        return len(self.labels)

    @property
    def dtype(self) -> np.dtype:
        return jnp.result_type(*(_first_leaf(block) for block in self.blocks))

    def moved(self, x: Array) -> State:
        """The state at the local coordinates `x`, (n, *runs)."""
        result = []
        at = 0
        for block, shape in zip(self.blocks, self.shapes, strict=True):
            count = int(np.prod(shape, dtype=int))
            local = x[at : at + count].reshape(*shape, *self.runs)
            at += count
            if on_group(block):
                wide = jax.tree.map(
                    lambda leaf: jnp.broadcast_to(
                        leaf.reshape(leaf.shape + (1,) * (1 + len(self.runs) - leaf.ndim)),
                        (leaf.shape[0], *self.runs),
                    ),
                    block,
                )
                result.append(wide.moved(local))
            else:
                block = jnp.reshape(block, block.shape + (1,) * (local.ndim - block.ndim))
                result.append(block + local)
        return jax.tree.unflatten(self.structure, result)

    def rate(self, x: Array, moved: State, rate: State) -> Array:
        """The rates of the local coordinates, (n, *runs), at `x`, from the state there and its
        rate."""
        result = []
        at = 0
        states = jax.tree.leaves(moved, is_leaf=on_group)
        rates = jax.tree.leaves(rate, is_leaf=on_group)
        for block, shape, k in zip(states, self.shapes, rates, strict=True):
            count = int(np.prod(shape, dtype=int))
            local = x[at : at + count]
            at += count
            if on_group(block):
                # By the coordinates: the rate of a quaternion is not that of its small rotation.
                result.append(block.coordinate_rate(local, k))
            else:
                result.append(jnp.broadcast_to(k, (*shape, *self.runs)).reshape(count, *self.runs))
        return jnp.concatenate(result)


def _first_leaf(tree: PyTree) -> PyTree:
    return jax.tree.leaves(tree)[0]


def jacobian(function: Callable[[Array], Array], x: Array) -> Array:
    """The Jacobian, (m, n, *runs), of a function of each run at `x`, (n, *runs)."""
    n = x.shape[0]
    units = jnp.eye(n, dtype=x.dtype).reshape(n, n, *(1,) * (x.ndim - 1))
    # Not `jax.jacfwd`, which would differentiate every run by every other one.
    along = jax.vmap(lambda e: jax.jvp(function, (x,), (jnp.broadcast_to(e, x.shape),))[1])
    return jnp.moveaxis(along(units), 0, 1)


def forced(
    system: AbstractSystem, inputs: tuple[Input, ...], runs: tuple[int, ...]
) -> tuple[Callable[[Array], AbstractSystem], tuple[str, ...]]:
    """The system as a function of its inputs u, (m, *runs), and the names of the inputs."""
    labels: list[str] = []
    parts: list[tuple[Input, int, tuple[int, ...]]] = []
    for given in inputs:
        if isinstance(given, str):
            value = getattr(system, given, None)
            if not eqx.is_array_like(value):
                raise InputError(
                    f"inputs names {given!r}: it must name a number among the fields of "
                    f"{type(system).__name__}, or be a function (system, u) -> system."
                )
            axes = component_axes_of(system)
            shape = getattr(value, "shape", ())[: max(getattr(axes, given), 0)]
            count = int(np.prod(shape, dtype=int))
            labels += [given] if shape == () else [f"{given}[{i}]" for i in range(count)]
            parts.append((given, count, shape))
        else:
            labels.append(getattr(given, "__name__", "input"))
            parts.append((given, 1, ()))

    def of(u: Array) -> AbstractSystem:
        result: Any = system
        at = 0
        for given, count, shape in parts:
            part = u[at : at + count].reshape(*shape, *runs)
            at += count
            if isinstance(given, str):
                value = jnp.asarray(getattr(result, given), u.dtype)
                value = value.reshape(value.shape + (1,) * (part.ndim - value.ndim))
                # Added to the value in the system, because u is a small change about it.
                result = eqx.tree_at(lambda s, n=given: getattr(s, n), result, value + part)
            else:
                result = given(result, part)
        return result

    return of, tuple(labels)


def measured(outputs: tuple[Output, ...], y: State, runs: tuple[int, ...]) -> Array:
    """The outputs of a state, (p, *runs)."""
    result = []
    for given in outputs:
        if isinstance(given, str):
            value = y.get(given) if isinstance(y, dict) else getattr(y, given, None)
            if value is None:
                raise InputError(
                    f"outputs names {given!r}: it must name a part of {type(y).__name__}, or be a "
                    "function of the state."
                )
        else:
            value = given(y)
        value = jnp.asarray(value)
        # From the front, because the runs are the last axes.
        components = value.shape[: value.ndim - len(runs)]
        result.append(value.reshape(int(np.prod(components, dtype=int)), *runs))
    return jnp.concatenate(result)

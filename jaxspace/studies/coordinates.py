"""The components of a tree of arrays as one vector, for matrices of derivatives.

The components are in the order of the fields, flattened. A block on a group, such as a
quaternion, has its local coordinates: a small rotation in body axes, rad. Each block may carry
further axes (times, runs) behind its components.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import AbstractGroupElement, InputError
from ..core.groups import on_group


class Coordinates(NamedTuple):
    """Layout of the components of the blocks of a tree in one vector.

    - `blocks`, `structure`: the tree, cut at its blocks on groups.
    - `shapes`, `trailing`: of each block, the axes of its components and those behind them.
    - `labels`: a name for each component."""

    blocks: tuple[PyTree, ...]
    structure: jax.tree_util.PyTreeDef
    shapes: tuple[tuple[int, ...], ...]
    trailing: tuple[tuple[int, ...], ...]
    labels: tuple[str, ...]

    @classmethod
    def of(
        cls, tree: PyTree, trailing: int | Sequence[int], names: Sequence[str] | None = None
    ) -> "Coordinates":
        """Coordinates of a tree whose leaves have `trailing` axes behind their components: one
        number for all leaves, or one each. The `names` are by default those of its fields."""
        blocks, structure = jax.tree.flatten(tree, is_leaf=on_group)
        paths = [path for path, _ in jax.tree_util.tree_flatten_with_path(tree)[0]]
        counts = [trailing] * len(paths) if isinstance(trailing, int) else list(trailing)
        names = [name_of(path) for path in paths] if names is None else names
        # The first leaf decides for a block with several.
        firsts = np.cumsum([0, *(len(jax.tree.leaves(block)) for block in blocks)])
        shapes = []
        behind = []
        labels = []
        for block, k in zip(blocks, firsts[:-1], strict=True):
            name, axes = names[int(k)], counts[int(k)]
            if on_group(block):
                # Its coordinates are not a field of it.
                name = name.rpartition(".")[0] or name
            shape = jnp.shape(jax.tree.leaves(block)[0])
            # JAX would give a whole number tangents of the class float0, of which no matrix is
            # made.
            if not jnp.issubdtype(jnp.result_type(*jax.tree.leaves(block)), jnp.floating):
                raise InputError(
                    f"{name} is not a real number and cannot be differentiated with respect to."
                )
            cut = len(shape) - axes
            behind.append(tuple(shape[cut:]))
            if on_group(block):
                shapes.append(tuple(jax.eval_shape(_zeros, block).shape[:1]))
            else:
                shapes.append(tuple(shape[:cut]))
            size = int(np.prod(shapes[-1], dtype=int))
            labels += [name] if shapes[-1] == () else [f"{name}[{i}]" for i in range(size)]
        return cls(tuple(blocks), structure, tuple(shapes), tuple(behind), tuple(labels))

    @property
    def count(self) -> int:
        """Number of components."""
        return len(self.labels)

    @property
    def dtype(self) -> np.dtype:
        """The precision of the blocks."""
        return jnp.result_type(*jax.tree.leaves(self.blocks))

    @property
    def tree(self) -> PyTree:
        """The tree that the coordinates are about."""
        return jax.tree.unflatten(self.structure, self.blocks)

    def at(self, tree: PyTree) -> "Coordinates":
        """The same coordinates about another tree."""
        # Shapes and labels stay: the states of one run differ in their numbers alone.
        return self._replace(blocks=tuple(jax.tree.leaves(tree, is_leaf=on_group)))

    def moved(self, x: Array) -> PyTree:
        """The tree at the coordinates `x`, (n,) or (n, ...) with the axes behind the blocks."""
        result = []
        at = 0
        for block, shape, behind in zip(self.blocks, self.shapes, self.trailing, strict=True):
            size = int(np.prod(shape, dtype=int))
            part = x[at : at + size]
            part = part.reshape(*shape, *part.shape[1:])
            missing = len(shape) + len(behind) - part.ndim
            # Time and batch axes follow the components, where broadcasting does not add them
            # automatically.
            local = jnp.broadcast_to(part.reshape(part.shape + (1,) * missing), (*shape, *behind))
            at += size
            result.append(block.moved(local) if on_group(block) else block + local)
        return jax.tree.unflatten(self.structure, result)

    def components(self, tangent: PyTree) -> Array:
        """The coordinates (n, ...) of a small change of the tree; the axes behind broadcast."""
        changes = jax.tree.leaves(tangent, is_leaf=on_group)
        behind = np.broadcast_shapes(*self.trailing)
        result = []
        for block, shape, change in zip(self.blocks, self.shapes, changes, strict=True):
            local = block.coordinate_rate(_zeros(block), change) if on_group(block) else change
            size = int(np.prod(shape, dtype=int))
            local = local.reshape(size, *local.shape[len(shape) :])
            result.append(jnp.broadcast_to(local, (size, *behind)))
        return jnp.concatenate(result)


def name_of(path: Sequence[jax.tree_util.KeyEntry]) -> str:
    """The place of a leaf in a tree, as `effects[0].mu`."""
    name = ""
    for key in path:
        if isinstance(key, jax.tree_util.SequenceKey):
            name += f"[{key.idx}]"
        else:
            name += f".{getattr(key, 'name', getattr(key, 'key', key))}"
    return name.lstrip(".") or "value"


def _zeros(block: AbstractGroupElement) -> Array:
    return block.coordinates()

"""Arrays of a module that carry runs, by the annotations of its fields.

A field annotated `Float[Array, "3 *#runs"]` has three components followed by the batch axes; one
annotated `Scalar` has the batch axes only. An array with more axes than its components carries runs
on its last axes. A field whose annotation names no runs declares nothing about them.
"""

import dataclasses
import functools
import typing
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree


def component_axes(annotation: object) -> int | None:
    """Number of axes of components that an annotation declares before the runs; `None` if it names
    none.

    Of a union, the first member that names runs counts."""
    for member in typing.get_args(annotation) or (annotation,):
        names = getattr(member, "dim_str", "").split()
        runs = [k for k, name in enumerate(names) if name.startswith("*") and "runs" in name]
        if runs:
            return runs[0]
    return None


@functools.cache
def _annotations(cls: type) -> Mapping[str, object]:
    """The annotation of every field of a class, inherited ones included."""
    if not dataclasses.is_dataclass(cls):
        return {}
    annotations = {field.name: field.type for field in dataclasses.fields(cls)}
    if any(isinstance(kind, str) for kind in annotations.values()):
        # The class was written under `from __future__ import annotations`.
        annotations |= typing.get_type_hints(cls)
    return annotations


def _declared_axes(tree: PyTree, path: jax.tree_util.KeyPath) -> int | None:
    """The component axes declared by the field that contains the leaf at `path`."""
    node: Any = tree
    annotation: Any = None
    for key in path:
        if isinstance(key, jax.tree_util.GetAttrKey):
            annotation = _annotations(type(node)).get(key.name)
            node = getattr(node, key.name)
        else:
            if isinstance(key, jax.tree_util.FlattenedIndexKey):
                # A class with opaque parts, such as `jax.tree_util.Partial`.
                return None
            # The annotation of a field does not describe entries of a list or a dictionary.
            annotation = None
            node = node[getattr(key, "idx", getattr(key, "key", None))]
    return component_axes(annotation)


def _is_array(leaf: object) -> bool:
    """Whether a leaf is an array or its shape. By its type: an object of a user may answer to any
    name, or raise for it."""
    return isinstance(leaf, jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct)


def component_axes_of(tree: PyTree) -> PyTree[int]:
    """Number of axes of components that each array of the tree declares before its runs.

    -1 for an array whose field has no declaration, and for leaves that are not arrays."""
    leaves, structure = jax.tree.flatten(tree)
    arrays = tuple(_is_array(leaf) for leaf in leaves)
    try:
        result = _component_axes(structure, arrays)
    except TypeError:
        # A structure with a static field that cannot be hashed is not cached.
        result = _component_axes.__wrapped__(structure, arrays)
    return jax.tree.unflatten(structure, result)


@functools.lru_cache(maxsize=256)
def _component_axes(
    structure: jax.tree_util.PyTreeDef, arrays: tuple[bool, ...]
) -> tuple[int, ...]:
    """Cached by the structure of a tree: reading annotations takes longer than a short run."""
    tree = jax.tree.unflatten(structure, arrays)
    paths = [path for path, _ in jax.tree_util.tree_flatten_with_path(tree)[0]]
    result = []
    for path, is_array in zip(paths, arrays, strict=True):
        declared = _declared_axes(tree, path) if is_array else None
        result.append(-1 if declared is None else declared)
    return tuple(result)


def run_axes_of(tree: PyTree, undeclared: Callable[[Array], int]) -> PyTree[int]:
    """Number of trailing axes of runs of each array of the tree.

    **Arguments**

    - `tree`: a system, a state, a mission: any tree of modules.
    - `undeclared`: called for an array whose field declares nothing.

    **Returns** a tree of the same structure; leaves that are not arrays count as zero."""

    def count(leaf: PyTree, axes: int) -> int:
        if not _is_array(leaf):
            return 0
        return undeclared(leaf) if axes < 0 else max(leaf.ndim - axes, 0)

    return jax.tree.map(count, tree, component_axes_of(tree))


def add_batch_axis(tree: PyTree) -> PyTree:
    """The arrays that all runs share, with an axis of length one for them behind the components.

    Arrays whose fields declare nothing, such as the weights of a network, stay as they are."""

    def leaf(x: PyTree, axes: int) -> PyTree:
        return jnp.expand_dims(x, -1) if axes > 0 and x.ndim == axes else x

    return jax.tree.map(leaf, tree, component_axes_of(tree))

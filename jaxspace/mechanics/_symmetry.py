"""Symmetries of a Lagrangian in time and coordinates, by its derivatives.

A derivative that is exactly zero at several places, with random numbers for the parameters, is zero
by the structure of the function: automatic differentiation by a coordinate on which nothing depends
gives an exact zero. A coordinate that drops out for special parameters only, such as without
gravity, is not recognised; none is recognised wrongly.

Source: Thomson 9.8 (cyclic coordinates), 9.3.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core.jit import quick_jit
from ..core.layout import component_axes_of
from ._description import AbstractDescription
from .constraints import constraints_of

PLACES = 8


class Symmetries(NamedTuple):
    """Constants of the motion: the energy (`time`), the momenta of the coordinates (`cyclic`)."""

    time: bool
    cyclic: tuple[bool, ...]


def symmetries(system: AbstractDescription) -> Symmetries:
    """The symmetries of a system, determined from its structure only; the same under every
    transformation."""
    arrays, static = eqx.partition(system, eqx.is_array_like)
    leaves, structure = jax.tree.flatten(arrays)
    axes = jax.tree.leaves(component_axes_of(arrays))
    # Without the axes of runs: one number represents all.
    shapes = tuple(np.shape(x)[: max(k, 0)] for x, k in zip(leaves, axes, strict=True))
    try:
        return _symmetries_of(structure, shapes, _Static(static))
    except TypeError:
        # A static field that cannot be hashed.
        return _symmetries_of.__wrapped__(structure, shapes, _Static(static))


class _Static:
    """The static part of a system, compared as a tree: the key of cached results."""

    def __init__(self, tree: PyTree):
        self.tree = tree
        self.key = tuple(jax.tree.leaves(tree)), jax.tree.structure(tree)

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Static) and self.key == other.key


@functools.lru_cache(maxsize=256)
def _symmetries_of(
    structure: object, shapes: tuple[tuple[int, ...], ...], static: _Static
) -> Symmetries:
    # A fixed seed: a system has the same invariants in every process.
    draw = np.random.default_rng(20260101)
    arrays = jax.tree.unflatten(structure, [draw.uniform(0.5, 1.5, shape) for shape in shapes])
    n = len(static.tree.names)
    # Of many sizes, so that no piece of a piecewise function is missed easily.
    size = np.repeat([0.3, 1.0, 3.0, 30.0], PLACES // 4)
    t, q, v = (draw.normal(size=(k, PLACES)) * size for k in (1, n, n))
    with jax.ensure_compile_time_eval():
        zero = [np.asarray(x) for x in _slopes(arrays, static.tree, t[0], q, v)]
    still, cyclic = ~np.any(zero[0] != 0.0), ~np.any(zero[1] != 0.0, axis=(1, 2))
    return Symmetries(bool(still), tuple(bool(x) for x in cyclic))


@quick_jit
def _slopes(arrays: PyTree, static: PyTree, t: Array, q: PyTree, v: PyTree) -> tuple[Array, Array]:
    """The rates of the energy, (k, places), and of each momentum, (n, k, places), at each place."""

    def one(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        system = eqx.combine(arrays, static)
        slopes = jax.grad(lambda t, q: jnp.sum(system.lagrangian(t, q, v)), (0, 1))(t, q)
        gains, each = [slopes[0]], [slopes[1][:, None]]
        force = system.force(t, q, v)
        if force is not None:
            gains.append(jnp.sum(jnp.abs(force)))
            each.append(force[:, None])
        if system.dissipation(t, q, v) is not None:
            drag = jax.grad(lambda v: jnp.sum(system.dissipation(t, q, v)))(v)
            gains.append(jnp.sum(jnp.abs(drag)))
            each.append(drag[:, None])
        result = constraints_of(system, t, q, jnp.zeros_like(v))
        if result is not None:
            # Constraints at rest do no work, and those that do not contain a coordinate exert no
            # force on it.
            gains.append(jnp.sum(jnp.abs(result.errors)))
            each.append(result.matrix.T)
        return jnp.stack(gains), jnp.concatenate(each, axis=1)

    return jax.vmap(one, in_axes=-1, out_axes=-1)(jnp.asarray(t), jnp.asarray(q), jnp.asarray(v))

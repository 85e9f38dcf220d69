"""Whether the gradient of an objective is its slope: a difference along one direction.

    D(h) = [f(x + h d) - f(x - h d)] / 2h          D = [4 D(h/2) - D(h)] / 3 + O(h^4)

The gradient of a run is that of its steps. Where a control has kinks that are no breaks of the
integration, the steps pass over what a single value of it changes: the run is right, its gradient
is not, and a descent comes to rest in a wrong place or diverges.
"""

import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

Point = PyTree[Float[Array, "..."]]

GRADIENT_TOLERANCE = 1e-3
"""Measured for runs at the default tolerance: sound gradients agree with the difference to 1e-8,
those by an interpolation without breaks to 1e-2; below 1e-3 a descent does not suffer."""
DOUBT = 3.0
"""How many times the difference of D(h) and D(h/2) is forgiven: their errors, of which that of
rounding and of the tolerance of a run is effectively random."""


def gradient_error(
    f: Callable[[Point], Float[Array, ""]], x: Point, gradient: Point
) -> Float[Array, ""]:
    """The relative difference of the `gradient` of `f` at `x` from its slope, along one fixed
    direction of effectively random components; zero where the slope is not known better.

    Four more evaluations of `f`, in a loop, so that it is compiled once."""
    leaves = jax.tree.leaves(x)
    structure = jax.tree.structure(x)
    # The best step of a difference of fourth order; of the size of each part of the point.
    h = float(jnp.finfo(leaves[0].dtype).eps) ** 0.2
    pattern = np.cos(2.4 * np.arange(sum(leaf.size for leaf in leaves)) + 1.0)
    direction = []
    for leaf in leaves:
        own, pattern = pattern[: leaf.size], pattern[leaf.size :]
        size = jnp.max(jnp.abs(leaf), initial=0.0)
        scale = jnp.where(size > 0.0, size, 1.0)
        direction.append(scale * jnp.asarray(own.reshape(leaf.shape), leaf.dtype))
    d = jax.tree.unflatten(structure, direction)

    def at(part: Array) -> Array:
        return f(jax.tree.map(lambda x, d: x + part.astype(x.dtype) * d, x, d))

    parts = h * np.array([1.0, -1.0, 0.5, -0.5])
    ahead, behind, half_ahead, half_behind = jax.lax.map(at, jnp.asarray(parts, leaves[0].dtype))
    coarse = (ahead - behind) / (2.0 * h)
    fine = (half_ahead - half_behind) / h
    slope = (4.0 * fine - coarse) / 3.0
    along = jax.tree.map(lambda g, d: jnp.sum(g * d), gradient, d)
    claimed = jax.tree.reduce(jnp.add, along)
    beyond = jnp.maximum(jnp.abs(slope - claimed) - DOUBT * jnp.abs(fine - coarse), 0.0)
    size = jnp.maximum(jnp.abs(slope), jnp.abs(claimed))
    error = beyond / jnp.where(size > 0.0, size, 1.0)
    # Outside of its domain the objective is infinite, and has no slope.
    return jax.lax.stop_gradient(jnp.where(jnp.isfinite(error), error, 0.0))


def warn_of_gradient(error: float, stacklevel: int) -> None:
    """Warn of a gradient that differs from the slope by this relative `error`."""
    if error <= GRADIENT_TOLERANCE:
        return
    warnings.warn(
        f"The gradient at the start differs from the slope of the objective by {error:.1g} of it: "
        f"a control with kinks that are no breaks is the likely cause; make it a "
        f"jaxspace.core.Table or Spline, or let the system declare its breaks().",
        stacklevel=stacklevel + 1,
    )

"""Whether the gradient of an objective is its slope: a difference along one direction.

    D(h) = [f(x + h d) - f(x - h d)] / 2h          D = [4 D(h/2) - D(h)] / 3 + O(h^4)

The gradient of a run is that of its steps. Where a control has kinks that are no breaks of the
integration, the steps pass over what a single value of it changes: the run is right, its gradient
is not, and a descent comes to rest in a wrong place or diverges. A search therefore refuses to
begin with a gradient that is not the slope.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from ..core import InputError

GRADIENT_TOLERANCE = 1e-3
"""Measured for runs at the default tolerance: sound gradients agree with the difference to 1e-8,
those by an interpolation without breaks to 1e-2; below 1e-3 a descent does not suffer."""
DOUBT = 3.0
"""How many times the difference of D(h) and D(h/2) is forgiven: their errors, of which that of
rounding and of the tolerance of a run is effectively random."""
PROBES = 4


def probe(x: Float[Array, " n"], size: Float[Array, " n"], number: Array) -> Float[Array, " n"]:
    """The place of a probe, 0 to 3, about `x`: along one fixed direction of effectively random
    components, each of the `size` of its unknown."""
    return x + _shares(x)[number] * _direction(x, size)


def probed_error(
    values: Float[Array, "4"], x: Float[Array, " n"], size: Float[Array, " n"], gradient: Array
) -> Float[Array, ""]:
    """The relative difference of the `gradient` at `x` from the slope of the `values` at the
    probes; zero where the slope is not known better."""
    h = _shares(x)[0]
    coarse = (values[0] - values[1]) / (2.0 * h)
    fine = (values[2] - values[3]) / h
    slope = (4.0 * fine - coarse) / 3.0
    claimed = gradient @ _direction(x, size)
    beyond = jnp.maximum(jnp.abs(slope - claimed) - DOUBT * jnp.abs(fine - coarse), 0.0)
    largest = jnp.maximum(jnp.abs(slope), jnp.abs(claimed))
    error = beyond / jnp.where(largest > 0.0, largest, 1.0)
    # Outside of its domain the objective is infinite, and has no slope.
    return jax.lax.stop_gradient(jnp.where(jnp.isfinite(error), error, 0.0))


def sizes_of(point: PyTree[Float[Array, "..."]]) -> Float[Array, " n"]:
    """For each unknown the largest magnitude in its part of the point, or 1 where that is zero."""

    def leaf(x: Array) -> Array:
        largest = jnp.max(jnp.abs(x), initial=0.0)
        return jnp.broadcast_to(jnp.where(largest > 0.0, largest, 1.0), x.shape)

    return ravel_pytree(jax.tree.map(leaf, point))[0]


def refuse(error: float) -> None:
    """Raise `InputError` for a gradient that differs from the slope by this relative `error`."""
    if error <= GRADIENT_TOLERANCE:
        return
    raise InputError(
        f"The gradient at the start differs from the slope of the objective by {error:.1g} of it, "
        f"and a search would end in a wrong place: a control with kinks that are no breaks is the "
        f"likely cause; make it a jaxspace.core.Table or Spline, let the system declare its "
        f"breaks(), or use finer steps. (check_gradient=False begins all the same.)"
    )


def _shares(x: Array) -> Float[Array, "4"]:
    # The best step of a difference of fourth order.
    h = float(jnp.finfo(x.dtype).eps) ** 0.2
    return jnp.asarray(h * np.array([1.0, -1.0, 0.5, -0.5]), x.dtype)


def _direction(x: Array, size: Array) -> Array:
    # Not drawn: the same start gets the same verdict every time.
    return size * jnp.asarray(np.cos(2.4 * np.arange(x.size) + 1.0), x.dtype)

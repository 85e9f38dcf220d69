"""Random numbers of a seed, and sequences whose correlation falls along a path.

    longitudinal   R = exp(-s)              x_{k+1} = q x_k + sqrt(1 - q^2) z
    transverse     R = (1 - s/2) exp(-s)    of second order, below

    symbol   meaning
    s        distance over the correlation length
    q        exp(-s) of the step
    z        independent standard normal numbers

Both are those of Dryden: the first also that of an exponential correlation. The step is exact for
any distance between two nodes: a value there has the variance one, and any two have the correlation
R. The transverse one is of second order, with

    w_1' = -w_1 + n,   w_2' = w_1 - w_2,   y = sqrt(3) w_1 + (1 - sqrt(3)) w_2,   |n|^2 = 1
    Cov(w_1, w_2) = (1/2, 1/4; 1/4, 1/4)

Source: Gardiner, Handbook of Stochastic Methods, 4.4; Gage, Creating a Unified Graphical Wind
Turbulence Model from Multiple Specifications, AIAA 2003-5529.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .types import Scalar

# Weights of both states in the transverse sequence, and their stationary covariance.
TAKEN = np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)])
STATIONARY = np.array([[0.5, 0.25], [0.25, 0.25]])


def normal_numbers(seed: Scalar, shape: tuple[int, ...]) -> Float[Array, "..."]:
    """Standard normal numbers of each seed, (*shape, *runs).

    Any number is a seed: another one gives other numbers. Derivatives by it are zero."""
    seed = lax.stop_gradient(jnp.asarray(seed))
    single = seed.astype(jnp.float32)
    # Seeds that differ beyond single precision differ, too: of many drawn seeds two would agree.
    rest = (seed - single.astype(seed.dtype)).astype(jnp.float32)
    bits, more = (lax.bitcast_convert_type(x, jnp.uint32).reshape(-1) for x in (single, rest))
    # The generator is fixed whatever the settings, so that a seed means the same everywhere.
    root = jax.random.key(0, impl="threefry2x32")

    def drawn(number: Array, rest: Array) -> Array:
        key = jax.random.fold_in(root, number)
        # A number of single precision means the same in double precision.
        data = jax.random.key_data(jax.random.fold_in(key, rest))
        data = jnp.where(rest == 0, jax.random.key_data(key), data)
        key = jax.random.wrap_key_data(data, impl="threefry2x32")
        return jax.random.normal(key, shape, seed.dtype)

    numbers = jax.vmap(drawn)(bits, more)
    return jnp.moveaxis(numbers, 0, -1).reshape(*shape, *seed.shape)


def longitudinal(
    steps: Float[Array, "steps *#runs"], z: Float[Array, "nodes *#runs"]
) -> Float[Array, "..."]:
    """The sequence with the correlation exp(-s), at each node, (nodes, *runs).

    **Arguments**

    - `steps`: distances between the nodes over the correlation length.
    - `z`: a standard normal number for each node."""
    # The variance remains one: the squares of the retained and the new part sum to it.
    keep = jnp.exp(-steps)
    fresh = jnp.sqrt(-jnp.expm1(-2.0 * steps))

    def step(x: Array, given: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        q, r, z = given
        x = q * x + r * z
        return x, x

    shape = jnp.broadcast_shapes(z.shape[1:], steps.shape[1:])
    first = jnp.broadcast_to(z[0], shape).astype(jnp.result_type(z, steps))
    rest = lax.scan(step, first, (keep, fresh, z[1:]))[1]
    return jnp.concatenate([first[None], rest])


def transverse(steps: np.ndarray, z: Float[Array, "nodes 2 *runs"]) -> Float[Array, "..."]:
    """The sequence with the correlation (1 - s/2) exp(-s), at each node, (nodes, *runs).

    **Arguments**

    - `steps`: known distances between the nodes over the correlation length, (steps,).
    - `z`: two standard normal numbers for each node."""
    keep = np.exp(-steps)[:, None, None] * (np.eye(2) + steps[:, None, None] * [[0, 0], [1, 0]])
    fresh = _fresh(steps)
    start = np.linalg.cholesky(STATIONARY)

    def step(w: Array, given: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        a, b, z = given
        w = jnp.tensordot(a, w, 1) + jnp.tensordot(b, z, 1)
        return w, w

    first = jnp.tensordot(jnp.asarray(start, z.dtype), z[0], 1)
    known = jnp.asarray(keep, z.dtype), jnp.asarray(fresh, z.dtype)
    rest = lax.scan(step, first, (*known, z[1:]))[1]
    w = jnp.concatenate([first[None], rest])
    return TAKEN[0].item() * w[:, 0] + TAKEN[1].item() * w[:, 1]


def _fresh(steps: np.ndarray) -> np.ndarray:
    """Lower roots, (steps, 2, 2), of the covariance that the noise adds to w over each step.

    Its elements are int_0^s u^k exp(-2 u) du, k = 0, 1, 2: as the stationary covariance less what
    is left of it, those of a small step would be rounding."""
    first = -0.5 * np.expm1(-2.0 * steps)
    # By Gauss's rule, exact to rounding over a short step: a sum of positive numbers.
    nodes, weights = np.polynomial.legendre.leggauss(16)
    u = 0.5 * np.minimum(steps, 1.0)[:, None] * (nodes + 1.0)
    mixed, second = (0.5 * steps * np.sum(weights * u**k * np.exp(-2.0 * u), 1) for k in (1, 2))
    gone = np.exp(-2.0 * steps)
    mixed = np.where(steps < 1.0, mixed, 0.25 - (0.25 + 0.5 * steps) * gone)
    second = np.where(steps < 1.0, second, 0.25 - (0.25 + 0.5 * steps * (1.0 + steps)) * gone)
    # Two nodes at one place add nothing.
    slope = mixed / np.where(first > 0.0, first, 1.0)
    root = np.sqrt(first)
    rest = np.sqrt(second - slope * mixed)
    return np.stack([np.stack([root, 0.0 * root], -1), np.stack([slope * root, rest], -1)], -2)

"""Variational calculus: the action of a path, and two extremals in closed form.

    S = int L(t, q, q') dt                       Hamilton: stationary along the motion
    chain           y = a cosh(x / a),  2 a sinh(d / (2 a)) = l
    brachistochrone x = r (p - sin p),  y = r (1 - cos p),  T = sqrt(r / g) p

    symbol   meaning                                              unit
    S        action                                               J s
    d, l     span and length of a chain                           m
    a        its parameter: horizontal tension over weight        m
    r, p     radius of the cycloid's circle, angle rolled         m, rad

Source: Thomson 9.7, appendix C (C-9, C-10, C-12, which give stationarity only).
"""

__all__ = ["action", "brachistochrone", "hanging_chain"]

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Scalar
from ..core.formula import POSITIVE, formula
from ..core.special import stumpff_near
from ..core.squares import quotient
from ..core.types import as_float, precision_of
from ._lagrangian import AbstractLagrangian

NODES = 24
STEPS = 60


@formula
def action(
    system: AbstractLagrangian,
    path: Callable[[Array], Array],
    start: Scalar,
    end: Scalar,
    pieces: int = 4,
) -> Float[Array, ""]:
    """The action of a path, by Gauss's quadrature; differentiable in all that the path closes over.

    **Arguments**

    - `system`: whose Lagrangian is integrated, one run.
    - `path`: from a time to the coordinates, (n,); the rates are its derivatives.
    - `start`, `end`: s; `pieces`: of equal length, each with 24 nodes.

    **Returns** S, J s.
    """
    x, weights = np.polynomial.legendre.leggauss(NODES)
    edges = np.arange(pieces)[:, None]
    kind = precision_of(system, start, end)
    share = jnp.asarray(((edges + 0.5 * (x + 1.0)) / pieces).reshape(-1), kind)
    start, end = as_float(start), as_float(end)

    def of_time(t: Array) -> Array:
        q, v = jax.jvp(path, (t,), (jnp.ones_like(t),))
        return jnp.asarray(system.lagrangian(t, q, v))

    values = jax.vmap(of_time)(start + (end - start) * share)
    return (end - start) * jnp.sum(
        jnp.tile(jnp.asarray(0.5 * weights / pieces, kind), pieces) * values
    )


@formula(span=POSITIVE, length=POSITIVE)
def hanging_chain(span: Scalar, length: Scalar) -> tuple[Scalar, Scalar]:
    """The parameter a and the sag, m, of a chain between two points of equal height (C-12).

    **Arguments**

    - `span`: between the points, m; `length`: of the chain, m, above the span.

    **Returns** both, m: the sag is a (cosh(d / (2 a)) - 1)."""
    ratio = length / span

    def newton(u: Array, ratio: Scalar) -> Array:
        # sinh(u) / u = l / d in logarithms, for which Newton's iteration is monotonic.
        value = jnp.log(jnp.sinh(u) / u) - jnp.log(ratio)
        return u - value / (jnp.cosh(u) / jnp.sinh(u) - 1.0 / u)

    fixed = jax.lax.stop_gradient(as_float(ratio))
    # For a taut chain sinh(u) / u = 1 + u^2 / 6; for a long one its logarithm is about u.
    guess = jnp.minimum(jnp.sqrt(6.0 * (fixed - 1.0)), 1.0 + 2.0 * jnp.log(fixed))
    root = jax.lax.fori_loop(0, STEPS, lambda _, u: newton(u, fixed), guess)
    # A step more carries the first derivatives, two the second ones.
    u = newton(newton(jax.lax.stop_gradient(root), ratio), ratio)
    # The sag of a long chain hardly depends on the span: the derivatives of 2 a sinh(u / 2)^2, and
    # 1 - tanh(u / 2)^2, would cancel.
    fall = jnp.exp(-u)
    share = jnp.where(u > 1.0, (1.0 - fall) / (1.0 + fall), jnp.tanh(0.5 * u))
    return 0.5 * span / u, 0.5 * length * share


@formula(distance=POSITIVE, drop=POSITIVE, gravity=POSITIVE)
def brachistochrone(
    distance: Scalar, drop: Scalar, gravity: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """The curve of quickest descent, from rest, to a point below and aside.

    **Arguments**

    - `distance`, `drop`: to the end, horizontally and downwards, m, both positive.
    - `gravity`: m/s^2.

    **Returns** the radius r, m, the angle rolled p, rad, and the time of the descent, s."""
    ratio = distance / drop

    def newton(p: Array, ratio: Scalar) -> Array:
        s, c = jnp.sin(0.5 * p), jnp.cos(0.5 * p)
        step = quotient(_lag(p) - 2.0 * ratio * s * s, 2.0 * s * (s - ratio * c))
        # Kept within one arch of the cycloid.
        return jnp.clip(p - step, 0.5 * p, 0.5 * p + jnp.pi)

    fixed = jax.lax.stop_gradient(as_float(ratio))
    # For a steep end p = 3 d / h.
    guess = jnp.minimum(3.0 * fixed, 2.0 * jnp.pi * fixed / (fixed + 1.0))
    root = jax.lax.fori_loop(0, STEPS, lambda _, p: newton(p, fixed), guess)
    p = newton(newton(jax.lax.stop_gradient(root), ratio), ratio)
    # By the distance: the drop r (1 - cos p) vanishes at the end of the arch.
    r = quotient(distance, _lag(p))
    return r, p, jnp.sqrt(r / gravity) * p


def _lag(p: Scalar) -> Scalar:
    """p - sin p from 0 to 2 pi, of the half of p: nothing cancels in a short arch."""
    h = 0.5 * p
    c2, c3, _, _ = stumpff_near(h * h)
    return 2.0 * h * h * h * (c2 + jnp.cos(h) * c3)

"""A small quadratic programme by Mehrotra's interior-point method, and by its active set.

    minimise z.Q z/2 + q.z   subject to   s = G z + h >= 0
    Q z + q = G^T nu,   s nu = 0,   nu >= 0

Where s and nu vanish together, as at a weakly active bound,
products s nu of one rounding leave s and nu at its square root. The interior point is therefore
improved: the constraints with nu > s are treated as equations, with multipliers

    (Q + k G_A^T G_A) dz = -(Q z + q - G_A^T nu) - k G_A^T s_A,     nu_A <- nu_A - k s_A

and the set is corrected by the signs of s and nu until it stays (a primal-dual active set). The
result is taken if it meets the conditions better.

    symbol  meaning
    z       unknowns
    Q, q    convex quadratic form, slope
    s, nu   slacks and multipliers of the inequalities
    A, k    active set, weight of its equations

Source: Nocedal and Wright, Numerical Optimization, 16.6; Hintermueller, Ito and Kunisch 2002
(active set). Dense: for some hundred unknowns at most.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import lu_factor, lu_solve
from jaxtyping import Array, Bool, Float, Int

# From a cold start ten to twenty steps reach rounding.
MOST_STEPS = 60
# Most corrections of the active set, and steps to the solution of each: the first few decide.
MOST_SETS, MOST_EQUATIONS = 6, 5


class Programme(NamedTuple):
    """Q (n, n), q (n,), G (m, n) and h (m,)."""

    Q: Float[Array, "n n"]
    q: Float[Array, " n"]
    G: Float[Array, "m n"]
    h: Float[Array, " m"]


class _Place(NamedTuple):
    z: Float[Array, " n"]
    s: Float[Array, " m"]
    nu: Float[Array, " m"]
    steps: Int[Array, ""]


def solve_programme(
    p: Programme, start: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    """The unknowns and the multipliers, from a `start` that need not be feasible."""
    # Beyond this gap the matrix of a step loses its digits, and with them the multipliers.
    size = 1.0 + jnp.max(jnp.abs(p.q))
    enough = 100.0 * jnp.finfo(p.q.dtype).eps * size
    # Away from zero, because no step is possible from the boundary.
    s = jnp.maximum(p.G @ start + p.h, 1e-2)
    first = _Place(start, s, jnp.full_like(s, 0.1 * size), jnp.asarray(0))

    def unfinished(at: _Place) -> Bool[Array, ""]:
        _, primal = _residuals(p, at)
        off = (jnp.max(at.s * at.nu) > enough) | (jnp.max(jnp.abs(primal)) > 10.0 * enough)
        return off & (at.steps < MOST_STEPS) & jnp.all(jnp.isfinite(at.z))

    last = lax.while_loop(unfinished, lambda at: _step(p, at), first)
    return _by_active_set(p, last)


def _by_active_set(p: Programme, at: _Place) -> tuple[Array, Array]:
    """Unknowns and multipliers of the active set that an interior point shows, if they meet the
    conditions better than the point itself."""
    # The inverse of the weight and the loss of digits by it are about the same size.
    weight = jnp.finfo(p.q.dtype).eps ** -0.4 * (1.0 + jnp.max(jnp.abs(p.Q)))
    eye = jnp.eye(at.z.size, dtype=at.z.dtype)

    def solved(active: Array) -> tuple[Array, Array]:
        G = jnp.where(active[:, None], p.G, 0.0)
        matrix = p.Q + weight * G.T @ G
        factors = lu_factor(matrix + 1e-15 * jnp.max(jnp.abs(matrix)) * eye)

        def better(_: object, place: tuple[Array, Array]) -> tuple[Array, Array]:
            z, nu = place
            missed = jnp.where(active, p.G @ z + p.h, 0.0)
            slope = p.Q @ z + p.q - G.T @ (nu - weight * missed)
            z = z - lu_solve(factors, slope)
            return z, nu - weight * jnp.where(active, p.G @ z + p.h, 0.0)

        return lax.fori_loop(0, MOST_EQUATIONS, better, (at.z, jnp.where(active, at.nu, 0.0)))

    def changed(state: tuple) -> Bool[Array, ""]:
        active, after, count, *_ = state
        return jnp.any(active != after) & (count < MOST_SETS)

    def corrected(state: tuple) -> tuple:
        _, active, count, *_ = state
        z, nu = solved(active)
        return active, nu > p.G @ z + p.h, count + 1, z, nu

    first = at.nu > at.s
    *_, z, nu = lax.while_loop(changed, corrected, (~first, first, 0, at.z, at.nu))
    better = _missed(p, z, nu) < _missed(p, at.z, at.nu)
    return jnp.where(better, z, at.z), jnp.where(better, jnp.maximum(nu, 0.0), at.nu)


def _missed(p: Programme, z: Array, nu: Array) -> Float[Array, ""]:
    """Residuals of the optimality conditions for unknowns and multipliers."""
    apart = jnp.max(jnp.abs(jnp.minimum(p.G @ z + p.h, nu)))
    return jnp.maximum(jnp.max(jnp.abs(p.Q @ z + p.q - p.G.T @ nu)), apart)


def _residuals(p: Programme, at: _Place) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    return p.Q @ at.z + p.q - p.G.T @ at.nu, p.G @ at.z + p.h - at.s


def _step(p: Programme, at: _Place) -> _Place:
    """Predictor and corrector with one matrix."""
    z, s, nu, steps = at
    dual, primal = _residuals(p, at)
    weight = nu / s
    matrix = p.Q + (p.G.T * weight) @ p.G
    # A small multiple of the identity, because elastic unknowns enter the inequalities alone.
    matrix = matrix + 1e-15 * jnp.max(jnp.abs(matrix)) * jnp.eye(z.size, dtype=z.dtype)

    factors = lu_factor(matrix)

    def newton(target: Float[Array, " m"]) -> tuple[Array, Array, Array]:
        push = (target - s * nu) / s - weight * primal
        dz = lu_solve(factors, p.G.T @ push - dual)
        ds = p.G @ dz + primal
        return dz, ds, (target - s * nu) / s - weight * ds

    mean = jnp.mean(s * nu)
    _, ds, dnu = newton(jnp.zeros_like(s))
    share = jnp.minimum(_room(s, ds), _room(nu, dnu))
    left = jnp.mean((s + share * ds) * (nu + share * dnu)) / mean
    # Mehrotra's choice: the more the predictor gains, the less the step is centred.
    dz, ds, dnu = newton(left**3 * mean - ds * dnu)
    # Ends before the boundary, where the matrix of the next step would be singular.
    share = jnp.minimum(1.0, 0.995 * jnp.minimum(_room(s, ds), _room(nu, dnu)))
    return _Place(z + share * dz, s + share * ds, nu + share * dnu, steps + 1)


def _room(x: Float[Array, " m"], dx: Float[Array, " m"]) -> Float[Array, ""]:
    """Largest step along `dx`, at most 1, before a component of a positive vector is zero."""
    falls = dx < 0.0
    return jnp.minimum(1.0, jnp.min(jnp.where(falls, -x / jnp.where(falls, dx, 1.0), jnp.inf)))

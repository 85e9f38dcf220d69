"""Violation, gradient of the Lagrangian, penalty and damped BFGS curvature for `_sqp.py`.

Source: Powell 1978 (damping)."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._infeasibility import ROUNDINGS, least_violation, unit_weights
from ._sqp_state import Evaluation, Limits, SqpState, Values


def scaled(evaluation: Evaluation, weight: Array, me: int) -> Values:
    """Objective, the first `me` constraints as equalities and the rest, times their `weight`."""
    values, jacobian = weight * evaluation.values, weight[:, None] * evaluation.jacobian
    f, c, d = values[0], values[1 : 1 + me], values[1 + me :]
    return Values(f, c, d, jacobian[0], jacobian[1 : 1 + me], jacobian[1 + me :], evaluation.report)


def violation(at: Values) -> Float[Array, ""]:
    """The largest violation of an equality or an inequality."""
    if not at.c.size + at.d.size:
        return jnp.zeros_like(at.f)
    largest = jnp.max(jnp.abs(at.c), initial=0.0)
    return jnp.maximum(largest, jnp.max(-at.d, initial=0.0))


def slope(at: Values, y: Array, nu: Array) -> Float[Array, " n"]:
    """The gradient of the Lagrangian f + y.c - nu.d."""
    if not y.size + nu.size:
        return at.g
    return at.g + at.J.T @ y - at.K.T @ nu


def gradient(s: SqpState, limits: Limits) -> Float[Array, ""]:
    """The gradient at x."""
    return lagrangian_gradient(s.at, s.x, s.y, s.nu, limits)


def lagrangian_gradient(
    at: Values, x: Array, y: Array, nu: Array, limits: Limits
) -> Float[Array, ""]:
    """The largest component of the projected gradient of the Lagrangian, or of nu d."""
    free = projected(at, x, y, nu, limits)
    if not nu.size:
        return jnp.max(jnp.abs(free))
    loose = jnp.minimum(jnp.maximum(at.d, 0.0), nu)
    return jnp.maximum(jnp.max(jnp.abs(free)), jnp.max(loose, initial=0.0))


def projected(at: Values, x: Array, y: Array, nu: Array, limits: Limits) -> Float[Array, " n"]:
    """The slope of the Lagrangian, projected on the bounds: a component that pushes against a bound
    allows no descent."""
    # It is x - clip(x - slope), without the difference of large x, which would lose a small slope.
    return jnp.clip(slope(at, y, nu), x - limits.upper, x - limits.lower)


def penalty(c: Array, d: Array) -> Float[Array, ""]:
    """The sum of the violations of c = 0 and d >= 0, in the units of their weights."""
    return jnp.sum(jnp.abs(c)) + jnp.sum(jnp.maximum(-d, 0.0))


def remembered(s: SqpState, ahead: SqpState, limits: Limits) -> Float[Array, "places 3"]:
    """`s.past` with the point of `ahead` in place of the oldest one."""
    return jnp.roll(s.past, 1, axis=0).at[0].set(_row(ahead, limits))


def only(s: SqpState, limits: Limits) -> Float[Array, "places 3"]:
    """`s.past` at the start of a search, or after a change of weights: the point of `s` alone."""
    return jnp.broadcast_to(_row(s, limits), s.past.shape)


def _row(s: SqpState, limits: Limits) -> Float[Array, " 3"]:
    return jnp.stack([s.at.f, penalty(s.at.c, s.at.d), gradient(s, limits)])


def damped_bfgs(s: SqpState, trial: Values, p: Array, y: Array, nu: Array) -> Array:
    """The BFGS curvature after a step p, damped so that it stays positive definite (Powell)."""
    change = slope(trial, y, nu) - slope(s.at, y, nu)
    along = p @ change
    B = s.B
    if not y.size + nu.size:
        # The first step sets the size of the curvature. Under constraints it does not, because the
        # first multipliers are far from those at the minimum.
        fresh = (s.calls == 1) & (along > 0.0)
        scale = jnp.where(fresh, (change @ change) / jnp.where(fresh, along, 1.0), 1.0)
        B = jnp.where(fresh, jnp.clip(scale, 1e-4, 1e4), 1.0) * B
    curvature = p @ B @ p
    # Powell's numbers: where the new curvature along p is below a fifth of the old one, the two are
    # mixed, so that B stays positive definite.
    low = along < 0.2 * curvature
    share = jnp.where(low, 0.8 * curvature / jnp.where(low, curvature - along, 1.0), 1.0)
    change = share * change + (1.0 - share) * (B @ p)
    bottom = curvature
    top = p @ change
    usable = (bottom > 0.0) & (top > 0.0)
    bottom, top = (jnp.where(usable, v, 1.0) for v in (bottom, top))
    q = B @ p
    new = B - jnp.outer(q, q) / bottom + jnp.outer(change, change) / top
    return jnp.where(usable, new, B)


def at_least_violation(
    at: Values, x: Array, y: Array, nu: Array, limits: Limits
) -> Bool[Array, ""]:
    """Whether no step from x reduces the violation of the constraints to first order.

    The violation is their sum, which the quadratic programmes reduce, or their sum of squares; `y`
    and `nu` are the multipliers with which a search ended."""
    holds = jnp.asarray(False)
    free = (x > limits.lower) & (x < limits.upper)
    # Three sets of weights, because the first is inexact: the multipliers of the last programme, in
    # which the objective has become a small part, lose digits where its radius is small.
    for pair in ((y, nu), _of_the_sum(at, free), (at.c, -at.d)):
        y, nu = unit_weights(*pair)
        gradient, weighted = at.J.T @ y - at.K.T @ nu, at.c @ y - at.d @ nu
        ends = (limits.lower, limits.upper)
        holds = holds | least_violation(x, gradient, weighted, violation(at), ends)
    return holds


def _of_the_sum(at: Values, free: Bool[Array, " n"]) -> tuple[Array, Array]:
    """Weights with which the sum of the violations has the least slope in the `free` unknowns.

    The weight of a violated constraint is its sign. Where a constraint is satisfied exactly, the
    sum has a kink, and the weight may be between -1 (for an inequality: 0) and 1."""
    met = ROUNDINGS * jnp.finfo(at.c.dtype).eps
    violated = jnp.concatenate([jnp.abs(at.c), -at.d]) > met
    signs = jnp.where(violated, jnp.concatenate([jnp.sign(at.c), jnp.ones_like(at.d)]), 0.0)
    kinks = ~violated & jnp.concatenate([jnp.ones_like(at.c, bool), at.d < met])
    rows = jnp.where(free, jnp.concatenate([at.J, -at.K]), 0.0)
    among = jnp.linalg.lstsq(jnp.where(kinks, rows.T, 0.0), -(signs @ rows))[0]
    least = jnp.concatenate([-jnp.ones_like(at.c), jnp.zeros_like(at.d)])
    weights = signs + jnp.clip(among, least, 1.0)
    return weights[: at.c.size], weights[at.c.size :]

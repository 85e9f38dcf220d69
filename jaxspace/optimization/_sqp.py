"""Sequential quadratic programming for small problems: every step uses the full Jacobian.

    phi(x) = f + rho (sum |c| + sum max(0, -d))                       exact penalty
    minimise over p:  g.p + p.B p/2 + rho (sum |c + J p| + sum max(0, -d - K p))
    subject to        lower <= x + p <= upper,   |p| <= Delta

    symbol          meaning
    f, c, d         objective, equalities, inequalities d >= 0
    g, J, K         their derivatives
    B               curvature of the Lagrangian: damped BFGS, or exact and made convex
    rho, Delta      weight of the constraints, radius of trust

The programme of a step always has a solution, so that infeasible targets end at the point with the
least violation. A step that raises the violation is corrected once with the constraints where it
leads (second-order correction). Unknowns are scaled by `scale`, objective and constraints by their
gradients at the start.

Source: Fletcher, Practical Methods of Optimization, 12.4 (S l1 QP), 14.4; Powell 1978 (damping).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ._quadratic import Programme, solve_programme

# With this weight a violation that no step reduces is final.
MOST_WEIGHT = 1e6


class Values(NamedTuple):
    """Objective f, constraints c and d, derivatives g, J and K; the `report` of the caller."""

    f: Float[Array, ""]
    c: Float[Array, " equal"]
    d: Float[Array, " inequal"]
    g: Float[Array, " n"]
    J: Float[Array, "equal n"]
    K: Float[Array, "inequal n"]
    report: Any


class SqpState(NamedTuple):
    """What one step hands to the next; `y`, `nu` are the multipliers of c and d, `shift` the
    second-order correction of (c, d), `rows` the history."""

    x: Float[Array, " n"]
    at: Values
    B: Float[Array, "n n"]
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    rho: Float[Array, ""]
    radius: Float[Array, ""]
    shift: tuple[Float[Array, " equal"], Float[Array, " inequal"]]
    corrected: Bool[Array, ""]
    hopeless: Bool[Array, ""]
    gradient: Float[Array, ""]
    violation: Float[Array, ""]
    steps: Int[Array, ""]
    rows: Float[Array, "steps 3"]


def solve_sqp(
    evaluate: Callable[[Float[Array, " n"]], Values],
    x: Float[Array, " n"],
    at: Values,
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    tolerance: Any,
    max_steps: int,
    curvature: Callable[[Array, Array, Array], Array] | None = None,
) -> SqpState:
    """The last state of the search.

    **Arguments**

    - `evaluate`: scaled problem with derivatives.
    - `x`: scaled unknowns at the start, and `at`: the problem there.
    - `lower`, `upper`: their bounds, which may be infinite.
    - `tolerance`: for the projected gradient of the Lagrangian and the violation, both scaled.
    - `curvature`: (x, y, nu) -> Hessian of the Lagrangian; without it BFGS.
    """
    zero = (jnp.zeros_like(at.c), jnp.zeros_like(at.d))
    one = jnp.ones_like(at.f)
    first = SqpState(
        x, at, jnp.eye(x.size, dtype=x.dtype), *zero, 10.0 * one, one, zero,
        jnp.asarray(False), jnp.asarray(False), jnp.inf * one, _violation(at), jnp.asarray(0),
        jnp.full((max_steps, 3), jnp.nan, x.dtype),
    )  # fmt: skip
    first = first._replace(gradient=_gradient(first, lower, upper))
    least = 1e2 * jnp.finfo(x.dtype).eps

    def unfinished(s: SqpState) -> Bool[Array, ""]:
        missed = (s.gradient > tolerance) | (s.violation > tolerance)
        missed = missed & ~s.hopeless
        return missed & (s.steps < max_steps) & (s.radius > least)

    def advance(s: SqpState) -> SqpState:
        if curvature is not None:
            values, vectors = jnp.linalg.eigh(curvature(s.x, s.y, s.nu))
            floor = 1e-8 * jnp.max(jnp.abs(values)) + 1e-12
            s = s._replace(B=(vectors * jnp.maximum(jnp.abs(values), floor)) @ vectors.T)
        return _advance(evaluate, s, lower, upper, curvature is None)

    return lax.while_loop(unfinished, advance, first)


def _violation(at: Values) -> Float[Array, ""]:
    """The largest violation of an equality or an inequality."""
    largest = jnp.max(jnp.abs(at.c), initial=0.0)
    return jnp.maximum(largest, jnp.max(-at.d, initial=0.0))


def _slope(at: Values, y: Array, nu: Array) -> Float[Array, " n"]:
    """The gradient of the Lagrangian f + y.c - nu.d."""
    return at.g + at.J.T @ y - at.K.T @ nu


def _gradient(s: SqpState, lower: Array, upper: Array) -> Float[Array, ""]:
    """The largest component of the gradient that the bounds leave free, or of nu d."""
    x = s.x
    free = x - jnp.clip(x - _slope(s.at, s.y, s.nu), lower, upper)
    loose = jnp.minimum(jnp.maximum(s.at.d, 0.0), s.nu)
    return jnp.maximum(jnp.max(jnp.abs(free)), jnp.max(loose, initial=0.0))


def _penalty(c: Array, d: Array) -> Float[Array, ""]:
    return jnp.sum(jnp.abs(c)) + jnp.sum(jnp.maximum(-d, 0.0))


def _programme(s: SqpState, lower: Array, upper: Array) -> tuple[Programme, Array]:
    """The programme of a step in (p, e, f): elastic unknowns e of c and f of d; and a start."""
    c, d = s.at.c + s.shift[0], s.at.d + s.shift[1]
    n, me, mi = s.x.size, c.size, d.size
    slack = me + mi
    Q = jnp.zeros((n + slack, n + slack), s.x.dtype).at[:n, :n].set(s.B)
    q = jnp.concatenate([s.at.g, jnp.full(slack, s.rho, s.x.dtype)])
    eye_n, eye_s = jnp.eye(n, dtype=s.x.dtype), jnp.eye(slack, dtype=s.x.dtype)
    body = jnp.concatenate([jnp.concatenate([s.at.J, s.at.K, -s.at.J]), eye_n, -eye_n])
    side = jnp.concatenate([eye_s, eye_s[:me], jnp.zeros((2 * n, slack), s.x.dtype)])
    G = jnp.concatenate([body, side], axis=1)
    # The elastic unknowns of inequalities are not negative; those of equalities follow.
    G = jnp.concatenate([G, jnp.concatenate([jnp.zeros((mi, n), s.x.dtype), eye_s[me:]], axis=1)])
    low = jnp.maximum(lower - s.x, -s.radius)
    high = jnp.minimum(upper - s.x, s.radius)
    h = jnp.concatenate([c, d, -c, -low, high, jnp.zeros_like(d)])
    first = jnp.concatenate([0.5 * (low + high), 1.0 + jnp.abs(c), 1.0 + jnp.maximum(-d, 0.0)])
    return Programme(Q, q, G, h), first


def _advance(
    evaluate: Callable[[Array], Values], s: SqpState, lower: Array, upper: Array, update: bool
) -> SqpState:
    """One step: solve the programme, try the point, and take it or shrink the radius."""
    programme, first = _programme(s, lower, upper)
    z, lam = solve_programme(programme, first)
    n, me, mi = s.x.size, s.at.c.size, s.at.d.size
    solved = jnp.all(jnp.isfinite(z))
    p = jnp.where(solved, z[:n], 0.0)
    y = lam[me + mi : 2 * me + mi] - lam[:me]
    nu = lam[me : me + mi]
    # Of a corrected step the model is that of the corrected constraints.
    c, d = s.at.c + s.shift[0] + s.at.J @ p, s.at.d + s.shift[1] + s.at.K @ p
    trial_x = jnp.clip(s.x + p, lower, upper)
    trial = evaluate(trial_x)
    before = s.at.f + s.rho * _penalty(s.at.c, s.at.d)
    after = trial.f + s.rho * _penalty(trial.c, trial.d)
    model = s.at.f + s.at.g @ p + 0.5 * p @ s.B @ p + s.rho * _penalty(c, d)
    predicted = before - model
    # Where both are rounding, the step is a success.
    noise = 10.0 * jnp.finfo(p.dtype).eps * (jnp.abs(before) + jnp.abs(s.at.f) + 1e-3)
    gain = before - after
    finite = jnp.isfinite(after) & jnp.all(jnp.isfinite(trial.g)) & solved
    ratio = jnp.where(finite, (gain + noise) / (jnp.maximum(predicted, 0.0) + noise), -1.0)
    take = ratio > 1e-4
    length = jnp.max(jnp.abs(p))
    grow = (ratio > 0.75) & (length > 0.8 * s.radius)
    # A correction is worth one trial where the constraints, and not the objective, refuse.
    raised = _penalty(trial.c, trial.d) > _penalty(c, d) + noise
    curved = finite & ~take & ~s.corrected & raised
    small = jnp.where(curved, s.radius, 0.35 * jnp.minimum(s.radius, length))
    radius = jnp.where(take, jnp.where(grow, 2.0 * s.radius, s.radius), small)
    radius = jnp.where(take & (ratio < 0.25), 0.5 * s.radius, radius)
    far = _penalty(s.at.c, s.at.d)
    reached = _penalty(c, d)
    present = far > 1e4 * jnp.finfo(p.dtype).eps
    stuck = (reached > 0.5 * far) & present & solved
    hopeless = (reached > (1.0 - 1e-6) * far) & present & (s.rho >= MOST_WEIGHT)
    rho = jnp.where(stuck, jnp.minimum(4.0 * s.rho, MOST_WEIGHT), s.rho)
    B = jnp.where(take, _damped_bfgs(s, trial, p, y, nu), s.B) if update else s.B
    keep = lambda new, old: jnp.where(take, new, old)  # noqa: E731
    shift = (trial.c - c, trial.d - d)
    moved = s._replace(
        x=keep(trial_x, s.x),
        at=jax.tree.map(keep, trial, s.at),
        B=B,
        y=keep(y, s.y),
        nu=keep(nu, s.nu),
        rho=rho,
        radius=radius,
        shift=jax.tree.map(lambda x: jnp.where(curved, x, 0.0), shift),
        corrected=curved,
        hopeless=hopeless,
        steps=s.steps + 1,
    )
    moved = moved._replace(gradient=_gradient(moved, lower, upper), violation=_violation(moved.at))
    row = jnp.stack([moved.at.f, moved.violation, moved.gradient])
    return moved._replace(rows=s.rows.at[s.steps].set(row))


def _damped_bfgs(s: SqpState, trial: Values, p: Array, y: Array, nu: Array) -> Array:
    """Powell's update of the curvature, which stays positive."""
    change = _slope(trial, y, nu) - _slope(s.at, y, nu)
    B = s.B
    own = p @ B @ p
    along = p @ change
    # The first step sets the size of the curvature.
    fresh = (s.steps == 0) & (along > 0.0)
    scale = jnp.where(fresh, (change @ change) / jnp.where(fresh, along, 1.0), 1.0)
    B = jnp.where(fresh, jnp.clip(scale, 1e-4, 1e4) * B, B)
    own = jnp.where(fresh, p @ B @ p, own)
    low = along < 0.2 * own
    share = jnp.where(low, 0.8 * own / jnp.where(low, own - along, 1.0), 1.0)
    change = share * change + (1.0 - share) * (B @ p)
    bottom, top = own, p @ change
    usable = (bottom > 0.0) & (top > 0.0)
    bottom, top = (jnp.where(usable, v, 1.0) for v in (bottom, top))
    q = B @ p
    new = B - jnp.outer(q, q) / bottom + jnp.outer(change, change) / top
    return jnp.where(usable, new, B)

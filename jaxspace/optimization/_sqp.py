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
gradients at the start. The loop is that of `_drive.py`: the state carries the step that waits for
its evaluation.

Source: Fletcher, Practical Methods of Optimization, 12.4 (S l1 QP), 14.4; Powell 1978 (damping).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ._gradient_check import GRADIENT_TOLERANCE, PROBES, probe, probed_error
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


class Pending(NamedTuple):
    """A step p whose end is not evaluated yet, and the multipliers of its programme."""

    p: Float[Array, " n"]
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    solved: Bool[Array, ""]


class SqpState(NamedTuple):
    """What one step hands to the next; `y`, `nu` are the multipliers of c and d, `shift` the
    second-order correction of (c, d), `weight` the scale of (f, c, d), `rows` the history.

    - `calls`: the number of the next evaluation: below zero the probes of the gradient, at zero
      that of the start; `probed`: the values of the probes, and `wrong`: what they find.
    - `size`: of the unknowns, by which they are scaled."""

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
    taken: Int[Array, ""]
    rows: Float[Array, "steps 3"]
    trial: Float[Array, " n"]
    pending: Pending
    weight: Float[Array, " all"]
    calls: Int[Array, ""]
    probed: Float[Array, "4 all"]
    wrong: Float[Array, ""]
    size: Float[Array, " n"]


class Found(NamedTuple):
    """An evaluation of the problem: values of f, c and d together, their Jacobian, the report."""

    values: Float[Array, " all"]
    jacobian: Float[Array, "all n"]
    report: Any


class Limits(NamedTuple):
    """Bounds of the scaled unknowns, which may be infinite, and the tolerance for the projected
    gradient of the Lagrangian and the violation, both scaled."""

    lower: Float[Array, " n"]
    upper: Float[Array, " n"]
    tolerance: Float[Array, ""]


def begin(
    x: Float[Array, " n"],
    size: Float[Array, " n"],
    me: int,
    mi: int,
    report: Any,
    max_steps: int,
    check: bool,
) -> SqpState:
    """The state before the first evaluation.

    **Arguments**

    - `x`: scaled unknowns at the start; `size`: by which they are scaled.
    - `me`, `mi`: how many equalities and inequalities there are.
    - `report`: a tree of the shapes of what the problem reports.
    - `check`: whether the gradient is compared with differences first."""
    n, rows = x.size, 1 + me + mi
    zeros = functools.partial(jnp.zeros, dtype=x.dtype)
    at = Values(zeros(()), zeros(me), zeros(mi), zeros(n), zeros((me, n)), zeros((mi, n)), report)
    one, no = jnp.ones((), x.dtype), jnp.asarray(False)
    calls = jnp.asarray(-PROBES if check else 0)
    return SqpState(
        x, at, jnp.eye(n, dtype=x.dtype), zeros(me), zeros(mi), 10.0 * one, one,
        (zeros(me), zeros(mi)), no, no, jnp.inf * one, jnp.inf * one, jnp.asarray(0),
        jnp.full((max_steps, 3), jnp.nan, x.dtype),
        probe(x, jnp.ones_like(x), calls) if check else x,
        Pending(zeros(n), zeros(me), zeros(mi), no), jnp.ones(rows, x.dtype), calls,
        zeros((PROBES, rows)), zeros(()), size,
    )  # fmt: skip


def unfinished(s: SqpState, limits: Limits) -> Bool[Array, ""]:
    """Whether another evaluation is wanted."""
    missed = (s.gradient > limits.tolerance) | (s.violation > limits.tolerance)
    sound = (s.wrong <= GRADIENT_TOLERANCE) & jnp.isfinite(s.at.f)
    least = 1e2 * jnp.finfo(s.x.dtype).eps
    goes_on = missed & ~s.hopeless & (s.taken < s.rows.shape[0]) & (s.radius > least) & sound
    return (s.calls <= 0) | goes_on


def advance(
    s: SqpState,
    found: Found,
    limits: Limits,
    curvature: Callable[[Array, Array], Array] | None = None,
) -> SqpState:
    """The state after an evaluation at `s.trial`: it is a probe, the start, or the end of a step.

    - `curvature`: from x and the weights of (f, c, d) to the Hessian of their sum; without it
      BFGS."""

    def probing(s: SqpState) -> SqpState:
        following = s.calls + 1
        place = probe(s.x, jnp.ones_like(s.x), following)
        return s._replace(
            probed=s.probed.at[s.calls].set(found.values),
            calls=following,
            trial=jnp.where(following < 0, place, s.x),
        )

    def searching(s: SqpState) -> SqpState:
        s = lax.cond(s.calls == 0, _started, functools.partial(_judged, limits=limits), s, found)
        if curvature is not None:
            weights = s.weight * jnp.concatenate([jnp.ones(1, s.x.dtype), s.y, -s.nu])
            values, vectors = jnp.linalg.eigh(curvature(s.x, weights))
            floor = 1e-8 * jnp.max(jnp.abs(values)) + 1e-12
            s = s._replace(B=(vectors * jnp.maximum(jnp.abs(values), floor)) @ vectors.T)
        s = s._replace(calls=s.calls + 1, gradient=_gradient(s, limits))
        return _planned(s, limits)

    return lax.cond(s.calls < 0, probing, searching, s)


def _scaled(found: Found, weight: Array, me: int) -> Values:
    values, jacobian = weight * found.values, weight[:, None] * found.jacobian
    f, c, d = values[0], values[1 : 1 + me], values[1 + me :]
    return Values(f, c, d, jacobian[0], jacobian[1 : 1 + me], jacobian[1 + me :], found.report)


def _started(s: SqpState, found: Found) -> SqpState:
    """With the values at the start, which set the scales."""
    weight = _weights(found.jacobian)
    at = _scaled(found, weight, s.y.size)
    mixed = weight * jnp.cos(1.3 * jnp.arange(weight.size, dtype=weight.dtype))
    checked = jnp.any(s.probed != 0.0)
    wrong = probed_error(s.probed @ mixed, s.x, jnp.ones_like(s.x), mixed @ found.jacobian)
    return s._replace(
        at=at, weight=weight, violation=_violation(at), wrong=jnp.where(checked, wrong, 0.0)
    )


def _weights(jacobian: Float[Array, "rows n"]) -> Float[Array, " rows"]:
    """The inverse of the size of each row of the Jacobian; 1 for a row of zeros."""
    row = jnp.max(jnp.abs(jacobian), axis=1)
    usable = (row > 0.0) & jnp.isfinite(row)
    return jnp.where(usable, 1.0 / jnp.where(usable, row, 1.0), 1.0)


def _violation(at: Values) -> Float[Array, ""]:
    """The largest violation of an equality or an inequality."""
    largest = jnp.max(jnp.abs(at.c), initial=0.0)
    return jnp.maximum(largest, jnp.max(-at.d, initial=0.0))


def _slope(at: Values, y: Array, nu: Array) -> Float[Array, " n"]:
    """The gradient of the Lagrangian f + y.c - nu.d."""
    return at.g + at.J.T @ y - at.K.T @ nu


def _gradient(s: SqpState, limits: Limits) -> Float[Array, ""]:
    """The largest component of the gradient that the bounds leave free, or of nu d."""
    x = s.x
    free = x - jnp.clip(x - _slope(s.at, s.y, s.nu), limits.lower, limits.upper)
    loose = jnp.minimum(jnp.maximum(s.at.d, 0.0), s.nu)
    return jnp.maximum(jnp.max(jnp.abs(free)), jnp.max(loose, initial=0.0))


def _penalty(c: Array, d: Array) -> Float[Array, ""]:
    return jnp.sum(jnp.abs(c)) + jnp.sum(jnp.maximum(-d, 0.0))


def _programme(s: SqpState, limits: Limits) -> tuple[Programme, Array]:
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
    low = jnp.maximum(limits.lower - s.x, -s.radius)
    high = jnp.minimum(limits.upper - s.x, s.radius)
    h = jnp.concatenate([c, d, -c, -low, high, jnp.zeros_like(d)])
    first = jnp.concatenate([0.5 * (low + high), 1.0 + jnp.abs(c), 1.0 + jnp.maximum(-d, 0.0)])
    return Programme(Q, q, G, h), first


def _planned(s: SqpState, limits: Limits) -> SqpState:
    """With the next step, from the programme at x."""
    programme, first = _programme(s, limits)
    z, lam = solve_programme(programme, first)
    n, me, mi = s.x.size, s.at.c.size, s.at.d.size
    solved = jnp.all(jnp.isfinite(z))
    p = jnp.where(solved, z[:n], 0.0)
    y = lam[me + mi : 2 * me + mi] - lam[:me]
    pending = Pending(p, y, lam[me : me + mi], solved)
    return s._replace(trial=jnp.clip(s.x + p, limits.lower, limits.upper), pending=pending)


def _judged(s: SqpState, found: Found, limits: Limits) -> SqpState:
    """With the end of the step that was pending, if it is taken, or a smaller radius."""
    p, y, nu, solved = s.pending
    trial = _scaled(found, s.weight, s.y.size)
    # Of a corrected step the model is that of the corrected constraints.
    c, d = s.at.c + s.shift[0] + s.at.J @ p, s.at.d + s.shift[1] + s.at.K @ p
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
    B = jnp.where(take, _damped_bfgs(s, trial, p, y, nu), s.B)
    keep = lambda new, old: jnp.where(take, new, old)  # noqa: E731
    shift = (trial.c - c, trial.d - d)
    moved = s._replace(
        x=keep(s.trial, s.x),
        at=jax.tree.map(keep, trial, s.at),
        B=B,
        y=keep(y, s.y),
        nu=keep(nu, s.nu),
        rho=rho,
        radius=radius,
        shift=jax.tree.map(lambda x: jnp.where(curved, x, 0.0), shift),
        corrected=curved,
        hopeless=hopeless,
        taken=s.taken + 1,
    )
    moved = moved._replace(gradient=_gradient(moved, limits), violation=_violation(moved.at))
    row = jnp.stack([moved.at.f, moved.violation, moved.gradient])
    return moved._replace(rows=s.rows.at[s.taken].set(row))


def _damped_bfgs(s: SqpState, trial: Values, p: Array, y: Array, nu: Array) -> Array:
    """Powell's update of the curvature, which stays positive."""
    change = _slope(trial, y, nu) - _slope(s.at, y, nu)
    B = s.B
    own = p @ B @ p
    along = p @ change
    # The first step sets the size of the curvature.
    fresh = (s.calls == 1) & (along > 0.0)
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

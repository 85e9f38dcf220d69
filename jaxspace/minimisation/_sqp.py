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
least violation. Along curved constraints a good step may raise phi, because the violation grows
with the square of its length (the Maratos effect). A step that raises the violation is therefore
compared with the largest phi of the last few accepted points (a nonmonotone test); if it fails that
too, it is corrected once with the constraints at its end (second-order correction). Unknowns,
objective and constraints are scaled (`_scaling.py`). The loop is that of `_drive.py`: the state
contains the step pending evaluation. Files: `_sqp_state.py`, `_sqp_measures.py`,
`_local_scale.py` (whether a search has converged).

Source: Fletcher, Practical Methods of Optimization, 12.4 (S l1 QP), 14.4; Powell 1978 (damping);
Nocedal and Wright, 15.5, 18.3 (Maratos effect); Panier and Tits, SIAM J. Numer. Anal. 28 (1991),
1183 (nonmonotone test).
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, PyTree

from ..core import Flag, Scalar
from ._gradient_check import MOST_LEVELS, PROBES, probed_error, varies
from ._infeasibility import ROUNDINGS
from ._local_scale import MOST_JUDGEMENTS, Judged, local_sizes
from ._quadratic import Programme, solve_programme
from ._scaling import weights
from ._sqp_measures import damped_bfgs, gradient, only, penalty, remembered, scaled, violation
from ._sqp_state import Evaluation, Limits, Pending, SqpState, Values, met, probes_of, stalled

# The largest weight: a violation that no step reduces then is final.
MOST_WEIGHT = 1e6


def advance(
    s: SqpState,
    evaluation: Evaluation,
    limits: Limits,
    curvature: Callable[[Array, Array], Array] | None = None,
) -> SqpState:
    """The state after an evaluation at `s.trial`: it is a probe, the start, or the end of a step.

    - `curvature`: a function from x and the weights of (f, c, d) to the Hessian of their sum;
      without it BFGS is used."""

    def probing(s: SqpState) -> SqpState:
        following = s.calls + 1
        at = probes_of(s.x, limits, s.level)
        place = s.x + at.shares[following] * at.direction
        return s._replace(
            probed=s.probed.at[s.calls].set(evaluation.values),
            calls=following,
            trial=jnp.where(following < 0, place, s.x),
        )

    def searching(s: SqpState) -> SqpState:
        started = s.calls == 0
        ways = [functools.partial(way, limits=limits) for way in (_started, _stepped, _rescaled)]
        way = jnp.where(started, 0, jnp.where(s.displaced, 2, 1))
        s = lax.switch(way, ways, s, evaluation)
        if curvature is not None:
            # The magnitudes of the eigenvalues, raised above zero, because the programme of a step
            # must be convex.
            weights = s.weight * jnp.concatenate([jnp.ones(1, s.x.dtype), s.y, -s.nu])
            values, vectors = jnp.linalg.eigh(curvature(s.x, weights))
            floor = 1e-8 * jnp.max(jnp.abs(values)) + 1e-12
            s = s._replace(B=(vectors * jnp.maximum(jnp.abs(values), floor)) @ vectors.T)
        s = s._replace(calls=s.calls + 1, gradient=gradient(s, limits))
        planned = _planned(s, limits)
        # The weights grow at most once at each place.
        s = jax.tree.map(
            functools.partial(jnp.where, way == 2), planned, _confirmed(planned, limits)
        )
        return _checked_again(s, started & s.unclear, limits)

    return lax.cond(s.calls < 0, probing, searching, s)


def _started(s: SqpState, evaluation: Evaluation, limits: Limits) -> SqpState:
    """Set the scales from the values and gradients at the start."""
    weight = weights(evaluation.values, evaluation.jacobian)
    at = scaled(evaluation, weight, s.y.size)
    checked, probed = jnp.any(s.probed != 0.0), probes_of(s.x, limits, s.level)
    claimed = weight * (evaluation.jacobian @ probed.direction)
    wrong, worst = probed_error(weight * s.probed, probed, claimed)
    unclear = checked & (s.level < MOST_LEVELS) & varies(weight * s.probed, probed, claimed, s.x)
    wrong = jnp.where(checked & ~unclear, wrong, 0.0)
    s = s._replace(at=at, weight=weight, violation=violation(at))
    s = s._replace(past=only(s, limits))
    return s._replace(wrong=wrong, worst=worst, unclear=unclear)


def _place(s: SqpState) -> Judged:
    return Judged(s.x, s.at, s.y, s.nu, local_sizes(s.x, s.start))


def _confirmed(s: SqpState, limits: Limits) -> SqpState:
    """The state before the evaluation that decides, if the search has met its tolerance and the
    numbers at its place do not confirm it."""
    place = _place(s)
    doubtful = place.growth(limits)[0] & (s.judgements < MOST_JUDGEMENTS)
    # Weights that are far too small may also be the reason why no step helps.
    asks = (met(s, limits) | stalled(s)) & s.at.sound() & doubtful & ~s.judged
    return s._replace(
        judged=met(s, limits) & ~asks,
        displaced=asks,
        trial=jnp.where(asks, place.displaced(limits), s.trial),
    )


def _rescaled(s: SqpState, evaluation: Evaluation, limits: Limits) -> SqpState:
    """The state after the evaluation that decides: judged, or with the weights of this place."""
    place = _place(s)
    curvature = place.curvature(scaled(evaluation, s.weight, s.y.size), limits)
    again, factor = place.growth(limits, curvature)
    me = s.y.size
    f, c, d = factor[0], factor[1 : 1 + me], factor[1 + me :]
    grown = s.at.grown(f, c, d)
    y, nu = s.y * f / c, s.nu * f / d
    # A zero would leave an unknown without a model: there a step is about its size.
    bend = jnp.where(curvature > 0.0, curvature, jnp.abs(s.at.g) / place.size + 1e-12)
    largest = jnp.max(jnp.abs(jnp.concatenate([y, nu])), initial=5.0)
    moved = s._replace(
        weight=factor * s.weight,
        at=grown,
        y=y,
        nu=nu,
        B=jnp.where(f > 1.0, jnp.diag(jnp.where(jnp.isfinite(bend), f * bend, f)), s.B),
        rho=2.0 * largest,
        radius=jnp.maximum(s.radius, jnp.max(place.size)),
        shift=jax.tree.map(jnp.zeros_like, s.shift),
        corrected=jnp.zeros_like(s.corrected),
        still=jnp.zeros_like(s.still),
        judgements=s.judgements + 1,
        violation=violation(grown),
    )
    moved = moved._replace(past=only(moved, limits))
    s = jax.tree.map(functools.partial(jnp.where, jnp.any(factor > 1.0)), moved, s)
    return s._replace(judged=~again, displaced=jnp.asarray(False))


def _checked_again(s: SqpState, again: Flag, limits: Limits) -> SqpState:
    """The state before nearer probes of the gradient, if it is checked `again`."""
    level = jnp.where(again, s.level + 1, s.level)
    nearer = probes_of(s.x, limits, level)
    place = s.x + nearer.shares[0] * nearer.direction
    return s._replace(
        level=level,
        calls=jnp.where(again, -PROBES, s.calls),
        trial=jnp.where(again, place, s.trial),
        unclear=jnp.asarray(False),
    )


def _programme(s: SqpState, limits: Limits) -> tuple[Programme, Array]:
    """The programme of a step in (p, e, f): elastic unknowns e of c and f of d; and a start."""
    c, d = s.at.c + s.shift[0], s.at.d + s.shift[1]
    n = s.x.size
    me = c.size
    mi = d.size
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
    """Compute the next step from the quadratic programme at x."""
    programme, first = _programme(s, limits)
    z, lam = solve_programme(programme, first)
    n = s.x.size
    me = s.at.c.size
    mi = s.at.d.size
    solved = jnp.all(jnp.isfinite(z))
    p = jnp.where(solved, z[:n], 0.0)
    # An equality enters the programme as two inequalities, whose multipliers subtract.
    y = lam[me + mi : 2 * me + mi] - lam[:me]
    pending = Pending(p, y, lam[me : me + mi], solved)
    # Clipped, because the programme satisfies the bounds to rounding only.
    return s._replace(trial=jnp.clip(s.x + p, limits.lower, limits.upper), pending=pending)


class Comparison(NamedTuple):
    """The end of a pending step compared with the prediction of its programme.

    - `at`: values and derivatives at the end; `c`, `d`: constraints of the model there.
    - `ratio`: the decrease of phi over that of the model, -1 without a finite step; for a
      step that raises the violation also from the largest phi of `past`, then at most 0.5.
    - `raised`: whether the constraints are violated more than in the model.
    - `predicted`, `noise`: decrease of the model, and its rounding.
    - `finite`: whether the end and the programme are."""

    at: Values
    c: Float[Array, " equal"]
    d: Float[Array, " inequal"]
    ratio: Scalar
    raised: Flag
    predicted: Scalar
    noise: Scalar
    finite: Flag


def _compared(s: SqpState, evaluation: Evaluation) -> Comparison:
    """Decrease of the penalty function along the pending step, compared with that of the model."""
    p = s.pending.p
    trial = scaled(evaluation, s.weight, s.y.size)
    # The model of a corrected step has the corrected constraints.
    c, d = s.at.c + s.shift[0] + s.at.J @ p, s.at.d + s.shift[1] + s.at.K @ p
    before = s.at.f + s.rho * penalty(s.at.c, s.at.d)
    after = trial.f + s.rho * penalty(trial.c, trial.d)
    model = s.at.f + s.at.g @ p + 0.5 * p @ s.B @ p + s.rho * penalty(c, d)
    predicted = before - model
    # Where gain and prediction are both rounding, that of the programme included, the step is a
    # success.
    rounded = jnp.abs(before) + jnp.abs(s.at.f) + 1e-3 + 10.0 * s.rho
    noise = 10.0 * jnp.finfo(p.dtype).eps * rounded
    finite = trial.sound() & jnp.isfinite(after) & s.pending.solved
    gained = (before - after + noise) / (jnp.maximum(predicted, 0.0) + noise)
    raised = penalty(trial.c, trial.d) > penalty(c, d) + noise
    # The next step removes most of the violation that a step along curved constraints leaves.
    highest = jnp.max(s.past[:, 0] + s.rho * s.past[:, 1])
    below = (highest - after + noise) / (jnp.maximum(predicted, 0.0) + noise)
    # At most 0.5, so that such a step does not enlarge the radius.
    gained = jnp.where(raised, jnp.maximum(gained, jnp.minimum(below, 0.5)), gained)
    gained = jnp.where(finite, gained, -1.0)
    return Comparison(trial, c, d, gained, raised, predicted, noise, finite)


def _is_taken(s: SqpState, end: Comparison, limits: Limits) -> tuple[Flag, Flag]:
    """Whether the pending step is accepted, and whether it leads nearer to the minimum."""
    # With the multipliers of the step, with which its gradient has to vanish.
    ahead = s._replace(x=s.trial, at=end.at, y=s.pending.y, nu=s.pending.nu)
    slope = gradient(ahead, limits)
    # A step whose predicted gain is rounding is accepted only if it reduces the gradient. Along
    # curved constraints it need not do so at each step.
    most, least = s.gradient, s.gradient
    if s.y.size + s.nu.size:
        most, least = jnp.max(s.past[:, 2]), jnp.min(s.past[:, 2])
    gains = end.predicted > end.noise
    take = (end.ratio > 1e-4) & (gains | (slope < most))
    return take, gains | (take & (slope < least))


def _next_radius(s: SqpState, ratio: Scalar, take: Flag, curved: Flag) -> Scalar:
    """The radius of trust after the pending step; `curved`: whether it is tried again, corrected.

    The ratios 0.25 and 0.75 and the doubling are those of Fletcher, 5.1."""
    p, _, _, solved = s.pending
    # Where the programme was not solved no step is taken, and only the radius shrinks.
    length = jnp.where(solved, jnp.max(jnp.abs(p)), s.radius)
    grow = (ratio > 0.75) & (length > 0.8 * s.radius)
    # No more than a fraction of the step's length: with a larger radius the same step would be
    # computed again.
    small = jnp.where(curved, s.radius, 0.35 * jnp.minimum(s.radius, length))
    radius = jnp.where(take, jnp.where(grow, 2.0 * s.radius, s.radius), small)
    return jnp.where(take & (ratio < 0.25), 0.5 * s.radius, radius)


def _stepped(s: SqpState, evaluation: Evaluation, limits: Limits) -> SqpState:
    """Accept the pending step, correct it, or reject it and reduce the trust radius."""
    p, y, nu, _ = s.pending
    end = _compared(s, evaluation)
    take, nearer = _is_taken(s, end, limits)
    modelled = penalty(end.c, end.d)
    # A correction is tried once where the constraints, and not the objective, reject the step.
    curved = end.finite & ~take & ~s.corrected & end.raised
    rho, hopeless = _weighted(s, modelled, take)
    keep = lambda new, old: jnp.where(take, new, old)  # noqa: E731
    shift = (end.at.c - end.c, end.at.d - end.d)
    moved = s._replace(
        x=keep(s.trial, s.x),
        at=jax.tree.map(keep, end.at, s.at),
        # A rejected step has no information on the curvature at the current point.
        B=keep(damped_bfgs(s, end.at, p, y, nu), s.B),
        y=keep(y, s.y),
        nu=keep(nu, s.nu),
        rho=rho,
        radius=_next_radius(s, end.ratio, take, curved),
        shift=jax.tree.map(lambda x: jnp.where(curved, x, 0.0), shift),
        corrected=curved,
        hopeless=hopeless,
        still=jnp.where(nearer, 0, s.still + 1),
    )
    moved = moved._replace(gradient=gradient(moved, limits), violation=violation(moved.at))
    moved = moved._replace(past=keep(remembered(s, moved, limits), s.past))
    return _counted(moved, end.at.sound(), evaluation.report)


def _counted(s: SqpState, sound: Flag, report: PyTree) -> SqpState:
    """The state with the step in its counts and its history; `sound`: whether the numbers at the
    end of the step, which the problem reports as `report`, are finite."""
    row = jnp.stack([s.at.f / s.weight[0], s.violation, s.gradient])
    return s._replace(
        taken=s.taken + 1,
        steps=s.steps + 1,
        left_out=s.left_out + jnp.where(sound, 0, 1),
        refused=jax.tree.map(functools.partial(jnp.where, sound), s.refused, report),
        rows=s.rows.at[s.taken].set(row),
    )


def _weighted(s: SqpState, modelled: Scalar, take: Flag) -> tuple[Scalar, Flag]:
    """The weight of the violation after the pending step, whose model leaves the penalty
    `modelled`; and whether no larger weight helps. `take`: whether the step is accepted."""
    p, y, nu, solved = s.pending
    far = penalty(s.at.c, s.at.d)
    # A corrected model has other constraints than those at x.
    present = (far > ROUNDINGS * jnp.finfo(p.dtype).eps) & ~s.corrected & solved
    # Where even the model leaves half of the violation, the objective still outweighs it, unless it
    # is within the accuracy of the programme, whose slopes are as large as the weight.
    accurate = far > 1e3 * (1.0 + s.rho) * jnp.finfo(p.dtype).eps
    stuck = (modelled > 0.5 * far) & present & accurate
    # A short step reduces little where a long one would reduce much.
    least = 1e-6 * far * jnp.minimum(s.radius, 1.0)
    hopeless = (far - modelled < least) & present & (s.rho >= MOST_WEIGHT)
    rho = jnp.where(stuck, jnp.minimum(4.0 * s.rho, MOST_WEIGHT), s.rho)
    # A weight far above the multipliers follows a curved constraint in tiny steps.
    largest = jnp.max(jnp.abs(jnp.concatenate([y, nu])), initial=0.0)
    eased = jnp.minimum(s.rho, jnp.maximum(0.25 * s.rho, 2.0 * largest))
    rho = jnp.where(take & (modelled <= 0.01 * far), eased, rho)
    return rho, hopeless

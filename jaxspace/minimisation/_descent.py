"""Descent by an optimiser of optax, under constraints by the method of multipliers.

    q <- q + share * update(grad L, state, q, value=L, grad=grad L, value_fn=L)

A round is a descent of one augmented Lagrangian (`_lagrangian.py`); it ends when the gradient is
small compared with the violation, or when neither decreases. The optimiser continues through all
rounds, with its moments and schedules; its state for a single function (curvature, the end of a
line search) is reset with each. A step to a place whose numbers are not finite is left out,
counted, and tried again with a quarter of its length. The result is the point of the least exact
penalty, because an optimiser with fixed steps does not descend at each of them.

Files: `optimiser.py` (inputs of optax), `_descent_state.py`, `_free_numbers.py` (bounds). The
loop is that of `_drive.py`.
"""

import functools

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core.safe import safe_divide
from ._descent_state import (
    LEAST_RATE,
    LEAST_SHARE,
    STILL_LINES,
    STILL_STEPS,
    DescentState,
    Place,
    Setting,
    converged,
    over,
)
from ._gradient_check import MOST_LEVELS, PROBES, probed_error, varies
from ._lagrangian import FIRST_WEIGHT
from ._local_scale import MOST_JUDGEMENTS, Judged, local_sizes
from ._scaling import weights
from ._sqp_measures import lagrangian_gradient, penalty, scaled, slope, violation
from ._sqp_state import Evaluation, Limits, probes_of

# A round ends where the gradient is below this part of the violation: a descent to the last digit
# is wasted while the multipliers are not right.
ENOUGH = 0.1
# After so many steps a round ends where its violation does not fall.
LONG_ROUND = 50
# Where the multipliers reduce the violation less than so, the weight has to grow.
SLOW, GROWTH = 0.25, 4.0
# The largest weight: a violation that no round reduces then is final.
MOST_WEIGHT = 1e6


def evaluate(s: DescentState, setting: Setting) -> Evaluation:
    """Values and derivatives at `s.trial`."""
    jacobian, (values, report) = setting.scaled.derivatives(_trial_point(s, setting), setting.ratio)
    return Evaluation(values, jacobian, report)


def _trial_point(s: DescentState, setting: Setting) -> Float[Array, " n"]:
    z = setting.point(s.trial)
    # Probes of the gradient and of the curvature are points of the problem itself, other trials are
    # unconstrained variables.
    return jnp.where((s.calls < 0) | (s.displaced == 1), s.trial, z)


def evaluated_step(s: DescentState, setting: Setting) -> DescentState:
    """The state after the evaluation at `s.trial`, and after the step that follows from it."""
    return advance(s, evaluate(s, setting), setting)


def advance(s: DescentState, found: Evaluation, setting: Setting) -> DescentState:
    """The state after an evaluation at `s.trial`: a probe of the gradient, the start, the end of a
    step, or the average of a schedule-free optimiser."""
    z = _trial_point(s, setting)
    ways = [functools.partial(f, setting=setting) for f in (_moved, _probed, _judged, _averaged)]
    way = jnp.where(s.displaced == 1, 2, jnp.where(s.averaging == 1, 3, 0))
    way = jnp.where(s.calls < 0, 1, way)
    return lax.switch(way, ways if setting.stepper.averages else ways[:3], s, found, z)


def _judged(s: DescentState, found: Evaluation, z: Array, *, setting: Setting) -> DescentState:
    """The state after the evaluation at a displaced point: judged, or with the weights of this
    place, from which the search begins again (`_local_scale.py`)."""
    del z
    here, limits, me = s.here, setting.limits, setting.me
    place = Judged(here.z, here.at, here.y, here.nu, local_sizes(here.z, s.start))
    curvature = place.curvature(scaled(found, s.weight, me), limits)
    again, factor = place.growth(limits, curvature)
    f, c, d = _numbers(factor, me)
    m = s.multipliers
    grown = s._replace(
        weight=factor * s.weight,
        here=_grown(here, f, c, d, limits),
        best=_grown(s.best, f, c, d, limits),
        multipliers=m._replace(y=m.y * f / c, nu=m.nu * f / d),
        optimiser=setting.stepper.restarted(s.optimiser, s.q, jnp.asarray(True)),
        trial=s.q,
        judgements=s.judgements + 1,
        still=jnp.zeros_like(s.still),
        displaced=jnp.full_like(s.displaced, 2),
    )
    ended = s._replace(judged=jnp.asarray(True), displaced=jnp.zeros_like(s.displaced), trial=s.q)
    return jax.tree.map(functools.partial(jnp.where, again), grown, ended)


def _grown(place: Place, f: Array, c: Array, d: Array, limits: Limits) -> Place:
    """A place with larger weights, by these factors."""
    at = place.at.grown(f, c, d)
    y, nu = place.y * f / c, place.nu * f / d
    gradient = lagrangian_gradient(at, place.z, y, nu, limits)
    return Place(place.z, at, y, nu, gradient, violation(at))


def _asked(s: DescentState, setting: Setting) -> DescentState:
    """The state before the evaluation that decides, if the search has met its tolerance and the
    numbers at its place do not confirm it."""
    here, limits = s.here, setting.limits
    place = Judged(here.z, here.at, here.y, here.nu, local_sizes(here.z, s.start))
    asks = converged(here, limits) & ~s.judged & (s.displaced == 0)
    doubtful = place.growth(limits)[0] & (s.judgements < MOST_JUDGEMENTS)
    return s._replace(
        judged=s.judged | (asks & ~doubtful),
        displaced=jnp.where(asks & doubtful, 1, 0),
        trial=jnp.where(asks & doubtful, place.displaced(limits), s.trial),
    )


def _probed(s: DescentState, found: Evaluation, z: Array, *, setting: Setting) -> DescentState:
    del z
    following = s.calls + 1
    start = setting.point(s.q)
    probes = probes_of(start, setting.limits, s.level)
    place = start + probes.shares[following] * probes.direction
    return s._replace(
        probed=s.probed.at[s.calls].set(found.values),
        calls=following,
        trial=jnp.where(following < 0, place, s.q),
    )


def _averaged(s: DescentState, found: Evaluation, z: Array, *, setting: Setting) -> DescentState:
    place = _place(s, found, z, setting)
    better = place.at.sound() & _no_worse(place, s.best)
    better = better | converged(place, setting.limits)
    best = jax.tree.map(functools.partial(jnp.where, better), place, s.best)
    return s._replace(best=best, averaging=jnp.asarray(2))


def _moved(s: DescentState, found: Evaluation, z: Array, *, setting: Setting) -> DescentState:
    """Accept the step or leave it out, and compute the next one; or probe the gradient again."""
    started = _started(s, found, setting)
    moved = _after_evaluation(started, found, z, setting)
    if not setting.check:
        return moved
    nearer = _nearer(started, setting)
    return jax.tree.map(functools.partial(jnp.where, started.unclear), nearer, moved)


def _nearer(s: DescentState, setting: Setting) -> DescentState:
    """The state before nearer probes of the gradient."""
    start, level = setting.point(s.q), s.level + 1
    probes = probes_of(start, setting.limits, level)
    return s._replace(
        level=level,
        calls=jnp.full_like(s.calls, -PROBES),
        trial=start + probes.shares[0] * probes.direction,
        unclear=jnp.asarray(False),
    )


def _after_evaluation(
    s: DescentState, found: Evaluation, z: Array, setting: Setting
) -> DescentState:
    first = s.calls == 0
    place = _place(s, found, z, setting)
    accepted = first | place.at.sound()
    keep = functools.partial(jnp.where, accepted)
    here = jax.tree.map(keep, place, s.here)
    better = accepted & (first | _no_worse(place, s.best) | converged(place, setting.limits))
    row = jnp.stack([here.at.f / s.weight[0], here.violation, here.gradient])
    s = s._replace(
        q=keep(s.trial, s.q),
        here=here,
        best=jax.tree.map(functools.partial(jnp.where, better), place, s.best),
        # A shorter step than the optimiser's, until one is finite again.
        share=keep(jnp.minimum(4.0 * s.share, 1.0), 0.25 * s.share),
        left_out=s.left_out + jnp.where(accepted, 0, 1),
        refused=jax.tree.map(keep, s.refused, found.report),
        rows=jnp.where(first, s.rows, s.rows.at[s.taken].set(row)),
        taken=s.taken + jnp.where(first, 0, 1),
        steps=s.steps + jnp.where(first, 0, 1),
        calls=s.calls + 1,
    )
    s = s._replace(stopped=s.stopped | (s.share < LEAST_SHARE))
    s = _asked(s, setting)
    asks = s.displaced == 1
    # Under `vmap` both are computed, which changes nothing.
    goes_on = accepted & ~asks & ~over(s, setting.limits)
    s = lax.cond(goes_on, lambda s: _stepped(s, setting), lambda s: s, s)
    trial = jnp.where(asks, s.trial, s.q + s.share * s.step)
    if setting.stepper.averages:
        ending = over(s, setting.limits) & ~asks & ~converged(s.here, setting.limits)
        trial = jnp.where(ending, setting.stepper.averaged(s.optimiser, s.q), trial)
        s = s._replace(averaging=jnp.where(ending, 1, 0))
    return s._replace(trial=trial)


def _started(s: DescentState, found: Evaluation, setting: Setting) -> DescentState:
    """The start of the search: the scales, and the error of the gradient where it was probed."""
    first = s.calls == 0
    weight = weights(found.values, found.jacobian)
    weight = jnp.where(first, weight, s.weight)
    if not setting.check:
        return s._replace(weight=weight)
    probes = probes_of(setting.point(s.q), setting.limits, s.level)
    claimed = weight * (found.jacobian @ probes.direction)
    wrong, worst = probed_error(weight * s.probed, probes, claimed)
    checked = first & jnp.any(s.probed != 0.0)
    unclear = (
        checked
        & (s.level < MOST_LEVELS)
        & varies(weight * s.probed, probes, claimed, setting.point(s.q))
    )
    checked = checked & ~unclear
    return s._replace(
        weight=weight,
        wrong=jnp.where(checked, wrong, s.wrong),
        worst=jnp.where(checked, worst, s.worst),
        unclear=unclear,
    )


def _place(s: DescentState, found: Evaluation, z: Array, setting: Setting) -> Place:
    at = scaled(found, s.weight, setting.me)
    now = s.multipliers.of(at.c, at.d)
    gradient = lagrangian_gradient(at, z, now.y, now.nu, setting.limits)
    return Place(z, at, now.y, now.nu, gradient, violation(at))


def _no_worse(place: Place, best: Place) -> Bool[Array, ""]:
    """Whether the exact penalty is at most that of the best point."""
    if not place.y.size + place.nu.size:
        return place.at.f <= best.at.f
    largest = jnp.max(jnp.abs(jnp.concatenate([place.y, place.nu])), initial=0.0)
    # Above the multipliers, so that its minimum is that of the problem.
    rho = jnp.maximum(FIRST_WEIGHT, 2.0 * largest)
    least = best.at.f + rho * penalty(best.at.c, best.at.d)
    return place.at.f + rho * penalty(place.at.c, place.at.d) <= least


def _stepped(s: DescentState, setting: Setting) -> DescentState:
    """The next step of the optimiser, in this round or at the start of the next one."""
    # After a step that changed nothing, memory of the function is of no use.
    restart = s.still > 0
    if setting.constrained:
        s, ended = _rounds(s, restart & setting.stepper.restarts, setting)
        restart = restart | ended
    state = setting.stepper.restarted(s.optimiser, s.q, restart)

    def function(q: Float[Array, " n"]) -> Array:
        values = setting.scaled.values(setting.point(q), setting.ratio)
        f, c, d = _numbers(s.weight * values, setting.me)
        value = s.multipliers.lagrangian(f, c, d)
        # A line search turns back where the function is infinite, and not where it is none.
        return jnp.where(jnp.isnan(value), jnp.inf, value)

    at, now = s.here.at, s.multipliers.of(s.here.at.c, s.here.at.d)
    g = slope(at, now.y, now.nu)
    if setting.constrained:
        g = s.multipliers.share * g
    if setting.free is not None:
        g = g * jax.jvp(setting.free.inside, (s.q,), (jnp.ones_like(s.q),))[1]
    value = s.multipliers.lagrangian(at.f, at.c, at.d)
    step, after = setting.stepper.step(s.q, g, value, function, state)
    sound = jnp.all(jnp.isfinite(step))
    step = jnp.where(sound, step, 0.0)
    if not setting.stepper.restarts:
        # Others begin again after a step that changed nothing.
        fresh = setting.stepper.begin(s.q)
        after = jax.tree.map(functools.partial(jnp.where, sound), after, fresh)
    change = jnp.max(jnp.abs(step) / jnp.maximum(jnp.abs(s.q), 1.0))
    unchanged = change <= 10.0 * jnp.finfo(s.q.dtype).eps
    fastest, most = s.fastest, STILL_LINES
    if not setting.stepper.restarts:
        rate = safe_divide(jnp.max(jnp.abs(step)), jnp.max(jnp.abs(g)))
        fastest, most = jnp.maximum(fastest, rate), STILL_STEPS
        unchanged = unchanged | (rate <= LEAST_RATE * fastest)
    still = jnp.where(unchanged, s.still + 1, 0)
    return s._replace(
        step=step,
        optimiser=after,
        left_out=s.left_out + jnp.where(sound, 0, 1),
        still=still,
        stopped=s.stopped | (still >= most),
        fastest=fastest,
        round_steps=s.round_steps + 1,
    )


def _numbers(values: Array, me: int) -> tuple[Array, Array, Array]:
    return values[0], values[1 : 1 + me], values[1 + me :]


def _rounds(
    s: DescentState, stuck: Bool[Array, ""], setting: Setting
) -> tuple[DescentState, Bool[Array, ""]]:
    """The multipliers of the next round where this one ended, and whether it did."""
    at, m = s.here.at, s.multipliers
    left, (begun, last) = m.missed(at.c, at.d), s.missed
    enough = s.here.gradient <= jnp.maximum(setting.limits.tolerance, ENOUGH * left)
    long = s.round_steps >= LONG_ROUND
    # With fixed steps the gradient may never be small: then the violation must have settled.
    ended = enough | stuck | (long & (left > 0.9 * begun))
    slow = ended & enough & (left > SLOW * last)
    hopeless = slow & (m.rho >= MOST_WEIGHT) & (left > setting.limits.tolerance)
    now = m.of(at.c, at.d)
    now = now._replace(rho=jnp.where(slow, jnp.minimum(GROWTH * m.rho, MOST_WEIGHT), m.rho))
    s = s._replace(
        multipliers=jax.tree.map(functools.partial(jnp.where, ended), now, m),
        missed=(jnp.where(ended | long, left, begun), jnp.where(ended, left, last)),
        round_steps=jnp.where(ended | long, 0, s.round_steps),
        stopped=s.stopped | hopeless,
    )
    return s, ended

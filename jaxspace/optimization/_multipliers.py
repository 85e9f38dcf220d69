"""A local minimum under constraints, by gradients: L-BFGS inside the method of multipliers.

    minimise f(x)   subject to   c(x) = 0,   d(x) >= 0
    L(x) = f + lambda . c + (rho/2) |c|^2 + (1/2 rho) sum [max(0, nu - rho d)^2 - nu^2]
    lambda <- lambda + rho c,   nu <- max(0, nu - rho d)          after each descent of L in x

    symbol       meaning
    f, c, d      objective, equalities, inequalities, scaled as in `_scaling.py`
    lambda, nu   multipliers
    rho          weight of the constraints, ten times larger while they do not decrease

Every evaluation has one purpose, by `calls` and the flags of the state: the slope of one of the
numbers f, c, d at the start, by which it is scaled (`measured`), a probe of the gradient, the start
of a descent (`fresh`), a step of Adam, or a trial of the line search; or, after the last descent,
the slope of a violation that is left (`judges`):

    L(x + t p) <= L(x) + 1e-4 t p.g,   p.g(x + t p) >= 0.9 p.g        (weak Wolfe conditions)

Source: Hestenes 1969, Powell 1969, Rockafellar 1973; the directions are those of
`optax.scale_by_lbfgs` and `optax.adam`; Nocedal and Wright, 3.1, 3.5.
Valid for smooth functions. `f` may be infinite outside its domain: the line search turns back.
"""

import jax
import jax.numpy as jnp
import optax
from jax import lax
from jaxtyping import Array, Bool

from ._gradient_check import GRADIENT_TOLERANCE, probed_error, probes, sizes_of
from ._infeasibility import unit_weights
from ._multipliers_state import (
    Descent,
    Evaluation,
    Options,
    lagrangian,
    line_from,
    scaled_numbers,
)
from ._scaling import weights

ARMIJO, WOLFE = 1e-4, 0.9
MOST_TRIALS = 30


def unfinished(s: Descent, options: Options) -> Bool[Array, ""]:
    """Whether another evaluation is wanted."""
    missed = (s.gradient > options.tolerance) | (s.violation > options.tolerance)
    # While the numbers are measured, too, `calls` is not positive.
    goes_on = missed & (s.taken < s.rows.shape[0]) & _sound(s) & ~astray(s, options)
    return (s.calls <= 0) | goes_on | judges(s, options)


def judges(s: Descent, options: Options) -> Bool[Array, ""]:
    """Whether the descents are over and leave a violation, whose slope is not known yet."""
    over = (s.calls > 0) & (s.taken >= s.rows.shape[0]) & _sound(s) & ~astray(s, options)
    return over & (s.violation > options.tolerance) & ~s.judged


def _sound(s: Descent) -> Bool[Array, ""]:
    return (s.wrong <= GRADIENT_TOLERANCE) & is_finite(s)


def astray(s: Descent, options: Options) -> Bool[Array, ""]:
    """Whether the free numbers are farther than any optimum is meant to be."""
    return jnp.max(jnp.abs(s.x)) > options.farthest


def is_finite(s: Descent) -> Bool[Array, ""]:
    """Whether L and its derivatives are."""
    return jnp.isfinite(s.value) & jnp.all(jnp.isfinite(s.slopes) & jnp.isfinite(s.held))


def wanted(s: Descent, values: Array, options: Options) -> tuple[Array, Array]:
    """L of the `values` f, c, d in the units of the problem, and which sum of their gradients the
    search asks for: that of L, one of them alone while they are measured, that of the violation at
    the end."""
    total, along = jax.value_and_grad(lagrangian)(values, s)
    one = (jnp.arange(values.size) == s.measured).astype(values.dtype)
    along = jnp.where(s.measured < values.size, one, along)
    y, nu = violations(values, s)
    outward = s.weight * jnp.concatenate([jnp.zeros(1, values.dtype), y, -nu])
    return total, jnp.where(judges(s, options), outward, along)


def violations(values: Array, s: Descent) -> tuple[Array, Array]:
    """The scaled violations of c and of d, over the largest of them."""
    _, c, d = scaled_numbers(values, s)
    return unit_weights(c, -d)


def advance(s: Descent, found: Evaluation, options: Options) -> Descent:
    """The state after an evaluation at `s.trial`."""
    value, slopes = found.value, found.slopes

    def place_of(calls: Array) -> Array:
        probed = probes(s.x, sizes_of(s.x))
        return jnp.where(calls < 0, s.x + probed.shares[calls] * probed.direction, s.x)

    def measuring(s: Descent) -> Descent:
        sloped = s.sloped.at[s.measured].set(jnp.max(jnp.abs(found.held)))
        measured = s.measured + 1
        last = measured == s.sloped.size
        return s._replace(
            sloped=sloped,
            claimed=s.claimed.at[s.measured].set(slopes @ probes(s.x, sizes_of(s.x)).direction),
            weight=jnp.where(last, weights(found.values[0], sloped), s.weight),
            measured=measured,
            trial=jnp.where(last, place_of(s.calls), s.x),
        )

    def probing(s: Descent) -> Descent:
        following = s.calls + 1
        place = place_of(following)
        return s._replace(
            probed=s.probed.at[s.calls].set(found.values), calls=following, trial=place
        )

    def searching(s: Descent) -> Descent:
        checked = (s.calls == 0) & jnp.any(s.probed != 0.0)
        probed = probes(s.x, sizes_of(s.x))
        wrong, worst = probed_error(s.weight * s.probed, probed, s.weight * s.claimed)
        wrong = jnp.where(checked, wrong, s.wrong)
        s = s._replace(wrong=wrong, worst=jnp.where(checked, worst, s.worst), calls=jnp.asarray(1))
        fell, steep = _conditions(s, value, slopes)
        give_up = ~s.fresh & (s.line.trials + 1 >= MOST_TRIALS)
        done = s.fresh | (fell & ~steep) | give_up
        return lax.cond(done, _moved, _tried_again, s, found, fell, options)

    def judging(s: Descent) -> Descent:
        return s._replace(judged=jnp.asarray(True), outward=found.held)

    # By the order of the purposes in the text above.
    ended = judges(s, options)
    purpose = jnp.where(ended, 3, jnp.where(s.calls < 0, 1, 2))
    purpose = jnp.where(s.measured < s.sloped.size, 0, purpose)
    return lax.switch(purpose, (measuring, probing, searching, judging), s)


def _conditions(s: Descent, value: Array, slopes: Array) -> tuple[Array, Array]:
    """Whether the trial fell enough, and whether it still falls steeply."""
    finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(slopes))
    # Where both are rounding, the trial is a success.
    noise = 10.0 * jnp.finfo(s.x.dtype).eps * jnp.abs(s.value)
    fell = finite & (value <= s.value + ARMIJO * s.line.t * s.line.slope + noise)
    return fell, slopes @ s.line.p < WOLFE * s.line.slope


def _tried_again(s: Descent, found: Evaluation, fell: Array, options: Options) -> Descent:
    """Choose the next trial: within the bracket, or farther out where there is none yet."""
    del options
    line, value = s.line, found.value
    along = found.slopes @ line.p
    low, high = jnp.where(fell, line.t, line.low), jnp.where(fell, line.high, line.t)
    low_value = jnp.where(fell, value, line.low_value)
    low_slope = jnp.where(fell, along, line.low_slope)
    high_value = jnp.where(fell, line.high_value, value)
    width = jnp.where(jnp.isfinite(high), high - low, 1.0)
    # The minimum of a parabola by the slope at the lower end, kept away from both ends.
    bend = high_value - low_value - low_slope * width
    usable = jnp.isfinite(bend) & (bend > 0.0)
    share = jnp.where(usable, -0.5 * low_slope * width / jnp.where(usable, bend, 1.0), 0.5)
    within = low + width * jnp.clip(share, 0.1, 0.9)
    # Farther by a large factor, because the last trial fell steeply still.
    t = jnp.where(jnp.isfinite(high), within, 4.0 * line.t)
    line = line._replace(
        t=t, low=low, low_value=low_value, low_slope=low_slope, high=high, high_value=high_value,
        trials=line.trials + 1,
    )  # fmt: skip
    return s._replace(line=line, trial=s.x + t * line.p)


def _moved(s: Descent, found: Evaluation, fell: Array, options: Options) -> Descent:
    """Move x to the trial and choose the next direction, or end this descent."""
    # A line search that gave up leaves x where it was.
    good = s.fresh | fell
    new = s._replace(x=s.trial, **found._asdict())
    s = jax.tree.map(lambda a, b: jnp.where(good, a, b), new, s)
    return lax.cond(s.adam_left > 0, _by_adam, _by_lbfgs, s, good, options)


def _by_adam(s: Descent, good: Array, options: Options) -> Descent:
    """A step of Adam, which leaves flat and rough starts that a line search does not."""
    del good
    # Outside of the domain the objective is infinite, and has no slope to follow.
    slopes = jnp.where(jnp.isfinite(s.slopes), s.slopes, 0.0)
    with jax.numpy_dtype_promotion("standard"):
        made, adam = optax.scale_by_adam().update(slopes, s.adam, s.x)
    step = jnp.asarray(made)
    trial = s.x - jnp.asarray(options.adam_rate, s.x.dtype) * step
    return s._replace(trial=trial, adam=adam, adam_left=s.adam_left - 1)


def _by_lbfgs(s: Descent, good: Array, options: Options) -> Descent:
    """The next direction, or with the gradient small enough the next multipliers."""
    method = optax.scale_by_lbfgs()
    # optax mixes integer widths, which a caller's strict promotion would refuse.
    with jax.numpy_dtype_promotion("standard"):
        fresh = method.init(s.x)
        memory = jax.tree.map(lambda a, b: jnp.where(s.fresh, a, b), fresh, s.memory)
        made, memory = method.update(s.slopes, memory, s.x)
    memory = jax.tree.map(lambda a, b: a.astype(b.dtype), memory, s.memory)
    step = jnp.asarray(made)
    slope = -(step @ s.slopes)
    downhill = slope < 0.0
    p = jnp.where(downhill, -step, -s.slopes)
    slope = jnp.where(downhill, slope, -(s.slopes @ s.slopes))
    round_steps = jnp.where(s.fresh, 0, s.round_steps + 1)
    largest = jnp.max(jnp.abs(s.slopes))
    # A descent to the last digit is wasted while the multipliers are not right.
    enough = jnp.maximum(0.01 * jnp.minimum(s.violation, 1.0), options.tolerance)
    # At a start that is stationary by symmetry the first direction is zero: nothing is left to do.
    still = (round_steps > 0) & (largest <= enough)
    ended = still | (round_steps >= options.max_steps) | ~good | (largest == 0.0)
    s = s._replace(
        memory=memory,
        line=line_from(p, slope, s.value, jnp.ones_like(s.value)),
        trial=s.x + p,
        fresh=jnp.asarray(False),
        steps=s.steps + jnp.where(round_steps > 0, 1, 0),
        round_steps=round_steps,
    )
    return lax.cond(ended, _next_round, lambda s, g: s, s, largest)


def _next_round(s: Descent, largest: Array) -> Descent:
    """Update the multipliers and the weight after a descent."""
    _, c, d = scaled_numbers(s.values, s)
    # Either d or its multiplier must be zero, and neither negative.
    loose = jnp.max(jnp.abs(jnp.minimum(d, s.nu / s.rho)), initial=0.0)
    left = jnp.maximum(jnp.max(jnp.abs(c), initial=0.0), loose)
    # Where the multipliers by themselves hardly reduce the violation, the weight has to.
    rho = jnp.where(left > 0.25 * s.violation, 10.0 * s.rho, s.rho)
    row = jnp.stack([s.values[0], left, largest])
    # With the weight of this descent, before it grows.
    y, nu = s.y + s.rho * c, jnp.maximum(s.nu - s.rho * d, 0.0)
    return s._replace(
        trial=s.x, y=y, nu=nu, rho=rho, violation=left, gradient=largest,
        rows=s.rows.at[s.taken].set(row), taken=s.taken + 1, fresh=jnp.asarray(True),
        round_steps=jnp.asarray(0),
    )  # fmt: skip

"""One step in regularised variables, and the series for the landing at the end of a segment.

    dz/d(sigma) = f(t, z)                     z: regularised variables; the last one is the time
    z(t1) = z + d z' + d^2 z'' / 2            d = x - (r'/r) x^2 / 2,  x = (t1 - t)/r,  r = t'

Both also carry the derivatives with respect to the time, up to the second. Where the perturbation
has a potential, the step is that of RKN 12(10), otherwise that of DOP853.

    symbol  meaning
    sigma   fictitious time
    t1      time to land on
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractRegularised, AbstractSecondOrderForm, Scalar, State
from ..core.barrier import barrier
from ..core.jit import quick_jit
from . import tableaus as tableau
from ._rkn1210 import POSITION_ERROR, VELOCITY_ERROR
from .embedded_errors import cautious
from .stages import combine, stage_loop, weighted
from .vector_field import ScaledField

Regular = Float[Array, "variables *runs"]

# Largest remaining time of a landing, in units of the motion, for which two terms of the series
# suffice: the third one is below rounding.
CLOSE = 1e-5
# Length of the first step, in units of the motion (`unit`).
FIRST_STEP = 0.1


class TrialStep(NamedTuple):
    """A step: the variables after it, their error, and dt/d(sigma) at its start."""

    z: Regular
    error: Regular
    rate: Scalar


@quick_jit
def derivative_in(form: PyTree, t: Scalar, duration: Scalar, z: Regular) -> Regular:
    """dz/d(sigma) in a segment that starts at the time `t` and lasts a `duration`."""
    z = barrier(z)
    # Steps may pass the end of the segment before they land on it. Beyond the end the perturbation
    # is that just inside of it, because the vector field may jump there.
    inside = duration * (1.0 - 4.0 * jnp.finfo(z.dtype).eps)
    elapsed = jnp.clip(z[-1], jnp.minimum(inside, 0.0), jnp.maximum(inside, 0.0))
    perturbation = barrier(form.perturbation(t + elapsed, z))
    return barrier(form.derivative(z, perturbation))


def regularised_start(field: ScaledField, y0: State) -> tuple[AbstractRegularised, Regular]:
    """The regularised variables in which a run is integrated, and those of its state `y0`."""
    form = form_of(field, jax.eval_shape(field.regularised().to_regularised, y0))
    return form, form.to_regularised(y0)


def form_of(field: ScaledField, z: Array | jax.ShapeDtypeStruct) -> AbstractRegularised:
    """The second-order form of the variables if there is one, for runs of the shape of `z`."""
    return form_in(field.regularised(), z)


def form_in(form: AbstractRegularised, z: Array | jax.ShapeDtypeStruct) -> AbstractRegularised:
    """The second-order form of `form` if there is one, else itself."""
    second = form.second_order(jax.ShapeDtypeStruct(z.shape, z.dtype))
    return form if second is None else second


def evaluations_of(form: AbstractRegularised) -> int:
    """Evaluations in a step."""
    return len(tableau.RKN1210_A if isinstance(form, AbstractSecondOrderForm) else tableau.DOP853_A)


def order_of(form: AbstractRegularised) -> float:
    """Order of the error estimate in the length of the step."""
    return 12.0 if isinstance(form, AbstractSecondOrderForm) else 7.0


def trial_step(
    form: AbstractRegularised,
    t: Scalar,
    duration: Scalar,
    z: Regular,
    h: Scalar,
    rolled: bool = False,
) -> TrialStep:
    """Take one step `h` in fictitious time.

    **Arguments**

    - `form`: the equations in regularised variables.
    - `t`, `duration`: start and length of the segment, s.
    - `z`: the variables before the step.
    - `h`: the step.
    - `rolled`: whether the stages are a loop of the program (`stage_loop`).

    **Returns** the variables after it, their error estimates and the rate of time at `z`."""
    if isinstance(form, AbstractSecondOrderForm):
        return _second_order_trial_step(form, z, h, rolled)
    ks = []
    if rolled:
        ks = stage_loop(
            lambda _, change: derivative_in(form, t, duration, z + h * change),
            *(z, tableau.DOP853_C, tableau.DOP853_A),
        )
    else:
        for row in tableau.DOP853_A:
            ks.append(derivative_in(form, t, duration, combine(z, h, row, ks) if row else z))
    z1 = barrier(combine(z, h, tableau.DOP853_B, ks))
    error = cautious(
        combine(None, h, tableau.DOP853_ERROR_5, ks), combine(None, h, tableau.DOP853_ERROR_3, ks)
    )
    return TrialStep(z1, error, ks[0][-1])


@quick_jit
def _rates(form: AbstractSecondOrderForm, q: Array, held: Array) -> tuple[Array, Scalar]:
    return barrier(form.rates(barrier(q), held))


def _second_order_trial_step(
    form: AbstractSecondOrderForm, z: Regular, h: Scalar, rolled: bool
) -> TrialStep:
    n = (z.shape[0] - 2) // 2
    q, p, held = barrier((z[:n], z[n : 2 * n], form.held(z)))
    c, a = tableau.RKN1210_C, tableau.RKN1210_A
    ks, rates = [], []
    # The part of the time that is not a function of q and p is integrated as a velocity: its rate
    # depends on q alone, and no rate depends on it.
    if rolled:
        ks, rates = stage_loop(
            lambda node, change: _rates(form, q + h * (node * p + h * change[0]), held),
            *((q, z[-1]), c, a),
        )
    else:
        for node, row in zip(c, a, strict=True):
            mean = node * p + h * weighted(row, ks) if row else node * p
            k, rate = _rates(form, q + h * mean, held)
            ks.append(k)
            rates.append(rate)
    q1 = q + h * (p + h * weighted(tableau.RKN1210_POSITION, ks))
    p1 = p + h * weighted(tableau.RKN1210_VELOCITY, ks)
    rest = h * weighted(tableau.RKN1210_VELOCITY, rates)
    of_q = (h * h) * weighted(POSITION_ERROR, ks)
    of_p = h * weighted(VELOCITY_ERROR, ks)
    q1, p1, rest, of_q, of_p = barrier((q1, p1, rest, of_q, of_p))
    # The two known times are subtracted first, because their difference is much smaller.
    elapsed = form.known_time(q1, p1, held) - form.known_time(q, p, held) + rest
    t1 = barrier(z[-1] + elapsed)
    zero = jnp.zeros_like(z[2 * n :])
    z1 = jnp.concatenate([q1, p1, z[2 * n : -1], t1[None]])
    error = jnp.concatenate([of_q, of_p, zero])
    return TrialStep(z1, error, form.clock(q))


def landed(form: AbstractRegularised, t: Scalar, duration: Scalar, z: Regular) -> Regular:
    """The variables at the end of the segment, by two terms of the series."""

    def rate(z: Regular) -> Regular:
        return derivative_in(form, t, duration, z)

    first = rate(z)
    second = jax.jvp(rate, (z,), (first,))[1]
    x = (duration - z[-1]) / first[-1]
    d = x - 0.5 * (second[-1] / first[-1]) * x * x
    return z + d * (first + (0.5 * d) * second)

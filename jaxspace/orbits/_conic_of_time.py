"""The conic on which a transfer takes a given time: the inverse of the time of flight T(x).

    direct   Householder's iteration of fourth order on T(x), which falls from infinity at x = -1
             to zero at x = infinity
    N >= 1   Newton's iteration on sqrt(1 - (T / least T)^(-2/3)), which is nearly linear in x on
             both branches from the least T on

    (1 - x^2) T''   = 3 T + 5 x T' + 2 kappa lambda^3 / y^3
    (1 - x^2) T'''  = 7 x T'' + 8 T' - 6 kappa lambda^5 x / y^5

Symbols and units: `_transfer_time.py`.

Source: Izzo (2015), Celestial Mechanics 121, 1, for the derivatives and the iteration. The starting
values are specific to this implementation: exact at the ends of every branch, with the slopes
there.
"""

import functools
import math
from collections.abc import Callable
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import Flag, Scalar
from ..core.barrier import barrier, computed_once
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.squares import unit_factor
from ._transfer_time import one_minus_plus, series_k, transfer_time

Pair: TypeAlias = tuple[Scalar, Scalar]
Triple: TypeAlias = tuple[Scalar, Scalar, Scalar]
IterationState: TypeAlias = tuple[Scalar, Scalar, Scalar, Array, int | Array]


@functools.partial(jax.custom_jvp, nondiff_argnums=(3, 4))
def conic_of_time(time: Scalar, lam: Scalar, kappa: Scalar, revolutions: int, low: bool) -> Scalar:
    """The x of the conic with the time of flight `time`; NaN where there is none.

    **Arguments**

    - `time`, `lam`, `kappa`: T, lambda and kappa of `_transfer_time.py`, each (*runs,).
    - `revolutions`: whole revolutions before the arrival.
    - `low`: after one or more revolutions there are two conics; whether to take the larger x.

    Derivatives of every order follow from the implicit function theorem.
    """
    if not revolutions:
        return _direct(time, lam, kappa)
    return _after(time, lam, kappa, revolutions, low)


@conic_of_time.defjvp
def _conic_rule(
    revolutions: int, low: bool, primals: Triple, tangents: Triple
) -> tuple[Scalar, Scalar]:
    time, lam, kappa = primals
    dtime, dlam, dkappa = tangents
    x = conic_of_time(time, lam, kappa, revolutions, low)
    _, slope, y, _ = transfer_time(x, lam, kappa, revolutions)
    # dT = (dT/dx) dx + (dT/dlambda) dlambda, with dkappa = -2 lambda dlambda. Close to lambda = 1
    # kappa is small, and its differential is more accurate than that of lambda.
    by_place = jnp.where(jnp.abs(lam) > 0.7, lam * dkappa, -2.0 * lam * lam * dlam) / y
    return x, (dtime - by_place) / slope


def _direct(time: Scalar, lam: Scalar, kappa: Scalar) -> Scalar:
    """The x of a transfer within less than one revolution."""
    start = _first_guess(time, lam, kappa)

    def correction(x: Scalar) -> tuple[Scalar, Scalar]:
        value, slope, second, third = _derivatives(x, lam, kappa, 0)
        # On a fast hyperbola the cube of the slope leaves the range of float32.
        unit = unit_factor(slope)
        late, slope, second, third = (unit * d for d in (value - time, slope, second, third))
        slope2 = slope * slope
        bend = slope * (slope2 - late * second) + third * late * late / 6.0
        return -late, -late * (slope2 - 0.5 * late * second) / bend

    x = _root(
        correction,
        jnp.full_like(start, -1.0),
        jnp.full_like(start, jnp.inf),
        start,
        lambda x: 1.0 + x,
        order=4,
    )
    return jnp.where(time > 0.0, x, jnp.nan)


@computed_once
def _derivatives(
    x: Scalar, lam: Scalar, kappa: Scalar, revolutions: int
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """The time and its first three derivatives by x."""
    value, slope, y, _ = transfer_time(x, lam, kappa, revolutions)
    energy = (1.0 - x) * (1.0 + x)
    # At the parabola the higher derivatives are 0/0. They only speed up the iteration, so that a
    # floor of the divisor is sufficient: the root does not depend on it.
    least = math.sqrt(jnp.finfo(x.dtype).eps)
    energy = jnp.where(jnp.abs(energy) < least, jnp.copysign(least, energy), energy)
    per_y, per_energy = barrier((1.0 / y, 1.0 / energy))
    q = lam * per_y
    bend = kappa * q * q * q
    second = (3.0 * value + 5.0 * x * slope + 2.0 * bend) * per_energy
    third = (7.0 * x * second + 8.0 * slope - 6.0 * bend * q * q * x) * per_energy
    return value, slope, second, third


@computed_once
def _first_guess(time: Scalar, lam: Scalar, kappa: Scalar) -> Scalar:
    """A starting value of x, within a fifth of 1 + x.

    Interpolated between x = -1, 0, 1 and infinity, where time and slope are known."""
    less, more = one_minus_plus(lam, kappa)
    root = jnp.sqrt(kappa)
    t0 = 0.5 * root * (2.0 * more * more + kappa * series_k(0.5 * less, 0.5 * more, 2, 4)) / more
    l2 = lam * lam
    # Time and slope of the parabola, x = 1.
    t1 = 2.0 / 3.0 * less * (1.0 + lam + l2)
    slope1 = 0.4 * less * (1.0 + (1.0 + lam) * (lam + l2 * lam))
    time, t0, t1, slope1 = barrier((time, t0, t1, slope1))
    hyperbola = 1.0 + t1 * (t1 - time) / (time * slope1)
    # Between x = 0 and 1 a cubic in 1/T with the slopes at both ends.
    u0 = 1.0 / t0
    u1 = 1.0 / t1
    du = u1 - u0
    s = (1.0 / time - u0) / du
    below = 0.5 * du * t0 * t0
    above = du * t1 * t1 / slope1
    ellipse = s * (below * (1.0 - s) ** 2 + s * (3.0 - 2.0 * s - above * (1.0 - s)))
    slow = _slow_guess(time / math.pi, t0 / math.pi, lam, root, more)
    return jnp.where(time >= t0, slow, jnp.where(time <= t1, hyperbola, ellipse))


def _slow_guess(t: Scalar, t0: Scalar, lam: Scalar, root: Scalar, more: Scalar) -> Scalar:
    """The starting value for x < 0: exact at x = 0 and far out, where 1 - x^2 = t^(-2/3).

    Times `t` and `t0` in units of pi; `root` is sqrt(kappa)."""
    short = lam > 0.0
    cube = jnp.maximum((t - t0) * (t + t0), 0.0) + jnp.where(short, 0.125 * more * more * more, 1.0)
    z = jnp.exp(-jnp.log(cube) / 3.0)
    by_short = (0.5 * more * z - 1.0) * inverse_sqrt(jnp.where(short, 1.0 - lam * z, 1.0))
    g = jnp.maximum(1.0 - z, 0.0)
    b = t0 / (0.75 * math.pi)
    near = 2.0 * g / (b + jnp.sqrt(b * b + 4.0 * (1.0 - b) * g))
    near = jnp.maximum(near, jnp.sqrt(jnp.maximum(g - b * root, 0.0)))
    return jnp.where(short, by_short, -(near + g * (jnp.sqrt(g) - near)))


def least_time(lam: Scalar, kappa: Scalar, revolutions: int) -> tuple[Scalar, Scalar]:
    """The shortest time of flight with one or more whole `revolutions`, and its x; (*runs,)."""
    x = _lowest(lam, kappa, revolutions)
    return transfer_time(x, lam, kappa, revolutions).value, x


@functools.partial(jax.custom_jvp, nondiff_argnums=(2,))
def _lowest(lam: Scalar, kappa: Scalar, revolutions: int) -> Scalar:
    """The x of the shortest time of flight, where dT/dx = 0."""

    def correction(x: Scalar) -> tuple[Scalar, Scalar]:
        # Halley's step for the root of the slope.
        _, slope, second, third = _derivatives(x, lam, kappa, revolutions)
        return slope, -2.0 * slope * second / (2.0 * second * second - slope * third)

    zero = jnp.zeros_like(lam)
    return _root(correction, zero, zero + 0.5, zero + 0.15 / revolutions, jnp.ones_like, order=2)


@_lowest.defjvp
def _lowest_rule(revolutions: int, primals: Pair, tangents: Pair) -> tuple[Scalar, Scalar]:
    # Implicit function theorem: the slope stays zero.
    lam, kappa = primals
    x = _lowest(lam, kappa, revolutions)
    _, dslope = jax.jvp(
        lambda lam, kappa: transfer_time(x, lam, kappa, revolutions).slope, primals, tangents
    )
    return x, -dslope / _derivatives(x, lam, kappa, revolutions)[2]


def _after(time: Scalar, lam: Scalar, kappa: Scalar, revolutions: int, low: bool) -> Scalar:
    """The x of a transfer after one or more whole revolutions."""
    least, lowest = least_time(lam, kappa, revolutions)
    end = 1.0 if low else -1.0

    def share(longer: Scalar, shorter: Scalar) -> Scalar:
        """1 - (shorter / longer)^(2/3)."""
        # By expm1 and log1p, because the two times are close near the shortest one.
        return -jnp.expm1(-jnp.log1p((longer - shorter) / shorter) / 1.5)

    goal = jnp.where(time >= least, jnp.sqrt(jnp.maximum(share(time, least), 0.0)), jnp.nan)
    edge = lowest + jnp.zeros_like(goal)
    # NaN ends the iteration of a run that has no transfer.
    other = jnp.where(jnp.isnan(goal), jnp.nan, end)

    def correction(x: Scalar) -> tuple[Scalar, Scalar]:
        value, slope, *_ = transfer_time(x, lam, kappa, revolutions)
        height2 = share(value, least)
        height = sqrt(jnp.where(height2 > 0.0, height2, jnp.nan))
        ahead = (1.0 - height2) * share(time, value) / (goal + height)
        return end * (value - time), ahead * 3.0 * value * height / ((1.0 - height2) * slope)

    low_end, high_end = (edge, other) if low else (other, edge)
    return _root(
        correction,
        low_end,
        high_end,
        edge + goal * (other - edge),
        lambda x: 1.0 - x * x,
        order=2,
    )


def _root(
    correction: Callable[[Scalar], tuple[Scalar, Scalar]],
    low: Scalar,
    high: Scalar,
    start: Scalar,
    size: Callable[[Scalar], Scalar],
    order: int,
) -> Scalar:
    """The root of an increasing function, for each run separately.

    **Arguments**

    - `correction`: the value of the function at x, and the step from x to the root.
    - `low`, `high`: ends of an interval that contains the root.
    - `start`: start of the iteration; a run that starts at NaN makes no step.
    - `size`: the unit in which a step at x is measured.
    - `order`: the order of convergence of the step.
    """
    # A step of this size leaves an error below rounding by the order of the iteration, so that no
    # further step is needed to see that it has converged. Two steps are the rule.
    close = jnp.finfo(start.dtype).eps ** (1.0 / order)

    def step(state: IterationState) -> IterationState:
        low, high, x, _, count = state
        value, change = correction(x)
        low = jnp.where(value < 0.0, x, low)
        high = jnp.where(value > 0.0, x, high)
        new = x + change
        # A step out of the interval is replaced by a bisection. Due to rounding of the value the
        # root itself may be outside of it: a bisection as short as the last step would end the
        # iteration.
        last = jnp.abs(change) <= close * size(x)
        inside = (new >= low) & (new <= high)
        held = jnp.where(last, jnp.clip(new, low, high), 0.5 * (low + high))
        new = jnp.where(inside, new, held)
        return (*barrier((low, high, new)), jnp.any(jnp.abs(new - x) > close * size(x)), count + 1)

    def running(state: IterationState) -> Flag:
        # 64 bisections exhaust the digits: the limit ends what never converges.
        return state[3] & (state[4] < 64)

    return jax.lax.while_loop(running, step, (low, high, start, jnp.array(True), 0))[2]

"""The best use of the propellant of an ascent in impulses: at the start, at the end, or split.

    W_1 = D/T + g T/2 - w_0        vertical part of the impulse at the start,   D = Y - y_0
    W_2 = g T/2 - D/T              vertical part of the impulse at the end
    U   = u_0 + sqrt(V^2 - c^2),   c = |W_1| + |W_2|,   V_1/V_2 = |W_1|/|W_2|

The vertical parts bring the rocket to the height Y with no vertical velocity there; the rest of V
is the horizontal velocity U, and both impulses have the same slope. For a given T the propellant is
split. If T is free, the least c is at a corner of |W_1| + |W_2|, where one impulse vanishes.

    D > 0    at the start:  T = sqrt(2 D/g),                  c = |sqrt(2 g D) - w_0|
    D < 0    at the end:    T = [w_0 + sqrt(w_0^2 - 2 g D)]/g,  c = sqrt(w_0^2 - 2 g D)
    D = 0    degenerate for w_0 > 0: every split and every T up to 2 w_0/g have c = w_0
             for T = 0 both impulses coincide: c = |w_0|, and only D = 0 is reached

The impulse belongs to the lower altitude, where the thrust is steepest. The heights that a gain V
reaches:

    T free     (w_0^2 - V^2)/2g <= D <= (w_0 + V)^2/2g     for V >= |w_0|
               (w_0 - V)^2/2g   <= D <= (w_0 + V)^2/2g     for V < w_0;   nothing for V < -w_0
    T given    T (w_0 - V)/2    <= D <= T (w_0 + V)/2      for V >= |g T - w_0|, or nothing

    symbol    meaning                                                unit
    u_0, w_0  horizontal and vertical velocity at release            m/s
    y_0, Y    height of release, height of the end                   m
    V         gain of velocity that the propellant gives             m/s
    T, g      time of flight; gravity, constant                      s, m/s^2

Source: Thomson 8.4; the sign test of the book needs C_2 Phi instead of Phi, and its third case, the
split, arises for a given T only. Flat earth, no air.
"""

import math
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Flag, InputError, Scalar
from ..core.checks import is_concrete
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.safe import safe_divide, safe_sqrt
from ..core.structure import HashedModule
from ..core.types import as_float


@final
@printed(
    first="m/s",
    last="m/s",
    first_angle="rad",
    last_angle="rad",
    duration="s",
    final_velocity="m/s",
    least_gain="m/s",
    nearest_climb="m",
)
class PropellantUse(HashedModule):
    """The result of `propellant_use`; each field is (*runs,).

    - `first`, `last`: velocity gained by the impulse at the start and at the end, m/s.
    - `first_angle`, `last_angle`: their angles above the horizontal, rad, of equal size.
    - `duration`, s: T.
    - `final_velocity`, m/s: U, horizontal.
    - `corner`: whether U as a function of T has a kink there, at which a search by gradients
      stalls.
    - `degenerate`: whether other splits and durations give the same U.
    - `feasible`: False where the propellant does not reach the height without climb; U is then
      that of the steepest impulse, and the height is missed.
    - `least_gain`: c, the gain that the height needs, m/s.
    - `nearest_climb`: the climb nearest to D that the gain reaches, m; NaN where it reaches none.
    """

    first: Float[Array, "*#runs"]
    last: Float[Array, "*#runs"]
    first_angle: Float[Array, "*#runs"]
    last_angle: Float[Array, "*#runs"]
    duration: Float[Array, "*#runs"]
    final_velocity: Float[Array, "*#runs"]
    corner: Flag
    degenerate: Flag
    feasible: Flag
    least_gain: Float[Array, "*#runs"]
    nearest_climb: Float[Array, "*#runs"]

    def sentence(self) -> str:
        """The advice as text, for one concrete run.

        Raises `InputError` for several runs."""
        if not is_concrete(self.first) or jnp.ndim(self.first) > 0:
            raise InputError("PropellantUse.sentence describes a single concrete run: select one.")
        if not bool(self.feasible):
            gain = float(self.first + self.last)
            climb = float(self.nearest_climb)
            reached = f"the closest height that it reaches is {climb:.6g} m above the release"
            return (
                f"The propellant is insufficient to reach the height without climb: it provides "
                f"{gain:.6g} m/s, where {float(self.least_gain):.6g} m/s are required; "
                f"{'no height is reached this way' if math.isnan(climb) else reached}."
            )
        if bool(self.degenerate):
            return "Every split gives the same velocity, because the height is that of the release."
        if float(self.last) == 0.0:
            return "All propellant at the start."
        if float(self.first) == 0.0:
            return "All propellant at the end."
        share = float(self.first) / float(self.first + self.last)
        return f"{share:.1%} of the propellant at the start, the rest at the end."


@formula(velocity_gain=NOT_NEGATIVE, gravity=POSITIVE, duration=NOT_NEGATIVE)
def propellant_use(
    velocity: Float[Array, "2 *#runs"],
    climb: Scalar,
    velocity_gain: Scalar,
    gravity: Scalar,
    duration: Scalar | None = None,
) -> PropellantUse:
    """The impulses with the greatest horizontal velocity at a given height (Thomson 8.4).

    **Arguments**

    - `velocity`: at release, horizontal and vertical, m/s, (2, *runs).
    - `climb`: D, height of the end above the release, m; negative below it.
    - `velocity_gain`: V, of all propellant, m/s; `gravity`: m/s^2.
    - `duration`: T, s, where it is prescribed, also zero; `None` chooses the best.

    **Returns** a `PropellantUse`.

    **Raises** `InputError` for a gravity that is not positive, or a negative duration or gain.
    """
    u0, w0 = as_float(velocity)
    D, V, g = (as_float(x) + 0.0 * u0 for x in (climb, velocity_gain, gravity))
    free = duration is None
    T = _best_duration(w0, D, g) if duration is None else as_float(duration) + 0.0 * u0
    # As sum and difference of two terms, so that at a corner one impulse is exactly zero.
    up = D > 0.0
    mean = safe_divide(D, T)
    first = mean + 0.5 * g * T - w0
    last = 0.5 * g * T - mean
    if free:
        first = jnp.where(up, safe_sqrt(2.0 * g * jnp.maximum(D, 0.0)) - w0, 0.0)
        last = jnp.where(up, 0.0, g * T - w0)
    # At T = 0 no gain reaches another height: the two impulses cancel vertically.
    one_moment = (T == 0.0) & (not free)
    still = one_moment & (D != 0.0)
    first, last = jnp.where(still, D, first), jnp.where(still, -D, last)
    size = jnp.abs(first) + jnp.abs(last)
    share = jnp.where(size > 0.0, safe_divide(jnp.abs(first), size), 1.0)
    size = jnp.where(still, jnp.inf, size)
    feasible = size <= V
    vertical = jnp.minimum(size, V)
    across = safe_sqrt(V * V - vertical * vertical)
    # Without propellant the impulse has no slope, and the angle is zero.
    angle = jnp.arctan2(vertical, jnp.where(V > 0.0, across, 1.0))
    return PropellantUse(
        first=V * share,
        last=V * (1.0 - share),
        first_angle=jnp.sign(first) * angle,
        last_angle=jnp.sign(last) * angle,
        duration=T,
        final_velocity=u0 + across,
        corner=(first == 0.0) | (last == 0.0),
        degenerate=(D == 0.0) & jnp.where(w0 > 0.0, free | (g * T <= 2.0 * w0), one_moment),
        feasible=feasible,
        least_gain=size,
        nearest_climb=jnp.where(feasible, D, _nearest_climb(w0, D, V, g, None if free else T)),
    )


def _nearest_climb(w0: Scalar, D: Scalar, V: Scalar, g: Scalar, T: Scalar | None) -> Scalar:
    """The climb nearest to D that V reaches, with T given or free; NaN where there is none."""
    if T is None:
        high = (w0 + V) ** 2 / (2.0 * g)
        low = jnp.where(V >= jnp.abs(w0), w0 * w0 - V * V, (w0 - V) ** 2) / (2.0 * g)
        any_height = w0 + V >= 0.0
    else:
        low, high = 0.5 * T * (w0 - V), 0.5 * T * (w0 + V)
        any_height = jnp.abs(g * T - w0) <= V
    return jnp.where(any_height, jnp.clip(D, low, high), jnp.nan)


def _best_duration(w0: Scalar, D: Scalar, g: Scalar) -> Scalar:
    """The T of the least |W_1| + |W_2|."""
    rise = safe_sqrt(2.0 * jnp.maximum(D, 0.0) / g)
    fall = (w0 + safe_sqrt(w0 * w0 - 2.0 * g * jnp.minimum(D, 0.0))) / g
    return jnp.where(D > 0.0, rise, fall)

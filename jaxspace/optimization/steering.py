"""Linear-tangent steering: the thrust angle of a burn for the greatest velocity at a given height.

    tan phi = (1 - t/T) tan theta_0                   the release is along theta_0 too
    w(T) = 0,   y(T) = Y                              two equations for theta_0 and T
    dU/dY = -tan(theta_0)/T,   dU/dv_0 = 1/cos(theta_0),   dU/dg = -(T/2) tan(theta_0)

    symbol    meaning                                           unit
    phi       angle of the thrust above the horizontal          rad
    theta_0   its value at ignition, and the angle of release   rad
    T, Y      time and height of the apex                       s, m
    U         velocity at the apex, horizontal                  m/s
    and the symbols of `ascent.py`

Without gravity, from rest to a height and a horizontal velocity in the least time, the law is

    tan phi = b (1 - 2t/T)

Source: Thomson 8.3 (8.3-9); Betts, Practical Methods for Optimal Control (minimum time).
Valid only if the apex comes after burnout, T >= t_b: the optimality condition at T needs a coast.

The two equations have another root with T < t_b, which is not a flight; the bracket of T excludes
it. Near T = t_b there may be two valid roots: the one with the later apex has the greater U, and is
returned.
"""

__all__ = [
    "LinearTangentSteering",
    "MaximumVelocitySteering",
    "linear_tangent_steering",
    "maximum_velocity_steering",
    "minimum_time_steering",
]

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import Flag, Scalar, check
from ..core.checks import check_finite, check_positive, is_concrete
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.roots import increasing_root
from ..core.structure import HashedModule
from ..core.types import as_float
from .ascent import Ascent, apex, burnout_state, velocity_gain


def linear_tangent_angle(t: Scalar, initial_angle: Scalar, vanishing_time: Scalar) -> Scalar:
    """The thrust angle phi of tan phi = (1 - t/T) tan theta_0 (Thomson 8.3-9).

    **Arguments**

    - `t`: time since ignition, s.
    - `initial_angle`: theta_0, rad, up to the vertical pi/2.
    - `vanishing_time`: T, s, at which phi is zero.

    **Returns** phi, rad.
    """
    # By sine and cosine, because the tangent is infinite at the vertical.
    return jnp.arctan2((1.0 - t / vanishing_time) * jnp.sin(initial_angle), jnp.cos(initial_angle))


@final
@printed(initial_angle="rad", vanishing_time="s", final_velocity="m/s")
class LinearTangentSteering(HashedModule):
    """The steering tan phi = (1 - t/T) tan theta_0, and its result; each field is (*runs,).

    - `initial_angle`, rad: theta_0.
    - `vanishing_time`, s: T, at which phi = 0: the time of the apex.
    - `final_velocity`, m/s: U, at the apex.
    - `reached`: False where a traced apex height has no solution with T >= t_b. The other fields
      are then finite, but belong to another height, and their derivatives with respect to it are
      zero."""

    initial_angle: Float[Array, "*#runs"]
    vanishing_time: Float[Array, "*#runs"]
    final_velocity: Float[Array, "*#runs"]
    reached: Flag

    def angle(self, t: Scalar) -> Scalar:
        """The thrust angle, rad, at the time `t`, s, of the burn."""
        return linear_tangent_angle(t, self.initial_angle, self.vanishing_time)


def linear_tangent_steering(ascent: Ascent) -> LinearTangentSteering:
    """The steering and release angle that maximise the velocity at the apex of `ascent` (Thomson
    8.3).

    The result is differentiable in every field of `ascent`. Raises `InputError` if a concrete apex
    height cannot be reached, or only before burnout."""
    result, lowest, highest = _solve(ascent)
    if is_concrete(lowest) and is_concrete(result.final_velocity):
        allowed = (
            f"between {np.asarray(lowest)} and {np.asarray(highest)}, "
            "the heights at which this burn can end before its apex"
        )
        check(np.asarray(result.reached), "Ascent.apex_height", ascent.apex_height, allowed)
    return result


@quick_jit
def _solve(ascent: Ascent) -> tuple[LinearTangentSteering, Scalar, Scalar]:
    """The solution, and the lowest and the highest apex for which there is one."""
    # The bracket of T needs no derivative: the root does not depend on it.
    fixed = jax.tree.map(
        lambda leaf: lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf, ascent
    )
    earliest = fixed.burn_time
    latest = (fixed.release_speed + velocity_gain(fixed)) / fixed.gravity
    possible = latest > earliest
    latest = jnp.where(possible, latest, 2.0 * earliest)
    # Once theta_0 is eliminated by w(T) = 0, the height of the apex first falls with T (from
    # T = t_b, if at all), then rises up to vertical flight. Only the rising part is optimal.
    lowest_time = lax.stop_gradient(increasing_root(lambda T: _slope(fixed, T), earliest, latest))
    vertical = burnout_state(fixed, 0.5 * jnp.pi, lambda t: 0.5 * jnp.pi + 0.0 * t)
    lowest = _apex_height(fixed, lowest_time)
    highest = apex(fixed, vertical)[1]
    reached = possible & (ascent.apex_height >= lowest) & (ascent.apex_height < highest)
    target = jnp.where(
        reached, ascent.apex_height, _apex_height(fixed, 0.5 * (lowest_time + latest))
    )
    T = increasing_root(lambda T: _apex_height(ascent, T) - target, lowest_time, latest)
    theta0 = _initial_angle(ascent, T)
    end = burnout_state(ascent, theta0, lambda t: linear_tangent_angle(t, theta0, T))
    return LinearTangentSteering(theta0, T, end.u, reached), lowest, highest


def _initial_angle(ascent: Ascent, T: Scalar) -> Scalar:
    """The theta_0, rad, for which the apex, w = 0, comes at T."""

    def excess(theta0: Scalar) -> Scalar:
        end = burnout_state(ascent, theta0, lambda t: linear_tangent_angle(t, theta0, T))
        return end.w - ascent.gravity * (T - ascent.burn_time)

    # w rises with theta_0 from horizontal to vertical flight.
    return increasing_root(excess, 0.0 * T, 0.5 * jnp.pi + 0.0 * T)


def _apex_height(ascent: Ascent, T: Scalar) -> Scalar:
    """The height of the apex, m, of the steering whose apex comes at T."""
    theta0 = _initial_angle(ascent, T)
    end = burnout_state(ascent, theta0, lambda t: linear_tangent_angle(t, theta0, T))
    return apex(ascent, end)[1]


def _slope(ascent: Ascent, T: Scalar) -> Scalar:
    """Derivative of the apex height by T along w(T) = 0."""
    return jax.jvp(lambda T: _apex_height(ascent, T), (T,), (jnp.ones_like(T),))[1]


@final
class MinimumTimeSteering(eqx.Module):
    """The steering tan phi = (1 - 2t/T) tan theta_0.

    - `initial_angle`: theta_0, rad; `duration`: T, s; both (*runs,)."""

    initial_angle: Float[Array, "*#runs"]
    duration: Float[Array, "*#runs"]

    def angle(self, t: Scalar) -> Scalar:
        """The thrust angle, rad, at the time `t`, s."""
        return linear_tangent_angle(t, self.initial_angle, 0.5 * self.duration)


def minimum_time_steering(
    acceleration: ArrayLike, height: ArrayLike, speed: ArrayLike
) -> MinimumTimeSteering:
    """The steering from rest to a height and a horizontal speed in the least time, without gravity.

    **Arguments**, each (*runs,)

    - `acceleration`: F/m, m/s^2, constant.
    - `height`: m; the range is free.
    - `speed`: m/s.

    **Raises** `InputError` for an acceleration or a speed that is not positive.
    """
    a = as_float(acceleration)
    h = as_float(height)
    v = as_float(speed)
    check_positive("acceleration", a)
    check_finite("height", h)
    check_positive("speed", v)
    # With b = tan theta_0 = sinh s the integrals of velocity and height are
    # v = a T s / sinh s and a h / v^2 = (sinh 2s - 2s) / (8 s^2), which rises with s.
    ratio = a * h / (v * v)
    # The right side is about s/6 for small s, and grows exponentially for large s.
    bound = 2.0 * jnp.arcsinh(6.0 * jnp.abs(ratio))
    s = increasing_root(lambda s: _height_ratio(s) - ratio, -bound, bound)
    return MinimumTimeSteering(jnp.arctan(jnp.sinh(s)), v / a * _sinh_over(s))


@final
@printed(initial_angle="rad", duration="s", final_velocity="m/s")
class MaximumVelocitySteering(HashedModule):
    """The steering tan phi = (1 - 2t/T) tan theta_0, and the velocity that it reaches.

    Each field is (*runs,).

    - `initial_angle`, rad: theta_0.
    - `duration`, s: T.
    - `final_velocity`, m/s: at the end."""

    initial_angle: Float[Array, "*#runs"]
    duration: Float[Array, "*#runs"]
    final_velocity: Float[Array, "*#runs"]

    def angle(self, t: Scalar) -> Scalar:
        """The thrust angle, rad, at the time `t`, s."""
        return linear_tangent_angle(t, self.initial_angle, 0.5 * self.duration)


def maximum_velocity_steering(
    acceleration: ArrayLike, height: ArrayLike, duration: ArrayLike
) -> MaximumVelocitySteering:
    """The steering from rest to a height with the greatest horizontal speed in a given time,
    without gravity: the counterpart of `minimum_time_steering`.

    **Arguments**, each (*runs,)

    - `acceleration`: F/m, m/s^2, constant.
    - `height`: m, of either sign, less than a quarter of acceleration times duration squared, which
      thrust straight up and down reaches.
    - `duration`: T, s.

    **Raises** `InputError` for an acceleration or a duration that is not positive, and a height
    that cannot be reached.
    """
    a, h, T = (as_float(x) for x in (acceleration, height, duration))
    check_positive("acceleration", a)
    check_positive("duration", T)
    ratio = h / (a * T * T)
    if is_concrete(ratio):
        check(
            np.abs(np.asarray(ratio)) < 0.25, "height", h, "less than acceleration duration^2 / 4"
        )
    # h/(a T^2) = (sinh 2s - 2s)/(8 sinh^2 s), which rises from -1/4 to 1/4. Beyond s = 18 it rounds
    # to its limit.
    end = 20.0 + 0.0 * ratio
    s = increasing_root(lambda s: _height_ratio(s) / _sinh_over(s) ** 2 - ratio, -end, end)
    return MaximumVelocitySteering(jnp.arctan(jnp.sinh(s)), T + 0.0 * s, a * T / _sinh_over(s))


def _sinh_over(s: Scalar) -> Scalar:
    """sinh(s) / s."""
    # Where the next term of the series is below rounding.
    small = jnp.abs(s) < 1e-4
    return jnp.where(small, 1.0 + s * s / 6.0, jnp.sinh(s) / jnp.where(small, 1.0, s))


def _height_ratio(s: Scalar) -> Scalar:
    """(sinh 2s - 2s) / (8 s^2), with its series where the difference loses digits."""
    small = jnp.abs(s) < 0.5
    z = jnp.where(small, 4.0 * s * s, 0.0)
    series = 1.0
    for n in range(16, 2, -2):
        series = 1.0 + z / (n * (n + 1)) * series
    closed = (jnp.sinh(2.0 * s) - 2.0 * s) / jnp.where(small, 1.0, 8.0 * s * s)
    return jnp.where(small, s / 6.0 * series, closed)

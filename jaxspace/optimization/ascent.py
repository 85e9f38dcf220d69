"""An ascent over a flat earth: a burn with steered thrust, then a coast to the apex.

    u' = a cos phi,   w' = a sin phi - g,   x' = u,   y' = w              while t < t_b
    u(0) = v_0 cos theta_0,   w(0) = v_0 sin theta_0,   x(0) = 0,   y(0) = y_0
    T = t_b + w_b/g,   y(T) = y_b + w_b^2/(2g)        the apex, not before burnout if w_b >= 0

    symbol   meaning                                                  unit
    x, y     range and height                                         m
    u, w     horizontal and vertical velocity                         m/s
    a        thrust acceleration F/m, known over time                 m/s^2
    phi      angle of the thrust above the horizontal                 rad
    v_0      speed at release, in the direction theta_0 to be chosen  m/s, rad
    g        gravity, constant                                        m/s^2
    t_b, T   time of burnout, time of the apex                        s

Source: Thomson 8.3.
Valid while height and range are small against the radius of the earth, and without air.
"""

__all__ = [
    "AbstractThrustAcceleration",
    "Ascent",
    "ConstantMassFlow",
    "ConstantThrustAcceleration",
    "FlightState",
    "apex",
    "burnout_state",
]

from abc import abstractmethod
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import NumberField, Scalar, check, quantity
from ..core.checks import check_finite, check_non_negative, check_positive, is_concrete
from ..core.formula import formula
from ..core.printing import printed
from ..core.structure import HashedModule
from ..core.types import as_float

# The error of Gauss-Legendre quadrature falls as rho^(-2 n): 64 nodes reach rounding for mass flows
# that leave 3 % of the mass or more.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(64)


class AbstractThrustAcceleration(HashedModule):
    """Thrust over mass as a smooth function of time since ignition."""

    @abstractmethod
    def __call__(self, t: Scalar) -> Scalar:
        """The acceleration F/m, m/s^2, at the time `t`, s, since ignition."""


@final
@printed(acceleration="m/s^2")
class ConstantThrustAcceleration(AbstractThrustAcceleration):
    """F/m is constant.

    - `acceleration`, m/s^2: F/m, positive, (*runs,)."""

    acceleration: Float[Array, "*#runs"] = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        check_positive("ConstantThrustAcceleration.acceleration", self.acceleration)

    def __call__(self, t: Scalar) -> Scalar:
        # Broadcast to the shape of the times, as for any other thrust.
        return self.acceleration + 0.0 * t


@final
@printed(exhaust_velocity="m/s", depletion_time="s")
class ConstantMassFlow(AbstractThrustAcceleration):
    """Constant thrust and mass flow, m = m_0 (1 - t/tau), so that F/m = u/(tau - t).

    - `exhaust_velocity`, m/s: u, (*runs,).
    - `depletion_time`, s: tau, (*runs,), at which the whole mass would be used up; later than the
      burnout."""

    exhaust_velocity: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    depletion_time: Float[Array, "*#runs"] = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        check_positive("ConstantMassFlow.exhaust_velocity", self.exhaust_velocity)
        check_positive("ConstantMassFlow.depletion_time", self.depletion_time)

    def __call__(self, t: Scalar) -> Scalar:
        return self.exhaust_velocity / (self.depletion_time - t)


@final
@printed(burn_time="s", release_speed="m/s", release_height="m", apex_height="m", gravity="m/s^2")
class Ascent(eqx.Module):
    """The data of an ascent, whose steering is to make the velocity at the apex greatest.

    Each number is (*runs,).

    - `thrust`: the thrust acceleration over time.
    - `burn_time`, s: t_b, duration of the burn.
    - `release_speed`, m/s: v_0; the direction of the release velocity is free.
    - `release_height`, m: y_0, height at the release.
    - `apex_height`, m: Y, prescribed height of the apex.
    - `gravity`, m/s^2: g."""

    thrust: AbstractThrustAcceleration
    burn_time: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    release_speed: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    release_height: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    apex_height: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    gravity: Float[Array, "*#runs"] = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        check_positive("Ascent.burn_time", self.burn_time)
        check_non_negative("Ascent.release_speed", self.release_speed)
        check_finite("Ascent.release_height", self.release_height)
        check_finite("Ascent.apex_height", self.apex_height)
        check_positive("Ascent.gravity", self.gravity)
        # At the last instant the acceleration of a constant flow is greatest, or no mass is left.
        last = self.thrust(self.burn_time)
        if is_concrete(last):
            check(
                np.isfinite(last) & (np.asarray(last) > 0.0),
                "Ascent.thrust at burn_time",
                last,
                "positive and finite",
            )


@final
@printed()
class FlightState(eqx.Module):
    """Place and velocity in the plane of the ascent; also their rates."""

    x: NumberField = quantity("m", doc="range")
    y: NumberField = quantity("m", doc="height")
    u: NumberField = quantity("m/s", doc="horizontal velocity")
    w: NumberField = quantity("m/s", doc="vertical velocity")


def release_state(ascent: Ascent, release_angle: Scalar) -> FlightState:
    """The state at ignition, released at the angle theta_0, rad, above the horizontal."""
    # The zero broadcasts the speed to the runs of the angle.
    v0 = ascent.release_speed + 0.0 * release_angle
    return FlightState(
        0.0 * v0,
        ascent.release_height + 0.0 * v0,
        v0 * jnp.cos(release_angle),
        v0 * jnp.sin(release_angle),
    )


def velocity_gain(ascent: Ascent) -> Scalar:
    """The integral V of F/m over the burn, m/s: the gain of speed without gravity and steering."""
    t, weight = _abscissae(ascent, 0)
    return jnp.sum(weight * ascent.thrust(t), axis=0)


@formula
def burnout_state(
    ascent: Ascent, release_angle: Scalar, steering: Callable[[Scalar], Scalar]
) -> FlightState:
    """The state at burnout, by Gauss-Legendre quadrature.

    **Arguments**

    - `ascent`: the data of the ascent.
    - `release_angle`: theta_0, rad, (*runs,).
    - `steering`: the thrust angle, rad, as a smooth function of time, s.
    """
    t, weight = _abscissae(ascent, jnp.ndim(release_angle))
    tb = ascent.burn_time
    start = release_state(ascent, release_angle)
    phi = steering(t)
    gain = weight * ascent.thrust(t)
    across = gain * jnp.cos(phi)
    up = gain * jnp.sin(phi)
    # The position is a single integral, because velocity gained at t acts for the time t_b - t.
    return FlightState(
        x=start.x + start.u * tb + jnp.sum((tb - t) * across, axis=0),
        y=start.y + start.w * tb + jnp.sum((tb - t) * up, axis=0) - 0.5 * ascent.gravity * tb * tb,
        u=start.u + jnp.sum(across, axis=0),
        w=start.w + jnp.sum(up, axis=0) - ascent.gravity * tb,
    )


def apex(ascent: Ascent, burnout: FlightState) -> tuple[Scalar, Scalar]:
    """Time, s, and height, m, of the apex of the coast; with w_b < 0 it would be before burnout,
    and is not reached.

    **Arguments**

    - `ascent`: the ascent.
    - `burnout`: the state at burnout."""
    coast = burnout.w / ascent.gravity
    return ascent.burn_time + coast, burnout.y + 0.5 * burnout.w * coast


def _abscissae(
    ascent: Ascent, rank: int
) -> tuple[Float[Array, "nodes *#runs"], Float[Array, "nodes *#runs"]]:
    """Times, s, and weights of the quadrature over the burn, (nodes, *runs), with at least `rank`
    axes of runs."""
    rank = max(rank, *(jnp.ndim(leaf) for leaf in jax.tree.leaves(ascent)))
    dtype = jnp.result_type(ascent.burn_time)
    nodes, weights = (
        jnp.asarray(values, dtype).reshape((-1,) + (1,) * rank) for values in (NODES, WEIGHTS)
    )
    half = 0.5 * ascent.burn_time
    return half * (1.0 + nodes), half * weights

"""The gravity turn: flight with the thrust along the velocity, curved by gravity only.

    v' = g (n - cos psi) - D/m              z = tan(psi/2)
    v psi' = g sin psi                      n = F/(m g)
    x' = v sin psi,   y' = v cos psi

For a constant n without drag, with s = ln(z/z_0) and E(a) = (e^(a s) - 1)/a (8.5-7 to 8.5-9):

    v = v_0 e^((n-1) s) (1 + z^2)/(1 + z_0^2)
    t = v_0/g [E(n-1) + z_0^2 E(n+1)]/(1 + z_0^2)
    x = 2 v_0^2/g z_0 [E(2n-1) + z_0^2 E(2n+1)]/(1 + z_0^2)^2
    y = v_0^2/g [E(2n-2) - z_0^4 E(2n+2)]/(1 + z_0^2)^2

    symbol  meaning                                                    unit
    v       speed                                                      m/s
    psi     angle of the path from the vertical, upwards               rad
    n       thrust over weight; negative for a thrust against the path 1
    g       gravity                                                    m/s^2
    x, y    range, height                                              m
    D, m    drag, mass                                                 N, kg

E(a) tends to s for a -> 0: n = 1, n = 1/2 and their mirror images are ordinary places. In s the
vertical start z_0 = 0 is ordinary too. A start at rest is singular: its direction is not defined.

Source: Thomson 8.5; x and y, which the book does not give, by the same substitution.
Flat earth for the closed form; `GravityTurn` may have a radius, a thrust over weight that rises as
mass leaves, and drag.
"""

__all__ = ["gravity_turn", "gravity_turn_after"]

import math
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import (
    AbstractClosedForm,
    AbstractSystem,
    NumberField,
    OptionalNumberField,
    Scalar,
    check,
    quantity,
)
from ..core.checks import is_concrete
from ..core.formula import POSITIVE, formula
from ..core.printing import printed
from ..core.roots import increasing_root
from ..core.safe import phi1
from ..core.types import as_float


@final
@printed()
class GravityTurnState(eqx.Module):
    """Speed, direction and place along the turn; also their rates."""

    speed: NumberField = quantity("m/s", doc="speed")
    angle: NumberField = quantity("rad", doc="of the path, from the vertical")
    range: NumberField = quantity("m", doc="horizontal distance")
    height: NumberField = quantity("m", doc="height")


@formula(gravity=POSITIVE, speed=POSITIVE, start=POSITIVE)
def gravity_turn(
    angle: Scalar, thrust_ratio: Scalar, gravity: Scalar, speed: Scalar, start: Scalar
) -> tuple[Scalar, GravityTurnState]:
    """The time and the state at which the path of a gravity turn has a given angle (Thomson 8.5).

    **Arguments**

    - `angle`: psi from the vertical, rad, between 0 and pi.
    - `thrust_ratio`: n = F/(m g), constant, of either sign.
    - `gravity`: m/s^2.
    - `speed`: at the start, m/s, and `start`: its angle from the vertical, rad, above 0.

    **Returns** the time since the start, s, negative for an angle below that of the start, and the
    state, with range and height from the start.

    **Raises** `InputError` for a speed or a start that is not positive: a vertical path stays
    vertical, see `gravity_turn_after`.
    """
    if is_concrete(angle):
        psi = np.asarray(angle)
        check((psi > 0.0) & (psi < np.pi), "angle", angle, "between 0 and pi")
    z0 = jnp.tan(0.5 * as_float(start))
    s = jnp.log(jnp.tan(0.5 * as_float(angle)) / z0)
    first = GravityTurnState(*map(as_float, (speed, start, 0.0, 0.0)))
    n = as_float(thrust_ratio)
    elapsed = _growth(n - 1.0, s) + _weighted(2, n + 1.0, s, z0)
    time = elapsed * speed / (gravity * (1.0 + z0 * z0))
    return time, _state(s, thrust_ratio, gravity, first)


@formula(gravity=POSITIVE)
def gravity_turn_after(
    time: Scalar, thrust_ratio: Scalar, gravity: Scalar, y: GravityTurnState
) -> GravityTurnState:
    """The state a `time`, s, of either sign, after the state `y` (Thomson 8.5).

    **Arguments**

    - `thrust_ratio`: n = F/(m g), constant; `gravity`: m/s^2.
    - `y`: with a speed above zero; its angle may be zero, which is a vertical flight.

    **Returns** the state, differentiable in everything, also at the vertical. Where the speed ends
    at zero before (n < 1 upwards, n < -1 downwards), the state there.
    """
    z0 = jnp.tan(0.5 * as_float(y.angle))
    scaled = gravity * (1.0 + z0 * z0) / y.speed * time
    n = as_float(thrust_ratio)
    # Beyond the root, which is large where a vertical path has a constant speed, n = 1, or where an
    # angle next to the vertical has to grow.
    least = jnp.finfo(scaled.dtype).tiny
    end = 64.0 * (1.0 + jnp.abs(scaled)) * (1.0 + 1.0 / jnp.maximum(z0 * z0, least))
    end = jnp.minimum(end, 2.0**30) + 0.0 * n
    s = increasing_root(lambda s: _elapsed(s, n, z0) - scaled, -end, end)
    return _state(_short(s, scaled, end, n, z0), n, gravity, y)


def _short(s: Scalar, scaled: Scalar, end: Scalar, n: Scalar, z0: Scalar) -> Scalar:
    """The root `s`, of which halvings leave no digits after a short time: by steps of Newton, which
    give it its derivatives, too; zero after no time."""
    straight = scaled / (1.0 + z0 * z0)
    # In float32 a step gains seven digits at most.
    s = jax.lax.stop_gradient(jnp.where(jnp.abs(straight) < 1e-8, straight, s))
    # At an end of the range the speed has ended, and nothing follows the time.
    inside = jnp.abs(s) < 0.999 * end
    # Each step doubles the order of the derivatives that are right.
    for _ in range(2):
        value, slope = jax.jvp(lambda s: _elapsed(s, n, z0) - scaled, (s,), (jnp.ones_like(s),))
        near = inside & (slope > 0.0)
        s = s - jnp.where(near, value, 0.0) / jnp.where(near, slope, 1.0)
    return s - jax.lax.stop_gradient(jnp.where(scaled == 0.0, s, 0.0))


def _bounded_exp(x: Scalar) -> Scalar:
    """e^x, which far from the root remains finite."""
    return jnp.exp(jnp.minimum(x, 0.95 * math.log(jnp.finfo(x.dtype).max)))


def _exp_times(z0: Scalar, x: Scalar) -> Scalar:
    """z_0 e^x of a start next to the vertical, where e^x itself may leave the range."""
    half = _bounded_exp(0.5 * x)
    return z0 * half * half


def _growth(a: Scalar, s: Scalar) -> Scalar:
    """(e^(a s) - 1)/a, and s at a = 0."""
    power = a * s
    grows = power > 0.0
    return s * jnp.where(grows, _bounded_exp(power), 1.0) * phi1(jnp.where(grows, -power, power))


def _weighted(k: int, a: Scalar, s: Scalar, z0: Scalar) -> Scalar:
    """z_0^k (e^(a s) - 1)/a without e^(a s), as in `_exp_times`."""
    power = a * s
    grows = power > 0.0
    weight = jnp.where(grows, _exp_times(z0, jnp.where(grows, power, 0.0) / k), z0) ** k
    return s * weight * phi1(jnp.where(grows, -power, power))


def _elapsed(s: Scalar, n: Scalar, z0: Scalar) -> Scalar:
    """The time in units of v_0/(g (1 + z_0^2))."""
    return _growth(n - 1.0, s) + _weighted(2, n + 1.0, s, z0)


def _state(s: Scalar, n: Scalar, gravity: Scalar, y: GravityTurnState) -> GravityTurnState:
    """The state at s = ln(z/z_0), from the state `y` at s = 0."""
    z0 = jnp.tan(0.5 * as_float(y.angle))
    w = 1.0 + z0 * z0
    unit = y.speed * y.speed / (gravity * w * w)
    across = _weighted(1, 2.0 * n - 1.0, s, z0) + _weighted(3, 2.0 * n + 1.0, s, z0)
    up = _growth(2.0 * n - 2.0, s) - _weighted(4, 2.0 * n + 2.0, s, z0)
    faster = _bounded_exp((n - 1.0) * s) + _exp_times(z0, 0.5 * (n + 1.0) * s) ** 2
    # By the difference of the two angles, z - z_0, which is accurate over a short time.
    short = jnp.abs(s) < 1.0
    z = _exp_times(z0, s)
    turned = jnp.where(short, z0 * jnp.expm1(jnp.where(short, s, 0.0)), z - z0)
    return GravityTurnState(
        speed=y.speed * faster / w,
        angle=y.angle + 2.0 * jnp.arctan2(turned, 1.0 + z0 * z),
        range=y.range + 2.0 * unit * across,
        height=y.height + unit * up,
    )


@final
class ConstantRatioTurn(AbstractClosedForm):
    """The exact gravity turn of a constant thrust over weight."""

    thrust_ratio: Float[Array, "*#runs"]
    gravity: Float[Array, "*#runs"]

    def flow(self, duration: Scalar, y: GravityTurnState) -> GravityTurnState:
        return gravity_turn_after(duration, self.thrust_ratio, self.gravity, y)


@final
class GravityTurn(AbstractSystem):
    """A gravity turn. State: `GravityTurnState`; the time counts from ignition.

    Without a flow of mass, a radius and a ballistic coefficient the motion is known in closed
    form."""

    thrust_ratio: NumberField = quantity("", doc="thrust over weight at ignition, n")
    gravity: NumberField = quantity("m/s^2", positive=True, doc="at the ground")
    burn_fraction_rate: OptionalNumberField = quantity(
        "1/s", optional=True, doc="share of the initial mass that leaves in a second"
    )
    radius: OptionalNumberField = quantity(
        "m", positive=True, optional=True, doc="of the planet; without it the ground is flat"
    )
    ballistic_coefficient: OptionalNumberField = quantity(
        "kg/m^2", positive=True, optional=True, doc="initial mass over drag coefficient times area"
    )
    air_density: NumberField = quantity(
        "kg/m^3", non_negative=True, default=1.225, doc="of the air at the ground"
    )
    scale_height: NumberField = quantity(
        "m", positive=True, default=7200.0, doc="climb over which the density falls by the factor e"
    )

    def vector_field(self, t: Scalar, y: GravityTurnState) -> GravityTurnState:
        mass = 1.0 if self.burn_fraction_rate is None else 1.0 - self.burn_fraction_rate * t
        up, across = jnp.cos(y.angle), jnp.sin(y.angle)
        g = self.gravity
        bend = self.gravity / y.speed
        ground = y.speed * across
        if self.radius is not None:
            r = self.radius + y.height
            g = self.gravity * (self.radius / r) ** 2
            # The local vertical turns as the flight goes round.
            bend = g / y.speed - y.speed / r
            ground = ground * self.radius / r
        # A constant thrust: its ratio to the weight is that of the ignition, and grows as the mass
        # falls.
        push = self.gravity * self.thrust_ratio / mass
        if self.ballistic_coefficient is not None:
            density = self.air_density * jnp.exp(-y.height / self.scale_height)
            push = push - 0.5 * density * y.speed**2 / (self.ballistic_coefficient * mass)
        return GravityTurnState(push - g * up, bend * across, ground, y.speed * up)

    def invariants(self, t: Scalar, y: GravityTurnState) -> dict[str, Array]:
        """For a constant n the constant of 8.5-7, C = v z^(1-n)/(1 + z^2), or 1/C for n > 1: zero
        on a vertical path, where the other form is infinite."""
        del t
        if self.closed_form() is None:
            return {}
        half = 0.5 * y.angle
        # By sine and cosine, because z is infinite on the way down.
        n = self.thrust_ratio
        sense = jnp.where(n > 1.0, -1.0, 1.0)
        power = sense * (1.0 - n)
        # Of a vertical path at n = 1, because the power 0 of zero has no derivative.
        upright = (power == 0.0) & (half == 0.0)
        z = jnp.where(upright, 1.0, jnp.sin(jnp.where(upright, 1.0, half)))
        return {"C": y.speed**sense * z**power * jnp.cos(half) ** (sense * (1.0 + n))}

    def closed_form(self) -> AbstractClosedForm | None:
        given = (self.burn_fraction_rate, self.radius, self.ballistic_coefficient)
        if any(x is not None for x in given):
            return None
        return ConstantRatioTurn(self.thrust_ratio, self.gravity)

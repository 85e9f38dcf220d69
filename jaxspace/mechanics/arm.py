"""Small swings about rotating axes: the damped pendulum on a rotating arm, Foucault's pendulum.

    arm        z'' + 2 (zeta p + i w) z' + (p^2 - w^2) z = e w^2        z = x + i y, turning axes
    Foucault   z'' + 2 i W z' + p^2 z = 0,  W = Omega sin(latitude)     z = x + i y, north, west

    symbol    meaning                                                    unit
    p, zeta   frequency sqrt(g / l), damping ratio of the swing          rad/s, 1
    w, e      rate and length of the arm                                 rad/s, m

Source: Thomson 9.10 problems 3, 20 and 21.
Valid for small swings. Damping that turns with the arm makes w > p unstable.
"""

__all__ = ["foucault_motion"]

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.formula import POSITIVE, formula
from ..core.printing import printed
from ..core.square_roots import sqrt


@final
@printed()
class ArmState(eqx.Module):
    """Place and velocity in the turning axes, x outwards; also the rates of both."""

    position: Float[Array, "2 *#runs"] = quantity("m", doc="x, y, from the end of the arm")
    velocity: Float[Array, "2 *#runs"] = quantity("m/s", doc="rate of the position")


@final
class ArmPendulum(AbstractSystem):
    """A damped pendulum that hangs on a rotating arm. State: `ArmState`."""

    frequency: NumberField = quantity("rad/s", positive=True, doc="p, of a small swing")
    damping_ratio: NumberField = quantity("", non_negative=True, doc="zeta, of the swing")
    rate: NumberField = quantity("rad/s", doc="w, of the arm")
    arm: NumberField = quantity("m", doc="e, length of the arm")

    def vector_field(self, t: Scalar, y: ArmState) -> ArmState:
        del t
        (x, across), (vx, vy) = y.position, y.velocity
        drag, spin = 2.0 * self.damping_ratio * self.frequency, 2.0 * self.rate
        pull = self.frequency**2 - self.rate**2
        ax = self.arm * self.rate**2 - drag * vx + spin * vy - pull * x
        ay = -drag * vy - spin * vx - pull * across
        return ArmState(y.velocity, jnp.stack(jnp.broadcast_arrays(ax, ay)))

    def invariants(self, t: Scalar, y: ArmState) -> dict[str, Array]:
        """Nothing is conserved: the damping dissipates energy, and the arm does work."""
        del t, y
        return {}

    @property
    def rest(self) -> Scalar:
        """The place of rest on the line of the arm, m: e w^2 / (p^2 - w^2)."""
        return self.arm * self.rate**2 / (self.frequency**2 - self.rate**2)

    @property
    def poles(self) -> Complex[Array, "2 *#runs"]:
        """The roots s of the motion z = e^(s t), 1/s."""
        p, zeta, w = jnp.broadcast_arrays(self.frequency, self.damping_ratio, self.rate)
        half = jax.lax.complex(zeta * p, w)
        # -(p^2 - w^2) + half^2, in which w^2 has cancelled.
        root = jnp.sqrt(jax.lax.complex(-(p * p) * (1.0 - zeta * zeta), 2.0 * zeta * p * w))
        return jnp.stack([-half - root, -half + root])

    @property
    def light_poles(self) -> Complex[Array, "2 *#runs"]:
        """The roots for light damping, to first order: -zeta (p +- w) -+ i (p +- w)."""
        zeta, w = self.damping_ratio, self.rate
        plus, minus = jnp.broadcast_arrays(self.frequency + w, self.frequency - w)
        return jnp.stack(
            [jax.lax.complex(-zeta * plus, -plus), jax.lax.complex(-zeta * minus, minus)]
        )


@formula(frequency=POSITIVE)
def foucault_motion(
    t: Scalar,
    position: Float[Array, "2 *#runs"],
    velocity: Float[Array, "2 *#runs"],
    frequency: Scalar,
    vertical_rate: Scalar,
) -> tuple[Array, Array]:
    """A small swing over the turning earth (Thomson 9.10, problem 3).

    **Arguments**

    - `t`: time, s.
    - `position`, `velocity`: at t = 0, to the north and west, m and m/s, (2, *runs).
    - `frequency`: p, rad/s, sqrt(g / l).
    - `vertical_rate`: W, of the earth about the vertical, Omega sin(latitude), rad/s.

    **Returns** position, m, and velocity, m/s, at `t`. The plane of the oscillation rotates by -W.
    """
    w = vertical_rate
    swing = sqrt(frequency * frequency + w * w)
    # In axes at rest the motion is that of a pendulum of the frequency sqrt(p^2 + W^2).
    x, y = position
    still = jnp.stack([velocity[0] - w * y, velocity[1] + w * x])
    c, s = jnp.cos(swing * t), jnp.sin(swing * t)
    place, speed = c * position + s / swing * still, c * still - s * swing * position
    ct, st = jnp.cos(w * t), jnp.sin(w * t)

    def back(z: Array) -> Array:
        return jnp.stack([ct * z[0] + st * z[1], ct * z[1] - st * z[0]])

    place, speed = back(place), back(speed)
    return place, speed + jnp.stack([w * place[1], -w * place[0]])

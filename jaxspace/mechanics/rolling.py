"""Rolling without slip: a disk on an incline, a sphere on a turntable, a wheel, a trailer.

    disk      x' = r phi' cos(psi),  y' = r phi' sin(psi)       x down the slope
              psi'' = 0,  (3/2) r phi'' = g sin(a) cos(psi)
    sphere    z'' = i k W z',  k = j / (1 + j)                  z = x + i y at rest, I = j m a^2
    wheel     path radius r phi' / theta', loop time 2 pi / theta'
    trailer   m (c^2 + rho^2) th'' + m c v th' + K L y = 0,  y' = v th + L th',  L = a + c

    symbol     meaning                                                          unit
    r, a       radius of the disk; angle of the slope                           m, rad
    psi, phi   heading from the line of slope; angle rolled                     rad
    W          rate of the turntable                                            rad/s
    a, c       of a trailer: mass centre behind the hitch, before the wheel     m
    rho, K     radius of gyration, lateral stiffness of the hitch               m, N/m
    v, y       speed; lateral deflection of the hitch                           m/s, m

Source: Thomson 9.4, 9.6 problem 3, 9.9 example 1 (there lambda = m g sin(a) cos(psi), which is not
the contact force), 9.10 problems 22 and 23.
"""

__all__ = ["rolling_loop", "turntable_motion"]

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.special import stumpff
from ._description import GeneralisedState
from ._lagrangian import AbstractLagrangian


@final
class InclineDisk(AbstractLagrangian):
    """A thin disk, upright on an incline, that rolls without slip. State: `GeneralisedState` of x,
    down the slope, y, across it, the heading psi and the rolling angle phi; its `reactions` are the
    contact forces.

    `disk = InclineDisk(1.0, 0.3, 0.1, 9.81)` rolls down a slope of 0.1 rad; `disk.state(psi=0.2,
    psi_rate=1.0, phi_rate=3.0)` is its state at the origin."""

    mass: NumberField = quantity("kg", positive=True, doc="m")
    radius: NumberField = quantity("m", positive=True, doc="r")
    slope: NumberField = quantity("rad", doc="a, of the incline")
    gravity: NumberField = quantity("m/s^2", doc="g")
    names: ClassVar[tuple[str, ...]] = ("x", "y", "psi", "phi")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        speeds = v[0] ** 2 + v[1] ** 2 + self.radius**2 * (0.25 * v[2] ** 2 + 0.5 * v[3] ** 2)
        return self.mass * (0.5 * speeds + self.gravity * jnp.sin(self.slope) * q[0])

    def nonholonomic(self, t: Scalar, q: Array, v: Array) -> Array:
        del t
        roll = self.radius * v[3]
        return jnp.stack([v[0] - roll * jnp.cos(q[2]), v[1] - roll * jnp.sin(q[2])])

    def state(self, psi: Scalar, psi_rate: Scalar, phi_rate: Scalar) -> GeneralisedState:
        """The state at the origin, rolling: heading, rad, and rates, rad/s."""
        zero = 0.0 * psi
        roll = self.radius * phi_rate
        v = (roll * jnp.cos(psi), roll * jnp.sin(psi), psi_rate, phi_rate)
        parts = jnp.broadcast_arrays(*(jnp.asarray(x) for x in (zero, zero, psi, zero, *v)))
        return GeneralisedState(jnp.stack(parts[:4]), jnp.stack(parts[4:]))

    def rolled(self, t: Scalar, psi: Scalar, psi_rate: Scalar, phi_rate: Scalar) -> Array:
        """x, y, phi and phi' a time `t`, s, after `state`, in closed form (9.9-h to -j); also
        without turning."""
        u, pull = psi_rate * t, 2.0 / 3.0 * self.gravity * jnp.sin(self.slope)
        # (1 - cos u) / u^2 and (u - sin u) / u^3, of u and of 2 u: nothing is singular at u = 0.
        c1, s1 = _fractions(u)
        c2, s2 = _fractions(2.0 * u)
        once = t * _sinc(0.5 * u)
        mean = psi + 0.5 * u
        gain = once * jnp.cos(mean)
        steady = self.radius * phi_rate * once
        turned = u * (s1 + jnp.cos(2.0 * psi) * (4.0 * s2 - s1))
        across = 0.5 * turned + jnp.sin(2.0 * psi) * (c2 - 0.5 * c1)
        x = steady * jnp.cos(mean) + 0.5 * pull * gain * gain
        y = steady * jnp.sin(mean) + pull * t * t * across
        fall = pull / self.radius * t * t
        phi = phi_rate * t + fall * (jnp.cos(psi) * c1 - u * jnp.sin(psi) * s1)
        rate = phi_rate + pull / self.radius * gain
        return jnp.stack(jnp.broadcast_arrays(x, y, phi, rate))


@formula(inertia_ratio=NOT_NEGATIVE)
def turntable_motion(
    t: Scalar,
    position: Float[Array, "2 *#runs"],
    velocity: Float[Array, "2 *#runs"],
    rate: Scalar,
    inertia_ratio: Scalar = 0.4,
) -> tuple[Array, Array]:
    """A sphere that rolls on a turntable: in axes at rest its centre moves on a circle.

    **Arguments**

    - `t`: time, s.
    - `position`, `velocity`: of the centre at t = 0, in axes at rest, m and m/s, (2, *runs).
    - `rate`: W of the turntable, rad/s; zero is a plane at rest.
    - `inertia_ratio`: I / (m a^2), 2/5 of a solid sphere, which circles at 2 W / 7.

    **Returns** position, m, and velocity, m/s, at `t`, (2, *runs).
    """
    turn = inertia_ratio / (1.0 + inertia_ratio) * rate * t
    c, s = jnp.cos(turn), jnp.sin(turn)
    # By sin(u)/u, which is regular for a plane at rest.
    along, across = t * _sinc(turn), t * _sinc(0.5 * turn) * jnp.sin(0.5 * turn)
    vx, vy = velocity
    moved = jnp.stack([along * vx - across * vy, across * vx + along * vy])
    return position + moved, jnp.stack([c * vx - s * vy, s * vx + c * vy])


@formula(radius=POSITIVE)
def rolling_loop(radius: Scalar, turn_rate: Scalar, roll_rate: Scalar) -> tuple[Scalar, ...]:
    """A vertical wheel that rolls on a circle: an example of constraints that cannot be integrated
    (Thomson 9.4).

    **Arguments**

    - `radius`: of the wheel, m; `turn_rate`: theta', `roll_rate`: phi', rad/s.

    **Returns** the radius of the path, m, the time of a loop, s, and the angle rolled in it, rad:
    the wheel comes back turned.
    """
    time = 2.0 * jnp.pi / turn_rate
    return radius * roll_rate / turn_rate, time, roll_rate * time


@final
@printed()
class TrailerState(eqx.Module):
    """Deflection of the hitch, angle of the trailer and its rate; also the rates of all."""

    hitch: NumberField = quantity("m", doc="y, lateral deflection of the hitch")
    angle: NumberField = quantity("rad", doc="theta, of the trailer from the line of tow")
    angle_rate: NumberField = quantity("rad/s", doc="rate of theta")


@final
class Trailer(AbstractSystem):
    """A trailer with one wheel behind a hitch that yields sideways. State: `TrailerState`."""

    mass: NumberField = quantity("kg", positive=True, doc="m")
    gyration_radius: NumberField = quantity("m", positive=True, doc="rho, about the mass centre")
    hitch_to_centre: NumberField = quantity("m", doc="a, of the mass centre behind the hitch")
    centre_to_wheel: NumberField = quantity("m", doc="c, of the wheel behind the mass centre")
    stiffness: NumberField = quantity("N/m", positive=True, doc="K, lateral, of the hitch")
    speed: NumberField = quantity("m/s", doc="v, of the tow")

    def vector_field(self, t: Scalar, y: TrailerState) -> TrailerState:
        del t
        c = self.centre_to_wheel
        length = self.hitch_to_centre + self.centre_to_wheel
        inertia = self.mass * (c * c + self.gyration_radius**2)
        moment = self.mass * c * self.speed * y.angle_rate + self.stiffness * length * y.hitch
        return TrailerState(
            self.speed * y.angle + length * y.angle_rate, y.angle_rate, -moment / inertia
        )

    def invariants(self, t: Scalar, y: TrailerState) -> dict[str, Array]:
        """Nothing is conserved: the tow does work."""
        del t, y
        return {}

    @property
    def stability_margin(self) -> Scalar:
        """a c - rho^2, m^2: the trailer follows where it is positive, at every speed and
        stiffness."""
        return self.hitch_to_centre * self.centre_to_wheel - self.gyration_radius**2


def _fractions(u: Scalar) -> tuple[Scalar, Scalar]:
    """(1 - cos u) / u^2 and (u - sin u) / u^3."""
    # Each branch gets arguments within its range, because derivatives pass through both.
    small = jnp.abs(u) < 1.0
    near, far = jnp.where(small, u, 0.0), jnp.where(small, 1.0, u)
    c, s = stumpff(near * near)[:2]
    # 1 - cos(u) as 2 sin^2(u/2), which is accurate near every full turn.
    half = jnp.sin(0.5 * far) / far
    return (
        jnp.where(small, c, 2.0 * half * half),
        jnp.where(small, s, (far - jnp.sin(far)) / far**3),
    )


def _sinc(x: Scalar) -> Scalar:
    """sin(x) / x."""
    # The sinc of NumPy is that of pi x.
    return jnp.sinc(x / jnp.pi)

"""Stable platform about three axes: gimbals, three gyros, a resolver and servo motors.

    (E^T J E + I_g) Phi'' = tau - c_g Phi' - E^T (J b + w x J w + h theta' - T)
    w = E Phi' + C^T w_V,  b = w' at constant Phi'
    I theta'' = h w - c theta'
    tau = -E^T s,  or the book's -E^-1 s;     s = K_p theta + K_d theta' + K_i int theta dt

    symbol          meaning                                                        unit
    Phi             angles of the gimbals, from the outermost inwards              rad
    E               their axes as columns, in axes of the platform
    w, w_V          rate of the platform; of the vehicle, in its own axes          rad/s
    J, I_g          inertia of the platform; of each gimbal about its axis         kg m^2
    theta, I        angles of the gyros; inertia about their output axes           rad, kg m^2
    h, c            spin momentum; damping of a gyro                               kg m^2/s, N m s
    tau, c_g        torques of the motors; friction of the gimbals                 N m, N m s
    T               torque on the platform, in its axes                            N m
    K_p, K_d, K_i   gains of the servo                                             N m, N m s, N m/s

The order is the book's: roll outside, about the vehicle's x axis, then yaw about z, and pitch about
y inside. At a yaw of 90 deg roll and pitch turn about one axis: gimbal lock. The motors give the
platform the moment -s at every other yaw, by the virtual work of E^T; the book's resolver, E^-1,
raises the gain of the loop by 1/cos^2(yaw). A vehicle that passes close to the lock makes the roll
gimbal flip by half a turn. A fourth gimbal outside, about the vehicle's z axis, is driven so that
the yaw stays small (K_4 times yaw times the cosine of roll), which avoids the lock.

Source: Thomson 6.8, 6.9.
Valid for small angles of the gyros (a run with more than `SMALL_ANGLE` has the status
`OUTSIDE_MODEL`); only the inertia of a gimbal about its own axis is modelled.
"""

__all__ = ["gimbal_axes"]

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import (
    AbstractSystem,
    NumberField,
    Scalar,
    Vector,
    argument,
    constructor,
    quantity,
)
from ..core.formula import formula
from ..core.limits import Limit
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.types import as_float
from ..core.vectors import cross
from ..rotations import Quaternion
from ._shapes import ZERO, Three
from ._small_angle import small_angle
from .platform import resolve_signals

Gimbals = Float[Array, "gimbals *#runs"]


@final
@printed()
class StablePlatformState(eqx.Module):
    """Angles of gimbals and gyros, their rates, integrals of the gyros' angles, and the platform's
    attitude in inertial space; also the rates of all.

    - `attitude`: of the platform, relative to inertial space."""

    angles: Gimbals = quantity("rad", doc="Phi, of the gimbals from the outermost inwards")
    angle_rates: Gimbals = quantity("rad/s", doc="rates of Phi")
    gyro_angles: Three = quantity("rad", doc="theta, about the output axes")
    gyro_rates: Three = quantity("rad/s", doc="rates of theta")
    integrals: Three = quantity("rad s", doc="of theta over time")
    attitude: Quaternion  # pyright: ignore[reportGeneralTypeIssues]


@final
class StablePlatform(AbstractSystem):
    """A platform in three gimbals, or in four. State: `StablePlatformState`, created with `state`.

    - `fourth`: whether there is a gimbal outside the roll gimbal, about the vehicle's z axis. Four
      gimbals turn three axes: their accelerations lose the ratio of J to I_g in roundings.
    - `secant`: whether the signals reach the motors through the book's resolver."""

    platform_inertia: Three = quantity("kg m^2", positive=True, doc="J, about its axes")
    gimbal_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I_g, of each about its axis"
    )
    gyro_inertia: NumberField = quantity("kg m^2", positive=True, doc="I, about an output axis")
    spin_momentum: NumberField = quantity("kg m^2/s", positive=True, doc="h, of each gyro")
    gain: NumberField = quantity("N m", default=0.0, doc="K_p, of the servos")
    rate_gain: NumberField = quantity("N m s", default=0.0, doc="K_d, of the servos")
    integral_gain: NumberField = quantity("N m/s", default=0.0, doc="K_i, of the servos")
    gyro_damping: NumberField = quantity("N m s", default=0.0, doc="c, of a gyro")
    gimbal_friction: NumberField = quantity("N m s", default=0.0, doc="c_g, viscous, of a gimbal")
    outer_gain: NumberField = quantity("N m", default=0.0, doc="K_4, of the fourth gimbal's motor")
    outer_damping: NumberField = quantity("N m s", default=0.0, doc="of the fourth gimbal's motor")
    torque: Three = quantity("N m", default=ZERO, doc="T, on the platform in its axes")
    vehicle_rate: Three = quantity("rad/s", default=ZERO, doc="w_V, steady, in its axes")
    sway: Three = quantity("rad", default=ZERO, doc="amplitudes of an oscillation about its axes")
    sway_frequency: NumberField = quantity("rad/s", default=1.0, doc="of the oscillation")
    fourth: bool = eqx.field(static=True, default=False)
    secant: bool = eqx.field(static=True, default=False)

    def vector_field(self, t: Scalar, y: StablePlatformState) -> StablePlatformState:
        phi, rates = y.angles, y.angle_rates
        rank = max(phi.ndim, jnp.ndim(t) + 1, self._rank()) - 1
        three = [with_rank(x, rank) for x in (self.platform_inertia, self.torque)]
        J, torque = three
        phi, rates, theta, theta_rate, integral = (
            with_rank(x, rank) for x in (phi, rates, y.gyro_angles, y.gyro_rates, y.integrals)
        )
        w, bend = self._turn(jnp.asarray(t), phi, rates)
        axes = gimbal_axes(phi)
        h, c = self.spin_momentum, self.gyro_damping
        load = J * bend + cross(w, J * w) + h * theta_rate - torque
        signals = self.gain * theta + self.rate_gain * theta_rate + self.integral_gain * integral
        drive = self._motors(phi, rates, axes, signals) - self.gimbal_friction * rates
        # Projected on the axes of the gimbals: the reactions in their bearings do no work and drop
        # out.
        forces = drive - jnp.einsum("ki...,k...->i...", axes, load)
        mass = jnp.einsum("ki...,k...,kj...->ij...", axes, J, axes)
        unit = jnp.eye(phi.shape[0], dtype=mass.dtype).reshape(mass.shape[:2] + (1,) * rank)
        mass = mass + self.gimbal_inertia * unit
        front, back = (0, 1), (-2, -1)
        runs = jnp.broadcast_shapes(mass.shape[2:], forces.shape[1:])
        mass = jnp.broadcast_to(mass, (*mass.shape[:2], *runs))
        forces = jnp.broadcast_to(forces, (forces.shape[0], *runs))
        # With pivots: towards the lock two axes coincide, and the matrix is regular only because of
        # the inertia of the gimbals.
        result = jnp.linalg.solve(
            jnp.moveaxis(mass, front, back), jnp.moveaxis(forces, 0, -1)[..., None]
        )
        gyro = (h * w - c * theta_rate) / self.gyro_inertia
        return StablePlatformState(
            rates,
            jnp.moveaxis(result[..., 0], -1, 0),
            theta_rate,
            gyro,
            theta,
            y.attitude.rate(w),
        )

    def limits(self, t: Scalar, y: StablePlatformState) -> Sequence[Limit]:
        del t
        # Of the three the largest.
        return (small_angle("gyro_angles", jnp.max(jnp.abs(y.gyro_angles), axis=0)),)

    def invariants(self, t: Scalar, y: StablePlatformState) -> dict[str, Array]:
        """Nothing is conserved with servos on."""
        del t, y
        return {}

    @constructor(
        roll=argument("rad", default=0.0, doc="angle of the gimbal about the vehicle's x axis"),
        yaw=argument("rad", default=0.0, doc="angle of the gimbal within"),
        pitch=argument("rad", default=0.0, doc="angle of the innermost gimbal, the platform's"),
        outer=argument("rad", default=0.0, doc="angle of the fourth gimbal"),
    )
    def state(
        self, roll: Scalar = 0.0, yaw: Scalar = 0.0, pitch: Scalar = 0.0, outer: Scalar = 0.0
    ) -> StablePlatformState:
        """The state of gimbals at these angles, rad, at the time zero, with the platform and the
        gyros at rest in inertial space, where the attitude is the identity."""
        given = (outer, roll, yaw, pitch) if self.fourth else (roll, yaw, pitch)
        angles = jnp.stack(jnp.broadcast_arrays(*(as_float(x) for x in given)))
        still = jnp.zeros_like(angles[:3])
        level = Quaternion(jnp.concatenate([jnp.ones_like(still[:1]), still]))
        # The gimbals turn against the vehicle, so that the platform itself is at rest.
        rates = self.held(0.0, angles)
        return StablePlatformState(angles, rates, still, still, still, level)

    def held(self, t: Scalar, angles: Gimbals) -> Gimbals:
        """The rates of the gimbals, rad/s, at which the platform is at rest in inertial space, with
        the fourth gimbal at rest; they grow without bound towards the lock."""
        turn = _vehicle_axes(angles).rotate_back(self.vehicle_turn(t))
        roll, pitch, yaw = resolve_signals(-turn, -angles[-1], -angles[-2])
        rates = jnp.stack(jnp.broadcast_arrays(roll, yaw, pitch))
        return jnp.concatenate([jnp.zeros_like(rates[:1]), rates]) if self.fourth else rates

    def vehicle_turn(self, t: Scalar) -> Vector:
        """The vehicle's rate w_V, rad/s, in its axes at `t`, s."""
        swing = self.sway_frequency * jnp.cos(self.sway_frequency * jnp.asarray(t))
        rank = max(self.sway.ndim, jnp.ndim(swing) + 1, self.vehicle_rate.ndim) - 1
        return with_rank(self.vehicle_rate, rank) + swing * with_rank(self.sway, rank)

    def _rank(self) -> int:
        parameters = (self.platform_inertia, self.torque, self.vehicle_rate, self.sway)
        return max(x.ndim for x in parameters)

    def _turn(self, t: Array, phi: Array, rates: Array) -> tuple[Vector, Vector]:
        """The platform's rate, and its change at constant rates of the gimbals."""

        def turn(t: Array, phi: Array) -> Vector:
            of_gimbals = jnp.einsum("ki...,i...->k...", gimbal_axes(phi), rates)
            return of_gimbals + _vehicle_axes(phi).rotate_back(self.vehicle_turn(t))

        # Along (1, rates): the change of the axes and that of the vehicle's rate, together.
        return jax.jvp(turn, (t, phi), (jnp.ones_like(t), jnp.broadcast_to(rates, phi.shape)))

    def _motors(self, phi: Array, rates: Array, axes: Array, signals: Vector) -> Gimbals:
        if self.secant:
            roll, pitch, yaw = resolve_signals(signals, -phi[-1], -phi[-2])
            inner = -jnp.stack(jnp.broadcast_arrays(roll, yaw, pitch))
        else:
            inner = -jnp.einsum("ki...,k...->i...", axes[:, -3:], signals)
        if not self.fourth:
            return inner
        outer = self.outer_gain * phi[2] * jnp.cos(phi[1]) - self.outer_damping * rates[0]
        return jnp.concatenate([outer[None], inner])


@formula
def gimbal_axes(angles: Gimbals) -> Float[Array, "3 gimbals *#runs"]:
    """The axes of gimbals as columns, in axes of the platform: of roll, yaw and pitch, or with a
    fourth one before them.

    **Arguments**

    - `angles`: from the outermost gimbal inwards, rad, (3, *runs) or (4, *runs).

    **Returns** E, (3, gimbals, *runs): the platform's rate relative to the vehicle is E Phi'."""
    one = jnp.ones_like(angles[0])
    zero = jnp.zeros_like(angles[0])
    s, c = jnp.sin(angles[-1]), jnp.cos(angles[-1])
    sz, cz = jnp.sin(angles[-2]), jnp.cos(angles[-2])
    roll = (c * cz, -sz, s * cz)
    yaw = (-s, zero, c)
    pitch = (zero, one, zero)
    columns = [roll, yaw, pitch]
    if angles.shape[0] == 4:
        # The vehicle's z axis, turned by roll, then by yaw, then by pitch.
        sx, cx = jnp.sin(angles[1]), jnp.cos(angles[1])
        x = sx * sz
        y = sx * cz
        z = cx
        columns = [(x * c - z * s, y, z * c + x * s), *columns]
    return jnp.stack([jnp.stack(column) for column in columns], axis=1)


def _vehicle_axes(angles: Gimbals) -> Quaternion:
    """Components in the axes of the vehicle from those in the axes of the platform."""
    turned = Quaternion.about(0, angles[-3]).then(Quaternion.about(2, angles[-2]))
    turned = turned.then(Quaternion.about(1, angles[-1]))
    return Quaternion.about(2, angles[0]).then(turned) if angles.shape[0] == 4 else turned

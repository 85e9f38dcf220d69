"""Wheels that turn in a body about axes fixed in it: reaction wheels, the rotor of a dual-spin
satellite, a damping wheel.

    w_i = h_i/I_i - a_i . omega                                   speed relative to the body
    h_i' = g_i = motor - f_i w_i
    H = (J - sum I_i a_i a_i^T) omega + sum h_i a_i               angular momentum of all
    H' = M - omega x H     in body axes, so that J* omega' = M - sum g_i a_i - omega x H

    lambda_h = n (C - A)/A + h/A        nutation of a gyrostat, seen from the body

    symbol     meaning                                                              unit
    a_i, I_i   axis of a wheel, of length one; its moment of inertia about it       1, kg m^2
    h_i        angular momentum of a wheel about its axis, of its whole rotation    kg m^2/s
    w_i, f_i   speed relative to the body; viscous friction of the bearing          rad/s, N m s
    g_i        torque on the wheel by the body                                      N m
    J, J*      inertia of all with the wheels locked; without their spin            kg m^2
    A, C, n    moments of a gyrostat across and along its axis, with the wheel      kg m^2,
               locked; its rate about the axis                                      rad/s

Source: Thomson 7.11, example 1 and Problem 4; Hughes, Spacecraft Attitude Dynamics, 3.4 and 6.
The state contains h_i instead of the speed: its rate is the torque only, so that no acceleration of
the body enters, and the momentum of all is conserved to the rounding of the run.
"""

__all__ = ["gyrostat_nutation_rate", "rotor_moment"]

from collections.abc import Sequence
from typing import Any, ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import (
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    State,
    Vector,
    argument,
    constructor,
    quantity,
)
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.shapes import with_rank
from ..core.types import as_float, follow_precision
from ..core.vectors import cross, unit
from .motors import AbstractMotor, along_axes


@formula(A=POSITIVE, C=POSITIVE)
def gyrostat_nutation_rate(n: Scalar, A: Scalar, C: Scalar, h: Scalar) -> Scalar:
    """Rate, rad/s, at which the small transverse rate of a gyrostat rotates in the body (Thomson
    7.11).

    **Arguments**, each (*runs,)

    - `n`: rate of the body about the axis of symmetry, rad/s.
    - `A`, `C`: moments across and along it, with the wheel locked, kg m^2.
    - `h`: momentum of the wheel relative to the body, I w, along the axis, kg m^2/s.

    **Returns** n (C - A)/A + h/A, (*runs,); with its sign. With a damper the spin of the body is
    stable where it has the sign of n.
    """
    return (n * (C - A) + h) / A


@formula(inertia=NOT_NEGATIVE)
def rotor_moment(
    omega: Vector, axis: Vector, inertia: Scalar, speed: Scalar, acceleration: Scalar
) -> Vector:
    """M_p = [h_1'] + omega x h_1 that acts on a rotor; the torque on the body is -M_p (Thomson
    7.11, example 1).

    **Arguments**

    - `omega`: of the body, rad/s, (3, *runs).
    - `axis`: of the rotor, of non-zero length, (3, *runs).
    - `inertia`: about it, kg m^2, (*runs,).
    - `speed`, `acceleration`: relative to the body, rad/s and rad/s^2, (*runs,).

    **Returns** the moment, N m, (3, *runs)."""
    rank = max(omega.ndim - 1, jnp.ndim(speed), jnp.ndim(acceleration))
    along = with_rank(unit(axis), rank)
    return inertia * (acceleration * along + cross(omega, speed * along))


@final
class ReactionWheels(AbstractEffect):
    """Wheels in a body, with motors, friction and limits.

    The inertia of the body includes the locked wheels. `Scene.start` adds the part
    `wheels` to a state: the angular momentum of each wheel about its axis, kg m^2/s, (wheels,
    *runs). `speeds` gives their speeds.

    A motor gives at most the `torque_limit`. The torque that raises the speed falls from there to
    zero between the `knee` and the `speed_limit`, as for a motor at constant voltage: a saturated
    wheel does not accelerate further, and can be slowed by the full torque."""

    keeps: ClassVar[frozenset[str]] = frozenset(
        {"angular_momentum", "axial_angular_momentum", "rotational_momentum"}
    )

    axes: Float[Array, "3 wheels *#runs"] = quantity(
        "", direction=True, doc="a_i as columns: x of all wheels, y, z; of non-zero length"
    )
    inertia: Float[Array, "wheels *#runs"] = quantity(
        "kg m^2", positive=True, doc="I_i, of each wheel about its axis"
    )
    speed: Float[Array, "wheels *#runs"] = quantity(
        "rad/s", doc="of each wheel relative to the body, at the start"
    )
    friction: NumberField = quantity(
        "N m s", non_negative=True, default=0.0, doc="viscous torque per speed, of every wheel"
    )
    torque_limit: OptionalNumberField = quantity(
        "N m", positive=True, optional=True, doc="greatest torque of a motor"
    )
    speed_limit: OptionalNumberField = quantity(
        "rad/s", positive=True, optional=True, doc="speed limit of the motor"
    )
    knee: NumberField = quantity(
        "",
        low=0.0,
        high=1.0,
        strict=True,
        default=0.95,
        doc="share of the speed limit above which the driving torque falls",
    )
    motor: AbstractMotor | None = eqx.field(
        default=None, metadata={"doc": "of the wheels; without motor torques by default"}
    )
    part: str = eqx.field(
        static=True, default="wheels", metadata={"doc": "name of its part of the state"}
    )

    def __check_init__(self):
        command = getattr(self.motor, "command", None)
        # A placeholder of a tree transformation has no shape.
        counts = [np.shape(x)[0] for x in (command, self.inertia) if getattr(x, "ndim", 0)]
        if len(set(counts)) > 1:
            raise InputError(
                f"ReactionWheels.motor has {counts[0]} commands: it must have one for each of the "
                f"{counts[1]} wheels."
            )

    @classmethod
    @constructor(
        sets=("axes", "inertia", "speed"),
        axis=argument("", shape=(3,), direction=True, doc="of the rotor, of non-zero length"),
        inertia=argument("kg m^2", positive=True, doc="of the rotor about its axis"),
        speed=argument("rad/s", default=0.0, doc="relative to the body, at the start"),
    )
    def rotor(
        cls,
        axis: Vector | Sequence[Scalar],
        inertia: Scalar,
        speed: Scalar = 0.0,
        **fields: Any,
    ) -> "ReactionWheels":
        """A single wheel, such as the rotor of a dual-spin satellite.

        **Arguments**

        - `axis`: (3, *runs); `inertia`, kg m^2, and `speed`, rad/s: (*runs,).
        - `fields`: the others of the class."""
        axes = as_float(axis)[:, None]
        one, turning = (
            as_float(x)[None] if jnp.ndim(x) else jnp.reshape(as_float(x), 1)
            for x in (inertia, speed)
        )
        return cls(axes, one, turning, **fields)

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        del body
        axes, inertia, speed = self._beside(y.omega)
        return {self.part: inertia * (speed + along_axes(axes, y.omega))}

    def speeds(self, y: BodyState) -> Array:
        """Speeds relative to the body, rad/s, (wheels, *runs), in the state `y`, also along a
        trajectory."""
        axes, inertia, _ = self._beside(y.omega)
        return y.part(self.part) / inertia - along_axes(axes, y.omega)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        axes, inertia, _ = self._beside(y.omega)
        speed = self.speeds(y)
        torque = self.limited(t, y, axes, speed) - self.friction * speed
        return Load(
            torque_B=-jnp.sum(axes * torque, axis=1),
            parts_rate={self.part: torque},
            # The body's inertia counts the wheels as locked: the part contained in their momentum
            # is subtracted.
            inertia_B=-jnp.sum(inertia * axes[:, None] * axes[None, :], axis=2),
            momentum_B=jnp.sum(axes * y.part(self.part), axis=1),
        )

    def limited(self, t: Scalar, y: BodyState, axes: Array, speed: Array) -> Array:
        """The torques of the motors within their limits, N m, (wheels, *runs); arguments as those
        of `AbstractMotor.torque`."""
        if self.motor is None:
            return jnp.zeros_like(speed)
        torque = self.motor.torque(t, y, axes, speed)
        if self.torque_limit is not None:
            torque = jnp.clip(torque, -self.torque_limit, self.torque_limit)
        if self.speed_limit is None:
            return torque
        left = (1.0 - jnp.abs(speed) / self.speed_limit) / (1.0 - self.knee)
        share = jnp.where(torque * speed > 0.0, jnp.clip(left, 0.0, 1.0), 1.0)
        return share * torque

    def _beside(self, omega: Vector) -> tuple[Array, Array, Array]:
        """Axes of length one, moments and speeds, with the axes of times and runs of `omega`, in
        its precision."""
        given = self.axes, self.inertia, self.speed
        axes, inertia, speed = follow_precision(given, omega)
        rank = omega.ndim - 1
        axes = with_rank(unit(axes), rank, axes=2)
        return axes, with_rank(inertia, rank), with_rank(speed, rank)

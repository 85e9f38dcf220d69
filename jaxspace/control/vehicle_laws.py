"""Control laws of the surfaces and engines of vehicles: to an apogee, about the axes, to the
ground.

    h_a = z + ln(1 + b v^2/g)/(2 b),      s = k (h_a - h) + s_0                 air brake
    d   = -q (k e + c (omega - n) + i int(e dt)),   q = min(1, (v_r/|v|)^2)     fins
    a   = 12 (r - x)/t_g^2 - 6 (v_f + v)/t_g + a_f                              landing
    T   = m (a - g),    (s, alpha, beta) = (T . z/F, K (z x d) - C omega)

    symbol          meaning                                                      unit
    z, v, h_a, h    height, speed of climb, predicted and target apogee          m, m/s, m
    b               rho C_D A/(2 m), deceleration by drag over the speed's       1/m
                    square
    e, omega, n     rotation vector to the target, rate, target rate             rad, rad/s
    v_r             speed above which the angles fall as the air's pressure      m/s
                    grows
    r, v_f, a_f     place, velocity and acceleration at the end                  m, m/s, m/s^2
    t_g, d          time to go, direction of T in body axes                      s, 1
    F               thrust of the open throttle                                  N

The prediction is exact for a vertical flight in air of one density, and for any as v falls to zero:
an error of b matters less and less. The path of the landing is a quartic in time. With a_f = 0 its
thrust ends along -g, and the vehicle upright.

Source: Klumpp, Apollo lunar-descent guidance, Automatica 10, 1974, 133; Thomson 8.5 (drag); Etkin,
Dynamics of Atmospheric Flight, 10 (gains by the dynamic pressure).
"""

__all__ = ["drag_apogee"]

from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import NumberField, OptionalNumberField, Scalar, Vector, quantity
from ..core.formula import POSITIVE, formula
from ..core.shapes import with_rank
from ..core.vectors import dot, norm, unit
from ._controller import AbstractController, measurement
from ._integral import Integral, integrated, integrating, unwound
from .attitude_laws import error_vector


@formula(drag=POSITIVE, gravity=POSITIVE)
def drag_apogee(height: Scalar, climb: Scalar, drag: Scalar, gravity: Scalar) -> Scalar:
    """Apogee, m, of a vertical flight against gravity and a drag by the square of the speed.

    **Arguments**, each (*runs,)

    - `height`: m; `climb`: its rate, m/s, whose negative values count as zero.
    - `drag`: b, deceleration over the square of the speed, 1/m, above zero; `gravity`: m/s^2."""
    v = jnp.maximum(climb, 0.0)
    return height + 0.5 * jnp.log1p(drag * v * v / gravity) / drag


@final
class ApogeeControl(AbstractController):
    """Opens an air brake so that the flight ends its climb at a height.

    Reads position, whose z is the height, and velocity. The command is the open share, between 0
    and 1, (*runs,)."""

    target: NumberField = quantity("m", doc="h, z of the target apogee")
    drag: NumberField = quantity(
        "1/m", positive=True, doc="b, of the vehicle with the brake at its typical parts"
    )
    gain: NumberField = quantity("1/m", non_negative=True, doc="k, share over predicted excess")
    share: NumberField = quantity("", default=0.0, doc="s_0, opening without excess")
    opening: NumberField = quantity(
        "s", default=0.0, doc="time before which the brake stays shut: the burnout"
    )
    gravity: NumberField = quantity("m/s^2", positive=True, default=9.80665, doc="g")

    def act(self, t: Scalar, memory: None, measured: PyTree) -> tuple[Scalar, None]:
        z, climb = measurement(measured, "position")[2], measurement(measured, "velocity")[2]
        # From the predicted apogee: the height itself would reveal an overshoot too late.
        excess = drag_apogee(z, climb, self.drag, self.gravity) - self.target
        share = self.gain * excess + self.share
        # Closed under thrust, where the prediction is invalid.
        return jnp.where(t < self.opening, 0.0, jnp.clip(share, 0.0, 1.0)), memory


@final
class FinControl(AbstractController):
    """Turns fins against the errors of attitude and rate about each axis.

    Reads attitude, omega and velocity. The command is the angle of the fins about each axis, rad,
    (3, *runs). Fins ahead of the centre of mass require positive gains, fins behind it negative
    ones about x and y. A gain of zero leaves its axis uncontrolled. The integral waits while the
    command is cut by the limit of the loop."""

    gain: Float[Array, "3 *#runs"] = quantity("", doc="k, angle of the fins over that of the error")
    damping: Float[Array, "3 *#runs"] = quantity("s", doc="c, angle of the fins over the rate")
    integral: Float[Array, "3 *#runs"] | None = quantity(
        "1/s", optional=True, doc="i, angle of the fins over the integral of the error"
    )
    target: Float[Array, "4 *#runs"] = quantity(
        "",
        direction=True,
        default=(1.0, 0.0, 0.0, 0.0),
        doc="target quaternion, scalar first",
    )
    rate: Float[Array, "3 *#runs"] = quantity(
        "rad/s", default=(0.0, 0.0, 0.0), doc="n, target about the axes of the body"
    )
    full_speed: OptionalNumberField = quantity(
        "m/s",
        positive=True,
        optional=True,
        doc="v_r; without it the gains do not depend on the speed",
    )

    def start(self, measured: PyTree) -> Integral | None:
        return None if self.integral is None else integrating(measurement(measured, "omega"))

    def act(
        self, t: Scalar, memory: Integral | None, measured: PyTree
    ) -> tuple[Vector, Integral | None]:
        attitude, omega = measurement(measured, "attitude"), measurement(measured, "omega")
        rank = omega.ndim - 1
        gain, damping, rate = (with_rank(x, rank) for x in (self.gain, self.damping, self.rate))
        error = error_vector(attitude, self.target)
        # In body axes, in which fins act about one axis each.
        angles = -gain * error - damping * (omega - rate)
        if memory is not None and self.integral is not None:
            memory = integrated(memory, t, error)
            angles = angles - with_rank(self.integral, rank) * memory.total
        if self.full_speed is None:
            return angles, memory
        v = measurement(measured, "velocity")
        full = self.full_speed
        # The moment of a fin grows with the square of the speed: the gain falls with it.
        return full * full / jnp.maximum(dot(v, v), full * full) * angles, memory

    def settle(self, memory: Integral | None, asked: Array, applied: Array) -> Integral | None:
        return None if memory is None else unwound(memory, asked != applied)


@final
class LandingControl(AbstractController):
    """Brings a vehicle to a place with a velocity and an acceleration at a time, and so upright.

    The command is that of its engine: throttle and the angles of the nozzle about x and y, rad, as
    (3, *runs). Reads position, velocity, mass, attitude and omega. The time to go falls no lower
    than `least_time`. The commanded thrust leans no more than `tilt_limit` and falls no lower than
    `least_thrust`: a vehicle that is too high does not turn over. The roll is controlled by another
    law."""

    arrival: NumberField = quantity("s", doc="arrival time")
    gravity: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", direction=True, doc="g, in inertial axes; not zero"
    )
    full_thrust: NumberField = quantity("N", positive=True, doc="F, at full throttle")
    gain: NumberField = quantity("", doc="K, angle of the nozzle over that of the error")
    damping: NumberField = quantity("s", doc="C, angle of the nozzle over the rate")
    least_thrust: NumberField = quantity("N", positive=True, doc="upwards, least commanded value")
    target: Float[Array, "3 *#runs"] = quantity(
        "m", default=(0.0, 0.0, 0.0), doc="r, target position"
    )
    velocity: Float[Array, "3 *#runs"] = quantity(
        "m/s", default=(0.0, 0.0, 0.0), doc="v_f, velocity at the arrival"
    )
    acceleration: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", default=(0.0, 0.0, 0.0), doc="a_f, at the end; zero ends upright"
    )
    least_time: NumberField = quantity(
        "s", positive=True, default=1.0, doc="time to go below which the gains are constant"
    )
    tilt_limit: NumberField = quantity(
        "rad", low=0.0, high=1.5, strict=True, default=0.5, doc="of the thrust from the vertical"
    )

    def thrust(self, t: Scalar, x: Vector, v: Vector, mass: Scalar) -> Vector:
        """The commanded thrust T within its limits, N, (3, *runs), in inertial axes.

        **Arguments**

        - `t`: s; `x`, `v`: position and velocity, m and m/s, (3, *runs); `mass`: kg."""
        rank = x.ndim - 1
        r, vf, af, g = (
            with_rank(a, rank)
            for a in (self.target, self.velocity, self.acceleration, self.gravity)
        )
        # The gains grow without bound as the time to go ends.
        left = jnp.maximum(self.arrival - t, self.least_time)
        a = 12.0 / (left * left) * (r - x) - 6.0 / left * (vf + v) + af
        command = mass * (a - g)
        up = -unit(g) + 0.0 * x
        upwards = dot(command, up)
        aside = command - upwards * up
        # A vehicle that is too high would turn over to push itself down.
        upwards = jnp.maximum(upwards, self.least_thrust)
        # Positive, so that the quotient is defined where the thrust is upright.
        most = upwards * jnp.tan(self.tilt_limit)
        size = norm(aside)
        return upwards * up + most / jnp.maximum(size, most) * aside

    def act(self, t: Scalar, memory: None, measured: PyTree) -> tuple[Vector, None]:
        x, v = measurement(measured, "position"), measurement(measured, "velocity")
        attitude, omega = measurement(measured, "attitude"), measurement(measured, "omega")
        thrust = attitude.rotate_back(self.thrust(t, x, v, measurement(measured, "mass")))
        d = unit(thrust)
        # The error is the direction of the thrust in body axes, across the nozzle.
        about_x = -self.gain * d[1] - self.damping * omega[0]
        about_y = self.gain * d[0] - self.damping * omega[1]
        return jnp.stack([thrust[2] / self.full_thrust, about_x, about_y]), memory

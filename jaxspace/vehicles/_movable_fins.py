"""Fins that turn about their spans: canards ahead of the centre of mass, or an all-moving tail.

    f_k = rho/2 |w| S (w_z sin d_k - t_k . u cos d_k)      along n_k = t_k cos d_k - z sin d_k
    u   = w + omega x l z,      F = sum f_k n_k,      M_xy = l z x F
    M_z = rho/2 |w| (R w_z mean(sin d_k) - D omega_z)

    symbol     meaning                                                            unit
    w, u       velocity relative to the air: of the centre of mass, at the fins   m/s
    d_k        angle of a fin, positive where it turns the body about +z          rad
    e_k, t_k   direction of a fin's span, z x e_k                                 1
    S          slope of the normal force of one fin on its body                   m^2
    l          centre of pressure of the fins, from the centre of mass            m
    R, D       slopes of the roll: by the angle of all fins, by the rate          m^3, m^4

A command (a_x, a_y, a_z) is mixed as d_k = a_z - a . e_k: from ahead of the centre of mass it turns
the body about +x, +y, +z, from behind about -x, -y, +z. Each fin follows its commanded angle
according to `servo_rate`.

Fins at rest are those of `FinSet` in `Aerodynamics`. The angle of a fin acts on fin and body as the
incidence of both does: by slender-body theory the force on both is that of the fin at incidence.

Source: Pitts, Nielsen and Kaattari, NACA Report 1307, 1957 (fins and their body); Barrowman, 1967,
3 (roll). Valid while the fins do not stall, below about 15 degrees of incidence: a run with more at
a dynamic pressure above 1 kPa has the status `OUTSIDE_MODEL`.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import InputError, NumberField, Scalar, State, quantity
from ..core.checks import is_concrete
from ..core.limits import Limit
from ..core.shapes import with_rank
from ..core.vectors import norm
from ..rockets.servo import servo_rate
from ._aerodynamics import centre_of
from .airframe import FinSet
from .local_air import LocalAir, air_about

STALL = math.radians(15.0)
"""The incidence, rad, at which a fin stalls."""

MARKED_FROM = 1000.0
"""The dynamic pressure, Pa, above which a stalled fin matters: at an apogee every angle occurs."""


@final
class MovableFins(AbstractEffect):
    """Fins whose angles follow a command about the three axes of the body.

    They bring the whole force of these fins: those of `Aerodynamics`, or of a table, are the
    others. `Scene.start` adds the part `fins` to a state: the angle of each, rad, (fins, *runs),
    which starts at the command that the effect is given. A `cant` adds to every angle.

    Raises `InputError` for another number of `azimuths` than there are fins."""

    PART: ClassVar[str] = "fins"

    fins: FinSet = eqx.field(metadata={"doc": "their shape and place"})
    azimuths: Float[Array, "fins *#runs"] = quantity(
        "rad", doc="of the span of each fin, from the x axis of the body towards y"
    )
    angle_limit: NumberField = quantity(
        "rad", low=0.0, high=0.5, strict=True, default=0.2, doc="greatest angle of a fin"
    )
    rate_limit: NumberField = quantity(
        "rad/s", positive=True, default=5.0, doc="greatest rate of an angle"
    )
    time_constant: NumberField = quantity("s", positive=True, default=0.02, doc="of the servos")
    air: LocalAir | None = eqx.field(
        default=None,
        metadata={"doc": "about the vehicle; calm standard air by default", "shared": "air"},
    )
    command: Float[Array, "3 *#runs"] = quantity(
        "rad", default=(0.0, 0.0, 0.0), doc="angles about the axes before the first command"
    )

    def __check_init__(self):
        super().__check_init__()
        count = self.fins.count
        angles = self.azimuths.shape[0] if self.azimuths.ndim else 1
        if is_concrete(count) and int(count) != angles:
            raise InputError(
                f"MovableFins.azimuths has the length {angles}: it must be equal to FinSet.count, "
                f"{int(count)}."
            )

    def _spans(self, rank: int) -> tuple[Array, Array]:
        """x and y of the directions e_k, (fins, *runs) each, with `rank` axes of runs."""
        azimuths = with_rank(self.azimuths, rank)
        return jnp.cos(azimuths), jnp.sin(azimuths)

    def mixed(self, command: Array) -> Array:
        """The angles of the fins, rad, (fins, *runs), for a command about the axes, (3, *runs)."""
        x, y = self._spans(command.ndim - 1)
        # Held after the sum, because a fin that pitches and rolls at once has one limit.
        return jnp.clip(
            command[2] - command[0] * x - command[1] * y, -self.angle_limit, self.angle_limit
        )

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        del body
        rank = y.omega.ndim - 1
        # The zero brings the runs and the precision of the state.
        return {self.PART: self.mixed(with_rank(self.command, rank)) + 0.0 * y.omega[0]}

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t
        fins = self.fins
        angles = y.part(self.PART)
        air, moving = air_about(self.air).at(y.position)
        w = y.attitude.rotate_back(y.velocity - moving)
        speed = norm(w)
        mach = speed / air.sound_speed
        push = 0.5 * air.density * speed
        arm = fins.centre() - centre_of(body, y)
        p, q, r = y.omega
        rank = y.omega.ndim - 1
        # t_k = (-y, x) of the span e_k = (x, y).
        x, z_cross_x = self._spans(rank)
        turned = angles if fins.cant is None else angles + fins.cant
        sine, cosine = jnp.sin(turned), jnp.cos(turned)
        # By the flow at the fins: on a long arm a pitch rate changes their incidence as much as an
        # angle.
        across = x * (w[1] - arm * p) - z_cross_x * (w[0] + arm * q)
        # Of one fin: those that work share the slope of all.
        slope = 2.0 / angles.shape[0] * fins.slope(mach)
        force = push * slope * (w[2] * sine - across * cosine)
        side = force * cosine
        force_x = -jnp.sum(side * z_cross_x, axis=0)
        force_y = jnp.sum(side * x, axis=0)
        # The slope is that of all fins at one angle: of different ones their mean rolls the body.
        roll = w[2] * fins.roll_slope(mach) * jnp.mean(sine, axis=0) - fins.roll_damping(mach) * r
        aim = self.mixed(with_rank(self.command, rank))
        limit = self.angle_limit
        rate = servo_rate(aim, angles, -limit, limit, self.rate_limit, self.time_constant)
        return Load(
            force_N=y.attitude.rotate(
                jnp.stack([force_x, force_y, -jnp.sum(force * sine, axis=0)])
            ),
            torque_B=jnp.stack([-arm * force_y, arm * force_x, push * roll]),
            parts_rate={self.PART: rate},
        )

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        del t
        angles = y.part(self.PART)
        air, moving = air_about(self.air).at(y.position)
        w = y.attitude.rotate_back(y.velocity - moving)
        arm = self.fins.centre() - centre_of(body, y)
        p, q, _ = y.omega
        x, z_cross_x = self._spans(y.omega.ndim - 1)
        across = x * (w[1] - arm * p) - z_cross_x * (w[0] + arm * q)
        turned = angles if self.fins.cant is None else angles + self.fins.cant
        # Of the flow in the plane across the span.
        incidence = jnp.abs(turned - jnp.arctan2(across, w[2]))
        largest = jnp.max(incidence, axis=0)
        speed = norm(w)
        dense = 0.5 * air.density * speed * speed > MARKED_FROM
        return (Limit("the incidence of a fin", "rad", largest, high=STALL, where=dense),)

    def ground(self) -> Scalar | None:
        return None if self.air is None else self.air.radius

"""Forces of the air on a rocket that turns: axial force by the Mach number, normal forces of its
parts, and their moments.

    F_z  = -rho/2 |w| A C_A(M) w_z
    F_xy = -rho/2 |w| [S_0 w_xy + S_1 (omega_y, -omega_x)]           S_i = sum_k S_k (z_k - z_C)^i
    M_x  =  rho/2 |w| [S_1 w_y - S_2 omega_x]
    M_y  = -rho/2 |w| [S_1 w_x + S_2 omega_y]

    symbol      meaning                                                          unit
    w           velocity of the centre of mass relative to the air, body axes    m/s
    S_k, z_k    slope of the normal force of a part, its centre of pressure      m^2, m
    z_C         centre of mass                                                   m
    A, C_A      reference area, coefficient of the axial force                   m^2, 1

S_1 < 0 is a stable rocket: the moment turns its nose into the flow. S_2 damps the turning, by the
flow that the turning makes at each part. The force is linear in the velocity across the axis, which
is the sine of the angle of attack: it is valid for every angle without a branch.

Source: Barrowman, 1967, 3; Etkin, Dynamics of Atmospheric Flight, 5.5 (damping). The flow is that
at the centre of mass.
"""

from collections.abc import Sequence
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, output, quantity
from ..core.listed import no_method
from ..core.vectors import norm
from .airframe import (
    FINS_DOC,
    RADIUS_CHANGES_DOC,
    AbstractSurface,
    Fins,
    NoseCone,
    RadiusChanges,
    parts_field,
    roll_of,
    several,
    surfaces_of,
)
from .coefficient import BURNOUT, MachTable, as_coefficient, as_optional_coefficient, coefficient_at
from .local_air import LocalAir, air_about, flow_pressure


def moments_of_slope(
    surfaces: Sequence[AbstractSurface], mach: Scalar, station: Scalar | float = 0.0
) -> tuple[Scalar, ...]:
    """S_0, m^2, S_1, m^3, and S_2, m^4, of parts about the `station`, m, at a Mach number."""
    # Arrays also for a rocket without such parts, whose forces must have the runs of the flow.
    zeroth = first = second = jnp.zeros_like(mach)
    for surface in surfaces:
        slope = surface.slope(mach)
        arm = surface.centre() - station
        zeroth, first = zeroth + slope, first + slope * arm
        second = second + slope * arm * arm
    return zeroth, first, second


def centre_of(body: AbstractBody, y: BodyState) -> Scalar:
    """z of the centre of mass in construction axes, m."""
    # A body of constant mass has its centre at the origin and gives a plain 0.0.
    centre: Any = body.centre_of_mass(y.mass)
    return centre if isinstance(centre, float) else centre[2]


@final
class Aerodynamics(AbstractEffect):
    """Forces and moments of the air on a slender rocket with nose, fins and tail."""

    area: NumberField = quantity("m^2", positive=True, doc="A, the reference area")
    # The checker takes the quantity above for a default.
    coefficient: MachTable = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        converter=as_coefficient, metadata={"doc": "C_A by the Mach number"}
    )
    nose: NoseCone | None = eqx.field(default=None, metadata={"doc": "the nose"})
    fins: Fins = parts_field(FINS_DOC)
    tail: RadiusChanges = parts_field(RADIUS_CHANGES_DOC)
    air: LocalAir | None = eqx.field(
        default=None,
        metadata={"doc": "about the vehicle; calm standard air by default", "shared": "air"},
    )
    coasting: MachTable | None = eqx.field(
        default=None,
        converter=as_optional_coefficient,
        metadata={"doc": "C_A after the burnout, if different"},
    )
    burnout: OptionalNumberField = quantity("s", optional=True, doc=BURNOUT)

    @property
    @no_method
    def surfaces(self) -> tuple[AbstractSurface, ...]:
        """The parts that give a normal force."""
        return surfaces_of(self.nose, self.fins, self.tail)

    def moments_of_slope(self, mach: Scalar, station: Scalar | float = 0.0) -> tuple[Scalar, ...]:
        """S_0, m^2, S_1, m^3, and S_2, m^4, about the `station`, m, at a Mach number."""
        return moments_of_slope(self.surfaces, mach, station)

    def centre_of_pressure(self, mach: Scalar) -> Scalar:
        """z of the point at which all normal forces act, m, at a Mach number."""
        zeroth, first, _ = self.moments_of_slope(mach)
        return first / zeroth

    def axial_coefficient(self, t: Scalar, mach: Scalar) -> Scalar:
        """C_A at the time `t`, s, and a Mach number."""
        return coefficient_at(t, mach, self.coefficient, self.coasting, self.burnout)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return None if self.burnout is None else self.burnout[None]

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        air, moving = air_about(self.air).at(y.position)
        w = y.attitude.rotate_back(y.velocity - moving)
        speed = norm(w)
        mach = speed / air.sound_speed
        # Without a factor |w|, which components of w bring in: no angle divides by a speed of zero.
        push = 0.5 * air.density * speed
        s0, s1, s2 = self.moments_of_slope(mach, centre_of(body, y))
        axial = self.area * self.axial_coefficient(t, mach)
        p, q, r = y.omega
        # The rates change the flow at each part by its arm, of which S_1 is the sum.
        force = -push * jnp.stack([s0 * w[0] + s1 * q, s0 * w[1] - s1 * p, axial * w[2]])
        forcing, damping = roll_of(several(self.fins), mach)
        roll = 0.0 * push if damping is None else -push * damping * r
        roll = roll if forcing is None else roll + push * speed * forcing
        turn = jnp.stack([push * (s1 * w[1] - s2 * p), -push * (s1 * w[0] + s2 * q), roll])
        return Load(force_N=y.attitude.rotate(force), torque_B=turn)

    @output("Pa")
    def dynamic_pressure(self, y: BodyState) -> Scalar:
        """Dynamic pressure rho |w|^2 / 2, Pa."""
        return flow_pressure(self.air, y)

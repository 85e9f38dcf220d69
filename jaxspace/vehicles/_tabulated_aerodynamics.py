"""Forces of the air on a rocket that turns, from a table of coefficients.

    alpha = atan2(w_p, w_z),   w_p^2 = w_x^2 + w_y^2,   phi = -atan2(w_y, w_x)
    F_z  = -rho/2 |w|^2 A C_A
    F_xy = -rho/2 |w| A [(C_N/sin alpha) (w_x, w_y) - (C_Y/sin alpha) (w_y, -w_x)]
    M_xy =  rho/2 |w| A [G_N (w_y, -w_x) + G_Y (w_x, w_y) + L^2/2 C_mq (omega_x, omega_y)]
    M_z  =  rho/2 |w| A [|w| L C_l + L^2/2 C_lp omega_z]
    G_N  = [L C_m + (z_0 - z_C) C_N]/sin alpha,   G_Y = [L C_n + (z_0 - z_C) C_Y]/sin alpha

    symbol      meaning                                                          unit
    w           velocity of the centre of mass relative to the air, body axes    m/s
    alpha, phi  angle of attack, roll of the body from the plane of the flow     rad
    C_A ...     coefficients at the Mach number |w|/c, alpha, phi, Reynolds      1
    A, L        reference area and length                                        m^2, m
    z_0, z_C    station of the table, centre of mass                             m
    Re          rho |w| L/mu,  mu = 1.458e-6 T^1.5/(T + 110.4)                   1

Coefficients missing in the table come from the parts of the airframe, if given: the normal force
with its damping, the damping only, the roll moment of canted fins. With a motor that burns C_A is
that of a base filled by the jet.

Source: Zipfel, Modeling and Simulation of Aerospace Vehicle Dynamics, 6.2 and 8.2; U.S. Standard
Atmosphere, 1976, Eq. 51 (viscosity). The flow is that at the centre of mass. A derivative by omega
is taken as one about the centre of mass.
"""

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, Air, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, Vector, output, quantity
from ..core.limits import Limit
from ..core.safe import safe_atan2, safe_sqrt
from ..core.vectors import norm
from ._aerodynamics import centre_of, moments_of_slope
from .aerodynamic_table import AerodynamicTable
from .airframe import (
    FINS_DOC,
    RADIUS_CHANGES_DOC,
    Fins,
    NoseCone,
    RadiusChanges,
    parts_field,
    roll_of,
    several,
    surfaces_of,
)
from .local_air import LocalAir, air_about, flow_pressure


def viscosity(temperature: Scalar) -> Scalar:
    """Dynamic viscosity of air, Pa s, at a `temperature`, K (U.S. Standard Atmosphere, Eq. 51)."""
    return 1.458e-6 * temperature * jnp.sqrt(temperature) / (temperature + 110.4)


@final
class TabulatedAerodynamics(AbstractEffect):
    """Forces and moments of the air from a table, in place of `Aerodynamics`.

    A run that passes beyond its table, at a dynamic pressure above `marked_from`, has the status
    `OUTSIDE_MODEL`: at an apogee every angle occurs, and matters little."""

    # The checker takes the quantities below for fields with defaults before this one.
    table: AerodynamicTable = eqx.field(metadata={"doc": "of the coefficients"})
    air: LocalAir | None = eqx.field(
        default=None,
        metadata={"doc": "about the vehicle; calm standard air by default", "shared": "air"},
    )
    burnout: OptionalNumberField = quantity(
        "s", optional=True, doc="time of the burnout; by default the motor is off"
    )
    nose: NoseCone | None = eqx.field(default=None, metadata={"doc": "the nose"})
    fins: Fins = parts_field(FINS_DOC)
    tail: RadiusChanges = parts_field(RADIUS_CHANGES_DOC)
    axial_factor: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="factor on the axial force, for dispersions"
    )
    normal_factor: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="factor on the force across the axis"
    )
    centre_shift: NumberField = quantity(
        "m", default=0.0, doc="of the centre of pressure towards the nose, for dispersions"
    )
    marked_from: NumberField = quantity(
        "Pa",
        non_negative=True,
        default=1000.0,
        doc="dynamic pressure above which leaving the table counts as outside the model",
    )

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return None if self.burnout is None else self.burnout[None]

    def ground(self) -> Scalar | None:
        return None if self.air is None else self.air.radius

    def _flow(self, y: BodyState) -> tuple[Air, Vector, Scalar, Scalar]:
        """The air, w in body axes, its length, and the angle of attack."""
        air, moving = air_about(self.air).at(y.position)
        w = y.attitude.rotate_back(y.velocity - moving)
        across = safe_sqrt(w[0] * w[0] + w[1] * w[1])
        return air, w, norm(w), safe_atan2(across, w[2])

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        air, w, speed, angle = self._flow(y)
        mach = speed / air.sound_speed
        # From the flow to the body: the flow in body axes turns the other way.
        roll = -safe_atan2(w[1], w[0])
        reynolds = air.density * speed * self.table.length / viscosity(air.temperature)
        c = self.table.at(mach, angle, roll, reynolds)
        push = 0.5 * air.density * speed
        station = centre_of(body, y)
        sideways, turn = self._across(c, w, mach, push, y.omega, station)
        # By |w| twice, of which `push` has one: across the axis a component of w is the other.
        axial = push * speed * self.table.area * self.axial_factor * self._axial(t, c)
        force = jnp.stack([sideways[0], sideways[1], -axial])
        spin = self._roll(c, mach, push, speed, y.omega[2])
        return Load(force_N=y.attitude.rotate(force), torque_B=jnp.stack([turn[0], turn[1], spin]))

    def _axial(self, t: Scalar, c: dict[str, Scalar]) -> Scalar:
        if self.burnout is None or "axial_burning" not in c:
            return c["axial"]
        return jnp.where(t < self.burnout, c["axial_burning"], c["axial"])

    def _across(
        self,
        c: dict[str, Scalar],
        w: Vector,
        mach: Scalar,
        push: Scalar,
        omega: Vector,
        station: Scalar,
    ) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
        """Force, N, and moment about the centre of mass, N m, across the axis."""
        parts = surfaces_of(self.nose, self.fins, self.tail)
        area, length = self.table.area, self.table.length
        s0, s1, s2 = moments_of_slope(parts, mach, station)
        # The flow that the turning makes at the parts.
        damping = -s2
        lag = s1
        if "pitch_damping" in c:
            # A measured damping applies to the moment only: the contribution of rotation to the
            # force is not in the table, and is omitted rather than computed with another theory.
            damping, lag = 0.5 * area * length * length * c["pitch_damping"], 0.0 * s1
        arm = self.table.station - station
        # Of the parts where the table has no force across the axis.
        normal, moment = s0, s1
        if "normal" in c:
            normal = area * c["normal"]
            moment = area * (c["lever"] if "lever" in c else length * c["pitch"]) + arm * normal
        moment = moment + self.centre_shift * normal
        side = area * c.get("side", 0.0)
        twist = area * length * c.get("yaw", 0.0) + (arm + self.centre_shift) * side
        factor = push * self.normal_factor
        p, q, _ = omega
        force = (
            factor * (side * w[1] - normal * w[0] - lag * q),
            factor * (lag * p - normal * w[1] - side * w[0]),
        )
        turn = (
            factor * (moment * w[1] + twist * w[0]) + push * damping * p,
            factor * (-moment * w[0] + twist * w[1]) + push * damping * q,
        )
        return force, turn

    def _roll(
        self, c: dict[str, Scalar], mach: Scalar, push: Scalar, speed: Scalar, rate: Scalar
    ) -> Scalar:
        """Moment about the axis, N m."""
        area, length = self.table.area, self.table.length
        forcing, damping = roll_of(several(self.fins), mach)
        damping = None if damping is None else -damping
        # Table entries replace the theory of the parts.
        if "roll_moment" in c:
            forcing = area * length * c["roll_moment"]
        if "roll_damping" in c:
            damping = 0.5 * area * length * length * c["roll_damping"]
        # The zero carries the runs.
        forced = 0.0 * push if forcing is None else push * speed * forcing
        return forced if damping is None else forced + push * damping * rate

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        del t, body
        air, _, speed, angle = self._flow(y)
        reynolds = air.density * speed * self.table.length / viscosity(air.temperature)
        # In thin air an end beyond the table has hardly a force, and no run must fail for it.
        dense = 0.5 * air.density * speed * speed > self.marked_from
        ends = self.table.limits(speed / air.sound_speed, angle, reynolds)
        return [limit._replace(where=dense) for limit in ends]

    @output("Pa")
    def dynamic_pressure(self, y: BodyState) -> Scalar:
        """Dynamic pressure rho |w|^2 / 2, Pa."""
        return flow_pressure(self.air, y)

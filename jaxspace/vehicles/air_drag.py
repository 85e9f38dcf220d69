"""Drag of a point that carries no attitude: a rocket in three degrees of freedom, a parachute.

    F = -rho/2 |w| C_D(M) A w          w = v - v_air,   M = |w|/c

    symbol   meaning                                       unit
    w, M     velocity relative to the air, Mach number     m/s, 1
    rho, c   density, speed of sound                       kg/m^3, m/s
    C_D, A   drag coefficient, area that it refers to      1, m^2

Source: Thomson 8.5 (drag in the gravity turn); Knacke, Parachute Recovery Systems Design Manual, 5
(parachutes).
"""

__all__ = ["descent_rate", "drag_force"]

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import InputError, NumberField, OptionalNumberField, Scalar, Vector, output, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.vectors import norm
from .coefficient import BURNOUT, MachTable, as_coefficient, as_optional_coefficient, coefficient_at
from .local_air import LocalAir, air_about, flow_pressure


@formula(density=NOT_NEGATIVE, drag_area=NOT_NEGATIVE)
def drag_force(relative_velocity: Vector, density: Scalar, drag_area: Scalar) -> Vector:
    """Drag, N, (3, *runs), against the velocity relative to the air.

    **Arguments**

    - `relative_velocity`: m/s, (3, *runs); `density`: kg/m^3.
    - `drag_area`: C_D A, m^2.

    **Returns** the force; zero, with a zero derivative, at rest."""
    return (-0.5 * density * drag_area * norm(relative_velocity)) * relative_velocity


@final
class AirDrag(AbstractEffect):
    """Drag by the Mach number in moving air, along the flow: that of a vehicle which points into
    it."""

    area: NumberField = quantity("m^2", positive=True, doc="A, the reference area")
    # The checker takes the quantity above for a default.
    coefficient: MachTable = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        converter=as_coefficient, metadata={"doc": "C_D by the Mach number"}
    )
    air: LocalAir | None = eqx.field(
        default=None,
        metadata={"doc": "about the vehicle; calm standard air by default", "shared": "air"},
    )
    coasting: MachTable | None = eqx.field(
        default=None,
        converter=as_optional_coefficient,
        metadata={"doc": "C_D after the burnout, if different"},
    )
    burnout: OptionalNumberField = quantity("s", optional=True, doc=BURNOUT)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return None if self.burnout is None else self.burnout[None]

    def ground(self) -> Scalar | None:
        return None if self.air is None else self.air.radius

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        air, moving = air_about(self.air).at(y.position)
        w = y.velocity - moving
        mach = norm(w) / air.sound_speed
        drag_area = self.area * coefficient_at(
            t, mach, self.coefficient, self.coasting, self.burnout
        )
        return Load(force_N=drag_force(w, air.density, drag_area))

    @output("Pa")
    def dynamic_pressure(self, y: BodyState) -> Scalar:
        """Dynamic pressure rho |w|^2 / 2, Pa."""
        return flow_pressure(self.air, y)


@final
class Parachute(AbstractEffect):
    """A parachute that fills within an inflation time from its opening on, and drags from then."""

    drag_area: NumberField = quantity("m^2", non_negative=True, doc="C_D A, filled")
    opening: OptionalNumberField = quantity(
        "s", optional=True, doc="time at which it starts to fill; open from the start by default"
    )
    inflation_time: OptionalNumberField = quantity(
        "s",
        non_negative=True,
        optional=True,
        doc="time over which its drag area grows linearly; instantaneous by default",
    )
    air: LocalAir | None = eqx.field(
        default=None,
        metadata={"doc": "about the vehicle; calm standard air by default", "shared": "air"},
    )

    def __check_init__(self):
        if self.opening is None and self.inflation_time is not None:
            raise InputError(
                "Parachute.inflation_time is given without an opening: omit it, or give the time "
                "at which the parachute starts to fill."
            )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        air, moving = air_about(self.air).at(y.position)
        return Load(
            force_N=drag_force(y.velocity - moving, air.density, self._filled(t) * self.drag_area)
        )

    def _filled(self, t: Scalar) -> Scalar | float:
        """The filled part of the drag area."""
        if self.opening is None:
            return 1.0
        since = t - self.opening
        # Open at the opening itself, where the segment begins that follows its break.
        step = jnp.where(since >= 0.0, 1.0, 0.0)
        if self.inflation_time is None:
            return step
        instant = self.inflation_time == 0.0
        # A canopy that opens at once would divide by zero, also in the branch that is not taken.
        time = jnp.where(instant, 1.0, self.inflation_time)
        return jnp.where(instant, step, jnp.clip(since / time, 0.0, 1.0))

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        # An open one has none: each end of a segment is looked up wherever a time is read.
        if self.opening is None:
            return None
        if self.inflation_time is None:
            return self.opening[None]
        return jnp.stack([self.opening, self.opening + self.inflation_time])


@formula(mass=POSITIVE, drag_area=POSITIVE, density=POSITIVE, gravity=NOT_NEGATIVE)
def descent_rate(mass: Scalar, drag_area: Scalar, density: Scalar, gravity: Scalar) -> Scalar:
    """Steady speed of the descent under a parachute, m/s (Knacke 5.2): sqrt(2 m g/(rho C_D A)).

    **Arguments**

    - `mass`: kg; `drag_area`: m^2; `density`: kg/m^3; `gravity`: m/s^2."""
    return jnp.sqrt(2.0 * mass * gravity / (density * drag_area))

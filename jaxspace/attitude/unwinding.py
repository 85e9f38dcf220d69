"""The unwinding of a yo-yo: masses on cords that leave a spinning drum, inextensible or stretched.

    s = w + phi',   C = I/(m R^2) + 1
    w' = -phi s^2/C,   s' = s (w - phi')/phi                              inextensible
    phi^2 = phi_0^2 + 2 phi_0 phi_0' t + W^2 t^2,   W^2 = w^2 + phi^2 s^2/C = const
    F = I phi s^2/(C R)                                                   tension of all cords
    w' = -R k x/I,  s' = s (R s - 2 L')/L,  x'' = R w' + L s^2 - k x/m    stretched: F = k x
    L = R phi + x

    symbol      meaning                                                   unit
    I, R, m     axial inertia of the body, radius of the drum, mass of    kg m^2, m, kg
                all that unwinds
    w           spin of the body                                          rad/s
    phi, s      angle unwound; rate at which a free cord turns            rad, rad/s
    x, k        stretch of a cord; stiffness of all together              m, N/m
    L           length of a free cord                                     m

Source: Thomson 7.5-2 to 7.5-9 (with phi where a phi' is squared or multiplies R), 7.5-P1; the
energy and the momentum give the quadratic for phi^2. Whatever the cords do at first, phi' = w_0
from phi = 0 on: there the equations of phi' are singular, and the closed form is not.
Valid for light cords in the plane of the mass centre that pull; the wound part of a cord does not
stretch. A run of stretched cords that become slack has the status `OUTSIDE_MODEL`.
"""

__all__ = ["CordState", "StretchingCords", "UnwindingCords"]

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, final

import equinox as eqx
from jaxtyping import Array, Float

from ..core import (
    AbstractClosedForm,
    AbstractSystem,
    NumberField,
    Scalar,
    argument,
    constructor,
    quantity,
)
from ..core.limits import Limit
from ..core.printing import printed
from ..core.safe import safe_divide, safe_sqrt
from ..core.types import as_float

if TYPE_CHECKING:
    # Declared as always present for static type checkers: it is absent only where no system reads
    # it.
    Stretch: TypeAlias = Any
else:
    Stretch: TypeAlias = Float[Array, "*#runs"] | None


@final
@printed()
class CordState(eqx.Module):
    """Spin of the body, and how far its cords are unwound and stretched; also the rates of these.

    The stretch is absent where the cords are inextensible."""

    spin: NumberField = quantity("rad/s", doc="w, of the body")
    angle: NumberField = quantity("rad", doc="phi, unwound")
    angle_rate: NumberField = quantity("rad/s", doc="phi'")
    stretch: Stretch = quantity("m", optional=True, doc="x, of a cord")
    stretch_rate: Stretch = quantity("m/s", optional=True, doc="x'")


@final
class UnwindingCords(AbstractSystem):
    """A body that spins about its axis while masses on inextensible cords unwind. State:
    `CordState`, preferably created with `state`; the motion is known in closed form."""

    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I, of the body without the masses"
    )
    radius: NumberField = quantity("m", positive=True, doc="R, of the drum")
    mass: NumberField = quantity("kg", positive=True, doc="m, of all masses together")

    @property
    def inertia_ratio(self) -> Scalar:
        """C, 1."""
        return self.axial_inertia / (self.mass * self.radius * self.radius) + 1.0

    @staticmethod
    @constructor(spin=argument("rad/s", doc="w_0, before the masses are released"))
    def state(spin: Scalar) -> CordState:
        """The state at the release of the masses, at the `spin` w_0, rad/s."""
        spin = as_float(spin)
        # phi' = w_0 from the first moment: the one motion that is regular at phi = 0.
        return CordState(spin, 0.0 * spin, spin)

    def vector_field(self, t: Scalar, y: CordState) -> CordState:
        del t
        s = y.spin + y.angle_rate
        spin_rate = -y.angle * s * s / self.inertia_ratio
        # At phi = 0 on the regular motion s' is zero, because w = phi' there.
        turning = s * safe_divide(y.spin - y.angle_rate, y.angle)
        return CordState(spin_rate, y.angle_rate, turning - spin_rate)

    def invariants(self, t: Scalar, y: CordState) -> dict[str, Array]:
        del t
        unit = self.mass * self.radius * self.radius
        C = self.inertia_ratio
        s = y.spin + y.angle_rate
        square = y.angle * y.angle
        return {
            "energy": 0.5 * unit * (C * y.spin**2 + square * s * s),
            "angular_momentum": unit * (C * y.spin + square * s),
        }

    def closed_form(self) -> AbstractClosedForm:
        return _Unwinding(self)

    def tension(self, y: CordState) -> Scalar:
        """F, N, of all cords together in the state `y`."""
        s = y.spin + y.angle_rate
        return self.axial_inertia * y.angle * s * s / (self.inertia_ratio * self.radius)


@final
class _Unwinding(AbstractClosedForm):
    cords: UnwindingCords

    def flow(self, duration: Scalar, y: CordState) -> CordState:
        C = self.cords.inertia_ratio
        s = y.spin + y.angle_rate
        rate2 = y.spin * y.spin + (y.angle * s) ** 2 / C
        square = (y.angle + 2.0 * y.angle_rate * duration) * y.angle + rate2 * duration**2
        angle = safe_sqrt(square)
        # As changes, which are exactly zero over no time; where nothing is unwound yet the rate is
        # that of the start.
        grown = y.angle_rate * (y.angle - angle) + rate2 * duration
        rate = y.angle_rate + safe_divide(grown, angle)
        lost = square * (y.spin + rate) - y.angle * y.angle * s
        spin = y.spin - lost / (C + square)
        return CordState(spin, angle, rate)


@final
class StretchingCords(AbstractSystem):
    """A body that spins about its axis while masses unwind on elastic cords. State: `CordState`
    with a stretch, preferably created with `state`; `UnwindingCords` has inextensible ones."""

    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I, of the body without the masses"
    )
    radius: NumberField = quantity("m", positive=True, doc="R, of the drum")
    mass: NumberField = quantity("kg", positive=True, doc="m, of all masses together")
    stiffness: NumberField = quantity(
        "N/m", positive=True, doc="k, of the springs of all cords together"
    )

    def state(self, spin: Scalar, angle: Scalar) -> CordState:
        """The state in which an inextensible cord would be, stretched by its tension.

        **Arguments**

        - `spin`: w_0, rad/s, before the masses were released, (*runs,).
        - `angle`: phi, rad, (*runs,), above zero: at zero the equations are singular."""
        rigid = UnwindingCords(self.axial_inertia, self.radius, self.mass)
        spin, angle = as_float(spin), as_float(angle)
        y = _Unwinding(rigid).flow(angle / spin, rigid.state(spin))
        stretch = rigid.tension(y) / self.stiffness
        # The tension grows at this rate: F = 4 I C w0^2 phi/(R (C + phi^2)^2).
        C = rigid.inertia_ratio
        square = angle * angle
        rate = stretch * spin / angle * (C - 3.0 * square) / (C + square)
        return CordState(y.spin, y.angle, y.angle_rate, stretch, rate)

    def vector_field(self, t: Scalar, y: CordState) -> CordState:
        del t
        length, rate = self._length(y)
        s = y.spin + y.angle_rate
        spin_rate = -self.radius * self.tension(y) / self.axial_inertia
        turning = s * (self.radius * s - 2.0 * rate) / length
        pull = self.tension(y) / self.mass
        stretching = self.radius * spin_rate + length * s * s - pull
        return CordState(spin_rate, y.angle_rate, turning - spin_rate, y.stretch_rate, stretching)

    def invariants(self, t: Scalar, y: CordState) -> dict[str, Array]:
        del t
        length, _ = self._length(y)
        s = y.spin + y.angle_rate
        along = self.radius * y.spin - y.stretch_rate
        moving = self.mass * (along * along + (length * s) ** 2)
        momentum = self.mass * (self.radius * along + length * length * s)
        stored = self.stiffness * y.stretch**2
        return {
            "energy": 0.5 * (self.axial_inertia * y.spin**2 + moving + stored),
            "angular_momentum": self.axial_inertia * y.spin + momentum,
        }

    def limits(self, t: Scalar, y: CordState) -> Sequence[Limit]:
        del t
        # Relative to the free length, because the stretch may be zero at the start.
        margin = 1e-6 * self.radius * abs(y.angle)
        return (Limit("the stretch of the cords", "m", y.stretch, 0.0, margin=margin),)

    def tension(self, y: CordState) -> Scalar:
        """F, N, of all cords together in the state `y`; negative where they would be slack."""
        return self.stiffness * y.stretch

    def _length(self, y: CordState) -> tuple[Scalar, Scalar]:
        """L, m, and its rate, m/s."""
        rate = self.radius * y.angle_rate + y.stretch_rate
        return self.radius * y.angle + y.stretch, rate

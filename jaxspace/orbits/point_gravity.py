"""Gravity of a point mass, or of any body whose mass is distributed in spherical shells.

    a = -mu r / |r|^3 = -grad U
    U = -mu / |r|

    symbol  meaning                                         unit
    r       position from the centre                        m
    mu      gravitational parameter G m of the centre       m^3/s^2
    U       potential energy per unit mass                  m^2/s^2

Source: Thomson 4.2-2, 4.7.
Valid outside the attracting body; singular at its centre.
"""

__all__ = ["point_gravity", "point_gravity_potential"]

from typing import ClassVar, final

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import AbstractSystem, NumberField, Scalar, Vector
from ..core.formula import AWAY, formula
from ..core.vectors import inverse_norm, over_norm, scale
from ._kepler_motion import KeplerMotion
from ._kustaanheimo_stiefel import KustaanheimoStiefel
from ._lengths import check_place
from ._planet import gravitational_parameter


@formula(r=AWAY)
def point_gravity(r: Vector, mu: Scalar) -> Vector:
    """Acceleration a, m/s^2, (3, *runs) (Thomson 4.7).

    **Arguments**

    - `r`: position from the centre, m, (3, *runs).
    - `mu`: gravitational parameter, m^3/s^2, (*runs,).
    """
    # `scale` has a derivative that does not compute the scalar again for every component.
    return scale(over_norm(-mu, r, 3), r)


@formula(r=AWAY)
def point_gravity_potential(r: Vector, mu: Scalar) -> Scalar:
    """Potential energy per unit mass U, m^2/s^2, zero at infinity.

    **Arguments**

    - `r`, `mu`: as in `point_gravity`."""
    return -mu * inverse_norm(r)


@final
class PointGravity(AbstractEffect):
    """Attraction by a point mass at the origin."""

    keeps: ClassVar[frozenset[str]] = frozenset(
        {"energy", "angular_momentum", "axial_angular_momentum"}
    )
    uniform: ClassVar[bool] = True

    mu: NumberField = gravitational_parameter()

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        return Load(acceleration_N=point_gravity(y.position, self.mu))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        assert y.position is not None
        return point_gravity_potential(y.position, self.mu)

    def scaled(self, factor: Scalar) -> "PointGravity":
        return PointGravity(factor * self.mu)

    def check_values(self, t: Scalar, y: BodyState, body: AbstractBody) -> None:
        """Warn of a place deep within a planet with this `mu`, most likely in kilometres."""
        del t, body
        check_place(y, self.mu)

    def closed_form(self) -> KeplerMotion:
        return KeplerMotion(self.mu)

    def regularised(self, rest: AbstractSystem | None) -> KustaanheimoStiefel:
        return KustaanheimoStiefel(self.mu, rest)

"""Torques on any body: constant ones, fixed in the body or in space, resistance and springs, and a
magnetic dipole in a field.

    M = M_B                                        fixed in the body
    M = C_BN M_N                                   fixed in space
    M_i = -c_i omega_i                             viscous resistance along the body's axes
    M = -k . v,   e^v = the turn from the attitude of rest            spring; v the rotation vector
    M = m x C_BN B(t, r)                           dipole

    symbol     meaning                                                     unit
    M          torque about the centre of mass, body axes                  N m
    C_BN       matrix from inertial to body components                     1
    c, k       resistance and stiffness along the body's axes              N m s, N m
    m, B       dipole moment in body axes; field in inertial axes          A m^2, T
    r          position                                                    m

Source: Thomson 5.6 (body-fixed moments), 5.14 (springs), 6.6 (resistance). The spring is linear in
the rotation vector, whose angle stays below half a turn: it jumps there.
"""

__all__ = ["AbstractMagneticField"]

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar, final

import equinox as eqx
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import AbstractParameters, Scalar, Vector, quantity
from ..core.shapes import with_rank
from ..core.vectors import cross, dot, inverse_norm
from ..rotations import Quaternion

# Invariants of the orbit. Energy is not among them: a scene counts none for a rotation without a
# mass.
KEEPS = frozenset({"angular_momentum", "axial_angular_momentum"})


@final
class BodyTorque(AbstractEffect):
    """A constant torque whose axis is fixed in the body."""

    keeps: ClassVar[frozenset[str]] = KEEPS

    torque: Float[Array, "3 *#runs"] = quantity("N m", doc="M_B, in body axes")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        return Load(torque_B=with_rank(self.torque, y.omega.ndim - 1))


@final
class SpaceTorque(AbstractEffect):
    """A constant torque whose axis is fixed in space."""

    keeps: ClassVar[frozenset[str]] = KEEPS

    torque: Float[Array, "3 *#runs"] = quantity("N m", doc="M_N, in inertial axes")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        torque = with_rank(self.torque, y.attitude.wxyz.ndim - 1)
        return Load(torque_B=y.attitude.rotate_back(torque))


@final
class ViscousTorque(AbstractEffect):
    """A resistance that is proportional to the angular velocity."""

    keeps: ClassVar[frozenset[str]] = KEEPS

    damping: Float[Array, "3 *#runs"] = quantity(
        "N m s", doc="c along the three body axes; negative values drive the motion"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        return Load(torque_B=-with_rank(self.damping, y.omega.ndim - 1) * y.omega)


@final
class SpringTorque(AbstractEffect):
    """A spring that rotates the body back to an equilibrium attitude."""

    keeps: ClassVar[frozenset[str]] = KEEPS

    stiffness: Float[Array, "3 *#runs"] = quantity("N m", doc="k along the three body axes")
    rest: Float[Array, "4 *#runs"] = quantity(
        "",
        direction=True,
        default=(1.0, 0.0, 0.0, 0.0),
        doc="quaternion of the equilibrium attitude, body to inertial",
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        rank = y.attitude.wxyz.ndim - 1
        rest = Quaternion(with_rank(self.rest, rank))
        # By the rotation vector: proportional to the angle itself, also far from rest.
        turn = rest.inverse().then(y.attitude).rotation_vector()
        return Load(torque_B=-with_rank(self.stiffness, rank) * turn)


class AbstractMagneticField(AbstractParameters):
    """A magnetic field. A concrete one is final; scene files offer it for a dipole."""

    @abstractmethod
    def __call__(self, t: Scalar, y: BodyState) -> Vector:
        """B in inertial axes, T, (3, *runs), at the time `t`, s, in the state `y`."""


@final
class MagneticDipole(AbstractEffect):
    """A magnetic dipole in a field.

    `field`, of the time, s, and the state, returns B in inertial axes, T, (3, *runs): a
    `DipoleField`, or a function; best an `equinox.Module` with a `__call__`."""

    keeps: ClassVar[frozenset[str]] = KEEPS

    field: AbstractMagneticField | Callable[[Scalar, BodyState], Vector] = eqx.field(
        metadata={"doc": "B, in inertial axes"}
    )
    moment: Float[Array, "3 *#runs"] = quantity("A m^2", doc="m, in body axes")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        B = y.attitude.rotate_back(self.field(t, y))
        return Load(torque_B=cross(with_rank(self.moment, B.ndim - 1), B))


@final
class DipoleField(AbstractMagneticField):
    """The field of a planet's dipole at the origin, B = (3 (k . r^) r^ - k)/r^3; for the Earth, k
    is -7.8e15 T m^3 along its axis."""

    strength: Float[Array, "3 *#runs"] = quantity(
        "T m^3", doc="k, mu_0/4 pi times the planet's moment, in inertial axes"
    )

    def __call__(self, t: Scalar, y: BodyState) -> Vector:
        del t
        per_r = inverse_norm(y.position)
        up = per_r * y.position
        k = with_rank(self.strength, up.ndim - 1)
        return per_r * per_r * per_r * (3.0 * dot(k, up) * up - k)

"""The torque of a central field on an extended body, because its nearer parts are drawn more
strongly, and the libration that it makes about the local vertical.

    M = 3 mu / |r|^3 r^ x J r^                                                     r^ = r / |r| in body axes
    W = 3 mu / (2 |r|^3) r^ . J r^                                                 what the turn of the body adds to its energy

On a circular orbit, axis 1 along the velocity, 2 along the orbit's normal, 3 outwards, the turn
theta about the normal obeys

    I_2 theta'' + 3/2 n^2 (I_1 - I_3) sin 2 theta = 0                              theta' and theta relative to the vertical
    theta small: theta'' = -p^2 theta,  p^2 = 3 n^2 (I_1 - I_3) / I_2;      period = 4 K(sin theta_max) / p

    symbol     meaning                                                             unit
    r          position of the body's centre of mass from the attracting centre    m
    mu         strength of the attracting body                                     m^3/s^2
    J          inertia about the centre of mass, in body axes                      kg m^2
    I_1 ...    its principal moments                                               kg m^2
    n          mean motion of the circular orbit                                   rad/s
    p          rate of small librations in pitch                                   rad/s
    K          complete elliptic integral of the first kind                        1

Source: Thomson 7.4, Problems 14 and 15; Hughes, Spacecraft Attitude Dynamics, 8.1 and 9.2. To first
order in the size of the body over |r|; what the rotation does to the orbit, of second order, is
left out.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, AbstractInertia, BodyState, Load
from ..core import (
    Scalar,
    Vector,
    as_float,
    barrier,
    check_positive,
    complete_elliptic,
    cross,
    dot,
    inverse_norm,
)
from ..rotations import Quaternion


def gravity_gradient_torque(
    r: Vector, attitude: Quaternion, inertia: AbstractInertia, mu: Scalar
) -> Vector:
    """M, N m, in body axes, at the position `r`, m, in inertial axes (Thomson 7.4, Problem 14)."""
    per_r, up = _upwards(r, attitude)
    return (3.0 * mu * per_r * (per_r * per_r)) * cross(up, inertia.times(up))


def gravity_gradient_energy(
    r: Vector, attitude: Quaternion, inertia: AbstractInertia, mu: Scalar
) -> Scalar:
    """W, J, of which the torque is the negative slope along a turn of the body, at the position
    `r`, m, in inertial axes."""
    per_r, up = _upwards(r, attitude)
    return (1.5 * mu * per_r * (per_r * per_r)) * dot(up, inertia.times(up))


def _upwards(r: Vector, attitude: Quaternion) -> tuple[Scalar, Vector]:
    """1 / |r|, and r^ in body axes."""
    per_r = inverse_norm(r)
    return per_r, barrier(attitude.rotate_back(per_r * r))


def pitch_libration_period(amplitude: Scalar, moments: Vector, mean_motion: Scalar) -> Scalar:
    """Period, s, of the libration in the plane of a circular orbit through `amplitude`, rad, on
    both sides of the vertical.

    `moments`: (I_1, I_2, I_3), kg m^2, along the velocity, along the normal and outwards, with I_1
    > I_3; `mean_motion`, rad/s (Thomson 7.4, Problem 15). It grows without limit towards an
    amplitude of a right angle and towards I_1 = I_3, where it is infinite, with derivatives of
    zero; NaN for I_1 < I_3."""
    along, across, outwards = moments
    stiffness = 3.0 * (along - outwards) / across
    endless = stiffness == 0.0
    rate = mean_motion * jnp.sqrt(jnp.where(endless, 1.0, stiffness))
    period = 4.0 * complete_elliptic(jnp.cos(amplitude) ** 2) / rate
    return jnp.where(endless, jnp.inf, period)


@final
class GravityGradient(AbstractEffect):
    """The torque by the gradient of the attraction of a point mass at the origin: `mu`, m^3/s^2.

    Add `PointGravity` of the same strength for the orbit. Raises `InputError` unless `mu` is
    positive."""

    needs: ClassVar[frozenset[str]] = frozenset({"position", "attitude"})
    adds: ClassVar[frozenset[str]] = frozenset({"torque"})
    keeps: ClassVar[frozenset[str]] = frozenset({"angular_momentum", "axial_angular_momentum"})

    mu: Float[Array, "*#runs"] = eqx.field(converter=as_float)

    def __check_init__(self):
        check_positive("GravityGradient.mu", self.mu)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t
        assert y.position is not None and y.attitude is not None
        return Load(
            torque_B=gravity_gradient_torque(y.position, y.attitude, body.inertia(y.mass), self.mu)
        )

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> None:
        # It depends on where the body is, and the orbit does not feel it: a moving body keeps no
        # energy that has it as a part.
        del t, y, body
        return None

"""The torque of a central field of gravity on an extended body, and the libration that it causes.

The nearer parts of the body are attracted more strongly than the farther ones.

    M = 3 mu / |r|^3 r^ x J r^              r^ = r / |r| in body axes
    W = 3 mu / (2 |r|^3) r^ . J r^          energy that depends on the orientation

On a circular orbit, with axis 1 along the velocity, 2 along the orbit's normal and 3 outwards, the
angle theta about the normal, from the vertical, obeys

    I_2 theta'' + 3/2 n^2 (I_1 - I_3) sin 2 theta = 0
    theta small: theta'' = -p^2 theta,  p^2 = 3 n^2 (I_1 - I_3) / I_2
    period = 4 K(sin theta_max) / p

    symbol     meaning                                                             unit
    r          position of the body's centre of mass from the attracting centre    m
    mu         gravitational parameter of the attracting body                      m^3/s^2
    J          inertia about the centre of mass, in body axes                      kg m^2
    I_1 ...    its principal moments                                               kg m^2
    n          mean motion of the circular orbit                                   rad/s
    p          rate of small librations in pitch                                   rad/s
    K          complete elliptic integral of the first kind                        1

Source: Thomson 7.4, Problems 14 and 15; Hughes, Spacecraft Attitude Dynamics, 8.1 and 9.2.

Valid to first order in the size of the body over |r|. The effect of the rotation on the orbit, of
second order, is left out.
"""

__all__ = ["gravity_gradient_energy", "gravity_gradient_torque", "pitch_libration_period"]

from typing import ClassVar, final

import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..bodies.inertia import AbstractInertia
from ..core import NumberField, Scalar, Vector, quantity
from ..core.barrier import barrier
from ..core.elliptic import complete_elliptic
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.shapes import check_components
from ..core.vectors import cross, dot, inverse_norm
from ..rotations import Quaternion


@formula(mu=NOT_NEGATIVE)
def gravity_gradient_torque(
    r: Vector, attitude: Quaternion, inertia: AbstractInertia, mu: Scalar
) -> Vector:
    """The torque on a body (Thomson 7.4, Problem 14).

    **Arguments**

    - `r`: position from the attracting centre, m, in inertial axes, (3, *runs).
    - `attitude`: of the body.
    - `inertia`: about the centre of mass, kg m^2.
    - `mu`: gravitational parameter of the centre, m^3/s^2, (*runs,).

    **Returns** M, N m, in body axes, (3, *runs).
    """
    per_r, up = _upwards(r, attitude)
    return (3.0 * mu * per_r * (per_r * per_r)) * cross(up, inertia.times(up))


@formula(mu=NOT_NEGATIVE)
def gravity_gradient_energy(
    r: Vector, attitude: Quaternion, inertia: AbstractInertia, mu: Scalar
) -> Scalar:
    """The energy W, J, (*runs,), whose negative derivative by a turn of the body is the torque.

    **Arguments**

    - `r`, `attitude`, `inertia`, `mu`: as in `gravity_gradient_torque`."""
    per_r, up = _upwards(r, attitude)
    return (1.5 * mu * per_r * (per_r * per_r)) * dot(up, inertia.times(up))


def _upwards(r: Vector, attitude: Quaternion) -> tuple[Scalar, Vector]:
    """1 / |r|, and r^ in body axes."""
    per_r = inverse_norm(r)
    # Behind a barrier, because three components of the torque read each component of r^.
    return per_r, barrier(attitude.rotate_back(per_r * r))


@formula(moments=POSITIVE, mean_motion=POSITIVE)
def pitch_libration_period(amplitude: Scalar, moments: Vector, mean_motion: Scalar) -> Scalar:
    """Period of the libration in the plane of a circular orbit (Thomson 7.4, Problem 15).

    **Arguments**

    - `amplitude`: greatest angle from the vertical, rad, (*runs,).
    - `moments`: I_1 along the velocity, I_2 along the normal and I_3 outwards, kg m^2, (3, *runs),
      with I_1 > I_3.
    - `mean_motion`: of the orbit, rad/s, (*runs,).

    **Returns** the period, s, (*runs,). It grows without limit towards a right angle and towards
    I_1 = I_3, where it is infinite, with derivatives of zero; NaN for I_1 < I_3.
    """
    check_components("pitch_libration_period: moments", moments, 3)
    along, across, outwards = moments
    stiffness = 3.0 * (along - outwards) / across
    endless = stiffness == 0.0
    rate = mean_motion * jnp.sqrt(jnp.where(endless, 1.0, stiffness))
    # K by the complementary modulus, which near a right angle is computed without a difference.
    period = 4.0 * complete_elliptic(jnp.cos(amplitude) ** 2) / rate
    # The infinite values are set last, so that their derivatives are zero and not infinity times
    # zero.
    return jnp.where(endless, jnp.inf, period)


@final
class GravityGradient(AbstractEffect):
    """The torque by the gradient of the attraction of a point mass at the origin.

    Add `PointGravity` with the same `mu` for the orbit."""

    keeps: ClassVar[frozenset[str]] = frozenset({"angular_momentum", "axial_angular_momentum"})

    mu: NumberField = quantity(
        "m^3/s^2",
        positive=True,
        shared="planet.mu",
        doc="gravitational parameter of the attracting body",
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t
        assert y.position is not None and y.attitude is not None
        return Load(
            torque_B=gravity_gradient_torque(y.position, y.attitude, body.inertia(y.mass), self.mu)
        )

"""A rigid body that turns about its centre of mass without torque.

    J omega' = (J omega) x omega            Euler's equations, body axes
    q' = q (0, omega) / 2
    h = C_NB J omega,  T = omega . J omega / 2       constant

For a symmetric body, J = diag(A, A, C), the spin n is constant, and the motion is the product of
two steady turns:

    omega_12(t) = omega_12(0) e^(i lambda t)          lambda = n (C - A) / A
    q(t) = q(0) exp(h_B(0) t / A) exp(-lambda t z)    psi' = h / A
                                                      phi' = n - psi' cos(theta) = -lambda
    tan(theta) = A omega_12 / (C n)                   tan(gamma) = omega_12 / n

Any other body moves in elliptic functions: `bodies.principal_frame.free_turn` has the closed form.

    symbol           meaning                                                    unit
    J                inertia about the centre of mass                           kg m^2
    A, C             transverse and axial moment of a symmetric body            kg m^2
    omega            angular velocity in body axes                              rad/s
    omega_12         its transverse part, omega_1 + i omega_2                   rad/s
    n                its axial part, the spin                                   rad/s
    h, h_B           angular momentum; in body axes                             kg m^2/s
    lambda           rate at which omega_12 circles in the body                 rad/s
    theta, psi, phi  Euler's angles 3-1-3 about h: nutation, precession, spin   rad
    gamma            angle between the axis of symmetry and omega               rad

Source: Thomson 5.6 (Euler), 5.8 (body axes), 5.9 (inertial axes, with the first term of 5.9-3 as
psi' phi').
Valid for a rigid body. A body that flexes, or in which a liquid sloshes, dissipates energy until it
turns about its axis of greatest inertia.
"""

__all__ = [
    "body_precession_rate",
    "cone_angles",
    "coning_omega",
    "precession_rate",
    "space_cone_angle",
    "symmetric_flow",
]

from typing import final

import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import BodyState, FreeRotation
from ..bodies.inertia import AbstractInertia, as_inertia, kinetic_energy
from ..bodies.newton_euler import angular_acceleration
from ..core import AbstractSystem, Scalar, Vector, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.safe import safe_atan2
from ..core.shapes import check_components
from ..core.squares import safe_hypot, unit_factor
from ..core.vectors import axis, components, norm
from ..rotations import Quaternion
from ._state import attitude_and_omega


@final
class TorqueFreeBody(AbstractSystem):
    """A free rigid body.

    State: `BodyState` with attitude and omega only. For a batch of bodies the last axis of the
    inertia is the batch axis."""

    inertia: AbstractInertia = quantity(
        "kg m^2",
        converter=as_inertia,
        doc="about the centre of mass: three principal moments, a tensor, or an inertia",
    )

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        return BodyState(
            attitude=attitude.rate(omega), omega=angular_acceleration(self.inertia, omega, None)
        )

    def closed_form(self) -> FreeRotation:
        return FreeRotation(self.inertia)

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        del t
        attitude, omega = attitude_and_omega(y)
        return {
            "energy": kinetic_energy(self.inertia, omega),
            "angular_momentum": attitude.rotate(self.inertia.times(omega)),
            "quaternion_norm": jnp.sqrt(attitude.norm_squared),
        }


@formula(A=POSITIVE, C=NOT_NEGATIVE)
def body_precession_rate(n: Scalar, A: Scalar, C: Scalar) -> Scalar:
    """Rate lambda at which the transverse rate of a symmetric body circles in the body (Thomson
    5.8-3); phi' = -lambda.

    **Arguments**

    - `n`: spin, rad/s.
    - `A`, `C`: transverse and axial moment of inertia, kg m^2.

    **Returns** lambda, rad/s, (*runs,).
    """
    return n * (C - A) / A


@formula(A=POSITIVE, C=NOT_NEGATIVE)
def precession_rate(omega: Vector, A: Scalar, C: Scalar) -> Scalar:
    """Rate psi' = h / A at which the axis of a symmetric body circles about h (Thomson 5.9).

    **Arguments**

    - `omega`: angular velocity in body axes, rad/s, (3, *runs).
    - `A`, `C`: transverse and axial moment of inertia, kg m^2.

    **Returns** psi', rad/s, (*runs,).
    """
    check_components("precession_rate: omega", omega, 3)
    return norm(jnp.stack([A * omega[0], A * omega[1], C * omega[2]])) / A


@formula(A=POSITIVE, C=NOT_NEGATIVE)
def cone_angles(omega: Vector, A: Scalar, C: Scalar) -> tuple[Scalar, Scalar]:
    """Angles of the axis of symmetry with h and with omega (Thomson 5.8-15, -16).

    **Arguments** as in `precession_rate`.

    **Returns** theta and gamma, rad, (*runs,); both zero at omega = 0. Gamma is the half-angle of
    the body cone, `space_cone_angle` that of the space cone.
    """
    check_components("cone_angles: omega", omega, 3)
    # Safe, because a body that spins about its axis of symmetry has no transverse rate.
    transverse = safe_hypot(omega[0], omega[1])
    return safe_atan2(A * transverse, C * omega[2]), safe_atan2(transverse, omega[2])


@formula(A=POSITIVE, C=NOT_NEGATIVE)
def space_cone_angle(omega: Vector, A: Scalar, C: Scalar) -> Scalar:
    """Angle of omega with h, the half-angle of the space cone on which the body cone rolls (Thomson
    5.8, 5.9).

    **Arguments** as in `precession_rate`.

    **Returns** the angle, rad, (*runs,), with a sign: negative for a slender body, A > C, whose
    precession is direct (the cones roll on their outsides), and positive for a flat one, C > A,
    whose precession is retrograde (the space cone is inside the body cone). Zero at omega = 0.
    """
    check_components("space_cone_angle: omega", omega, 3)
    # The angle is the same at any rate.
    omega = unit_factor(*components(omega)) * omega
    transverse = safe_hypot(omega[0], omega[1])
    # Of gamma - theta, without the difference, which loses digits for nearly equal moments.
    across = transverse * jnp.abs(omega[2]) * (C - A)
    return safe_atan2(across, A * transverse * transverse + C * omega[2] * omega[2])


@formula(A=POSITIVE, C=NOT_NEGATIVE)
def coning_omega(theta: Scalar, precession: Scalar, A: Scalar, C: Scalar) -> Vector:
    """The angular velocity with which a symmetric body cones (Thomson 5.9-1, -4).

    **Arguments**

    - `theta`: angle between the axis of symmetry and h, rad.
    - `precession`: psi', rad/s.
    - `A`, `C`: transverse and axial moment of inertia, kg m^2.

    **Returns** omega, rad/s, in body axes, (3, *runs), with h in the plane of the body's y and z.
    """
    # From C n = h cos(theta), with h = A psi'.
    axial = A / C * precession * jnp.cos(theta)
    return precession * jnp.sin(theta) * axis(1, axial) + axial * axis(2, axial)


@formula(A=POSITIVE, C=NOT_NEGATIVE)
def symmetric_flow(duration: Scalar, y: BodyState, A: Scalar, C: Scalar) -> BodyState:
    """The exact state of a free symmetric body a given duration later (Thomson 5.8-5, 5.9).

    **Arguments**

    - `duration`: s, (*runs,), of either sign.
    - `y`: the state, with attitude and omega; any rate, zero included.
    - `A`, `C`: transverse and axial moment of inertia, kg m^2, of any quotient, one included.

    **Returns** the state of attitude and omega.
    """
    attitude, omega = attitude_and_omega(y)
    z = axis(2, omega[2])
    # h_B / A = omega + (C - A)/A n z: exactly omega for a sphere.
    momentum_per_A = omega + (C - A) / A * omega[2] * z
    roll = body_precession_rate(omega[2], A, C) * duration
    # The turn about h, then the turn back about the body's own axis: no nutation angle, which would
    # be singular for a pure spin.
    turn = Quaternion.from_rotation_vector(momentum_per_A * duration).then(
        Quaternion.about(2, -roll)
    )
    return BodyState(attitude=attitude.then(turn), omega=Quaternion.about(2, roll).rotate(omega))

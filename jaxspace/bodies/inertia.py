"""Moments of inertia about the centre of mass, in body axes.

    h = J omega         J = diag(A, B, C) in principal axes, else the symmetric tensor
    J_P = J + m (d^2 1 - d d^T)         parallel axes: d leads from the centre of mass to P

    symbol   meaning                                     unit
    A, B, C  principal moments of inertia                kg m^2
    J        inertia tensor; off-diagonal elements are   kg m^2
             minus the product of inertia, -int xy dm
    h        angular momentum                            kg m^2/s

A slender rod has no moment about its axis: one principal moment may be zero. A torque about this
axis has nothing to accelerate, and the rate about it is constant.

Source: Thomson 5.3 (tensor), 5.5 (parallel axes), 7.1, 7.10 (slender body).
"""

__all__ = ["AbstractInertia", "as_inertia", "kinetic_energy", "parallel_axes"]

from abc import abstractmethod
from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..core import AbstractParameters, InputError, Matrix, Scalar, Vector, check, quantity
from ..core.checks import is_concrete
from ..core.field_types import is_real, shown
from ..core.formula import NOT_NEGATIVE, formula
from ..core.safe import safe_divide
from ..core.shapes import with_rank
from ..core.types import as_float
from ..core.vectors import dot, identity, matvec


class AbstractInertia(AbstractParameters):
    """The linear map from angular velocity to angular momentum."""

    @abstractmethod
    def times(self, omega: Vector) -> Vector:
        """Angular momentum h = J omega, kg m^2/s, from omega, rad/s, (3, *runs).

        The runs of the body and of omega broadcast, as in `solve` and `plus_diagonal`."""

    @abstractmethod
    def solve(self, h: Vector) -> Vector:
        """Angular velocity omega with J omega = h, rad/s; zero about an axis without a moment."""

    @abstractmethod
    def plus_diagonal(self, moments: Vector) -> "AbstractInertia":
        """The sum of J and diag(moments), kg m^2."""

    @abstractmethod
    def matrix(self) -> Matrix:
        """The tensor J as a matrix, (3, 3, *runs), kg m^2."""


@final
class PrincipalInertia(AbstractInertia):
    """Inertia in principal axes.

    One moment may be zero, that of a slender rod about its axis; the other two are then equal. Its
    rate about the axis is constant under any torque. Derivatives by the moments of a rod are valid
    while these two remain equal.

    Raises `InputError` when a moment exceeds the sum of the other two, which no body allows, and
    when more than one is zero: a point does not turn."""

    moments: Float[Array, "3 *#runs"] = quantity(
        "kg m^2", non_negative=True, doc="principal moments (A, B, C); one may be zero"
    )

    def __check_init__(self):
        # Values that are not finite have a separate message, from the declaration.
        if is_concrete(self.moments) and np.all(np.isfinite(self.moments)):
            m = np.asarray(self.moments)
            slack = m.sum(axis=0) - 2.0 * m.max(axis=0)
            # A flat body has a slack of zero, which rounding of single precision makes negative.
            # A negative moment has a separate message, from the declaration.
            check(
                (slack >= -1e-6 * m.max(axis=0)) | np.any(m < 0.0, axis=0),
                "PrincipalInertia.moments",
                m,
                "such that no moment exceeds the sum of the other two",
            )
            check(
                np.sum(m == 0.0, axis=0) <= 1,
                "PrincipalInertia.moments",
                m,
                "such that at most one moment is zero",
            )

    def times(self, omega: Vector) -> Vector:
        moments, omega = _same_rank(self.moments, omega)
        return moments * omega

    def solve(self, h: Vector) -> Vector:
        moments, h = _same_rank(self.moments, h)
        # Three quotients, however many runs share the body. For a rod the rate about the axis is
        # zero.
        return h * safe_divide(jnp.ones_like(moments), moments)

    def plus_diagonal(self, moments: Vector) -> "PrincipalInertia":
        principal, moments = _same_rank(self.moments, moments)
        return PrincipalInertia(principal + moments)

    def matrix(self) -> Matrix:
        return diagonal(self.moments)


@final
class InertiaTensor(AbstractInertia):
    """Inertia in any body axes.

    Raises `InputError` when the tensor of a single body is not symmetric, not positive definite, or
    has a principal moment that exceeds the sum of the other two, which no body allows."""

    tensor: Float[Array, "3 3 *#runs"] = quantity("kg m^2", doc="symmetric and positive definite")

    def __check_init__(self):
        # A batch is not checked: eigenvalues of many tensors are too expensive for a check.
        # Values that are not finite have a separate message, from the declaration.
        single = is_concrete(self.tensor) and self.tensor.ndim == 2
        if single and np.all(np.isfinite(self.tensor)):
            j = np.asarray(self.tensor, dtype=float)
            # In units of the largest element, because those of any size shall not overflow.
            unit = j / (np.abs(j).max() or 1.0)
            check(np.abs(unit - unit.T) <= 1e-6, "InertiaTensor.tensor", j, "symmetric")
            moments = np.linalg.eigvalsh(unit)
            check(moments > 0.0, "InertiaTensor.tensor", j, "positive definite")
            # A flat body has a slack of zero, to rounding.
            check(
                moments[0] + moments[1] - moments[2] >= -1e-6 * moments[2],
                "InertiaTensor.tensor",
                j,
                "such that no principal moment exceeds the sum of the other two",
            )

    def times(self, omega: Vector) -> Vector:
        return matvec(self.tensor, omega)

    def solve(self, h: Vector) -> Vector:
        return _solve_definite(*_same_rank(self.tensor, h, axes=2))

    def plus_diagonal(self, moments: Vector) -> "InertiaTensor":
        tensor, moments = _same_rank(self.tensor, moments, axes=2)
        return InertiaTensor(tensor + diagonal(moments))

    def matrix(self) -> Matrix:
        return self.tensor


def _solve_definite(m: Matrix, b: Vector) -> Vector:
    """The solution x of m x = b for a symmetric and positive definite m, by its factors L D L^T.

    Cofactors would lose the digits that a slender body's small moment has."""
    a, d, e = m[0, 0], m[0, 1], m[0, 2]
    l10, l20 = d / a, e / a
    d1 = m[1, 1] - l10 * d
    below = m[1, 2] - l20 * d
    l21 = below / d1
    d2 = m[2, 2] - l20 * e - l21 * below
    y1 = b[1] - l10 * b[0]
    x2 = (b[2] - l20 * b[0] - l21 * y1) / d2
    x1 = y1 / d1 - l21 * x2
    return jnp.stack([b[0] / a - l10 * x1 - l20 * x2, x1, x2])


def _same_rank(inertia: Array, vector: Vector, axes: int = 1) -> tuple[Array, Vector]:
    """The inertia, with its `axes` component axes, and the vector with as many axes of times and
    runs as the one of them that has more."""
    # Both may be the one that is shared: a body of all runs, or one spin for a batch of bodies.
    rank = max(inertia.ndim - axes, vector.ndim - 1)
    return with_rank(inertia, rank, axes), with_rank(vector, rank)


def diagonal(d: Vector) -> Matrix:
    """The matrix with `d` on its diagonal."""
    return identity(d.ndim - 1) * d[:, None]


# The shapes of raw arrays do not identify the axis of the bodies.
_OF_SEVERAL = (
    "give PrincipalInertia(moments), (3, bodies), or InertiaTensor(tensors), (3, 3, bodies)."
)


def as_inertia(x: PyTree) -> AbstractInertia:
    """An inertia from three principal moments (shape (3,)), a tensor (shape (3, 3)), or an inertia
    as it is.

    A batch is built by `PrincipalInertia` or `InertiaTensor`, whose shapes leave no doubt. Raises
    `InputError` otherwise."""
    # A bare `object` is the placeholder of a tree transformation, which converts nothing.
    if isinstance(x, AbstractInertia) or type(x) is object:
        return x  # type: ignore[return-value]
    x = as_float(x)
    if not is_real(x):
        raise InputError(
            f"inertia is {shown(x)}: it must be three principal moments, a tensor, or an inertia, "
            f"in kg m^2."
        )
    if x.shape == (3,):
        return PrincipalInertia(x)
    if x.shape == (3, 3):
        try:
            return InertiaTensor(x)
        except InputError as error:
            raise InputError(f"{error} For the moments of three bodies {_OF_SEVERAL}") from None
    raise InputError(
        f"inertia has the shape {x.shape}: it must be (3,), the principal moments, or (3, 3), the "
        f"tensor. For several bodies {_OF_SEVERAL}"
    )


@formula
def kinetic_energy(inertia: AbstractInertia, omega: Vector) -> Scalar:
    """Kinetic energy of rotation, omega . J omega / 2, J (Thomson 5.3).

    **Arguments**

    - `inertia`: about the centre of mass, in body axes.
    - `omega`: angular velocity in body axes, rad/s, (3, *runs)."""
    return 0.5 * dot(omega, inertia.times(omega))


@formula(mass=NOT_NEGATIVE)
def parallel_axes(inertia: AbstractInertia, mass: Scalar, offset: Vector) -> InertiaTensor:
    """Inertia about another point than the centre of mass (Thomson 5.5).

    **Arguments**

    - `inertia`: about the centre of mass, kg m^2.
    - `mass`: of the body, kg, (*runs,).
    - `offset`: from the centre of mass to the point, m, (3, *runs).

    **Returns** the tensor about the point, kg m^2; the runs of all three broadcast.

    **Raises** `InputError` for a rod and a point of its axis, about which it has no moment either.
    """
    tensor = inertia.matrix()
    shift = particle_inertia(mass, offset)
    rank = max(tensor.ndim, shift.ndim) - 2
    return InertiaTensor(with_rank(tensor, rank, axes=2) + with_rank(shift, rank, axes=2))


def particle_inertia(mass: Scalar, offset: Vector) -> Matrix:
    """The tensor m (d^2 1 - d d^T) of a particle of the `mass`, kg, (*runs,), about a point at the
    `offset` d, m, (3, *runs), from it; kg m^2, (3, 3, *runs)."""
    # Either of the two may be the one that many runs share.
    offset = with_rank(offset, jnp.ndim(mass))
    one = identity(offset.ndim - 1)
    return mass * (dot(offset, offset) * one - offset[:, None] * offset[None, :])

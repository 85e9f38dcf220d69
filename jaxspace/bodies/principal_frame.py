"""The free rotation in any body axes: into the principal frame, and back.

    J' = V^T J V = diag(I) + E,     E = 0 as a number, but with a derivative

    I_i != I_j:   E_ij turns the frame through theta_k = E_ij / (I_i - I_j), (i, j, k) cyclic;
                  the remainder of E after the turn has no first derivative, that after a second
                  turn none below the fourth
    I_i = I_j:    E_ij splits the moments along the axes at 45 degrees: I_i + E_ij, I_j - E_ij;
                  right to first order in E

    symbol   meaning                                           unit
    J, J'    inertia in the given and in the principal axes    kg m^2
    V        principal axes as columns, right-handed           1
    theta    turn of the principal frame                       rad

Source: Thomson 5.5 (principal axes); Kato, Perturbation Theory for Linear Operators, II.2. The
principal axes of two equal moments have no derivative; the motion has one, which this module
computes.
"""

__all__ = ["free_turn"]

import math

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, PyTree

from ..core import Matrix, Scalar, Vector
from ..core.formula import formula
from ..core.shapes import with_rank
from ..core.types import follow_precision
from ..core.vectors import axis, cross, matvec
from ..rotations import Quaternion
from ._free_rotation import free_rotation
from .inertia import AbstractInertia, InertiaTensor, PrincipalInertia
from .principal_axes import principal_axes

_PAIRS = ((1, 2), (2, 0), (0, 1))


@formula
def free_turn(
    duration: Scalar, inertia: AbstractInertia, omega: Vector
) -> tuple[Quaternion, Vector]:
    """The rotation of a body after a `duration`, s, in its axes at the start, and its angular
    velocity then, rad/s.

    Shapes (4, *runs) and (3, *runs). First derivatives are valid for every inertia; where two
    moments of a tensor differ by the relative gap g > 0, the derivative with respect to the element
    that couples them has an error of about eps/g, or g if smaller. Derivatives of second order are
    valid for any principal moments, and for a tensor whose moments differ, where the error is about
    eps/g^2; where g < eps^(1/4) (1e-4 in double precision), the second derivatives with respect to
    the tensor are NaN.

    **Arguments**

    - `duration`: s.
    - `inertia`: of the body.
    - `omega`: at the start, in body axes, rad/s, (3, *runs)."""
    inertia = follow_precision(inertia, duration, omega)
    if isinstance(inertia, PrincipalInertia):
        return _of_moments(duration, inertia.moments, omega)
    tensor = inertia.matrix()
    rank = max(jnp.ndim(duration), omega.ndim - 1, tensor.ndim - 2)
    tensor, omega = with_rank(tensor, rank, axes=2), with_rank(omega, rank)
    return _turned(duration, tensor, omega)


def _of_moments(duration: Scalar, moments: Vector, omega: Vector) -> tuple[Quaternion, Vector]:
    """R and omega(t), in principal axes, also of a rod, one of whose moments is zero.

    With its axis e, the moment C about it and A across: R = exp(L t/A) exp((1 - C/A) omega_e t e),
    the symmetric body of Thomson 5.9 for C = 0, with its derivative by C."""
    rank = max(jnp.ndim(duration), omega.ndim - 1, moments.ndim - 1)
    moments, omega = with_rank(moments, rank), with_rank(omega, rank)
    rod = jnp.any(moments == 0.0, axis=0)
    # The general formula divides by each moment: in the branch not taken the body is a sphere.
    result = free_rotation(duration, jnp.where(rod, 1.0, moments), omega)

    def of_rods() -> tuple[Quaternion, Vector]:
        e = jnp.where(moments == 0.0, 1.0, 0.0).astype(moments.dtype)
        across = 0.5 * jnp.sum((1.0 - e) * moments, axis=0)
        share = jnp.sum(e * moments, axis=0) / across
        spin, rest = e * omega, (1.0 - e) * omega
        second = Quaternion.from_rotation_vector(duration * (1.0 - share) * spin)
        first = Quaternion.from_rotation_vector(duration * (rest + share * spin))
        later = second.rotate_back(rest) + spin
        return Quaternion(jnp.where(rod, first.then(second).wxyz, result[0].wxyz)), jnp.where(
            rod, later, result[1]
        )

    # Skipped for other bodies, to save the sines.
    return jax.lax.cond(jnp.any(rod), of_rods, lambda: result)


@jax.custom_jvp
def _turned(duration: Scalar, tensor: Matrix, omega: Vector) -> tuple[Quaternion, Vector]:
    """R and omega(t), in the axes of the tensor."""
    local, axes = _principal_frame(tensor)
    # The elements off the diagonal are rounding here: only the rule of derivatives needs them.
    moments = jnp.stack([local[k, k] for k in range(3)])
    turn, later = _in_axes(
        axes, *free_rotation(duration, moments, matvec(_transposed(axes), omega))
    )
    # The tensor rebuilt from its principal axes equals the given one to rounding only.
    return turn, jnp.where(duration == 0.0, omega, later)


def _turned_tangent(
    primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]
) -> tuple[PyTree, ...]:
    """The derivative along the inputs that vary: a constant tensor must not enter with derivatives
    that are zero or NaN."""
    still = [isinstance(x, SymbolicZero) for x in tangents]
    moving = [k for k in range(3) if not still[k]]

    def frame(*moved: Array) -> tuple[Quaternion, Vector]:
        given = list(primals)
        for k, x in zip(moving, moved, strict=True):
            given[k] = x
        local, axes = _principal_frame(given[1])
        return _in_axes(
            axes, *_near_principal(given[0], local, matvec(_transposed(axes), given[2]))
        )

    return jax.jvp(frame, tuple(primals[k] for k in moving), tuple(tangents[k] for k in moving))


_turned.defjvp(_turned_tangent, symbolic_zeros=True)


def _principal_frame(tensor: Matrix) -> tuple[Matrix, Matrix]:
    """The tensor in its principal axes, and these as columns; the axes are without derivatives."""
    # The derivative of `eigh` divides by the gap of the moments: it must not be formed at all.
    axes = _axes(jax.lax.stop_gradient(tensor))
    return _transformed(tensor, axes), axes


def _in_axes(axes: Matrix, turn: Quaternion, later: Vector) -> tuple[Quaternion, Vector]:
    return Quaternion(jnp.concatenate([turn.wxyz[:1], matvec(axes, turn.wxyz[1:])])), matvec(
        axes, later
    )


def _near_principal(duration: Scalar, local: Matrix, omega: Vector) -> tuple[Quaternion, Vector]:
    """R and omega(t) for a tensor whose elements off the diagonal have derivatives, but no
    values."""
    local, frame, equal = _diagonal(local)
    moments = jnp.stack([local[k, k] for k in range(3)])
    between = jnp.stack([_derivative_of(local[i, j]) for i, j in _PAIRS])
    omega = frame.rotate_back(omega)
    split = [
        (moments, omega),
        *(_split(moments, x[k], omega, k) for k in range(3) for x in (between, 0.0 * moments)),
    ]
    # One batch of seven, so that the closed form is compiled once.
    durations = jnp.stack([duration + 0.0 * moments[0]] * 7)
    turns, ends = free_rotation(
        durations, *(jnp.stack(x, axis=1) for x in zip(*split, strict=True))
    )
    vector, later = turns.wxyz[1:, 0], ends[:, 0]
    real = turns.wxyz[:1, 0]
    for k in range(3):
        back = _half_right(k, between[k])
        one = 2 * k + 1
        none = 2 * k + 2
        # The difference from the same axes without a split, whose value cancels and whose
        # derivative remains.
        change = turns.wxyz[:, one] - turns.wxyz[:, none]
        real = real + jnp.where(equal[k], change[:1], 0.0)
        vector = vector + jnp.where(equal[k], back.rotate(change[1:]), 0.0)
        later = later + jnp.where(equal[k], back.rotate(ends[:, one] - ends[:, none]), 0.0)
    return Quaternion(jnp.concatenate([real, frame.rotate(vector)])), frame.rotate(later)


def _diagonal(local: Matrix) -> tuple[Matrix, Quaternion, Array]:
    """The tensor in its principal axes, the turn to them from the given axes, and the pairs of
    equal moments, whose off-diagonal element remains. Right to third order; for close moments to
    first order, and NaN beyond."""
    eps = float(jnp.finfo(local.dtype).eps)
    gap = jax.lax.stop_gradient(jnp.stack([jnp.abs(local[i, i] - local[j, j]) for i, j in _PAIRS]))
    largest = jax.lax.stop_gradient(local[2, 2])
    equal, close = gap <= eps**0.5 * largest, gap <= eps**0.25 * largest
    moments = [local[k, k] for k in range(3)]
    between = jnp.stack([_derivative_of(local[i, j]) for i, j in _PAIRS])
    whole = sum(moments) + jnp.sum(between, axis=0)
    local = _symmetric(
        moments, _once_differentiable(between, whole, jnp.where(close, jnp.nan, 0.0))
    )
    frame = Quaternion(jnp.stack([jnp.ones_like(gap[0]), *jnp.zeros_like(gap)]))
    # Two turns, because the first leaves elements of second order, which would enter Hessians.
    for _ in range(2):
        apart = jnp.stack([local[i, i] - local[j, j] for i, j in _PAIRS])
        between = jnp.stack([_derivative_of(local[i, j]) for i, j in _PAIRS])
        theta = jnp.where(equal, 0.0, between / jnp.where(equal, 1.0, apart))
        turn = Quaternion(jnp.concatenate([jnp.ones_like(theta[:1]), 0.5 * theta])).normalised()
        local = _transformed(local, turn.matrix())
        frame = frame.then(turn)
    return local, frame, equal


@jax.custom_jvp
def _once_differentiable(x: Array, whole: Scalar, bar: Array) -> Array:
    """`x`, whose second derivative by everything that moves the `whole` is the `bar`, 0 or NaN."""
    del whole, bar
    return x


@jax.custom_jvp
def _unit(whole: Scalar, bar: Array) -> Array:
    del whole
    return jnp.ones_like(bar)


_once_differentiable.defjvp(lambda p, t: (p[0], t[0] * _unit(*p[1:])))
_unit.defjvp(lambda p, t: (_unit(*p), p[1] * t[0]))


def _symmetric(diagonal: list[Scalar], between: Vector) -> Matrix:
    a, b, c = diagonal
    x, y, z = between
    return jnp.stack([jnp.stack([a, z, y]), jnp.stack([z, b, x]), jnp.stack([y, x, c])])


def _transformed(m: Matrix, axes: Matrix) -> Matrix:
    """A^T m A for the axes A as columns."""
    return jnp.stack([matvec(_transposed(axes), matvec(m, axes[:, k])) for k in range(3)], axis=1)


def _split(moments: Vector, half_gap: Scalar, omega: Vector, k: int) -> tuple[Vector, Vector]:
    """Moments and omega along the axes at 45 degrees, when the two moments besides the k-th
    split."""
    i, j = _PAIRS[k]
    return moments + half_gap * (axis(i, half_gap) - axis(j, half_gap)), _half_right(
        k, half_gap
    ).rotate_back(omega)


def _half_right(k: int, like: Scalar) -> Quaternion:
    """The turn through 45 degrees about the k-th axis."""
    return Quaternion.about(k, 0.25 * math.pi * jnp.ones_like(like))


def _derivative_of(x: Array) -> Array:
    """Zero, with the derivative of `x`."""
    return x - jax.lax.stop_gradient(x)


def _axes(tensor: Matrix) -> Matrix:
    """The principal axes as columns, right-handed."""
    axes = principal_axes(InertiaTensor(tensor))[1]
    # Eigenvectors may form a left-handed frame, which is not a rotation.
    return jnp.stack([axes[:, 0], axes[:, 1], cross(axes[:, 0], axes[:, 1])], axis=1)


def _transposed(m: Matrix) -> Matrix:
    return jnp.swapaxes(m, 0, 1)

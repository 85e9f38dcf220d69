"""The free rotation in any body axes: into the principal frame, and back.

    J' = V^T J V = diag(I) + E,     E = 0 as a number, but with a derivative

    I_i != I_j:   E_ij turns the frame through theta_k = E_ij / (I_i - I_j)             (i, j, k) cyclic
    I_i = I_j:    E_ij splits the moments along the axes at 45 degrees: I_i + E_ij, I_j - E_ij

    symbol   meaning                                           unit
    J, J'    inertia in the given and in the principal axes    kg m^2
    V        principal axes as columns, right-handed           1
    theta    turn of the principal frame                       rad

Source: Thomson 5.5 (principal axes); Kato, Perturbation Theory for Linear Operators, II.2.
The principal axes of two equal moments have no derivative; the motion has one, and this is how it comes out right.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._core import Matrix, Scalar, Vector, axis, cross, matvec
from ..rotations import Quaternion
from ._free_rotation import free_rotation
from ._inertia import AbstractInertia, PrincipalInertia, principal_axes

_PAIRS = ((1, 2), (2, 0), (0, 1))


def free_turn(duration: Scalar, inertia: AbstractInertia, omega: Vector) -> tuple[Quaternion, Vector]:
    """The turn of the body, in its axes at the start, and its angular velocity, rad/s, a `duration`, s, after `omega`.

    Shapes (4, *runs) and (3, *runs). First derivatives hold for every inertia; where two moments of a tensor differ by the
    relative gap g > 0, the one by the element that couples them has an error of about eps/g, or of g where that is less."""
    if isinstance(inertia, PrincipalInertia):
        return free_rotation(duration, inertia.moments, omega)
    tensor = inertia.matrix()
    rank = max(jnp.ndim(duration), omega.ndim - 1, tensor.ndim - 2)
    tensor, omega = _with_rank(tensor, 2, rank), _with_rank(omega, 1, rank)
    axes = _axes(jax.lax.stop_gradient(inertia))
    axes = _with_rank(axes, 2, rank)
    local = jnp.stack([matvec(_transposed(axes), matvec(tensor, axes[:, k])) for k in range(3)], axis=1)
    turn, later = _near_principal(duration, local, matvec(_transposed(axes), omega))
    return Quaternion(jnp.concatenate([turn.wxyz[:1], matvec(axes, turn.wxyz[1:])])), matvec(axes, later)


def _near_principal(duration: Scalar, local: Matrix, omega: Vector) -> tuple[Quaternion, Vector]:
    """R and omega(t) for a tensor whose elements off the diagonal have derivatives, but no values."""
    moments = jnp.stack([local[k, k] for k in range(3)])
    between = jnp.stack([_derivative_of(local[i, j]) for i, j in _PAIRS])
    gap = jax.lax.stop_gradient(jnp.stack([moments[i] - moments[j] for i, j in _PAIRS]))
    equal = jnp.abs(gap) <= float(jnp.finfo(gap.dtype).eps) ** 0.5 * moments[0]
    theta = jnp.where(equal, 0.0, between / jnp.where(equal, 1.0, gap))
    frames = [_split(moments, between[k], omega, k) for k in range(3)]
    split = (
        jnp.stack([moments, *(m for m, _ in frames)], axis=1),
        jnp.stack([omega + cross(omega, theta), *(w for _, w in frames)], axis=1),
    )
    still = jax.lax.stop_gradient(duration)
    durations = jnp.stack([x + 0.0 * local[0, 0] for x in (duration, still, still, still)])
    turns, ends = free_rotation(durations, *split)
    vector, later = turns.wxyz[1:, 0] + cross(theta, turns.wxyz[1:, 0]), ends[:, 0] + cross(theta, ends[:, 0])
    turn = jnp.concatenate([turns.wxyz[:1, 0], vector])
    for k in range(3):
        back = _half_right(k, between[k])
        change = jnp.concatenate([turns.wxyz[:1, k + 1], back.rotate(turns.wxyz[1:, k + 1])])
        turn = turn + jnp.where(equal[k], _derivative_of(change), 0.0)
        later = later + jnp.where(equal[k], _derivative_of(back.rotate(ends[:, k + 1])), 0.0)
    return Quaternion(turn), later


def _split(moments: Vector, half_gap: Scalar, omega: Vector, k: int) -> tuple[Vector, Vector]:
    """Moments and omega along the axes at 45 degrees, when the two moments besides the k-th split; of no other derivative."""
    i, j = _PAIRS[k]
    split = jax.lax.stop_gradient(moments) + half_gap * (axis(i, half_gap) - axis(j, half_gap))
    return split, _half_right(k, half_gap).rotate_back(jax.lax.stop_gradient(omega))


def _half_right(k: int, like: Scalar) -> Quaternion:
    """The turn through 45 degrees about the k-th axis."""
    return Quaternion.about(k, 0.25 * math.pi * jnp.ones_like(like))


def _derivative_of(x: Array) -> Array:
    """Zero, with the derivative of `x`."""
    return x - jax.lax.stop_gradient(x)


def _axes(inertia: AbstractInertia) -> Matrix:
    """The principal axes as columns, right-handed."""
    axes = principal_axes(inertia)[1]
    return jnp.stack([axes[:, 0], axes[:, 1], cross(axes[:, 0], axes[:, 1])], axis=1)


def _transposed(m: Matrix) -> Matrix:
    return jnp.swapaxes(m, 0, 1)


def _with_rank(x: Array, lead: int, rank: int) -> Array:
    """`x` with `rank` axes of runs behind its `lead` axes of components."""
    return x.reshape(*x.shape[:lead], *(1,) * (rank - x.ndim + lead), *x.shape[lead:])

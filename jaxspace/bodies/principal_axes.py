"""Principal moments and axes, and functions of the inertia tensor that do not depend on a choice of
axes.

    J = V diag(I) V^T,   f(J) = V diag(f(I_1), f(I_2), f(I_3)) V^T

    dI_i = E_ii,   dV = V K,   K_ij = E_ij / (I_j - I_i),   E = V^T dJ V
    df(J) = V (D * E) V^T,     D_ij = int_0^1 f'(I_i + x (I_j - I_i)) dx

    symbol   meaning                                                      unit
    J        inertia tensor                                               kg m^2
    I_i, V   principal moments, ascending; principal axes as columns      kg m^2, 1
    E, K     change of the tensor in principal axes; turn of the axes     kg m^2, 1
    D        divided differences of f, taken element by element           of f per kg m^2

Source: Thomson 5.5 (principal axes); Kato, Perturbation Theory for Linear Operators, II.2 (E, K);
Higham, Functions of Matrices, 3.2 (Daleckii and Krein: D). At equal moments K has no limit, but D
has.
"""

__all__ = ["principal_axes", "tensor_function"]

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..core import Matrix, Scalar, Vector
from ..core.safe import times_slope
from .inertia import AbstractInertia, InertiaTensor

# The mean of f' with eight-point Gauss quadrature is accurate to rounding for moments within this
# share of one another, for f without a singularity closer than zero moment; the quotient is used
# beyond it.
_CLOSE = 0.1
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def principal_axes(inertia: AbstractInertia) -> tuple[Vector, Matrix]:
    """Principal moments in ascending order, kg m^2, and the principal axes as the columns of a
    matrix (Thomson 5.5).

    The derivative of an axis exists only where its moment differs from the others: where two are
    equal to rounding, the derivatives of their axes are not finite, in both modes, while that of
    the third axis exists. For equal moments the derivative of their sum is right, and that of each
    one is along the axis that happens to be returned. Functions that do not depend on the choice of
    axes have derivatives there, too: `tensor_function` for a function of the tensor, `FreeRotation`
    for the motion."""
    return _principal_axes(inertia.matrix())


def tensor_function(f: Callable[[Scalar], Scalar], inertia: AbstractInertia) -> InertiaTensor:
    """The function `f` of the tensor: the same axes, and f of each principal moment.

    **Arguments**

    - `f`: a smooth function of a moment, element by element, such as `jnp.sqrt`.
    - `inertia`: of the body, kg m^2.

    **Returns** the tensor V diag(f(I)) V^T, in the unit of f.

    It is smooth for every inertia, unlike the axes: first derivatives are valid at and near equal
    moments. Second derivatives are valid where the moments differ, and not finite where two are
    equal. Closed-over values of `f` are treated as constant: derivatives are with respect to the
    tensor.
    """
    return InertiaTensor(_tensor_function(f, inertia.matrix()))


@jax.custom_jvp
def _principal_axes(tensor: Matrix) -> tuple[Vector, Matrix]:
    # `eigh` takes the runs first and the matrix last.
    moments, axes = jnp.linalg.eigh(jnp.moveaxis(tensor, (0, 1), (-2, -1)))
    return jnp.moveaxis(moments, -1, 0), jnp.moveaxis(axes, (-2, -1), (0, 1))


@_principal_axes.defjvp
def _principal_axes_tangent(primals, tangents):
    moments, axes = _principal_axes(*primals)
    local = _local(axes, tangents[0])
    gap = moments[None, :] - moments[:, None]
    equal = jnp.abs(gap) <= 8.0 * float(jnp.finfo(gap.dtype).eps) * moments[2]
    slope = jnp.where(equal, jnp.inf, 1.0 / jnp.where(equal, 1.0, gap))
    same = jnp.eye(3, dtype=bool).reshape(3, 3, *(1,) * (gap.ndim - 2))
    turn = times_slope(jnp.where(same, 0.0, slope), local)
    along = jnp.stack([local[k, k] for k in range(3)])
    return (moments, axes), (along, jnp.einsum("ki...,ij...->kj...", axes, turn))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _tensor_function(f: Callable[[Scalar], Scalar], tensor: Matrix) -> Matrix:
    moments, axes = _principal_axes(tensor)
    return jnp.einsum("ki...,i...,li...->kl...", axes, f(moments), axes)


@_tensor_function.defjvp
def _tensor_function_tangent(f, primals, tangents):
    moments, axes = _principal_axes(*primals)
    change = _divided_differences(f, moments) * _local(axes, tangents[0])
    value = jnp.einsum("ki...,i...,li...->kl...", axes, f(moments), axes)
    return value, jnp.einsum("ki...,ij...,lj...->kl...", axes, change, axes)


def _local(axes: Matrix, change: Matrix) -> Matrix:
    """A change of the tensor in principal axes: only its symmetric part is one of an inertia."""
    change = 0.5 * (change + jnp.swapaxes(change, 0, 1))
    return jnp.einsum("ki...,kl...,lj...->ij...", axes, change, axes)


def _divided_differences(f: Callable[[Scalar], Scalar], moments: Vector) -> Matrix:
    """D."""
    first, second = jnp.broadcast_arrays(moments[:, None], moments[None, :])
    gap = second - first
    close = jnp.abs(gap) <= _CLOSE * jnp.minimum(jnp.abs(first), jnp.abs(second))
    places, weights = (
        jnp.asarray(x, gap.dtype).reshape(-1, *(1,) * gap.ndim)
        for x in (0.5 + 0.5 * _PLACES, 0.5 * _WEIGHTS)
    )
    between = first + jnp.where(close, gap, 0.0) * places
    slopes = jax.jvp(f, (between,), (jnp.ones_like(between),))[1]
    mean = jnp.sum(weights * slopes, axis=0)
    far = jnp.where(close, 1.0, gap)
    return jnp.where(close, mean, (f(second) - f(first)) / far)

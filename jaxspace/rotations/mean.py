"""The mean of several orientations.

    M = sum w_i q_i q_i^T,   M q = lambda q                lambda: the greatest of four eigenvalues
    (lambda 1 - M) dq = (dM - dlambda 1) q,   q . dq = 0

It is the orientation that minimises the sum of w_i sin^2(angle_i / 2), with the angles to the given
ones.

    symbol     meaning                                    unit
    q_i, w_i   unit quaternion and weight of each         1
    q          quaternion of the mean                     1

Source: Markley, Cheng, Crassidis and Oshman (2007), J. Guidance 30, 1193. The mean does not depend
on the signs of the quaternions. Where the two greatest eigenvalues are equal, as for two
orientations half a turn apart, the mean is not unique and has no derivative.
"""

__all__ = ["mean_attitude"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import check
from ..core.formula import formula
from ..core.shapes import with_rank
from ._quaternion import Quaternion


@formula
def mean_attitude(
    attitudes: Quaternion, weights: Float[Array, "attitudes *#runs"] | None = None
) -> Quaternion:
    """The mean of orientations, with weights.

    **Arguments**

    - `attitudes`: (4, attitudes, *runs), of unit length.
    - `weights`: none negative, (attitudes, *runs); all equal where they are left out.

    **Returns** the mean, (4, *runs), of unit length, on the side of the first one. Derivatives
    exist wherever there is a single mean, also where all orientations are the same.

    **Raises** `InputError` for a single orientation without an axis of attitudes.
    """
    q = attitudes.wxyz
    check(q.ndim > 1, "mean_attitude: the number of axes", q.ndim, "two or more")
    if weights is None:
        weights = jnp.ones(q.shape[1:], q.dtype)
    rank = max(q.ndim - 2, weights.ndim - 1)
    q, weights = with_rank(q, rank, axes=2), with_rank(weights, rank)
    moment = jnp.sum(weights * q[:, None] * q[None, :], axis=2)
    # The runs first and the matrix last, as the eigenvalue solver takes them.
    mean = jnp.moveaxis(_greatest(jnp.moveaxis(moment, (0, 1), (-2, -1))), -1, 0)
    side = jnp.sum(mean * q[:, 0], axis=0) < 0.0
    return Quaternion(jnp.where(side, -mean, mean))


@jax.custom_jvp
def _greatest(m: Float[Array, "*runs n n"]) -> Float[Array, "*runs n"]:
    """The unit eigenvector of the greatest eigenvalue."""
    return jnp.linalg.eigh(m)[1][..., -1]


@_greatest.defjvp
def _greatest_tangent(primals, tangents):
    # Not that of `eigh`, which divides by the differences of the other eigenvalues: these vanish
    # where the orientations agree.
    (m,), (dm,) = primals, tangents
    v = _greatest(m)
    value = jnp.einsum("...i,...ij,...j->...", v, m, v)[..., None, None]
    eye = jnp.eye(m.shape[-1], dtype=m.dtype)
    along = v[..., :, None] * v[..., None, :]
    push = jnp.einsum("...ij,...jk,...k->...i", eye - along, dm, v)
    # The added part makes the matrix regular, and acts only along v, which `push` does not have.
    change = jnp.linalg.solve(value * (eye + along) - m, push[..., None])[..., 0]
    return v, change

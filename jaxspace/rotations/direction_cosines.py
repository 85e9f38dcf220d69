"""Rates of the nine direction cosines of a turning body, without angles and quaternions.

    C' = C [w]x                          row by row of the body's axes:
    i' = w_z j - w_y k,  j' = w_x k - w_z i,  k' = w_y i - w_x j
    [w]x = C^T C'                        the way back

    symbol   meaning                                                        unit
    C        turns body components into inertial ones; its columns are      1
             the body's axes i, j, k
    w        angular velocity of the body, in its axes                      rad/s

Source: Thomson 3, problems 13 to 16 (where one rate is printed with w_x for w_y).
The six orthonormality conditions on C are preserved by the exact motion, but not by the steps of an
integrator: a quaternion has only one such condition.
"""

__all__ = ["cosine_conditions", "cosine_rates", "omega_from_cosine_rates"]

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Matrix, Vector
from ..core.formula import formula
from ..core.vectors import cross, dot


@formula
def cosine_rates(cosines: Matrix, omega_B: Vector) -> Matrix:
    """C', 1/s, (3, 3, *runs), of a rotating body (Thomson 3, problem 15).

    **Arguments**

    - `cosines`: C, (3, 3, *runs), from body to inertial components.
    - `omega_B`: angular velocity in the axes of the body, rad/s, (3, *runs).
    """
    # Of the rows of C, which are the inertial axes in the body: they turn by -w.
    return jnp.stack([cross(row, omega_B) for row in cosines])


@formula
def omega_from_cosine_rates(cosines: Matrix, cosine_rates: Matrix) -> Vector:
    """The angular velocity in the axes of the body, rad/s, (3, *runs), from C and C'.

    **Arguments**

    - `cosines`, `cosine_rates`: C and C', 1/s, (3, 3, *runs). The part of C' that no turn has, as
      of an integration with errors, is left out.
    """
    turned = [cross(rate, row) for row, rate in zip(cosines, cosine_rates, strict=True)]
    # (r x w) x r is the part of w across the row r, and three rows at right angles count it twice.
    return 0.5 * (turned[0] + turned[1] + turned[2])


@formula
def cosine_conditions(cosines: Matrix) -> Float[Array, "6 *#runs"]:
    """Residuals of the six conditions on nine cosines, (6, *runs): the squares of the
    lengths of i, j and k less one, and j . k, k . i and i . j.

    **Arguments**

    - `cosines`: C, (3, 3, *runs).
    """
    i, j, k = (cosines[:, n] for n in range(3))
    lengths = [dot(a, a) - 1.0 for a in (i, j, k)]
    return jnp.stack([*lengths, dot(j, k), dot(k, i), dot(i, j)])

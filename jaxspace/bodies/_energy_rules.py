"""Derivatives of the free rotation from its conserved quantities, in the letters of
`_free_rotation`: they lose no digits where the formulas have differences of growing terms.

    L(t) . delta omega(t) + omega(t) . delta I omega(t)/2 = the same at the start        energy
    L(t) . theta = t L . delta omega                                                     about h
"""

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..core import Scalar, Vector
from ..core.vectors import dot, norm


def _direction(moments: Vector, omega: Vector) -> tuple[Vector, Scalar]:
    """L/h and 1/h; zero for a body at rest."""
    momentum = moments * omega
    h = norm(momentum)
    # The inner switch keeps zero out of the quotient, also in its derivative.
    inverse = jnp.where(h > 0.0, 1.0 / jnp.where(h > 0.0, h, 1.0), 0.0)
    return momentum * inverse, inverse


@jax.custom_jvp
def of_equal_energy(later: Vector, moments: Vector, omega: Vector) -> Vector:
    """`later`, with the derivative along L that conserves T: I omega . delta omega + omega . delta
    I omega / 2 is the same at both times."""
    return later


@of_equal_energy.defjvp
def _of_equal_energy_tangent(
    primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]
) -> tuple[PyTree, ...]:
    later, moments, omega = primals
    of_later, of_moments, of_omega = tangents

    def change(omega: Vector, of_omega: Vector) -> Scalar:
        along, inverse = _direction(moments, omega)
        return dot(along, of_omega) + 0.5 * dot(omega * inverse, of_moments * omega)

    # In the formula it is a difference of terms that grow like 1/tilt.
    missing = change(omega, of_omega) - change(later, of_later)
    along = _direction(moments, later)[0]
    return of_equal_energy(*primals), of_later + missing * along


@jax.custom_jvp
def by_energy(
    chi: Scalar, duration: Scalar, omega: Vector, later: Vector, start: Vector, end: Vector
) -> Scalar:
    """`chi`, with the derivative by which L(t) . theta = t L . delta omega; `start` and `end` are
    L. In the formula it is a difference of terms that grow with every flip."""
    return chi


@by_energy.defjvp
def _by_energy_tangent(
    primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]
) -> tuple[PyTree, ...]:
    _, duration, omega, later, start, end = primals
    _, of_duration, of_omega, _, of_start, of_end = tangents
    h = norm(start)

    def twist(n: Vector, of_n: Vector) -> Scalar:
        """Angle about n of the smallest rotation from e_z to n, for a change of n."""
        return (n[1] * of_n[0] - n[0] * of_n[1]) / (1.0 + n[2])

    along = (duration * dot(start, of_omega) + dot(end, later) * of_duration) / h
    twists = twist(end / h, of_end / h) - twist(start / h, of_start / h)
    return by_energy(*primals), along + twists

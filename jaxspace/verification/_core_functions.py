"""Functions of the edge cases of NaN-safe operations, and of rotations.

Each maps the inputs of a case, (inputs,), to its outputs, (outputs,)."""

import jax.numpy as jnp
from jaxtyping import Array

from ..core.elliptic import complete_elliptic, complete_third
from ..core.safe import end_sqrt, phi1, safe_atan2, safe_sqrt, sinc_squared
from ..core.special import stumpff
from ..core.vectors import norm, unit
from ..rotations import Quaternion, from_euler_angles, to_euler_angles


def root(x: Array) -> Array:
    """The square root."""
    return safe_sqrt(x)


def end_root(x: Array) -> Array:
    """sqrt(a - b) from a and b, with its infinite slope at the end."""
    # From both ends, because at the end the slopes by them are infinite with opposite signs.
    return end_sqrt(lambda a, b: a - b, x[0], x[1])[None]


def arctangent(x: Array) -> Array:
    """The angle of the point (x, y) from y and x, rad."""
    return safe_atan2(x[0], x[1])[None]


def exponential_quotient(x: Array) -> Array:
    """(e^x - 1)/x."""
    return phi1(x)


def sine_quotient(x: Array) -> Array:
    """sin(sqrt(z))/sqrt(z), hyperbolic below zero."""
    return sinc_squared(x)


def stumpff_functions(x: Array) -> Array:
    """Stumpff's functions."""
    return jnp.concatenate(stumpff(x))


def elliptic_k(x: Array) -> Array:
    """The complete elliptic integral K from the complement of its parameter."""
    # By its complement, which is accurate near modulus one, where K grows without bound.
    return complete_elliptic(x)


def elliptic_third(x: Array) -> Array:
    """R_J(0, y, z, p) from sum and product of the roots of y and z, and p."""
    # By sum and product of the roots, by which it has derivatives where y = z, too.
    return complete_third(x[0], x[1], x[2])[None]


def length(x: Array) -> Array:
    """The length of a vector."""
    return norm(x)[None]


def direction(x: Array) -> Array:
    """The unit vector along a vector."""
    return unit(x)


def rotation_exp(x: Array) -> Array:
    """The quaternion of a rotation vector, rad."""
    return Quaternion.from_rotation_vector(x).wxyz


def rotation_log(x: Array) -> Array:
    """The rotation vector of a quaternion, rad."""
    return Quaternion(x).rotation_vector()


def euler_angles(x: Array) -> Array:
    """Euler's angles 3-2-1 of a quaternion, rad."""
    return to_euler_angles(Quaternion(x), "321")


def turned_there_and_back(x: Array) -> Array:
    """Euler's angles 3-1-3 by way of their quaternion, rad."""
    # There and back, because a quaternion with small theta contains psi and phi in numbers of its
    # size, from which they must be recovered accurately.
    return to_euler_angles(from_euler_angles(x, "313"), "313")

"""Hard cases of the functions without NaN, and of rotations."""

import math

import jax.numpy as jnp
from jaxtyping import Array

from ..core.elliptic import complete_elliptic, complete_third
from ..core.safe import end_sqrt, phi1, safe_atan2, safe_sqrt, sinc_squared
from ..core.special import stumpff
from ..core.vectors import norm, unit
from ..rotations import Quaternion, from_euler_angles, to_euler_angles
from ._case import Case


def root(x: Array) -> Array:
    """The square root."""
    return safe_sqrt(x)


def end_root(x: Array) -> Array:
    """sqrt(a - b) from a and b, with its infinite slope at the end."""
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
    return complete_elliptic(x)


def elliptic_third(x: Array) -> Array:
    """R_J(0, y, z, p) from sum and product of the roots of y and z, and p."""
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
    return to_euler_angles(from_euler_angles(x, "313"), "313")


NONE3 = ((0.0, 0.0, 0.0),) * 3
# The derivatives at no turn: of the quaternion by the rotation vector, and back.
HALF = tuple(tuple(0.5 * float(i == j + 1) for j in range(3)) for i in range(4))
TWICE = tuple(tuple(2.0 * float(j == i + 1) for j in range(4)) for i in range(3))
LOST = "the input rounds onto the singular place"

CASES = (
    # The conventions at ends of ranges (`core.safe`): zero, or an infinite slope of a known sign.
    Case("core: root at zero", root, (0.0,), "exact", value=(0.0,), slopes=((0.0,),)),
    Case(
        *("core: end of a range", end_root, (0.75, 0.75), "exact"),
        value=(0.0,),
        slopes=((math.inf, -math.inf),),
    ),
    Case(
        "core: angle of the origin",
        arctangent,
        (0.0, 0.0),
        "exact",
        value=(0.0,),
        slopes=((0.0, 0.0),),
    ),
    Case(
        "core: angle on the cut",
        arctangent,
        (1e-300, -1.0),
        value=(math.pi,),
        slopes=((-1.0, 0.0),),
    ),
    # Both sides of each branch between a closed form and its series.
    Case("core: (e^x - 1)/x at zero", exponential_quotient, (0.0,), value=(1.0,), slopes=((0.5,),)),
    Case(
        *("core: (e^x - 1)/x at its branch", exponential_quotient, (0.5,)),
        value=(1.2974425414002563,),
        slopes=((0.70255745859974371,),),
        single="",
    ),
    Case("core: (e^x - 1)/x far below zero", exponential_quotient, (-40.0,)),
    Case("core: sin(s)/s at zero", sine_quotient, (0.0,), value=(1.0,), slopes=((-1.0 / 6.0,),)),
    Case("core: sin(s)/s below its branch", sine_quotient, (0.0999,)),
    Case("core: sin(s)/s above its branch", sine_quotient, (0.1001,), slope_roundings=64.0),
    Case("core: sinh(s)/s beyond its branch", sine_quotient, (-0.1001,), slope_roundings=64.0),
    Case(
        *("core: Stumpff functions at zero", stumpff_functions, (0.0,)),
        value=(1 / 2, 1 / 6, 1 / 24, 1 / 120),
        slopes=((-1 / 24,), (-1 / 120,), (-1 / 720,), (-1 / 5040,)),
    ),
    Case("core: Stumpff functions near zero", stumpff_functions, (-1e-9,)),
    Case("core: Stumpff functions at half a turn", stumpff_functions, (9.869,)),
    Case("core: Stumpff functions at their branch", stumpff_functions, (-9.87,)),
    Case("core: Stumpff functions far out", stumpff_functions, (-400.0,)),
    # Infinite at one end; arguments of very different size.
    Case(
        *("core: K at modulus one", elliptic_k, (0.0,), "exact"),
        value=(math.inf,),
        slopes=((0.0,),),
    ),
    Case("core: K beside modulus one", elliptic_k, (1e-30,), slope_roundings=64.0),
    Case(
        "core: K at modulus zero",
        elliptic_k,
        (1.0,),
        value=(math.pi / 2,),
        slopes=((-math.pi / 8,),),
    ),
    Case("core: R_J, arguments far apart", elliptic_third, (1.0, 1e-6, 1e-8), roundings=16.0),
    Case("core: R_J, equal arguments", elliptic_third, (2.0, 1.0, 1.0)),
    # A vector of zeros has no direction, and its length a corner.
    Case(
        "core: length of no vector",
        length,
        (0.0, 0.0, 0.0),
        "exact",
        value=(0.0,),
        slopes=NONE3[:1],
    ),
    Case("core: length across the range", length, (3e-9, 4e-9, 1e-17)),
    Case(
        "core: direction of no vector",
        direction,
        (0.0, 0.0, 0.0),
        "exact",
        value=(0.0, 0.0, 0.0),
        slopes=NONE3,
    ),
    # The axis of no turn is arbitrary; that of half a turn has two directions.
    Case(
        "rotations: no turn", rotation_exp, (0.0, 0.0, 0.0), value=(1.0, 0.0, 0.0, 0.0), slopes=HALF
    ),
    Case("rotations: turn of 1e-9 rad", rotation_exp, (1e-9, -2e-9, 3e-10)),
    Case(
        "rotations: turn by two whole turns",
        rotation_exp,
        (0.0, 12.566, 0.01),
        "slopes of the cosine vanish there",
        slope_roundings=1e4,
        single="the distance from whole turns is five hundred roundings of the angle",
    ),
    Case(
        "rotations: angle of no turn",
        rotation_log,
        (1.0, 0.0, 0.0, 0.0),
        value=(0.0, 0.0, 0.0),
        slopes=TWICE,
    ),
    Case("rotations: angle of 1e-12 rad", rotation_log, (1.0, 1e-12, -3e-13, 2e-12)),
    Case("rotations: angle at its series", rotation_log, (1.0, 6e-4, 8e-4, 1e-5)),
    Case(
        *("rotations: angle beside half a turn", rotation_log, (1e-12, 0.6, 0.8, 0.0)),
        single="",
    ),
    # Two of the three angles turn about the same axis at the pole.
    Case(
        *("rotations: pitch 1e-6 rad below the pole", euler_angles),
        (0.7071069579, 0.0, 0.7071066044, 0.0),
        "yaw and roll are quotients of numbers of 1e-6",
        roundings=64.0,
        slope_roundings=1e7,
        single=LOST,
    ),
    Case(
        *("rotations: Euler's angles there and back", turned_there_and_back, (0.4, 1e-5, -1.1)),
        "psi and phi are quotients of numbers of 1e-5",
        value=(0.4, 1e-5, -1.1),
        slopes=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        roundings=64.0,
        slope_roundings=1e6,
        single=LOST,
    ),
)

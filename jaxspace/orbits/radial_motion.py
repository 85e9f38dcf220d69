"""The radial motion under any central potential: turning points, apsidal angle, circular orbits.

    V(r) = U(r) + h^2 / (2 r^2)                    effective potential: r'^2/2 + V(r) = E
    T(x) = e^(2x) (E - U(e^x)), x = ln r           (r r')^2 = 2 T - h^2, zero at x_1 and x_2
    2 T - h^2 = h^2 (x - x_1) (x_2 - x) Q(x)       Q = -2 T[x_1, x, x_2] / h^2
    x = (x_1 + x_2)/2 - (x_2 - x_1)/2 cos(chi)
    apsidal angle = int_0^pi d(chi) / sqrt(Q)      period = 2/h int_0^pi r^2 d(chi) / sqrt(Q)
    circle: theta'^2 = U'/r,  w_r^2 = U'' + 3 U'/r, stable where positive

    symbol        meaning                                                  unit
    U             potential energy per unit mass                           m^2/s^2
    E, h          energy and angular momentum per unit mass                m^2/s^2, m^2/s
    x_1, x_2      logarithms of the inner and outer turning radius         1
    T[a, b, c]    divided difference                                       m^2/s^2
    chi           phase of the radial motion                               rad
    w_r           frequency of small radial oscillations about a circle    rad/s

Source: Thomson 4.5-6 to -10, 4.15-3 to -5; Harrison and Nettleton 5.20 to 5.24.

The phase removes the square roots at both ends, so that the integrand is smooth and periodic; in
terms of the logarithm it has no nearby singularity for any ratio of the radii. The divided
differences are means of derivatives where the points are close, so that circles lose no digits.
Motions between distant radii are as accurate as the potential: choose its zero at the outer radius
or at infinity.
"""

__all__ = [
    "RadialMotion",
    "circular_rate",
    "effective_potential",
    "radial_frequency_squared",
    "radial_motion",
    "turning_points",
]

from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Flag, Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.printing import printed
from ..core.safe import safe_divide
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.squares import quotient, unit_factor
from ..core.vectors import cross, dot, norm

Potential: TypeAlias = Callable[[Scalar], Scalar]

# The error falls exponentially with the nodes: 64 give every digit for radii of a ratio of 1e6.
NODES = 64
# Points closer than this in ln r take the mean of the derivative, by Gauss' rule, exact to rounding
# for powers of r up to the fifth.
CLOSE = 0.5
_GAUSS = np.polynomial.legendre.leggauss(8)
# The search for turning points covers r e^-30 to r e^30, at steps that grow by a fifth.
_STEPS = np.geomspace(1e-16, 30.0, 220)
_BISECTIONS = 60


@final
@printed(apsidal_angle="rad", period="s", energy="m^2/s^2", angular_momentum="m^2/s")
class RadialMotion(eqx.Module):
    """A motion between two turning points under a central potential; each field is (*runs,).

    - `apsidal_angle`, rad: turned from one turning point to the next.
    - `period`, s: from one inner turning point to the next.
    - `energy`, m^2/s^2: per unit mass.
    - `angular_momentum`, m^2/s: per unit mass."""

    apsidal_angle: Float[Array, "*#runs"]
    period: Float[Array, "*#runs"]
    energy: Float[Array, "*#runs"]
    angular_momentum: Float[Array, "*#runs"]


def _slope(f: Potential, x: Scalar) -> Scalar:
    """Derivative of a function that acts elementwise."""
    return jax.jvp(f, (x,), (jnp.ones_like(x),))[1]


def _gauss(like: Array) -> tuple[Array, Array]:
    """Nodes within [0, 1] and weights, on a new leading axis."""
    shape = (-1,) + (1,) * like.ndim
    nodes, weights = (jnp.asarray(x, like.dtype).reshape(shape) for x in _GAUSS)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _divided(f: Potential, a: Scalar, b: Scalar) -> Scalar:
    """Divided difference f[a, b] in ln r, the derivative where a = b."""
    gap = b - a
    close = jnp.abs(gap) < CLOSE
    s, weights = _gauss(gap)
    near = jnp.where(close, gap, 0.0)
    mean = jnp.sum(weights * _slope(f, a + s * near), axis=0)
    return jnp.where(close, mean, (f(b) - f(a)) / jnp.where(close, 1.0, gap))


def _second_divided(f: Potential, a: Scalar, x: Scalar, b: Scalar) -> Scalar:
    """Divided difference f[a, x, b] in ln r of three points in order, all close together."""
    # Hermite and Genocchi: a mean of the second derivative over the triangle of the three points.
    s, weights_s = _gauss(x)
    t, weights_t = s[:, None], weights_s[:, None]
    second = _slope(lambda z: _slope(f, z), a + s * (x - a + t * (b - x)))
    return jnp.sum(jnp.sum(weights_t * weights_s * s * second, axis=0), axis=0)


@formula(r=POSITIVE)
def effective_potential(potential: Potential, r: Scalar, h: Scalar) -> Scalar:
    """V(r) = U(r) + h^2/(2 r^2), m^2/s^2 (Harrison and Nettleton 5.21).

    **Arguments**

    - `potential`: U, m^2/s^2, a function of the distance that acts elementwise.
    - `r`: distance from the centre, m, (*runs,).
    - `h`: angular momentum per unit mass, m^2/s, (*runs,).

    **Returns** V, m^2/s^2, (*runs,): motion of the energy E is where V <= E.
    """
    return potential(r) + 0.5 * (h / r) ** 2


@formula(r=POSITIVE)
def circular_rate(potential: Potential, r: Scalar) -> Scalar:
    """Angular rate sqrt(U'/r) of the circular orbit, rad/s (Thomson 4.15-1); NaN where the force
    repels.

    **Arguments**

    - `potential`, `r`: as in `effective_potential`."""
    r = jnp.asarray(r)
    return jnp.sqrt(_slope(potential, r) / r)


@formula(r=POSITIVE)
def radial_frequency_squared(potential: Potential, r: Scalar) -> Scalar:
    """w_r^2 = U'' + 3 U'/r, 1/s^2, of small radial oscillations about the circular orbit.

    Negative where the circle is unstable: for a force k / r^n it is (3 - n) k / r^(n+1). (Thomson
    4.15-3).

    **Arguments**

    - `potential`, `r`: as in `effective_potential`."""
    r = jnp.asarray(r)
    first = _slope(potential, r)
    return _slope(lambda z: _slope(potential, z), r) + 3.0 * first / r


@formula(inner=POSITIVE, outer=POSITIVE)
def radial_motion(potential: Potential, inner: Scalar, outer: Scalar) -> RadialMotion:
    """The motion between two given turning radii, accurate to rounding error, including circles.

    **Arguments**

    - `potential`: U, m^2/s^2, a function of the distance, m, that acts elementwise and
      is smooth between the radii.
    - `inner`, `outer`: turning radii, m, (*runs,).

    **Returns** a `RadialMotion`, with derivatives with respect to the radii and to the parameters
    of the potential; NaN where no motion goes from one of the radii to the other. For an unstable
    circle the angle and the period are NaN.
    """
    inner, outer = jnp.broadcast_arrays(jnp.asarray(inner), jnp.asarray(outer))
    x_2 = jnp.log(quotient(outer, inner))
    lower, upper = potential(inner), potential(outer)

    def weighted(x):
        return jnp.exp(2.0 * x) * (potential(inner * jnp.exp(x)) - lower)

    # T(x_1) = T(x_2) = h^2/2 gives the kinetic energy at the inner end.
    close = jnp.abs(x_2) < CLOSE
    zero, near = jnp.zeros_like(x_2), jnp.where(close, x_2, 0.0)
    mean = _divided(weighted, zero, near) / _divided(lambda x: jnp.exp(2.0 * x), zero, near)
    ratio = quotient(inner, outer)
    share = jnp.where(close, 1.0, (1.0 - ratio) * (1.0 + ratio))
    kinetic = jnp.where(close, mean, (upper - lower) / share)
    # In a unit of length in which no power of the distance leaves the range of float32.
    unit = unit_factor(outer)
    half_h_squared = kinetic * (unit * inner) ** 2
    # Each half of the nodes is measured from the nearer end, where no large terms cancel, neither
    # in the values nor in the derivatives by the other end.
    chi = (np.arange(NODES) + 0.5) * np.pi / NODES
    shape = (-1,) + (1,) * inner.ndim
    first = (chi < 0.5 * np.pi).reshape(shape)
    shares = np.where(chi < 0.5 * np.pi, np.sin(0.5 * chi) ** 2, -(np.cos(0.5 * chi) ** 2))
    x = jnp.asarray(shares, inner.dtype).reshape(shape) * x_2
    end, level = jnp.where(first, inner, outer), jnp.where(first, lower, upper)
    length = unit * end

    def t(x):
        gain = potential(end * jnp.exp(x)) - level
        return jnp.exp(2.0 * x) * (half_h_squared - length * length * gain)

    close = jnp.broadcast_to(x_2 < CLOSE, x.shape)
    bend = _second_divided(
        t,
        jnp.where(close & ~first, -x_2, 0.0),
        jnp.where(close, x, 0.0),
        jnp.where(close & first, x_2, 0.0),
    )
    apart = jnp.where(first, x - x_2, x + x_2)
    from_end = _divided(t, jnp.zeros_like(x), x) / jnp.where(close, 1.0, apart)
    # h^2 Q, because h cancels from the period.
    inverse_root = inverse_sqrt(-2.0 * jnp.where(close, bend, from_end))
    h = sqrt(2.0 * half_h_squared)
    r = length * jnp.exp(x)
    return RadialMotion(
        jnp.pi * h * jnp.mean(inverse_root, axis=0),
        2.0 * jnp.pi * jnp.mean(r * r * inverse_root, axis=0) / unit,
        # At the outer radius: at the inner one both terms may be far greater than their sum.
        upper + kinetic * ratio * ratio,
        h / unit,
    )


@formula
def turning_points(potential: Potential, r: Vector, v: Vector) -> tuple[Scalar, Scalar]:
    """The turning radii of a motion.

    **Arguments**

    - `potential`: U, m^2/s^2, a function of the distance, m, that acts elementwise.
    - `r`, `v`: a state of the motion, m and m/s, (3, *runs).

    **Returns** the inner and the outer radius, m, (*runs,): the nearest on either side. The inner
    one is 0 for a motion that reaches the centre, the outer one infinite for one that escapes;
    their derivatives are zero then. On a circle both are |r|; there they have a kink, and the
    derivatives are those of |r|. A forbidden zone narrower than a fifth of its distance in ln r may
    be missed.
    """
    length = norm(r)
    radial = (dot(r, v) / length) ** 2
    h_squared = dot(cross(r, v), cross(r, v)) / (length * length)
    level = potential(length)

    def t(y):
        # Energy less potential, times the squared ratio of the distances.
        gain = 0.5 * (radial + h_squared) - (potential(length * jnp.exp(y)) - level)
        return jnp.exp(2.0 * y) * gain

    def side(sign):
        def over(s):
            """(r r')^2/2 over s, at r e^(sign s) in units of |r|, of the sign of the radicand."""
            start = jnp.zeros_like(s)
            near = 0.5 * radial / s + sign * _divided(t, start, sign * s)
            # Far inside, the difference from the start would lose all digits of the small
            # remainder.
            return jnp.where(s < CLOSE, near, (t(sign * s) - 0.5 * h_squared) / s)

        steps = jnp.asarray(_STEPS, length.dtype).reshape((-1,) + (1,) * length.ndim)
        steps = jnp.broadcast_to(steps, (len(_STEPS), *length.shape))
        return _first_root(over, steps)

    inwards, turns_in = side(-1.0)
    outwards, turns_out = side(1.0)
    return (
        jnp.where(turns_in, length * jnp.exp(-inwards), 0.0),
        jnp.where(turns_out, length * jnp.exp(outwards), jnp.inf),
    )


def _first_root(f: Potential, steps: Array) -> tuple[Scalar, Flag]:
    """The place where `f` first becomes negative on a grid of positive `steps`, (steps, *runs),
    zero if it is from the start; and whether it does."""
    negative = jax.lax.stop_gradient(f(steps)) <= 0.0
    result = jnp.any(negative, axis=0)
    first = jnp.argmax(negative, axis=0)
    high = jnp.take_along_axis(steps, first[None], axis=0)[0]
    low = jnp.take_along_axis(steps, jnp.maximum(first - 1, 0)[None], axis=0)[0]

    def halve(g):
        def step(_, ends):
            a, b = ends
            middle = 0.5 * (a + b)
            beyond = g(middle) <= 0.0
            return jnp.where(beyond, a, middle), jnp.where(beyond, middle, b)

        a, b = jax.lax.fori_loop(0, _BISECTIONS, step, (low, high))
        return 0.5 * (a + b)

    regular = result & (first > 0)
    root = jax.lax.custom_root(
        f,
        jax.lax.stop_gradient(high),
        lambda g, _: halve(g),
        # Each run alone, so that the derivative of g is a number for each.
        lambda g, y: jnp.where(regular, safe_divide(y, g(jnp.ones_like(y))), 0.0),
    )
    return jnp.where(regular, root, 0.0), result

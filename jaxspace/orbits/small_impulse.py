"""Changes of the elements due to any impulse, exactly and to first order.

    change = elements(r, v + dv) - elements(r, v)        exact
    change = d(elements)/dv dv                           first order

    dh = r x dv,   de = (dv x h + (v + dv) x dh)/mu,     d|a| = (2 a + da) . da / (|a| + |a + da|)
    d(angle of (x, y)) = angle of (x x' + y y', x dy - y dx)        x' = x + dx, y' = y + dy

    symbol   meaning                                              unit
    r, v     position, velocity                                   m, m/s
    dv       impulse                                              m/s
    h, e     angular momentum, eccentricity vector (elements.py)  m^2/s, 1

Source: Thomson 4.13 and 4.14, for impulses in the plane; here in any direction (Gauss). The
differences of the constant vectors keep the digits that a difference of two sets of elements loses.
"""

__all__ = ["impulse_change"]

import math

import jax
import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.safe import safe_atan2, safe_divide
from ..core.shapes import with_rank
from ..core.squares import quotient, unit_factor
from ..core.vectors import axis, cross, dot, norm, scale
from .elements import ClassicalElements, eccentricity_vector, elements_from_state

_TURN = 2.0 * math.pi
_ANGLES = ("inclination", "node", "argument_of_periapsis", "true_anomaly")


@formula(mu=POSITIVE)
def impulse_change(
    position: Vector, velocity: Vector, impulse: Vector, mu: Scalar, *, first_order: bool = False
) -> dict[str, Scalar]:
    """Changes of the classical elements due to an impulse.

    **Arguments**

    - `position`, m; `velocity`, m/s; `impulse`, m/s: inertial components, (3, *runs).
    - `mu`: gravitational parameter, m^3/s^2, (*runs,).
    - `first_order`: whether to give the derivative times the impulse.

    **Returns** the changes by the names of `ClassicalElements`, each (*runs,): m, 1, rad; angles
    from -pi to pi. Where an angle is undefined (circle, equator), so is its change.
    """

    def elements(v: Vector) -> ClassicalElements:
        return elements_from_state(position, v, mu)

    if first_order:
        change = jax.jvp(elements, (velocity,), (impulse,))[1]
        # A plain dictionary: changes need not be in the ranges of `ClassicalElements`.
        return dict(vars(change))
    rank = max(x.ndim for x in (position, velocity, impulse)) - 1
    position, velocity, impulse = (with_rank(x, rank) for x in (position, velocity, impulse))
    before, after = vars(elements(velocity)), vars(elements(velocity + impulse))
    h, dh = cross(position, velocity), cross(position, impulse)
    e = eccentricity_vector(position, velocity, mu)
    de = quotient(cross(impulse, h) + cross(velocity + impulse, dh), mu)
    level = 1.0 - axis(2, h[2])
    across, d_across = norm(level * h), _longer(level * h, level * dh)
    length, d_length = norm(h), _longer(h, dh)
    x, y, z = position
    precise = {
        "semi_latus_rectum": quotient(dot(2.0 * h + dh, dh), mu),
        "eccentricity": _longer(e, de),
        "inclination": _turned(across, h[2], d_across, dh[2]),
        "node": _turned(h[0], -h[1], dh[0], -dh[1]),
        # Of r e sin f = |h| r . v / mu and r e cos f = e . r.
        "true_anomaly": _turned(
            quotient(length * dot(position, velocity), mu),
            dot(e, position),
            quotient(
                d_length * dot(position, velocity + impulse) + length * dot(position, impulse), mu
            ),
            dot(de, position),
        ),
    }
    circle = (before["eccentricity"] == 0.0) | (after["eccentricity"] == 0.0)
    flat, stays_flat = across == 0.0, norm(level * (h + dh)) == 0.0
    # From the node; at the equator from the x axis, which stays.
    latitude = _turned(length * z, h[0] * y - h[1] * x, d_length * z, dh[0] * y - dh[1] * x)
    latitude = jnp.where(flat | stays_flat, 0.0, latitude)
    precise["argument_of_periapsis"] = latitude - precise["true_anomaly"]
    # A vector that is zero before or after has no angle: the conventions of the elements decide.
    no_node = flat | stays_flat
    same_equator = flat & stays_flat & (h[2] * (h[2] + dh[2]) > 0.0)
    by_convention = {
        "semi_latus_rectum": False,
        "eccentricity": circle,
        "inclination": no_node,
        "node": no_node,
        "argument_of_periapsis": circle | (no_node & ~same_equator),
        "true_anomaly": circle,
    }
    result = {}
    for name, decided in by_convention.items():
        step = jnp.where(decided, after[name] - before[name], precise[name])
        # An angle that passes the cut at pi has not changed by a whole turn.
        result[name] = step - _TURN * jnp.round(step / _TURN) if name in _ANGLES else step
    return result


def _longer(a: Vector, da: Vector) -> Scalar:
    """The change of the length of a vector `a` that changes by `da`."""
    length = norm(a) + norm(a + da)
    # The direction first, because squares may leave the range of float32.
    return dot(scale(safe_divide(1.0, length), 2.0 * a + da), da)


def _turned(y: Scalar, x: Scalar, dy: Scalar, dx: Scalar) -> Scalar:
    """The change of the angle of the point (x, y), rad, by a step (dx, dy)."""
    factor = unit_factor(y, x)
    y, x, dy, dx = (factor * part for part in (y, x, dy, dx))
    return safe_atan2(x * dy - y * dx, x * (x + dx) + y * (y + dy))

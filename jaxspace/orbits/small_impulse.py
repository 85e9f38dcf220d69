"""Changes of the elements due to any impulse, exactly and to first order.

    change = elements(r, v + dv) - elements(r, v)        exact
    change = d(elements)/dv dv                           first order

    symbol   meaning                    unit
    r, v     position, velocity         m, m/s
    dv       impulse                    m/s

Source: Thomson 4.13 and 4.14, for impulses in the plane; here in any direction (Gauss).
"""

__all__ = ["impulse_change"]

import math

import jax
import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import POSITIVE, formula
from .elements import ClassicalElements, elements_from_state

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
    from -pi to pi. Where an angle is undefined (circle, equator), so is its change. The
    exact change is a difference: for an impulse of s times the speed its relative error is 1e-16/s.
    Below s = 1e-8 the change to first order is more accurate.
    """

    def elements(v: Vector) -> ClassicalElements:
        return elements_from_state(position, v, mu)

    if first_order:
        change = jax.jvp(elements, (velocity,), (impulse,))[1]
        # A plain dictionary: changes need not be in the ranges of `ClassicalElements`.
        return dict(vars(change))
    before, after = vars(elements(velocity)), vars(elements(velocity + impulse))
    result = {}
    for name, value in after.items():
        step = value - before[name]
        # An angle that passes the cut at pi has not changed by a whole turn.
        result[name] = step - _TURN * jnp.round(step / _TURN) if name in _ANGLES else step
    return result

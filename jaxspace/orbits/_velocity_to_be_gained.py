"""The velocity to be gained: the missing speed on the way to an orbit of given semi-major axis.

    v_g = v_r - |v|,    v_r^2 = mu (2/r - 1/a)
        = (v_r^2 - v^2) / (v_r + |v|)                         without cancellation near cut-off

    symbol   meaning                                                            unit
    v_g      velocity to be gained: the burn ends where it is zero              m/s
    v_r      speed that the orbit requires at the present distance (vis-viva)   m/s
    r, v     distance from the centre, velocity                                 m, m/s
    a        required semi-major axis                                           m

Valid for a burn along the velocity, or close to it: it then only has to raise the energy, while
plane and shape of the orbit follow from the steering. Beyond r = 2 a the orbit is out of reach:
v_r^2 is negative there, v_g = -(|v_r|^2 + v^2) / (|v_r| + |v|), and the sign still indicates that
the energy exceeds the required one.

Source: Battin, An Introduction to the Mathematics and Methods of Astrodynamics, chapter 11 (v_g =
v_r - v, cut-off where it vanishes); vis-viva: Thomson 4.7.
"""

from typing import ClassVar, final

import jax.numpy as jnp

from ..bodies import AbstractCondition, BodyState
from ..core import NumberField, Scalar, check, quantity
from ..core.checks import is_concrete
from ..core.safe import safe_divide, safe_sqrt
from ..core.vectors import dot, norm


@final
class VelocityToBeGained(AbstractCondition):
    """The velocity to be gained, m/s, of a burn along the velocity into an orbit of given
    semi-major axis: zero, from either side, at the cut-off.

    At rest at r = 2 a, which is on the orbit, it is not differentiable: its derivatives are set to
    zero."""

    direction: ClassVar[int] = 0
    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    semi_major_axis: NumberField = quantity(
        "m", doc="a of the required orbit; negative on a hyperbola"
    )
    mu: NumberField = quantity(
        "m^3/s^2", positive=True, shared="planet.mu", doc="gravitational parameter"
    )

    def __check_init__(self):
        a = self.semi_major_axis
        if is_concrete(a):
            check(a != 0.0, "VelocityToBeGained.semi_major_axis", a, "other than zero")

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """v_g, m/s, in the state `y`."""
        del t
        required = self.mu * (2.0 / norm(y.position) - 1.0 / self.semi_major_axis)
        # Beyond r = 2 a the square is negative: the absolute value gives a size to divide by.
        size = safe_sqrt(jnp.abs(required)) + norm(y.velocity)
        return safe_divide(required - dot(y.velocity, y.velocity), size)

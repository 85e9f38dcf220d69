"""Motion relative to uniformly rotating axes: the inertial forces.

    a = -2 w x v - w x (w x r)                        relative to the turning axes
    U = -|w x r|^2 / 2
    a = -2 w x v,  U = 0                              for gravity along a plumb line (2.6-4)
    J = v^2/2 + U + other potentials                  the integral of Jacobi

    symbol  meaning                                                  unit
    r, v    position, velocity relative to the turning axes          m, m/s
    w       angular velocity of the axes, in them                    rad/s
    J       constant if the other effects rest in these axes         m^2/s^2

Source: Thomson 2.5-7, 2.6; Goldstein, Classical Mechanics, 4.10. Coriolis' force does no work.

The origin of the axes does not accelerate. `MovingFrame` of `rotations` converts states to inertial
axes and back: with w along z, V = v + w x r and both turned by the angle w t.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Scalar, quantity
from ..core.vectors import cross, dot


@final
class RotatingFrame(AbstractEffect):
    """Inertial forces in uniformly rotating axes, which are then the axes of the scene's state.

    The energy of such a scene is the integral of Jacobi. The forces act on the orbit only: the
    attitude of a body remains relative to inertial axes.

    - `centrifugal`: whether the centrifugal force is included. Use `False` with a gravity that
      already contains it, such as gravity along a plumb line; only the Coriolis force then acts."""

    keeps: ClassVar[frozenset[str]] = frozenset({"energy"})
    uniform: ClassVar[bool] = True

    omega: Float[Array, "3 *#runs"] = quantity("rad/s", doc="angular velocity of the axes, in them")
    centrifugal: bool = eqx.field(static=True, default=True)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.velocity is not None
        # One product for both forces: w x (2 v + w x r).
        moving = 2.0 * y.velocity
        if self.centrifugal:
            assert y.position is not None
            moving = moving + cross(self.omega, y.position)
        return Load(acceleration_N=-cross(self.omega, moving))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        if not self.centrifugal:
            return jnp.zeros(())
        assert y.position is not None
        turning = cross(self.omega, y.position)
        return -0.5 * dot(turning, turning)

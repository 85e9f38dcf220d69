"""Plane motion of a body: the paths of its instantaneous centre, in space and on the body.

    X = X_0 - Y_0' / theta',  Y = Y_0 + X_0' / theta'        in space
    (x, y) = R(-theta) (X - X_0, Y - Y_0)                    on the body

    symbol     meaning                                                  unit
    X_0, Y_0   a point of the body, in space                            m
    theta      angle of the body's axes from those of space             rad
    X, Y       instantaneous centre in space: the fixed centrode        m
    x, y       the same in the body's axes: the moving centrode         m

Source: Thomson 3.3-1. The moving centrode rolls on the fixed one without slip.
"""

__all__ = ["centrodes"]

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar
from ..core.formula import formula

PlaneMotion = Callable[[Scalar], tuple[Float[Array, "2"], Scalar]]


@formula
def centrodes(
    motion: PlaneMotion, ts: Float[Array, " times"]
) -> tuple[Float[Array, "2 times"], Float[Array, "2 times"]]:
    """The fixed and the moving centrode of a plane motion.

    **Arguments**

    - `motion`: from a time, s, to the place of a point of the body, m, (2,), and the angle of the
      body, rad.
    - `ts`: times, s.

    **Returns** the instantaneous centre in space and in the axes of the body, m, (2, times) each;
    not finite at times at which the body does not turn.
    """

    def centre(t: Scalar) -> tuple[Array, Array]:
        # By forward mode: exact, where differences of the places would lose half of the digits.
        (place, angle), (v, rate) = jax.jvp(motion, (t,), (jnp.ones_like(t),))
        way = jnp.stack([-v[1], v[0]]) / rate
        c, s = jnp.cos(angle), jnp.sin(angle)
        return place + way, jnp.stack([c * way[0] + s * way[1], c * way[1] - s * way[0]])

    return jax.vmap(centre, out_axes=-1)(ts)

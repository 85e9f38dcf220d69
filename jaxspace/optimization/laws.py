"""Laws of a thrust angle with parameters for a search: a few, or as many as a free profile has.

    tan phi = a + b s,   (a + b s)/(1 + c s)       linear and bilinear tangent
    phi_k at nodes       `SteeringProfile`, straight lines; `core.Spline`, cubic in between
    phi = N(2 s - 1)     a network, such as an `equinox.nn.MLP` from a scalar to a scalar

    symbol   meaning                                                        unit
    phi      angle of the thrust above the horizontal                       rad
    s        time since ignition, s, or its fraction of the burn            s or 1

A law is any function of s that is an `equinox.Module`. A search varies the values of a profile or a
table and not their times; of any other law every number.

Source: Bryson and Ho, Applied Optimal Control, 2.4, 2.7.
"""

__all__ = ["SteeringNetwork", "TangentLaw"]

from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import Scalar, Spline, Table
from ..core.checks import check_finite
from ..core.printing import printed
from ..core.structure import HashedModule
from ..core.tables import polygon
from ..core.types import as_float

Law: TypeAlias = Callable[[Scalar], Scalar]


@final
@printed(times="s", angles="rad")
class SteeringProfile(HashedModule):
    """Thrust angles at given times, linear in between.

    - `times`, s: ascending, (nodes, *runs).
    - `angles`, rad: at these times, (nodes, *runs)."""

    times: Float[Array, "nodes *#runs"] = eqx.field(converter=as_float)
    angles: Float[Array, "nodes *#runs"] = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        check_finite("SteeringProfile.times", self.times)
        check_finite("SteeringProfile.angles", self.angles)

    def __call__(self, t: Scalar) -> Scalar:
        """The angle, rad, at the time `t`, s: constant before the first node and after the last."""
        return polygon(t, self.times, self.angles)


@final
@printed()
class TangentLaw(HashedModule):
    """The tangent of the angle linear in s, or with `denominator` bilinear.

    - `tangent`: a, tangent of the angle at s = 0, (*runs,).
    - `rate`: b, (*runs,), per unit of s.
    - `denominator`: c, (*runs,), per unit of s; `None` for the linear law."""

    tangent: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    rate: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    denominator: Float[Array, "*#runs"] | None = eqx.field(
        default=None, converter=lambda x: None if x is None else as_float(x)
    )

    def __call__(self, s: Scalar) -> Scalar:
        """The angle, rad, at `s`."""
        below = 1.0 if self.denominator is None else 1.0 + self.denominator * s
        # By numerator and denominator, because the quotient is infinite for a vertical thrust.
        return jnp.arctan2(self.tangent + self.rate * s, below + 0.0 * s)


@final
@printed()
class SteeringNetwork(HashedModule):
    """The angle computed by a neural network.

    - `network`: a function from a scalar to a scalar. Its input is s, scaled so that 0 to
      `duration` becomes -1 to 1.
    - `duration`: range of s, in the unit of s."""

    network: Callable[[Scalar], Scalar]
    duration: float = eqx.field(static=True, default=1.0)

    def __call__(self, s: Scalar) -> Scalar:
        """The angle, rad, at `s`."""
        x = 2.0 * jnp.asarray(s) / self.duration - 1.0
        # A network takes one number, whereas the times may have any shape.
        return jax.vmap(self.network)(x.ravel()).reshape(x.shape)


def free_numbers(law: PyTree) -> tuple[PyTree, Callable[[PyTree], PyTree]]:
    """The numbers of a law that a search may vary, and a function that puts other numbers in their
    place."""
    if isinstance(law, SteeringProfile):
        return law.angles, lambda angles: SteeringProfile(law.times, angles)
    if isinstance(law, Table | Spline):
        # Constructed again, because the curvatures of a spline follow from its values.
        return law.values, lambda values: type(law)(law.times, values)
    free, rest = eqx.partition(law, eqx.is_inexact_array)
    return free, lambda numbers: eqx.combine(numbers, rest)


def corners(law: PyTree) -> Float[Array, " nodes"] | None:
    """The inner nodes of a law, at which it or a derivative of it jumps."""
    return law.times[1:-1] if isinstance(law, SteeringProfile | Table | Spline) else None

"""What may act on a body, and what it contributes: the interface between a scene and the physics of its effects."""

from abc import abstractmethod
from typing import final

import equinox as eqx
from equinox import AbstractClassVar
from jaxtyping import Array, Float

from .._core import AbstractRegularForm, AbstractSystem, Scalar, State, Vector
from ._body import AbstractBody
from ._state import BodyState


@final
class Load(eqx.Module):
    """What an effect contributes to the motion; `None` contributes nothing and costs nothing.

    - `acceleration_N`, m/s^2: of the centre of mass, in inertial axes (gravity: no mass is needed).
    - `force_N`, N: in inertial axes.
    - `torque_B`, N m: about the centre of mass, in body axes.
    - `mass_rate`, kg/s: negative when mass leaves.
    - `parts_rate`: rates of the state's extra parts, by name."""

    acceleration_N: Vector | None = None
    force_N: Vector | None = None
    torque_B: Vector | None = None
    mass_rate: Scalar | None = None
    parts_rate: dict[str, State] | None = None


class AbstractEffect(eqx.Module):
    """Something that acts on a body. A concrete effect is final.

    - `needs`: the parts of the state that it reads, of `position`, `velocity`, `attitude`, `omega`, `mass`.
    - `adds`: what its load contributes, of `acceleration`, `force`, `torque`, `mass_rate`, `parts`.
    - `keeps`: what motion under it alone conserves, of `energy`, `angular_momentum` (of the orbit, all components),
      `axial_angular_momentum` (its z component)."""

    needs: AbstractClassVar[frozenset[str]]
    adds: AbstractClassVar[frozenset[str]]
    keeps: AbstractClassVar[frozenset[str]]

    @abstractmethod
    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        """The contribution at the time `t`, s, in the state `y`."""

    @abstractmethod
    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        """Potential energy per unit mass, J/kg; `None` says that the effect is not conservative."""


class AbstractScalableEffect(AbstractEffect):
    """An effect with a parameter that its whole load is proportional to, and that it keeps its own abilities with."""

    @abstractmethod
    def scaled(self, factor: Scalar) -> "AbstractScalableEffect":
        """The same effect with its load multiplied by the `factor`."""


class AbstractFlowEffect(AbstractScalableEffect):
    """An effect that depends on the position alone, and under which alone position and velocity are known in closed form."""

    @abstractmethod
    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        """The exact state a `duration`, s (negative: backwards), after `y`, which holds a position and a velocity only."""


class AbstractRegularEffect(AbstractScalableEffect):
    """An effect that dominates a motion, and knows variables in which that motion is smooth close to its centre too."""

    @abstractmethod
    def regular_form(self, rest: AbstractSystem | None) -> AbstractRegularForm:
        """The motion under this effect and the accelerations of `rest`, a system of position and velocity, in such variables."""


class AbstractPiecewiseEffect(AbstractEffect):
    """An effect that is smooth only between known times."""

    @abstractmethod
    def breaks(self) -> Float[Array, "times *#runs"]:
        """The times, s, at which the load or a derivative of it jumps."""

"""The interface of an effect: an influence on a body and its contribution to the motion."""

__all__ = ["with_parts"]

import dataclasses
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..core import (
    AbstractClosedForm,
    AbstractParameters,
    AbstractRegularised,
    AbstractSystem,
    Flag,
    InputError,
    Matrix,
    Scalar,
    State,
    Vector,
)
from ..core.limits import Limit, any_passed
from ..core.printing import printed
from ._body import AbstractBody
from .state import BodyState


@final
@printed(
    acceleration_N="m/s^2",
    force_N="N",
    torque_B="N m",
    mass_rate="kg/s",
    inertia_B="kg m^2",
    momentum_B="kg m^2/s",
)
class Load(eqx.Module):
    """Contribution of an effect to the motion; `None` means no contribution, at no cost.

    Vectors are (3, *runs).

    - `acceleration_N`, m/s^2: of the centre of mass, in inertial axes (gravity: no mass is needed).
    - `force_N`, N: in inertial axes.
    - `torque_B`, N m: about the centre of mass, in body axes.
    - `mass_rate`, kg/s: negative when mass leaves.
    - `parts_rate`: rates of the state's extra parts, by name.
    - `inertia_B`, kg m^2: contribution of moving parts to the inertia of the body, (3, 3, *runs).
    - `momentum_B`, kg m^2/s: angular momentum of moving parts in body axes, relative to the body.
      Their torque contains the changes in body axes only, without omega x momentum."""

    acceleration_N: Vector | None = None
    force_N: Vector | None = None
    torque_B: Vector | None = None
    mass_rate: Scalar | None = None
    parts_rate: dict[str, State] | None = None
    inertia_B: Matrix | None = None
    momentum_B: Vector | None = None


class AbstractEffect(AbstractParameters):
    """An effect that acts on a body. A concrete effect is final.

    A scene determines what an effect reads and adds by tracing its load in states with missing
    parts: a part whose absence (`None`) the load accepts is optional, and one whose absence raises
    is required.

    - `keeps`: the quantities conserved by the motion under this effect only, out of "energy",
      "angular_momentum" (of the orbit, all components), "axial_angular_momentum" (its z component),
      "rotational_momentum" (of the body and its moving parts: of effects whose torques are
      internal); by default none. They are declared, because tracing cannot determine them.
    - `uniform`: whether it accelerates all parts of the body equally, as gravity and rotating axes
      do, so that an accelerometer in the body does not sense it."""

    # Without an annotation it is not a field of the class, and a subclass may make it one.
    keeps = frozenset[str]()
    uniform = False

    @abstractmethod
    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        """The contribution at the time `t`, s, in the state `y` of a `body`."""

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        """Potential energy per unit mass, J/kg; `None`, the default, where there is none."""
        del t, y, body
        return None

    def constrained(self, t: Scalar, y: BodyState, rate: BodyState) -> BodyState:
        """The rate of the state under a constraint, from the `rate` under all loads: a rail keeps a
        body on its line. By default there is no constraint, at no cost."""
        del t, y
        return rate

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State] | None:
        """The initial values of the extra parts of the state that this effect integrates, by name;
        `None` if it has none.

        **Arguments**

        - `y`: the state without them, of every run.
        - `body`: that of the scene."""
        del y, body
        return None

    def closed_form(self) -> AbstractClosedForm | None:
        """The exact motion of a position and a velocity under this effect only, or `None`.

        For effects that depend on the position only."""
        return None

    def regularised(self, rest: AbstractSystem | None) -> AbstractRegularised | None:
        """The motion in variables that are smooth close to the centre of this effect, or `None`.

        **Arguments**

        - `rest`: a system of position and velocity whose accelerations perturb the motion."""
        # Absent by default: an effect is correct without them, only slower.
        del rest
        return None

    def started_at(self, t0: Scalar) -> "AbstractEffect":
        """The effect in a phase of a mission that starts at the time `t0`, s
        (`AbstractSystem.started_at`)."""
        del t0
        return self

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        """Times, s, at which the load or one of its derivatives jumps, or `None`."""
        return None

    def switches(self) -> dict[str, str]:
        """The parts of the state at whose changes the load jumps (`AbstractSystem.switches`)."""
        return {}

    def ground(self) -> Scalar | None:
        """Radius, m, of the sphere about the origin above which the effect is valid: a run that
        passes below it gets a warning. Zero for an effect that is valid inside its planet; `None`,
        the default, for no warning."""
        return None

    def check_values(self, t: Scalar, y: BodyState, body: AbstractBody) -> None:
        """Raise `InputError`, or warn, for numbers that contradict the first state `y`, at the time
        `t`, s (`AbstractSystem.check_values`)."""
        del t, y, body

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        """The limits of the range of the effect, such as that of a table; none by default
        (`AbstractSystem.limits`)."""
        del t, y, body
        return ()

    def outside(self, t: Scalar, y: BodyState, body: AbstractBody) -> Flag | None:
        """Whether the state is outside the range of the effect, for each run: by default beyond one
        of its `limits`; `None` where every state is inside (`AbstractSystem.outside`)."""
        return any_passed(self.limits(t, y, body))

    def scaled(self, factor: Scalar) -> "AbstractEffect | None":
        """The same effect with its load multiplied by `factor`, or `None`.

        For effects with a parameter to which the whole load is proportional: they retain their
        other capabilities when they are scaled. `jaxspace.scene.scaled` scales every effect."""
        del factor
        return None


def with_parts(y: BodyState, effects: Iterable[AbstractEffect], body: AbstractBody) -> BodyState:
    """A state with the extra parts that effects integrate.

    **Arguments**

    - `y`: the state; existing parts are left unchanged.
    - `effects`, `body`: of the scene.

    **Raises** `InputError` where two effects integrate a part of the same name."""
    result: dict[str, State] = {}
    for effect in effects:
        for name, part in (effect.start(y, body) or {}).items():
            if name in result:
                raise InputError(
                    f"{type(effect).__name__}.part is {name!r}: another effect of the scene "
                    "integrates a part of this name, use another one."
                )
            result[name] = part
    if not result:
        return y
    # Parts in the state are left unchanged: a phase continues with those of the previous phase.
    return dataclasses.replace(y, parts={**result, **(y.parts or {})})

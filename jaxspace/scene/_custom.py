"""Any function as an effect."""

from collections.abc import Callable
from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..bodies import PARTS, AbstractBody, AbstractEffect, BodyState, Load
from ..core import InputError, Scalar, quantity

ADDS = ("acceleration", "force", "torque", "mass_rate", "parts")


@final
class Custom(AbstractEffect):
    """An effect from a function `load(t, y, body) -> Load`: components first, runs last.

    - `function`: best an `equinox.Module` with a `__call__`, whose parameters are then part of the
      scene. In a batch its arrays carry the runs on the last axis, or an axis of length one there
      when all runs share them.
    - `needs`, `adds`, `keeps`: as in `AbstractEffect`.
    - `energy`: a function (t, y, body) -> potential energy per unit mass, J/kg, if the effect keeps
      the energy.

    Raises `InputError` for an unknown part or contribution, or an effect that keeps the energy
    without a potential."""

    function: Callable[[Scalar, BodyState, AbstractBody], Load]
    # Of the instance and not of the class, because each function has its own.
    needs: frozenset[str] = eqx.field(static=True, converter=frozenset)  # pyright: ignore
    adds: frozenset[str] = eqx.field(static=True, converter=frozenset)  # pyright: ignore
    keeps: frozenset[str] = eqx.field(  # pyright: ignore
        static=True, converter=frozenset, default=frozenset()
    )
    energy: Callable[..., Scalar] | None = None
    break_times: Float[Array, "times *#runs"] | None = quantity(
        "s", optional=True, doc="at which the load or a derivative of it jumps"
    )

    def __check_init__(self):
        # A misspelt word would otherwise leave a part out of the state without an error.
        for field, allowed in (("needs", PARTS), ("adds", ADDS)):
            unknown = sorted(getattr(self, field) - set(allowed))
            if unknown:
                raise InputError(
                    f"Custom.{field} names {unknown}: it may name {', '.join(allowed)}."
                )
        if "energy" in self.keeps and self.energy is None:
            raise InputError(
                "Custom.keeps names the energy, and Custom.energy is None: "
                "give the potential energy per unit mass."
            )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        return self.function(t, y, body)

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        return None if self.energy is None else self.energy(t, y, body)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.break_times

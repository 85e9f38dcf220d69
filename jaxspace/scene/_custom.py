"""Any function as an effect."""

from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..bodies import PARTS, AbstractBody, AbstractEffect, BodyState, Load
from ..core import InputError, Scalar, check_components, quantity

# What a load may hold: the word of `adds`, and the field.
FIELDS = {
    "acceleration": "acceleration_N",
    "force": "force_N",
    "torque": "torque_B",
    "mass_rate": "mass_rate",
    "parts": "parts_rate",
    "inertia": "inertia_B",
    "momentum": "momentum_B",
}
VECTORS = ("acceleration_N", "force_N", "torque_B", "momentum_B")


def _check_vector(name: str, value: object) -> None:
    """Raise `InputError` unless the value is a vector, or absent. A number would push along all
    three axes."""
    if value is None:
        return
    if not isinstance(value, jax.Array | np.ndarray):
        kind = type(value).__name__
        raise InputError(f"{name} is of type {kind}: it must be an array (3, *runs), or None.")
    if value.ndim == 0:
        raise InputError(f"{name} has no axis: it must be an array (3, *runs), or None.")
    check_components(name, value, 3)


@final
class Custom(AbstractEffect):
    """An effect from a function `load(t, y, body) -> Load`: components first, runs last.

    - `function`: best an `equinox.Module` with a `__call__`, whose parameters are then part of the
      scene. In a batch its arrays carry the runs on the last axis, or an axis of length one there
      when all runs share them.
    - `needs`, `adds`, `keeps`: as in `AbstractEffect`.
    - `energy`: a function (t, y, body) -> potential energy per unit mass, J/kg, if the effect keeps
      the energy.

    Raises `InputError` for an unknown part or contribution, an effect that keeps the energy without
    a potential, and, when it is first evaluated, a load that holds what `adds` does not name."""

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
        for field, allowed in (("needs", PARTS), ("adds", tuple(FIELDS))):
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
        load = self.function(t, y, body)
        if not isinstance(load, Load):
            raise InputError(
                f"Custom.function returns {type(load).__name__}: it must return a Load."
            )
        # What is not declared would be left out of the state, and so out of the motion.
        given = (word for word, field in FIELDS.items() if getattr(load, field) is not None)
        undeclared = sorted(set(given) - self.adds)
        if undeclared:
            raise InputError(
                f"Custom.function returns {' and '.join(undeclared)}, and Custom.adds names "
                f"{', '.join(sorted(self.adds)) or 'nothing'}: it must name what the load holds."
            )
        for field in VECTORS:
            _check_vector(f"Custom.function: Load.{field}", getattr(load, field))
        return load

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        return None if self.energy is None else self.energy(t, y, body)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.break_times

"""An effect made stronger or weaker as a whole."""

from typing import Any, final

import equinox as eqx
import jax
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Scalar, quantity


def scaled(effect: AbstractEffect, factor: Scalar) -> AbstractEffect:
    """The `effect` with its whole load multiplied by the `factor`: by itself where it can, so that
    it still offers its closed form and its regular variables, else as a `Scaled`."""
    own = effect.scaled(factor)
    return Scaled(effect, factor) if own is None else own


@final
class Scaled(AbstractEffect):
    """An `effect` whose whole load is multiplied by the `factor`: 1 leaves it as it is, 0 takes it
    away.

    A derivative in the factor at 1 says what a result owes to the effect, to first order."""

    effect: AbstractEffect
    factor: Float[Array, "*#runs"] = quantity("", doc="by which the load is multiplied")
    needs: frozenset[str] = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    adds: frozenset[str] = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    keeps: frozenset[str] = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, effect: AbstractEffect, factor: Any):
        self.effect, self.factor = effect, factor
        self.needs, self.adds, self.keeps = effect.needs, effect.adds, effect.keeps

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        return jax.tree.map(lambda x: self.factor * x, self.effect.load(t, y, body))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Any:
        own = self.effect.potential(t, y, body)
        return None if own is None else self.factor * own

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.effect.breaks()

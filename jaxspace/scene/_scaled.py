"""An effect whose whole load is multiplied by a factor."""

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Flag, NumberField, Scalar, State, quantity
from ..core.field_types import check_types
from ..core.limits import Limit


def scaled(effect: AbstractEffect, factor: Scalar) -> AbstractEffect:
    """An effect with its whole load multiplied by a factor.

    **Arguments**

    - `effect`: any effect.
    - `factor`: (*runs,); 1 leaves the effect as it is, 0 removes it.

    **Returns** an effect of the same class where it has a parameter for this, so that its closed
    form and regularised variables remain available, else a `Scaled`.
    """
    product = effect.scaled(factor)
    return Scaled(effect, factor) if product is None else product


@final
class Scaled(AbstractEffect):
    """An effect whose whole load is multiplied by a factor.

    - `effect`: the effect that is scaled.
    - `factor`: on its load; 1 leaves the effect unchanged, 0 removes it.

    The derivative of a result with respect to the factor, at 1, is the contribution of the effect
    to the result, to first order."""

    effect: AbstractEffect
    factor: NumberField = quantity("", doc="factor on the load")
    # Of the instance and not of the class, because it is that of the effect.
    keeps: frozenset[str] = eqx.field(static=True)  # pyright: ignore
    uniform: bool = eqx.field(static=True)  # pyright: ignore

    def __init__(self, effect: AbstractEffect, factor: Scalar):
        self.effect = effect
        self.factor = factor
        check_types(self, "effect")
        self.keeps = effect.keeps
        self.uniform = effect.uniform

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        return jax.tree.map(lambda x: self.factor * x, self.effect.load(t, y, body))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        energy = self.effect.potential(t, y, body)
        return None if energy is None else self.factor * energy

    def constrained(self, t: Scalar, y: BodyState, rate: BodyState) -> BodyState:
        held = self.effect.constrained(t, y, rate)
        if held is rate:
            return rate
        return jax.tree.map(lambda free, guided: free + self.factor * (guided - free), rate, held)

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State] | None:
        # Not scaled: these parts are a state of the effect, and no load.
        return self.effect.start(y, body)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.effect.breaks()

    def switches(self) -> dict[str, str]:
        return self.effect.switches()

    def ground(self) -> Scalar | None:
        return self.effect.ground()

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        return self.effect.limits(t, y, body)

    def outside(self, t: Scalar, y: BodyState, body: AbstractBody) -> Flag | None:
        return self.effect.outside(t, y, body)

"""A vector field whose arguments alone are stored for reverse mode, which computes the rest
again."""

from typing import final

import equinox as eqx

from ..core import AbstractRegularised, AbstractSplit, Scalar, State
from ..solvers.vector_field import ScaledField


@final
class CheckpointedField(eqx.Module):
    """The vector field `field` under `jax.checkpoint`.

    Its intermediate values take longer to write and to read back than to compute, because a step
    holds all of its stages at once. The program that stores none of them also compiles sooner."""

    field: ScaledField

    def __call__(self, s: Scalar, y: State) -> State:
        return eqx.filter_checkpoint(self.field)(s, y)

    def time(self, s: Scalar) -> Scalar:
        return self.field.time(s)

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        return self.field.duration(s, ds)

    def projected(self, s: Scalar, y: State) -> State:
        return self.field.projected(s, y)

    def split(self) -> AbstractSplit:
        return self.field.split()

    def regularised(self) -> AbstractRegularised:
        return self.field.regularised()

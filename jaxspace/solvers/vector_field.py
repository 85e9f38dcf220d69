"""The vector field of a step, in normalised time.

Normalised time s counts segments. The vector field is smooth within a segment and may jump from one
to the next, so that a step evaluates it only inside of the segment.
"""

from typing import NamedTuple, Protocol, final, runtime_checkable

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..core import AbstractRegularised, AbstractSplit, Scalar, State
from ..core.barrier import barrier
from ..core.groups import project
from ..core.jit import quick_jit


@runtime_checkable
class ScaledField(Protocol):
    """The `args` of a step: the vector field in normalised time, and the parts of it.

    Most methods only evaluate it. Methods that integrate with a capability of the system use the
    capability, which expects times and durations in seconds."""

    def __call__(self, s: Scalar, y: State) -> State:
        """dy/ds at the normalised time `s`."""
        ...

    def time(self, s: Scalar) -> Scalar:
        """The time, s, at the normalised time `s`."""
        ...

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        """The duration, s, of the normalised time `ds` from `s` on."""
        ...

    def projected(self, s: Scalar, y: State) -> State:
        """The state nearest to `y` on its groups that meets the constraints of the system."""
        ...

    def split(self) -> AbstractSplit:
        """Drift and kick of the system."""
        ...

    def regularised(self) -> AbstractRegularised:
        """The motion of the system in regularised variables."""
        ...


@quick_jit
def evaluate(terms: diffrax.AbstractTerm, t: Scalar, y: State, args: PyTree) -> State:
    """The vector field at one stage.

    All stages of a step share one trace of it."""
    # Without the first barrier the compiler would repeat the sum of the stages in every output of
    # the vector field, without the second one the vector field in every reader.
    return barrier(terms.vf(t, barrier(y), args))


@quick_jit
def _field(t: Scalar, y: State, field: ScaledField) -> State:
    """The vector field, traced once for all evaluations in a program."""
    return field(t, y)


TERM: diffrax.ODETerm = diffrax.ODETerm(_field)  # pyright: ignore[reportArgumentType]
"""The vector field in the form of diffrax; the field itself is the argument `args` of every
step."""


@final
class StepField(NamedTuple):
    """The vector field dy/dt = f(t, y) during one step, as diffrax passes it to a solver.

    - `made_jump`: whether it may have jumped at the start of the step, so that earlier evaluations
      belong to another vector field."""

    terms: diffrax.AbstractTerm
    args: PyTree
    made_jump: Bool[Array, "*runs"] | bool

    def __call__(self, t: Scalar, y: State) -> State:
        return evaluate(self.terms, t, y, self.args)

    def projected(self, t: Scalar, y: State) -> State:
        """The state at the end `t` of a step, projected on its groups and constraints, so that it
        does not drift from them in a long run."""
        # Other `args` come from a user of diffrax, or from local coordinates.
        return self.args.projected(t, y) if isinstance(self.args, ScaledField) else project(y)


def just_before(t0: Float[Array, ""], t1: Float[Array, ""]) -> Float[Array, ""]:
    """The time a few roundings before the end of the step from `t0` to `t1`.

    A vector field that jumps at `t1` is evaluated there on the side of the step."""
    return t1 - 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(t1), t1 - t0)


@final
class FieldOfStep(eqx.Module):
    """The vector field `field` during a step that ends at `end`, just after `latest`.

    For methods that evaluate the field at the very end of a step, where the next segment begins:
    there the field may jump, and normalised time changes its unit. A stage beyond the end is left
    there: it is part of the method."""

    field: ScaledField
    latest: Float[Array, ""]
    end: Float[Array, ""]

    def __call__(self, s: Scalar, y: State) -> State:
        return self.field(self._inside(s), y)

    def time(self, s: Scalar) -> Scalar:
        return self.field.time(self._inside(s))

    def _inside(self, s: Scalar) -> Scalar:
        # A stage at the end may miss it by some roundings.
        at_end = (s > self.latest) & (s - self.end <= self.end - self.latest)
        return jnp.where(at_end, self.latest, s)

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        return self.field.duration(s, ds)

    def projected(self, s: Scalar, y: State) -> State:
        return self.field.projected(s, y)

    def split(self) -> AbstractSplit:
        return self.field.split()

    def regularised(self) -> AbstractRegularised:
        return self.field.regularised()

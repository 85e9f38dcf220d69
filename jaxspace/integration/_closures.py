"""A vector field whose arrays are all leaves, those that its functions close over included.

A function in a system may close over an array that is being differentiated, as a user's effect
within a loss function does. A custom rule for derivatives sees only the leaves of its arguments, so
that such arrays are made leaves first.
"""

from collections.abc import Callable
from typing import Literal, final

import equinox as eqx
import jax
from jaxtyping import Array

from ..core import AbstractRegularised, AbstractSplit, Scalar, State
from ..solvers.vector_field import ScaledField


@final
class _Split(AbstractSplit):
    of_drift: Callable[[Scalar, State], State]
    of_kick: Callable[[Scalar, Scalar, State], State]

    def drift(self, duration: Scalar, y: State) -> State:
        return self.of_drift(duration, y)

    def kick(self, t: Scalar, duration: Scalar, y: State) -> State:
        return self.of_kick(t, duration, y)


@final
class _Regularised(AbstractRegularised):
    to: Callable[[State], Array]
    back: Callable[[Array], State]
    of_perturbation: Callable[[Scalar, Array], Array]
    of_derivative: Callable[[Array, Array], Array]
    of_time: Callable[[Scalar, Array], Scalar]
    of_size: Callable[[Array, Array, Array], Scalar]

    def to_regularised(self, y: State) -> Array:
        return self.to(y)

    def from_regularised(self, z: Array) -> State:
        return self.back(z)

    def perturbation(self, t: Scalar, z: Array) -> Array:
        return self.of_perturbation(t, z)

    def derivative(self, z: Array, perturbation: Array) -> Array:
        return self.of_derivative(z, perturbation)

    def fictitious_time(self, duration: Scalar, z: Array) -> Scalar:
        return self.of_time(duration, z)

    def size(self, x: Array, z0: Array, z1: Array) -> Scalar:
        return self.of_size(x, z0, z1)


@final
class _Field(eqx.Module):
    rate: Callable[[Scalar, State], State]
    of_time: Callable[[Scalar], Scalar]
    of_duration: Callable[[Scalar, Scalar], Scalar]
    of_projection: Callable[[Scalar, State], State]
    capability: AbstractSplit | AbstractRegularised | None

    def __call__(self, s: Scalar, y: State) -> State:
        return self.rate(s, y)

    def time(self, s: Scalar) -> Scalar:
        return self.of_time(s)

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        return self.of_duration(s, ds)

    def projected(self, s: Scalar, y: State) -> State:
        return self.of_projection(s, y)

    def split(self) -> AbstractSplit:
        assert isinstance(self.capability, AbstractSplit)
        return self.capability

    def regularised(self) -> AbstractRegularised:
        assert isinstance(self.capability, AbstractRegularised)
        return self.capability


def closures_as_leaves(
    field: ScaledField, needs: Literal["", "split", "regularised"], s: Array, y0: State
) -> ScaledField:
    """The vector field with all arrays that it closes over as leaves.

    **Arguments**

    - `field`: the vector field in normalised time.
    - `needs`: the capability by which the method integrates (`SolverTraits.needs`); the result
      has no other.
    - `s`, `y0`: a normalised time and a state, for their shapes.
    """
    # Only what the method evaluates is converted, because each conversion is a trace.
    convert = eqx.filter_closure_convert
    t = jax.eval_shape(field.time, s)
    # Shapes are enough: nothing is computed until the loop runs.
    duration = jax.eval_shape(field.duration, s, s)
    capability = None
    if needs == "split":
        split = field.split()
        capability = _Split(
            convert(split.drift, duration, y0), convert(split.kick, t, duration, y0)
        )
    elif needs == "regularised":
        form = field.regularised()
        z = jax.eval_shape(form.to_regularised, y0)
        # The last variable is the time of each run, also where all runs share a segment.
        duration_of_run = jax.eval_shape(lambda z: z[-1], z)
        t_of_run = jax.eval_shape(lambda t, z: t + z[-1], t, z)
        perturbation = jax.eval_shape(form.perturbation, t_of_run, z)
        capability = _Regularised(
            to=convert(form.to_regularised, y0),
            back=convert(form.from_regularised, z),
            of_perturbation=convert(form.perturbation, t_of_run, z),
            of_derivative=convert(form.derivative, z, perturbation),
            of_time=convert(form.fictitious_time, duration_of_run, z),
            of_size=convert(form.size, z, z, z),
        )
    return _Field(
        convert(field, s, y0),
        convert(field.time, s),
        convert(field.duration, s, s),
        convert(field.projected, s, y0),
        capability,
    )

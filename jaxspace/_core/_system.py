"""The one noun of the library: what moves, and what its exact motion keeps."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float

from ._types import Scalar, State


class AbstractSystem(eqx.Module):
    """A dynamical system: its fields are its physical parameters, every one a leaf that may carry runs on its last axis.

    A concrete system is final. Its state is a small `equinox.Module` with named fields; the components of a field lead and the
    runs trail, and the derivative has the type of the state."""

    @abstractmethod
    def vector_field(self, t: Scalar, y: State) -> State:
        """The rate of change of the state `y` at the time `t`, s; of the same type as `y`."""

    @abstractmethod
    def invariants(self, t: Scalar, y: State) -> dict[str, Array]:
        """What the exact motion keeps constant, by name; `{}` when nothing is kept."""


class AbstractClosedFormSystem(AbstractSystem):
    """A system whose motion is known in closed form."""

    @abstractmethod
    def flow(self, duration: Scalar, y: State) -> State:
        """The exact state a `duration`, s (negative: backwards), after the state `y`."""


class AbstractSplitSystem(AbstractSystem):
    """A system whose vector field is the sum of two that are each known in closed form: a drift and a kick."""

    @abstractmethod
    def drift(self, duration: Scalar, y: State) -> State:
        """The exact state a `duration`, s (negative: backwards), after `y` under the first part alone.

        Raises `InputError` if the system has no such part."""

    @abstractmethod
    def kick(self, t: Scalar, duration: Scalar, y: State) -> State:
        """The exact state a `duration`, s, after `y` under the rest alone, as it is at the time `t`, s."""


class AbstractRegularForm(eqx.Module):
    """A motion in regular variables z, one array with the components first, over a fictitious time sigma in which it is smooth
    where it is fast or singular in time. The last component of z is the time since z was made from a state."""

    @abstractmethod
    def enter(self, y: State) -> Array:
        """The regular variables of the state `y`."""

    @abstractmethod
    def leave(self, z: Array) -> State:
        """The state of the regular variables."""

    @abstractmethod
    def push(self, t: Scalar, z: Array) -> Array:
        """The perturbation at the time `t`, s, as `slope` takes it."""

    @abstractmethod
    def slope(self, z: Array, push: Array) -> Array:
        """dz/d(sigma); its last component is dt/d(sigma)."""

    @abstractmethod
    def span(self, duration: Scalar, z: Array) -> Scalar:
        """About how much fictitious time a `duration`, s (negative: backwards), takes from `z` on: exact without perturbation."""


class AbstractRegularisedSystem(AbstractSystem):
    """A system that can also be seen in regular variables."""

    @abstractmethod
    def regular_form(self) -> AbstractRegularForm:
        """The same motion in regular variables. Raises `InputError` if the system has none."""


class AbstractPiecewiseSystem(AbstractSystem):
    """A system whose vector field is smooth only between known times."""

    @abstractmethod
    def breaks(self) -> Float[Array, "times *#runs"]:
        """The times, s, on which every integration has to land: there the vector field or a derivative of it jumps."""

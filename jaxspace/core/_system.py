"""The interface of a system: its vector field, its invariants, and its capabilities.

Every system has a `vector_field` and `invariants`. Its capabilities are values: `closed_form()`,
`decoupled()`, `split()`, `regularised()` and `breaks()` return an object, or `None` where there is
none. Because they are values and not base classes, a scene can compose them from those of its
effects.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .limits import Limit, any_passed
from .printing import printed
from .quantities import AbstractParameters
from .structure import HashedModule
from .types import Flag, Scalar, State


@printed()
class RunWarning(NamedTuple):
    """A probable mistake in finished runs.

    - `words`: a message about it.
    - `runs`: the runs concerned, (*runs,)."""

    words: str
    runs: Bool[np.ndarray, "*runs"]


class AbstractClosedForm(HashedModule):
    """The exact motion of a system."""

    @abstractmethod
    def flow(self, duration: Scalar, y: State) -> State:
        """The exact state a `duration`, s (negative: backwards), after the state `y`."""

    def outside(self, duration: Scalar, y: State) -> Flag | None:
        """Whether a motion of this `duration`, s, from `y` on leaves the range of validity of the
        closed form, as by a collision, for each run; `None` where none does."""
        del duration, y
        return None

    @property
    def range_of_validity(self) -> str:
        """What a motion outside of the range has done, in words, for the message of its run."""
        return ""


class AbstractSplit(HashedModule):
    """A vector field as the sum of two, a drift and a kick, whose motions are known exactly."""

    @abstractmethod
    def drift(self, duration: Scalar, y: State) -> State:
        """The exact state a `duration`, s (negative: backwards), after `y`, due to the drift
        only."""

    @abstractmethod
    def kick(self, t: Scalar, duration: Scalar, y: State) -> State:
        """The exact state a `duration`, s, after `y`, due to the kick only, frozen at time `t`,
        s."""


class AbstractRegularised(HashedModule):
    """A motion in regularised variables z over a fictitious time sigma.

    z is one array with the components first. The motion is smooth in sigma where it is fast or
    singular in time. The last component of z is the time, s, since z was made from a state."""

    @property
    def attraction(self) -> Scalar | None:
        """The gravitational parameter of the central body, m^3/s^2, from which the method "auto"
        computes the eccentricity. `None`, the default, where there is no such point."""
        return None

    @abstractmethod
    def to_regularised(self, y: State) -> Array:
        """The regularised variables of the state `y`."""

    @abstractmethod
    def from_regularised(self, z: Array) -> State:
        """The state of the regularised variables `z`."""

    @abstractmethod
    def perturbation(self, t: Scalar, z: Array) -> Array:
        """The perturbation at the time `t`, s, in the form of `derivative`."""

    @abstractmethod
    def derivative(self, z: Array, perturbation: Array) -> Array:
        """dz/d(sigma); its last component is dt/d(sigma)."""

    @abstractmethod
    def fictitious_time(self, duration: Scalar, z: Array) -> Scalar:
        """The fictitious time of a `duration`, s (negative: backwards), from `z` on: exact without
        perturbation, approximate with one."""

    def step_scale(self, sigma: Scalar, z: Array) -> Scalar:
        """A positive number in proportion to which steps may be chosen, about a fictitious time
        `sigma` after `z`: the distance from a centre, for example.

        By default one, for a general motion."""
        # The product has the shape of the times and of the runs.
        return jnp.ones_like(sigma * z[0])

    def size(self, x: Array, z0: Array, z1: Array) -> Scalar:
        """The norm of a change `x` of the variables, in proportion to those before and after a
        step.

        By default the norm of all but the time, which have one unit."""

        def squared(x: Array) -> Scalar:
            return jnp.sum(x[:-1] * x[:-1], axis=0)

        # Relative to the greater of both, because the variables may pass close to zero at one of
        # the ends.
        return jnp.sqrt(squared(x) / jnp.maximum(squared(z0), squared(z1)))

    def second_order(self, z: jax.ShapeDtypeStruct) -> "AbstractSecondOrderForm | None":
        """The same motion in variables whose second derivatives depend on these variables only, or
        `None`; for runs of the shape of `z`."""
        del z
        return None


class AbstractSecondOrderForm(AbstractRegularised):
    """Regularised variables z = (q, q', c, t) with q'' = f(q, c) and constant c.

    The time is a function of the variables, and a quadrature for the rest:
    t = T(q, q') + integral of g(q) d(sigma)."""

    @abstractmethod
    def held(self, z: Array) -> Array:
        """The constants of `rates` and `known_time` along a step from `z`."""

    @abstractmethod
    def rates(self, q: Array, held: Array) -> tuple[Array, Scalar]:
        """q'' and g."""

    @abstractmethod
    def known_time(self, q: Array, dq: Array, held: Array) -> Scalar:
        """T, from q and q'; zero where g is all of dt/d(sigma)."""

    @abstractmethod
    def clock(self, q: Array) -> Scalar:
        """dt/d(sigma)."""


class AbstractDecoupled(HashedModule):
    """A motion of which one part is known exactly, and on which the rest does not depend."""

    @property
    @abstractmethod
    def rest(self) -> "AbstractSystem":
        """The system of the rest."""

    @abstractmethod
    def rest_of(self, y: State) -> State:
        """The state of the rest, from the whole state `y`."""

    @abstractmethod
    def joined(self, duration: Scalar, y: State, rest: State) -> State:
        """The whole state a `duration`, s (negative: backwards), after the whole state `y`, from
        that of the rest there."""

    @abstractmethod
    def turns(self, duration: Scalar, y: State) -> Scalar:
        """Approximate angle, rad, through which the exact part turns in a `duration`, s, from `y`
        on, (*runs,), which steps would have to resolve."""


class AbstractSystem(AbstractParameters):
    """A dynamical system: its fields are its physical parameters.

    Every parameter is a leaf that may carry runs on its last axis, as its annotation declares
    (`*runs`). A concrete system is final. Its state is a small `equinox.Module` with named fields;
    the components of a field come first and the batch axes last, and the derivative has the type of
    the state.

    `vector_field` and `invariants` have no default, because an author must decide what is
    conserved. The capabilities have one, `None`, so that a system names only those it has."""

    @abstractmethod
    def vector_field(self, t: Scalar, y: State) -> State:
        """The derivative of the state `y` at the time `t`, s; of the same type as `y`."""

    @abstractmethod
    def invariants(self, t: Scalar, y: State) -> dict[str, Array]:
        """The invariants of the exact motion, by name; `{}` when nothing is conserved."""

    def started_at(self, t0: Scalar) -> "AbstractSystem":
        """The system in a phase of a mission that starts at the time `t0`, s: with the times of the
        mission in place of those that count from there. By default nothing counts from there."""
        del t0
        return self

    def closed_form(self) -> AbstractClosedForm | None:
        """The exact motion, or `None`."""
        return None

    def decoupled(self) -> AbstractDecoupled | None:
        """An exact part of the motion and the rest, or `None`."""
        return None

    def split(self) -> AbstractSplit | None:
        """Drift and kick, or `None`."""
        return None

    def regularised(self) -> AbstractRegularised | None:
        """The motion in regularised variables, or `None`."""
        return None

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        """Times, s, at which the vector field or a derivative of it jumps, or `None`.

        Every integration lands a step on each of them."""
        return None

    def switches(self) -> dict[str, str]:
        """The parts of the state at whose thresholds the vector field is discontinuous, other than
        at `breaks`, by the name of the parameter.

        Derivatives of a run over such a jump need an event there; without one `simulate` warns."""
        return {}

    def projected(self, t: Scalar, y: State) -> State | None:
        """The state nearest to `y` that meets the constraints of the system, or `None` where it
        has none.

        Every step of the integrators of this package ends on it, and so does every state saved
        within a step: `y` is off it by the error of a step."""
        del t, y
        return None

    def limits(self, t: Scalar, y: State) -> Sequence[Limit]:
        """The limits of the range of the model at the time `t`, s, and the state `y`, such as the
        dry mass as the least mass; none by default. Their quantities are named in the message of a
        run that leaves the range."""
        del t, y
        return ()

    def outside(self, t: Scalar, y: State) -> Flag | None:
        """Whether the state `y` is outside the range of the model, for each run: by default beyond
        one of its `limits`; `None` where every state is inside.

        Asked of every saved state and of that at the end of each step. The run then has the status
        `OUTSIDE_MODEL`, also where the state is inside again later; beyond the event that ends a
        run none is asked. A margin of the rounding and of the tolerance belongs to it, because an
        event may end the run on the boundary."""
        return any_passed(self.limits(t, y))

    def warning(self, ts: Array, states: State, undisturbed: bool) -> RunWarning | None:
        """Probable mistakes in finished runs, such as a path through the ground; `None`, the
        default, where there is none.

        Asked after a run outside of `jit`, of concrete numbers.

        **Arguments**

        - `ts`: the saved times, s, (times,) or (times, *runs); `states`: those there.
        - `undisturbed`: whether nothing but the system moves the state between them, such as a jump
          or a command."""
        del ts, states, undisturbed
        return None

    def check_values(self, t: Scalar, y: State) -> None:
        """Raise `InputError` for contradictions between the numbers of the system and the first
        state `y`, at the time `t`, s. Asked before a run, where no number is traced; `t` is a
        number of NumPy."""
        del t, y

    def missing(self, capability: str) -> str:
        """The reason why `capability` ("split", "regularised", ...) is `None`, as the end of a
        message.

        For error messages; empty where there is nothing to add."""
        # A system without specific reasons: the caller's message is sufficient.
        del capability
        return ""

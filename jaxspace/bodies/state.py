"""The state of a body in a scene: only the parts that the effects of the scene require."""

__all__ = ["PARTS", "sample_state"]

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TypeAlias, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..core import InputError, State, quantity
from ..core.checks import check_positive
from ..core.field_types import shown
from ..core.listed import no_method
from ..core.printing import printed
from ..core.shapes import check_components
from ..core.structure import HashedModule
from ..core.types import as_float
from ..rotations import Quaternion

if TYPE_CHECKING:
    # A part is absent only where no effect reads it, which the scene has checked: for a static
    # type checker every part is there.
    VectorPart: TypeAlias = Any
    ScalarPart: TypeAlias = Any
    AttitudePart: TypeAlias = Any
else:
    VectorPart: TypeAlias = Float[Array, "3 *#runs"] | None
    # A separate name, because in axes of a batch and in shapes the runs of a mass and of a position
    # need not agree.
    ScalarPart: TypeAlias = Float[Array, "*runs_of_mass"] | None
    AttitudePart: TypeAlias = Quaternion | None


def as_part(x: object) -> Any:
    """Plain numbers, and arrays of whole ones, as an array of floats; anything else unchanged,
    because a state is also built from batch axes, which are integers, and from shapes."""
    plain = isinstance(x, float | list | tuple)
    whole = isinstance(x, np.ndarray | np.generic | Array) and x.dtype.kind in "iu"
    return as_float(x) if plain or whole else x


@final
@printed()
class BodyState(HashedModule):
    """Position and velocity of the centre of mass, orientation, angular velocity and mass of a
    body; also their rates.

    Vectors are (3, *runs), along a trajectory (3, times, *runs); the mass is (*runs,) or
    (times, *runs). A part that is `None` is absent: it is not a leaf of the pytree, and therefore
    not part of an integration, a batch or a gradient.

    - `parts`: further quantities that effects integrate, by name.

    Raises `InputError` for an array whose first axis does not have the components."""

    position: VectorPart = quantity(
        "m", optional=True, converter=as_part, doc="of the centre of mass, in inertial axes"
    )
    velocity: VectorPart = quantity(
        "m/s", optional=True, converter=as_part, doc="of the centre of mass, in inertial axes"
    )
    attitude: AttitudePart = quantity(
        "", optional=True, converter=as_part, doc="a `Quaternion`, body to inertial"
    )
    omega: VectorPart = quantity(
        "rad/s",
        optional=True,
        converter=as_part,
        doc="angular velocity relative to inertial space, in body axes",
    )
    mass: ScalarPart = quantity("kg", optional=True, converter=as_part, doc="of the body")
    parts: dict[str, State] | None = None

    def __check_init__(self):
        # Only shapes are checked, so that traced states are checked too, at no cost.
        for name in ("position", "velocity", "omega"):
            check_components(f"BodyState.{name}", getattr(self, name), 3)
        if isinstance(self.attitude, Quaternion):
            check_components("BodyState.attitude", self.attitude.wxyz, 4)
        elif isinstance(self.attitude, Array | np.ndarray):
            raise InputError(
                f"BodyState.attitude is {shown(self.attitude)}: it must be a Quaternion, such as "
                "Quaternion([w, x, y, z]) or rotations.from_euler_angles(angles)."
            )

    def check_start(self) -> None:
        """Raise `InputError` for concrete numbers that no initial state can have: a mass that is
        not positive, a quaternion of zeros."""
        check_positive("BodyState.mass", self.mass)
        if isinstance(self.attitude, Quaternion):
            self.attitude.check_start()

    def part(self, name: str) -> PyTree:
        """The extra part of this name. Raises `InputError` where the state does not have it."""
        if self.parts is None or name not in self.parts:
            raise InputError(
                f"The state has no part {name!r}: Scene.start adds the parts that the effects "
                "integrate."
            )
        return self.parts[name]

    @property
    @no_method
    def present(self) -> tuple[str, ...]:
        """The names of the parts of this state."""
        return tuple(name for name in PARTS if getattr(self, name) is not None)


PARTS = ("position", "velocity", "attitude", "omega", "mass", "parts")


def sample_state(parts: Iterable[str]) -> BodyState:
    """A state with these `parts`, all ones, for shapes and operation counts."""
    vector = jnp.ones(3)
    # Ones and not zeros: a vector field may divide by a distance or a mass.
    every = BodyState(vector, vector, Quaternion(jnp.ones(4)), vector, jnp.ones(()), {})
    return BodyState(**{part: getattr(every, part) for part in parts})

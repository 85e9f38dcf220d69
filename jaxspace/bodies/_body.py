"""Mass, centre of mass and inertia of a body, constant or changing with the remaining mass.

    J(m) = J_d + m_p diag(k^2) + m_d m_p / m d^2 diag(1, 1, 0)          m_p = m - m_d

    symbol  meaning                                                          unit
    m, m_d  mass, dry mass                                                   kg
    m_p     remaining propellant                                             kg
    J_d     inertia of the dry body about its own centre of mass             kg m^2
    k       radii of gyration of the propellant about its centre             m
    d       distance of the propellant's centre from the dry centre, along z m

Source: Thomson 5.5 (parallel axes), 7.9 (rocket with constant radii of gyration).

The propellant's centre and radii of gyration are constant: exact for a grain that burns evenly over
its length. The position of the state is the centre of mass.
"""

from abc import abstractmethod
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractParameters, NumberField, OptionalNumberField, Scalar, Vector, quantity
from ..core.shapes import with_rank
from ..core.vectors import axis
from .inertia import AbstractInertia, as_inertia


def _as_optional_inertia(x: object) -> AbstractInertia | None:
    return None if x is None else as_inertia(x)


class AbstractBody(AbstractParameters):
    """Mass properties as functions of the remaining mass.

    Shapes: masses (*runs,), vectors (3, *runs). `None` means that the body does not have the
    property."""

    @abstractmethod
    def constant_mass(self) -> Scalar | None:
        """The mass, kg, if it is constant; `None` where it is unknown or a part of the state."""

    @abstractmethod
    def loaded_mass(self) -> Scalar | None:
        """The mass, kg, at the start of a flight; `None` when it is unknown."""

    def least_mass(self) -> Scalar | None:
        """The mass, kg, without propellant; `None` if there is none."""
        return None

    @abstractmethod
    def has_inertia(self) -> bool:
        """Whether the body has an inertia, so that it can rotate."""

    @abstractmethod
    def inertia(self, mass: Scalar | None) -> AbstractInertia:
        """Inertia about the centre of mass, in body axes, when `mass`, kg, is left."""

    @abstractmethod
    def inertia_per_mass(self, mass: Scalar) -> Vector:
        """Diagonal of dJ/dm, m^2, when `mass`, kg, is left."""

    @abstractmethod
    def centre_of_mass(self, mass: Scalar | None) -> Vector | float:
        """Centre of mass in the body's construction axes, m, when `mass`, kg, is left."""


@final
class RigidBody(AbstractBody):
    """A body with constant mass properties: `RigidBody(mass, inertia)`.

    Either may be absent: a point mass needs no inertia, and the mass cancels in motion under
    gravity only.

    - `inertia`: about the centre of mass, kg m^2: three principal moments, a tensor, or an inertia
      object."""

    mass: OptionalNumberField = quantity("kg", positive=True, optional=True, doc="mass")
    moment_of_inertia: AbstractInertia | None = quantity(
        "kg m^2",
        key="inertia",
        optional=True,
        converter=_as_optional_inertia,
        doc="about the centre of mass: three principal moments, a tensor, or an inertia",
    )

    # The argument has the name of the method `inertia`, so that a field of this name cannot exist.
    def __init__(self, mass=None, inertia=None):
        self.mass = mass
        self.moment_of_inertia = inertia

    def constant_mass(self) -> Scalar | None:
        return self.mass

    def loaded_mass(self) -> Scalar | None:
        return self.mass

    def has_inertia(self) -> bool:
        return self.moment_of_inertia is not None

    def inertia(self, mass: Scalar | None) -> AbstractInertia:
        del mass
        assert self.moment_of_inertia is not None
        return self.moment_of_inertia

    def inertia_per_mass(self, mass: Scalar) -> Vector:
        # With the axes of runs of the mass, because the caller multiplies it by components.
        return 0.0 * axis(0, mass)

    def centre_of_mass(self, mass: Scalar | None) -> Vector | float:
        del mass
        return 0.0


@final
class BurningBody(AbstractBody):
    """A body that carries propellant on its z axis; the mass is a part of the state.

    The dry centre of mass is the origin of the construction axes."""

    dry_mass: NumberField = quantity("kg", positive=True, doc="of the body without propellant")
    dry_inertia: AbstractInertia = quantity(
        "kg m^2",
        key="inertia",
        converter=as_inertia,
        doc="about the dry centre of mass: three principal moments, a tensor, or an inertia",
    )
    gyration_radii: Float[Array, "3 *#runs"] = quantity(
        "m", non_negative=True, doc="radii of gyration of the propellant about its centre"
    )
    propellant_station: NumberField = quantity(
        "m", default=0.0, doc="z of the propellant's centre, from the dry centre of mass"
    )
    propellant_mass: OptionalNumberField = quantity(
        "kg",
        positive=True,
        optional=True,
        doc="at the start; the state contains the remaining propellant",
    )

    def constant_mass(self) -> Scalar | None:
        return None

    def loaded_mass(self) -> Scalar | None:
        return None if self.propellant_mass is None else self.dry_mass + self.propellant_mass

    def least_mass(self) -> Scalar | None:
        return self.dry_mass

    def has_inertia(self) -> bool:
        return True

    def inertia(self, mass: Scalar | None) -> AbstractInertia:
        assert mass is not None
        propellant = mass - self.dry_mass
        k = with_rank(self.gyration_radii, jnp.ndim(mass))
        # Parallel axes for two masses about their common centre: the reduced mass times d^2.
        apart = self.dry_mass * propellant / mass * self.propellant_station**2
        return self.dry_inertia.plus_diagonal(propellant * k * k + apart * _transverse(apart))

    def inertia_per_mass(self, mass: Scalar) -> Vector:
        k = with_rank(self.gyration_radii, jnp.ndim(mass))
        # The derivative of the reduced mass by m is (m_d / m)^2.
        apart = (self.dry_mass / mass * self.propellant_station) ** 2
        return k * k + apart * _transverse(apart)

    def centre_of_mass(self, mass: Scalar | None) -> Vector | float:
        assert mass is not None
        z = (1.0 - self.dry_mass / mass) * self.propellant_station
        return z * axis(2, z)


def _transverse(like: Scalar) -> Vector:
    """(1, 1, 0) with the runs and the precision of `like`."""
    return 1.0 - axis(2, jnp.asarray(like))

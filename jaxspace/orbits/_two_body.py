"""Motion of a body of small mass about a fixed attracting centre: the conics of Kepler.

    r'' = -mu r / |r|^3

    symbol  meaning                                     unit
    r       position from the centre                    m
    mu      gravitational parameter G m of the centre   m^3/s^2

Energy, angular momentum and the eccentricity vector are constant; the motion is known in closed
form (`kepler_flow`). For two bodies of comparable mass r leads from one to the other, and mu =
G (m1 + m2).

Source: Thomson 4.6 (reduction to one body), 4.7 (conics).
"""

from typing import final

from jaxtyping import Array

from ..bodies import BodyState
from ..core import AbstractSystem, NumberField, Scalar
from ._kepler_motion import KeplerMotion
from ._lengths import check_place
from ._planet import gravitational_parameter
from .elements import angular_momentum, eccentricity_vector, specific_energy
from .point_gravity import point_gravity


@final
class TwoBody(AbstractSystem):
    """A body about a fixed attracting centre.

    State: `BodyState` with position and velocity only."""

    mu: NumberField = gravitational_parameter()

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        assert y.position is not None
        return BodyState(position=y.velocity, velocity=point_gravity(y.position, self.mu))

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        del t
        assert y.position is not None and y.velocity is not None
        return {
            "energy": specific_energy(y.position, y.velocity, self.mu),
            "angular_momentum": angular_momentum(y.position, y.velocity),
            "eccentricity_vector": eccentricity_vector(y.position, y.velocity, self.mu),
        }

    def check_values(self, t: Scalar, y: BodyState) -> None:
        """Warn of a place deep within a planet with this `mu`, most likely in kilometres."""
        del t
        check_place(y, self.mu)

    def closed_form(self) -> KeplerMotion:
        return KeplerMotion(self.mu)

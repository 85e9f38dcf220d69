"""Deviations of a run from the nominal one at the same place, and elements of its orbit, as
outputs.

    R = r_0/|r_0|,  W = h_0/|h_0|,  S = W x R          axes of the nominal state
    radial, along-track, cross-track = R . d, S . d, W . d,    d = r - r_0

    symbol    meaning                                      unit
    r, r_0    position, and that of the nominal run        m
    h_0       angular momentum per mass, nominal           m^2/s

Source: Vallado, Fundamentals of Astrodynamics and Applications, 4th edition, 3.3.3 (RSW).
"""

__all__ = [
    "along_track_error",
    "argument_of_periapsis",
    "cross_track_error",
    "eccentricity",
    "node_longitude",
    "radial_error",
]


from ..core import Scalar, State, Vector, output
from ..core.formula import AWAY, NOT_ZERO, POSITIVE, formula
from ..core.vectors import cross, dot, norm, unit
from .elements import eccentricity_vector, elements_from_state


@formula
@output("m")
def radial_error(position: Vector, nominal: State) -> Scalar:
    """Difference of the position from that of the `nominal` state along its radius, m.

    **Arguments**

    - `position`: m, (3, *runs).
    - `nominal`: the state of the nominal run."""
    return dot(position - nominal.position, unit(nominal.position))


@formula
@output("m")
def along_track_error(position: Vector, nominal: State) -> Scalar:
    """Difference of the position from that of the `nominal` state in its plane and across its
    radius, m: positive ahead.

    **Arguments**

    - `position`: m, (3, *runs).
    - `nominal`: the state of the nominal run."""
    # Not along the velocity, of which a part is radial: both errors would overlap.
    ahead = cross(cross(nominal.position, nominal.velocity), nominal.position)
    return dot(position - nominal.position, unit(ahead))


@formula
@output("m")
def cross_track_error(position: Vector, nominal: State) -> Scalar:
    """Difference of the position from that of the `nominal` state across its plane, m: positive
    towards its angular momentum.

    **Arguments**

    - `position`: m, (3, *runs).
    - `nominal`: the state of the nominal run."""
    momentum = cross(nominal.position, nominal.velocity)
    return dot(position - nominal.position, unit(momentum))


@formula(position=AWAY, mu=NOT_ZERO)
@output("", mu="planet.mu")
def eccentricity(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Eccentricity of the orbit; on a circle its derivative is zero.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2."""
    return norm(eccentricity_vector(position, velocity, mu))


@formula(position=AWAY, mu=POSITIVE)
@output("rad", mu="planet.mu")
def node_longitude(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Longitude of the ascending node, rad, within (-pi, pi]; zero over the equator.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2."""
    return elements_from_state(position, velocity, mu).node


@formula(position=AWAY, mu=POSITIVE)
@output("rad", mu="planet.mu")
def argument_of_periapsis(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Angle from the ascending node to the periapsis, rad, within (-pi, pi]; zero on a circle.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2."""
    return elements_from_state(position, velocity, mu).argument_of_periapsis

"""Outputs of an orbit, and conditions at which a phase of flight may end."""

__all__ = [
    "altitude",
    "apoapsis",
    "apoapsis_altitude",
    "ascending_node",
    "descending_node",
    "periapsis",
    "periapsis_altitude",
    "radial_speed",
    "speed",
    "speed_error",
    "velocity_error",
]


from ..bodies import BodyState
from ..core import Scalar, State, Vector, event, output
from ..core.formula import AWAY, NOT_NEGATIVE, NOT_ZERO, POSITIVE, formula
from ..core.vectors import dot, norm
from .elements import apoapsis_radius, periapsis_radius


@formula(position=AWAY, mu=NOT_ZERO, radius=POSITIVE)
@output("m", mu="planet.mu", radius="planet.radius")
def periapsis_altitude(position: Vector, velocity: Vector, mu: Scalar, radius: Scalar) -> Scalar:
    """Least height of the orbit, m, above a sphere of the `radius`, m.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2.
    - `radius`: of the sphere, m."""
    return periapsis_radius(position, velocity, mu) - radius


@formula(position=AWAY, mu=NOT_ZERO, radius=POSITIVE)
@output("m", mu="planet.mu", radius="planet.radius")
def apoapsis_altitude(position: Vector, velocity: Vector, mu: Scalar, radius: Scalar) -> Scalar:
    """Greatest height of the orbit, m, above a sphere of the `radius`, m; infinite when it is not
    closed.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2.
    - `radius`: of the sphere, m."""
    return apoapsis_radius(position, velocity, mu) - radius


@formula(radius=NOT_NEGATIVE)
@output("m", radius="planet.radius")
def altitude(position: Vector, radius: Scalar) -> Scalar:
    """Height above a sphere, m.

    **Arguments**

    - `position`: m, (3, *runs).
    - `radius`: of the sphere, m, (*runs,)."""
    return norm(position) - radius


@formula
@output("m/s")
def radial_speed(position: Vector, velocity: Vector) -> Scalar:
    """Rate of the distance from the centre, m/s: zero at an apsis and on a circle.

    **Arguments**

    - `position`: m, (3, *runs).
    - `velocity`: m/s, (3, *runs)."""
    return dot(position, velocity) / norm(position)


@formula
@output("m/s")
def speed(velocity: Vector) -> Scalar:
    """Length of the velocity, m/s."""
    return norm(velocity)


@formula
@output("m/s")
def speed_error(velocity: Vector, nominal: State) -> Scalar:
    """Difference of the speed from that of the `nominal` state, m/s.

    **Arguments**

    - `velocity`: m/s, (3, *runs).
    - `nominal`: the state of the nominal run."""
    return norm(velocity) - norm(nominal.velocity)


@formula
@output("m/s")
def velocity_error(velocity: Vector, nominal: State) -> Scalar:
    """Length of the difference of the velocity from that of the `nominal` state, m/s.

    **Arguments**

    - `velocity`: m/s, (3, *runs).
    - `nominal`: the state of the nominal run."""
    return norm(velocity - nominal.velocity)


@formula
@event("m^2/s", direction=1, needs=("position", "velocity"))
def periapsis(t: Scalar, y: BodyState) -> Scalar:
    """r . v, m^2/s: zero at both apsides, and rising at the periapsis.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with a position and a velocity."""
    del t
    # Not the radial speed, which has the same zeros and divides by the distance.
    return dot(y.position, y.velocity)


@formula
@event("m^2/s", direction=-1, needs=("position", "velocity"))
def apoapsis(t: Scalar, y: BodyState) -> Scalar:
    """r . v, m^2/s: zero at both apsides, and falling at the apoapsis.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with a position and a velocity."""
    del t
    return dot(y.position, y.velocity)


@formula
@event("m", direction=1, needs=("position", "velocity"))
def ascending_node(t: Scalar, y: BodyState) -> Scalar:
    """z, m: zero at the nodes, and rising at the ascending one.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with a position."""
    del t
    return y.position[2]


@formula
@event("m", direction=-1, needs=("position", "velocity"))
def descending_node(t: Scalar, y: BodyState) -> Scalar:
    """z, m: zero at the nodes, and falling at the descending one.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with a position."""
    del t
    return y.position[2]

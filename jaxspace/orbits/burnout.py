"""The orbit of a point from its distance, speed and flight-path angle, as at the end of a burn.

    lambda = r v^2 / mu,  p = lambda r cos^2 beta
    e cos f = lambda cos^2 beta - 1,  e sin f = lambda sin beta cos beta
    v^2 = mu (2/r - 1/a),  v_escape^2 = 2 mu / r,  v_circular^2 = mu / r

    symbol  meaning                                                      unit
    r, v    distance from the centre, speed                              m, m/s
    beta    flight-path angle, of the velocity above the horizontal      rad
    f, e    true anomaly, eccentricity                                   rad, 1
    p, a    semi-latus rectum, semi-major axis (negative: hyperbola)     m

Source: Thomson 4.9-4..9, 4.10-1..8.
"""

__all__ = [
    "circular_speed",
    "elements_from_burnout",
    "escape_speed",
    "excess_speed",
    "orbit_from_burnout",
    "vis_viva_speed",
]

import math

import jax.numpy as jnp

from ..core import Scalar, Vector, argument, initial
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.safe import safe_atan2, safe_sqrt
from ..core.squares import quotient
from ..core.types import as_float
from .elements import ClassicalElements, state_from_elements
from .initial import MU


@formula(radius=POSITIVE, mu=POSITIVE)
def circular_speed(radius: Scalar, mu: Scalar) -> Scalar:
    """Speed on a circle about a centre, m/s (Thomson 4.10-1).

    **Arguments**

    - `radius`: m, (*runs,).
    - `mu`: gravitational parameter, m^3/s^2, (*runs,)."""
    return jnp.sqrt(mu / radius)


@formula(radius=POSITIVE)
def escape_speed(radius: Scalar, mu: Scalar) -> Scalar:
    """Least speed, m/s, that does not return from a radius (Thomson 4.10). Zero for a centre that
    repels.

    **Arguments**

    - `radius`: m, (*runs,).
    - `mu`: gravitational parameter, m^3/s^2, (*runs,)."""
    repels = as_float(mu) < 0.0
    return jnp.where(repels, 0.0, jnp.sqrt(jnp.where(repels, 1.0, 2.0 * mu / radius)))


@formula(radius=POSITIVE, speed=NOT_NEGATIVE)
def excess_speed(radius: Scalar, speed: Scalar, mu: Scalar) -> Scalar:
    """Speed at infinity after an escape, m/s. NaN below the escape speed (Thomson 4.7,
    4.10).

    **Arguments**

    - `radius`: m, (*runs,), and `speed`: there, m/s.
    - `mu`: gravitational parameter, m^3/s^2; negative for a centre that repels."""
    attracts = as_float(mu) > 0.0
    escape = escape_speed(radius, jnp.where(attracts, mu, 1.0))
    # As a product, because a difference of squares loses digits close to the escape speed.
    left = (speed - escape) * (speed + escape)
    return jnp.sqrt(jnp.where(attracts, left, speed * speed - 2.0 * mu / radius))


@formula(radius=POSITIVE, mu=POSITIVE)
def vis_viva_speed(radius: Scalar, semi_major_axis: Scalar, mu: Scalar) -> Scalar:
    """Speed at a distance from the centre (Thomson 4.9).

    **Arguments**, each (*runs,)

    - `radius`: m.
    - `semi_major_axis`: m; negative for a hyperbola, infinite for a parabola.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the speed, m/s; NaN where the orbit does not reach the radius.
    """
    return jnp.sqrt(mu * (2.0 / radius - 1.0 / as_float(semi_major_axis)))


@formula(radius=POSITIVE, speed=NOT_NEGATIVE, mu=POSITIVE)
def elements_from_burnout(
    radius: Scalar, speed: Scalar, flight_path_angle: Scalar, mu: Scalar
) -> ClassicalElements:
    """Size, shape and true anomaly of an orbit from its burnout data (Thomson 4.9).

    **Arguments**, each (*runs,)

    - `radius`: distance from the centre, m.
    - `speed`: m/s; `flight_path_angle`: of the velocity above the horizontal, rad.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the elements in the plane z = 0, with the burnout on the x axis. On a circle the
    true anomaly, and the derivatives of eccentricity and anomaly, are zero.

    **Raises** `InputError` for a velocity straight up or down.
    """
    r = as_float(radius)
    lam = quotient(r * speed * speed, mu)
    s, c = jnp.sin(flight_path_angle), jnp.cos(flight_path_angle)
    # As components, because their angle is right in every quadrant.
    cosine = lam * c * c - 1.0
    sine = lam * s * c
    f = safe_atan2(sine, cosine)
    zero = 0.0 * f
    return ClassicalElements(
        lam * c * c * r, safe_sqrt(cosine * cosine + sine * sine), zero, zero, -f, f
    )


@formula
@initial(
    "orbit",
    gives=("position", "velocity"),
    burnout_radius=argument("m", positive=True, doc="distance from the centre at burnout"),
    burnout_speed=argument("m/s", positive=True, doc="speed at burnout"),
    flight_path_angle=argument(
        "rad",
        low=-math.pi,
        high=math.pi,
        default=0.0,
        doc="angle of the velocity at burnout above the horizontal",
    ),
    inclination=argument(
        "rad", low=-math.pi, high=math.pi, default=0.0, doc="angle from the z axis to r x v"
    ),
    node=argument("rad", default=0.0, doc="longitude of the ascending node"),
    argument_of_latitude=argument(
        "rad", default=0.0, doc="angle from the ascending node to the place of burnout"
    ),
    mu=MU,
)
def orbit_from_burnout(
    burnout_radius: Scalar,
    burnout_speed: Scalar,
    mu: Scalar,
    flight_path_angle: Scalar = 0.0,
    inclination: Scalar = 0.0,
    node: Scalar = 0.0,
    argument_of_latitude: Scalar = 0.0,
) -> tuple[Vector, Vector]:
    """Position and velocity at burnout, from distance, speed and flight-path angle.

    **Arguments**

    - `burnout_radius`, m; `burnout_speed`, m/s; `mu`, m^3/s^2.
    - `flight_path_angle`: of the velocity above the horizontal, rad.
    - `inclination`, `node`, `argument_of_latitude`: of the plane and of the place in it, rad.

    **Returns** position, m, and velocity, m/s, each (3, *runs).

    **Raises** `InputError` for a radius, a speed or a parameter that is not positive."""
    # The place is that on a circle, and the velocity follows from its directions there: a vertical
    # velocity then needs no special case.
    r = as_float(burnout_radius)
    zero = 0.0 * r
    circle = ClassicalElements(r, zero, inclination, node, argument_of_latitude, zero)
    position, along = state_from_elements(circle, mu)
    v = as_float(burnout_speed)
    up = v * jnp.sin(flight_path_angle) / r
    level = v * jnp.cos(flight_path_angle) / circular_speed(r, mu)
    return position, up * position + level * along

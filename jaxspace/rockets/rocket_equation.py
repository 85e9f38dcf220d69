"""The rocket equation and the vertical flight of one stage.

    dv = u ln(m_0 / m)                              in free space (7.7-4)
    v  = v_0 + u ln(m_0 / m) - g t                  vertical, constant gravity (8.1-6)
    h  = v_0 t + u t [1 - ln(mu) / (mu - 1)] - g t^2 / 2     constant mass flow (8.1-11)
    H  = r x / (1 - x),  x = v^2 r / (2 g R^2)      coast from the radius r under inverse-square
                                                    gravity (8.1-12)
    H  = v^2 / (2 g)                                coast under constant gravity
    eta = 2 u v / (u^2 + v^2)                       propulsive efficiency (8.1)

    symbol  meaning                            unit
    v       speed of the rocket                m/s
    u       exhaust velocity                   m/s
    m_0, m  mass at ignition, mass now         kg
    mu      mass ratio m_0 / m                 1
    g, R    surface gravity, radius            m/s^2, m

Source: Thomson 7.7-4, 8.1-6, 8.1-11, 8.1-12.
Valid for a constant exhaust velocity and mass flow, without drag.
"""

__all__ = [
    "coast_height",
    "mass_ratio_for",
    "propulsive_efficiency",
    "rocket_equation",
    "vertical_burnout_height",
    "vertical_burnout_velocity",
]

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.types import as_float


@formula(exhaust_velocity=POSITIVE, mass_ratio=POSITIVE)
def rocket_equation(exhaust_velocity: Scalar, mass_ratio: Scalar) -> Scalar:
    """Gain of speed in free space, u ln(m_0 / m), m/s (Thomson 7.7-4).

    **Arguments**

    - `exhaust_velocity`: u, m/s.
    - `mass_ratio`: m_0 / m.

    **Raises** `InputError` where one of them is not positive.
    """
    return exhaust_velocity * jnp.log(mass_ratio)


@formula(exhaust_velocity=POSITIVE)
def mass_ratio_for(exhaust_velocity: Scalar, velocity_gain: Scalar) -> Scalar:
    """Mass ratio m_0 / m that gives a gain of speed in free space (Thomson 7.7-4).

    **Arguments**

    - `exhaust_velocity`: u, m/s.
    - `velocity_gain`: m/s.

    **Raises** `InputError` for an exhaust velocity that is not positive.
    """
    return jnp.exp(velocity_gain / exhaust_velocity)


@formula(
    exhaust_velocity=POSITIVE, mass_ratio=POSITIVE, burn_time=NOT_NEGATIVE, gravity=NOT_NEGATIVE
)
def vertical_burnout_velocity(
    exhaust_velocity: Scalar,
    mass_ratio: Scalar,
    burn_time: Scalar,
    gravity: Scalar,
    start: Scalar = 0.0,
) -> Scalar:
    """Speed at burnout of a vertical flight, m/s (Thomson 8.1-6).

    **Arguments**

    - `exhaust_velocity`: m/s.
    - `mass_ratio`: mass at ignition over mass at burnout.
    - `burn_time`: s.
    - `gravity`: m/s^2.
    - `start`: speed at ignition, m/s.

    **Raises** `InputError` for a mass ratio or an exhaust velocity that is not positive.
    """
    return start + rocket_equation(exhaust_velocity, mass_ratio) - gravity * burn_time


@formula(
    exhaust_velocity=POSITIVE, mass_ratio=POSITIVE, burn_time=NOT_NEGATIVE, gravity=NOT_NEGATIVE
)
def vertical_burnout_height(
    exhaust_velocity: Scalar,
    mass_ratio: Scalar,
    burn_time: Scalar,
    gravity: Scalar,
    start: Scalar = 0.0,
) -> Scalar:
    """Height gained at burnout of a vertical flight, m (Thomson 8.1-11).

    **Arguments**

    - `exhaust_velocity`, `mass_ratio`, `burn_time`, `gravity`, `start`: as in
      `vertical_burnout_velocity`; a mass ratio of 1 is allowed."""
    # 1 - ln(mu) / (mu - 1) = z - (1 - z) z^2 (1/3 + z^2/5 + ...), z = (mu - 1) / (mu + 1), near
    # mu = 1, where the difference loses its digits. The 22nd power of z is below rounding, also in
    # slopes.
    e = mass_ratio - 1.0
    small = jnp.abs(e) < 0.25
    s = jnp.where(small, e, 0.0)
    z = s / (2.0 + s)
    series = 0.0
    for n in range(21, 1, -2):
        series = 1.0 / n + z * z * series
    closed = 1.0 - jnp.log1p(jnp.where(small, 0.0, e)) / jnp.where(small, 1.0, e)
    share = jnp.where(small, z - (1.0 - z) * z * z * series, closed)
    return start * burn_time + exhaust_velocity * burn_time * share - 0.5 * gravity * burn_time**2


@formula(speed=NOT_NEGATIVE, surface_gravity=POSITIVE, radius=POSITIVE)
def coast_height(
    speed: Scalar, height: Scalar, surface_gravity: Scalar, radius: Scalar | None = None
) -> Scalar:
    """Height gained in a vertical coast until rest, m (Thomson 8.1-12); infinite from the speed of
    escape on.

    **Arguments**

    - `speed`: at the start, m/s, upwards.
    - `height`: of the start above the surface, m.
    - `surface_gravity`: g, m/s^2; gravity is g (R / r)^2.
    - `radius`: R, m; without it gravity is constant, and the height of the start plays no role.
    """
    if radius is None:
        # With the runs of the height, as for any radius.
        return speed**2 / (2.0 * surface_gravity) + 0.0 * height
    r = radius + height
    # x is the square of the speed over the square of the speed of escape.
    level = speed**2 / (2.0 * surface_gravity) * (r / radius) ** 2
    x = level / r
    # The branch that is not taken must not divide by zero: its NaN would enter every gradient.
    return jnp.where(x < 1.0, level / jnp.where(x < 1.0, 1.0 - x, 1.0), jnp.inf)


@formula(exhaust_velocity=POSITIVE)
def propulsive_efficiency(speed: Scalar, exhaust_velocity: Scalar) -> Scalar:
    """The share of the power of a jet that moves the rocket, F v / [F v + m' (u - v)^2 / 2] with
    the thrust F = m' u; the rest stays behind as kinetic energy of the exhaust (Thomson 8.1).

    It is 1 at the speed u, at which the exhaust comes to rest, and falls above it.

    **Arguments**

    - `speed`: v, m/s.
    - `exhaust_velocity`: u, m/s.

    **Raises** `InputError` for an exhaust velocity that is not positive.
    """
    # In units of u, so that no square overflows in single precision.
    x = as_float(speed) / exhaust_velocity
    return 2.0 * x / (1.0 + x * x)

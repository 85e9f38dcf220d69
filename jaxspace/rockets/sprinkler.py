"""The sprinkler: arms rotated by the angular momentum of the outflowing water.

    M = m' R (R omega - u sin b)           moment that holds the arms at the rate omega

    symbol  meaning                                                       unit
    m'      mass flow of all nozzles                                      kg/s
    R       distance of the nozzles from the axis                         m
    u       speed of the jet relative to the nozzle                       m/s
    b       angle of the jet from the radius, backwards; 0: radial        rad
    omega   rate of turn                                                  rad/s

Source: Thomson 7.7, problems 7.10-1 and 7.10-2. The water enters along the axis, without swirl.
"""

__all__ = ["sprinkler_moment", "sprinkler_speed"]

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula


@formula(flow=NOT_NEGATIVE, arm=POSITIVE)
def sprinkler_moment(
    flow: Scalar, arm: Scalar, spin_rate: Scalar, jet_speed: Scalar = 0.0, bend: Scalar = 0.0
) -> Scalar:
    """Moment that rotates a sprinkler at a steady rate, N m; negative where the jets would rotate
    it faster (Thomson 7.10-P1).

    **Arguments**

    - `flow`: mass flow of all nozzles, kg/s.
    - `arm`: R, m; `spin_rate`: omega, rad/s.
    - `jet_speed`: u, m/s, and `bend`: b, rad; radial jets need neither.
    """
    return flow * arm * (arm * spin_rate - jet_speed * jnp.sin(bend))


@formula(flow=POSITIVE, arm=POSITIVE, friction=NOT_NEGATIVE)
def sprinkler_speed(
    flow: Scalar, arm: Scalar, jet_speed: Scalar, bend: Scalar, friction: Scalar = 0.0
) -> Scalar:
    """Steady rate of a sprinkler that its jets turn against a moment of friction, rad/s (Thomson
    7.10-P2). A negative result means that friction keeps it at rest.

    **Arguments**

    - `flow`: mass flow of all nozzles, kg/s.
    - `arm`: R, m; `jet_speed`: u, m/s; `bend`: b, rad.
    - `friction`: moment, N m.

    **Raises** `InputError` for a flow or an arm that is not positive.
    """
    return (jet_speed * jnp.sin(bend) - friction / (flow * arm)) / arm

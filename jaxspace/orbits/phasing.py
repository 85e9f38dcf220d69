"""Phasing: a rendezvous within one orbit, with a phasing orbit that returns to the same point.

    T' = T (m - L / T) / k,   a' = a ((m - L/T) / k)^(2/3),   dv = v(r, a') - v(r, a)

    symbol   meaning                                                              unit
    T, a     period and semi-major axis of the orbit; ': of the detour            s, m
    L        time by which the target is ahead                                    s
    m, k     revolutions of the target, counted from the chaser, and of the       1
             chaser on the detour
    r, v     radius of the place of the impulse, speed there                      m, m/s

Source: Thomson 4.16, problems 3 and 4: on a circle L/T = phi/360 and
a'/r = (N - phi/360)^(2/3) (in problem 3 the printed exponent is wrong).
"""

__all__ = ["Phasing", "phasing"]

import math
from typing import NamedTuple

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import POSITIVE, formula
from ..core.printing import printed
from ..core.squares import quotient
from ..core.types import as_float
from .burnout import vis_viva_speed


@printed(semi_major_axis="m", impulse="m/s", duration="s", opposite="m")
class Phasing(NamedTuple):
    """A detour, each (*runs,): its `semi_major_axis`, m; the `impulse` along the velocity that
    begins it and, with the other sign, ends it, m/s; its `duration`, s; the radius of its
    `opposite` apsis, m, where the impulse is at an apsis."""

    semi_major_axis: Scalar
    impulse: Scalar
    duration: Scalar
    opposite: Scalar


@formula(
    radius=POSITIVE,
    semi_major_axis=POSITIVE,
    mu=POSITIVE,
    revolutions=POSITIVE,
    target_revolutions=POSITIVE,
)
def phasing(
    radius: Scalar,
    semi_major_axis: Scalar,
    lead: Scalar,
    mu: Scalar,
    *,
    revolutions: Scalar = 1.0,
    target_revolutions: Scalar | None = None,
) -> Phasing:
    """The phasing orbit after which chaser and target are at the same point of the same orbit.

    **Arguments**, each (*runs,)

    - `radius`: of the place of the impulses, m; `semi_major_axis`: of the orbit, m.
    - `lead`: the time by which the target passes this place before the chaser, s; negative when it
      is behind.
    - `mu`: gravitational parameter, m^3/s^2.
    - `revolutions`: of the chaser on the detour.
    - `target_revolutions`: of the target meanwhile, less its lead; as many by default. With one
      more the detour leads outwards.

    **Returns** a `Phasing`; its impulse is NaN where the detour does not reach the place.
    """
    a = as_float(semi_major_axis)
    turns = revolutions if target_revolutions is None else target_revolutions
    period = 2.0 * math.pi * a * jnp.sqrt(quotient(a, mu))
    # The change of the period and not the period, so that a small lead is accurate.
    longer = ((turns - revolutions) - lead / period) / revolutions
    growth = jnp.expm1(2.0 / 3.0 * jnp.log1p(longer))
    new = a * (1.0 + growth)
    # v'^2 - v^2 = mu (1/a - 1/a').
    speeds = vis_viva_speed(radius, new, mu) + vis_viva_speed(radius, a, mu)
    impulse = mu * growth / (new * speeds)
    return Phasing(new, impulse, (1.0 + longer) * revolutions * period, 2.0 * new - radius)

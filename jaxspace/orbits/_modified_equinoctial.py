"""Modified equinoctial elements: of any conic, regular at the circle and the equator.

    e vector = f F + g G                      f = e cos(omega + I node), g = e sin(omega + I node)
    h = tan(i/2)^I cos(node)                  k = tan(i/2)^I sin(node)
    F = (1 + h^2 - k^2, 2 h k, -2 I k) / s    G = (2 I h k, I (1 - h^2 + k^2), 2 h) / s
    s = 1 + h^2 + k^2                         r = |r| (cos L F + sin L G)
    |r| = p / (1 + f cos L + g sin L)         v = sqrt(mu/p) ((f + cos L) G - (g + sin L) F)

    symbol  meaning                                               unit
    p       semi-latus rectum                                     m
    F, G    unit vectors in the plane of the orbit, 90 deg apart  1
    L       true longitude, from F                                rad
    I       1; -1 for retrograde elements                         1

Source: Walker, Ireland and Owens (1985), Celestial Mechanics 36, 409.

They are valid for every conic and regular on circular and equatorial orbits: the round trip from
state to elements and back is the identity, including its derivatives. At i = 180 degrees h and k
are infinite; the retrograde elements are singular at i = 0 instead.
"""

import functools
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..core import AbstractParameters, InputError, NumberField, Scalar, Vector, check, quantity
from ..core.barrier import barrier, computed_once
from ..core.blocks import in_blocks
from ..core.checks import is_concrete
from ..core.squares import quotient
from ..core.trigonometry import atan2, sincos_once
from ..core.types import as_float
from ..core.vectors import dot, norm, scale, unit
from .elements import apoapsis_of_conic, axis_of_conic, constant_vectors


@final
class ModifiedEquinoctialElements(AbstractParameters):
    """Six elements of any conic that is not a straight line, regular at the circle and the equator.

    Raises `InputError` for a longitude beyond the asymptotes of an open orbit."""

    semi_latus_rectum: NumberField = quantity("m", positive=True, doc="p, defined for every conic")
    f: NumberField = quantity("", doc="e cos(argument of periapsis + node)")
    g: NumberField = quantity("", doc="e sin(argument of periapsis + node)")
    h: NumberField = quantity("", doc="tan(i/2) cos(node)")
    k: NumberField = quantity("", doc="tan(i/2) sin(node)")
    true_longitude: NumberField = quantity(
        "rad", doc="L, node + argument of periapsis + true anomaly"
    )
    retrograde: bool = eqx.field(
        static=True,
        default=False,
        metadata={"doc": "retrograde elements: regular at i = 180 deg"},
    )

    def __check_init__(self):
        # The kinds of the numbers come first.
        super().__check_init__()
        values = (self.f, self.g, self.true_longitude)
        if all(is_concrete(x) for x in values):
            f, g, L = (np.asarray(x, float) for x in values)
            # To rounding, for elements that come from a state far out.
            check(
                1.0 + f * np.cos(L) + g * np.sin(L) > -1e-6,
                "ModifiedEquinoctialElements.true_longitude",
                L,
                "between the asymptotes of the open orbit",
            )

    @classmethod
    def of_state(
        cls, position: Vector, velocity: Vector, mu: Scalar, *, retrograde: bool = False
    ) -> "ModifiedEquinoctialElements":
        """The elements of the orbit through a state, with the longitude within (-pi, pi].

        **Arguments**

        - `position`, m, and `velocity`, m/s: (3, *runs).
        - `mu`: gravitational parameter, m^3/s^2, (*runs,).
        - `retrograde`: whether the elements are regular at i = 180 degrees instead of i = 0.

        **Raises** `InputError` for a concrete state at the singular inclination.
        """
        elements = functools.partial(_of_state, retrograde)
        return in_blocks(elements, (1, 1, 0), position, velocity, mu)

    @property
    def eccentricity(self) -> Scalar:
        """Eccentricity of the conic; its derivative is zero on a circle."""
        return norm_of(self.f, self.g)

    @property
    def semi_major_axis(self) -> Scalar:
        """Semi-major axis, m: negative for a hyperbola, infinite for the parabola."""
        return axis_of_conic(self.semi_latus_rectum, self.eccentricity)

    @property
    def periapsis_radius(self) -> Scalar:
        """Least distance from the centre on the whole conic, m."""
        return self.semi_latus_rectum / (1.0 + self.eccentricity)

    @property
    def apoapsis_radius(self) -> Scalar:
        """Greatest distance from the centre, m; infinite on an open orbit."""
        return apoapsis_of_conic(self.semi_latus_rectum, self.eccentricity)

    def state(self, mu: Scalar) -> tuple[Vector, Vector]:
        """Position, m, and velocity, m/s, each (3, *runs), for the parameter `mu`, m^3/s^2."""
        return in_blocks(_state, (0, 0), self, mu)


def norm_of(f: Scalar, g: Scalar) -> Scalar:
    """The eccentricity from its components."""
    return norm(jnp.stack(jnp.broadcast_arrays(f, g, jnp.zeros_like(f))))


def _of_state(
    retrograde: bool, position: Vector, velocity: Vector, mu: Scalar
) -> ModifiedEquinoctialElements:
    momentum, e = constant_vectors(position, velocity, mu)
    h, k = _tilt(momentum, retrograde)
    F, G = orbit_axes(h, k, retrograde)
    longitude = atan2(dot(position, G), dot(position, F))
    p = quotient(dot(momentum, momentum), mu)
    return ModifiedEquinoctialElements(p, dot(e, F), dot(e, G), h, k, longitude, retrograde)


def _state(x: ModifiedEquinoctialElements, mu: Scalar) -> tuple[Vector, Vector]:
    s, c = sincos_once(as_float(x.true_longitude))
    F, G = orbit_axes(x.h, x.k, x.retrograde)
    return state_along(F, G, x.semi_latus_rectum, (x.f, x.g), (c, s), mu)


def state_along(
    F: Vector, G: Vector, p: Scalar, e: tuple[Scalar, Scalar], u: tuple[Scalar, Scalar], mu: Scalar
) -> tuple[Vector, Vector]:
    """The state in the direction `u` of an orbit with the eccentricity vector `e`, both by their
    components along F and G."""
    (f, g), (c, s) = e, u
    r = p / (1.0 + f * c + g * s)
    speed = jnp.sqrt(mu / p)
    x, y, vx, vy = barrier((r * c, r * s, -speed * (g + s), speed * (f + c)))
    return scale(x, F) + scale(y, G), scale(vx, F) + scale(vy, G)


@computed_once
def _tilt(momentum: Vector, retrograde: bool) -> tuple[Scalar, Scalar]:
    """h and k from the angular momentum."""
    w = unit(momentum)
    sense = -1.0 if retrograde else 1.0
    behind, aside = sense * w[2] < 0.0, w[0] * w[0] + w[1] * w[1]
    if is_concrete(w[2]) and np.any(np.asarray(behind & (aside == 0.0))):
        raise InputError(
            f"The inclination is {180 * (not retrograde)} deg, where these elements are infinite: "
            f"use retrograde={not retrograde}."
        )
    # 1/(1 + w_z), close to the inclination at which the elements are singular without the sum.
    per = (1.0 - sense * w[2]) / jnp.where(behind, aside, 1.0)
    per = jnp.where(behind, per, 1.0 / (1.0 + jnp.where(behind, 0.0, sense * w[2])))
    return -w[1] * per, w[0] * per


@computed_once
def orbit_axes(h: Scalar, k: Scalar, retrograde: bool) -> tuple[Vector, Vector]:
    """The unit vectors F and G in the plane of the orbit."""
    sense = -1.0 if retrograde else 1.0
    h, k = jnp.broadcast_arrays(h, k)
    h2 = h * h
    k2 = k * k
    hk = 2.0 * h * k
    per = 1.0 / (1.0 + h2 + k2)
    F = (1.0 + h2 - k2, hk, -2.0 * sense * k)
    G = (sense * hk, sense * (1.0 - h2 + k2), 2.0 * h)
    return scale(per, jnp.stack(F)), scale(per, jnp.stack(G))

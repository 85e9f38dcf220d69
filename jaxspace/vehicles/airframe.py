"""Normal force of the parts of a slender rocket: nose, fins and conical changes of the radius.

    N_k = rho/2 |w| S_k w_perp,   S_k = C_N_alpha A       at the centre of pressure z_k

    nose        S = 2 pi r^2                            z = tip - (L - V/(pi r^2))
    change      S = 2 pi (r_a^2 - r_f^2)                z = fore end - L/3 (1 + 1/(1 + r_f/r_a))
    fins        S = K_n (1 + r/(s + r)) 4 pi s^2/(2 + sqrt(4 + (beta Lambda/cos Gamma)^2))
                z = leading edge - x_s/3 (c_r + 2 c_t)/(c_r + c_t)
                    - (c_r + c_t - c_r c_t/(c_r + c_t))/6
    beta^2 = |1 - M^2|, at least 0.36

    symbol       meaning                                             unit
    w, w_perp    flow past the part, and across the axis             m/s
    r, L, V      radius, length, volume of the nose                  m, m, m^3
    s, c_r, c_t  span of a fin, chords at root and tip               m
    Lambda       aspect ratio of a fin, 2 s^2 over its area          1
    Gamma, x_s   sweep at half chord, sweep length                   rad, m
    K_n          fins that work: n/2, with losses from five on       1

Roll by a cant angle delta, and its damping (strip theory):

    M_z = rho/2 [|w|^2 n k_f (y + r) S_1 delta - |w| omega_z n k_d (2 pi/beta) int c xi^2 dxi]

A vehicle may have several sets of fins and several changes of the radius; their forces add up.

Source: Barrowman, The Practical Calculation of the Aerodynamic Characteristics of Slender Finned
Vehicles, 1967, 3 and 4; Niskanen, OpenRocket technical documentation, 3.2. Valid for small angles
of attack; near Mach 1 the factor beta is held, for want of a theory. The wake of fins on those
behind them is left out.
"""

__all__ = ["prandtl_factor"]

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, TypeAlias, TypeVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..core import (
    AbstractParameters,
    Choice,
    NumberField,
    OptionalNumberField,
    Scalar,
    argument,
    constructor,
    quantity,
)
from ..core.formula import formula
from ..core.square_roots import sqrt
from ..core.types import as_float


@formula
def prandtl_factor(mach: Scalar) -> Scalar:
    """beta = sqrt(|1 - M^2|), held at 0.6 about Mach 1, where linear theory ends."""
    return sqrt(jnp.maximum(jnp.abs(1.0 - mach * mach), 0.36))


class AbstractSurface(AbstractParameters):
    """A part of the airframe that gives a normal force. A concrete surface is final."""

    @abstractmethod
    def slope(self, mach: Scalar) -> Scalar:
        """S = C_N_alpha A, m^2, at a Mach number."""

    @abstractmethod
    def centre(self) -> Scalar:
        """z of the centre of pressure, m, in the construction axes of the body."""


NOSES = ("conical", "ogive", "parabolic", "ellipsoid", "von_karman")


@final
class NoseCone(AbstractSurface):
    """The nose, given by its base, its tip and its centre of pressure."""

    radius: NumberField = quantity("m", positive=True, doc="of the base")
    tip: NumberField = quantity("m", doc="z of the tip in construction axes")
    centre_behind: NumberField = quantity(
        "m", non_negative=True, doc="distance of the centre of pressure behind the tip"
    )

    @classmethod
    @constructor(
        sets=("centre_behind",),
        length=argument("m", positive=True, doc="of the nose"),
        shape=Choice(NOSES, doc="of the nose"),
    )
    def of_shape(cls, radius: Scalar, tip: Scalar, length: Scalar, shape: str) -> "NoseCone":
        """A nose of a known shape.

        **Arguments**

        - `radius`: of the base; `tip`: z of the tip; `length`: m.
        - `shape`: "conical", "ogive" (tangent), "parabolic", "ellipsoid" or "von_karman".
        """
        length, r = as_float(length), as_float(radius)
        # The centre is L - V/(pi r^2) behind the tip, V the volume (Barrowman 3-8).
        shares = {"conical": 2 / 3, "parabolic": 0.5, "ellipsoid": 1 / 3, "von_karman": 0.5}
        share = shares[shape] if shape in shares else 1.0 - _ogive_volume(r, length)
        return cls(r, tip, share * length)

    def slope(self, mach: Scalar) -> Scalar:
        # Slender-body theory knows no Mach number: the zero brings the runs of the flow.
        return 2.0 * np.pi * self.radius * self.radius + 0.0 * mach

    def centre(self) -> Scalar:
        return self.tip - self.centre_behind


def _ogive_volume(r: Scalar, length: Scalar) -> Scalar:
    """Volume of a tangent ogive over that of its cylinder."""
    rho = 0.5 * (r * r + length * length) / r
    # Of the arc of the radius rho that meets the tube without a corner.
    volume = length * (rho * rho - length * length / 3.0)
    volume = volume - rho * rho * (rho - r) * jnp.arcsin(length / rho)
    return volume / (r * r * length)


@final
class RadiusChange(AbstractSurface):
    """A conical tail or shoulder: a change of the body's radius."""

    fore_radius: NumberField = quantity("m", positive=True, doc="at its fore end")
    aft_radius: NumberField = quantity("m", positive=True, doc="at its aft end")
    length: NumberField = quantity("m", positive=True, doc="along the axis")
    fore_end: NumberField = quantity("m", doc="z of its fore end in construction axes")

    def slope(self, mach: Scalar) -> Scalar:
        return 2.0 * np.pi * (self.aft_radius**2 - self.fore_radius**2) + 0.0 * mach

    def centre(self) -> Scalar:
        ratio = self.fore_radius / self.aft_radius
        # (1 - q)/(1 - q^2) is written 1/(1 + q), which is finite for equal radii.
        return self.fore_end - self.length / 3.0 * (1.0 + 1.0 / (1.0 + ratio))


@final
class FinSet(AbstractSurface):
    """Equal trapezoidal fins about the body, evenly spaced."""

    count: NumberField = quantity("", low=2.0, high=8.0, whole=True, fixed=True, doc="of the fins")
    span: NumberField = quantity("m", positive=True, doc="s, of one fin")
    root_chord: NumberField = quantity("m", positive=True, doc="at the body")
    tip_chord: NumberField = quantity("m", non_negative=True, doc="at the tip")
    sweep_length: NumberField = quantity(
        "m", doc="from the leading edge of the root aft to that of the tip"
    )
    radius: NumberField = quantity("m", positive=True, doc="of the body at the fins")
    leading_edge: NumberField = quantity(
        "m", doc="z of the leading edge of the root in construction axes"
    )
    cant: OptionalNumberField = quantity(
        "rad",
        low=-0.5,
        high=0.5,
        optional=True,
        doc="of the fins, positive for a roll about +z; straight by default",
    )

    def single_slope(self, mach: Scalar) -> Scalar:
        """S of an isolated fin, m^2 (Diederich's formula)."""
        mean = 0.5 * (self.root_chord + self.tip_chord)
        # Distance of the middle of the tip chord behind that of the root.
        middle = self.sweep_length + 0.5 * (self.tip_chord - self.root_chord)
        # Aspect ratio over the cosine of the sweep at half chord, with the span taken in.
        wide = 2.0 * jnp.sqrt(self.span**2 + middle**2) / mean
        bent = prandtl_factor(mach) * wide
        # Between slender fins, whose slope has no Mach number, and long ones with 2 pi/beta.
        return 4.0 * np.pi * self.span**2 / (2.0 + jnp.sqrt(4.0 + bent * bent))

    def slope(self, mach: Scalar) -> Scalar:
        n = self.count
        # From five fins on they are in each other's wake (Niskanen 3.2.2).
        # A selection and not a table by index, because the number of fins is a traced float.
        losses = jnp.select(
            [n == 5.0, n == 6.0, n == 7.0, n == 8.0], [2.37, 2.74, 2.99, 3.24], 0.5 * n
        )
        # The flow about the body is faster at the root of a fin, which then gives more force.
        body = 1.0 + self.radius / (self.span + self.radius)
        return losses * body * self.single_slope(mach)

    def centre(self) -> Scalar:
        root, tip = self.root_chord, self.tip_chord
        both = root + tip
        behind = self.sweep_length / 3.0 * (root + 2.0 * tip) / both
        return self.leading_edge - behind - (both - root * tip / both) / 6.0

    def roll_slope(self, mach: Scalar) -> Scalar:
        """Moment about the axis over rho |w|^2/2 and the angle of all fins, m^3."""
        arm = self.span / 3.0 * (self.root_chord + 2.0 * self.tip_chord)
        arm = arm / (self.root_chord + self.tip_chord) + self.radius
        return self.count * self._forcing_share() * arm * self.single_slope(mach)

    def roll_forcing(self, mach: Scalar) -> Scalar | None:
        """Moment about the axis over rho |w|^2/2, m^3; `None` for straight fins."""
        return None if self.cant is None else self.roll_slope(mach) * self.cant

    def roll_damping(self, mach: Scalar) -> Scalar:
        """Moment against the roll over rho |w| omega_z/2, m^4."""
        s = self.span
        r = self.radius
        root = self.root_chord
        tip = self.tip_chord
        # The integral of chord times distance from the axis squared, over the span.
        strips = (root + 3.0 * tip) * s**3 + 4.0 * (root + 2.0 * tip) * r * s**2
        strips = (strips + 6.0 * (root + tip) * s * r**2) / 12.0
        # Each strip meets the flow at omega_z times its distance over |w|, with the slope of a thin
        # plate.
        return self.count * self._damping_share() * 2.0 * np.pi / prandtl_factor(mach) * strips

    def _forcing_share(self) -> Scalar:
        """k_f, interference factor of the body for the roll moment of canted fins (Barrowman
        3-32).

        With a = arcsin((tau^2 - 1)/(tau^2 + 1)), whose cosine is 2 tau/(tau^2 + 1), it is

            k_f = ((tau + 1)/(pi tau))^2 (pi^2/4 + pi f(a) + g(a)),

        in which nothing cancels for fins that are short compared with the radius (tau near 1)."""
        tau = 1.0 + self.span / self.radius
        first, second = _interference(
            jnp.arctan(self.span / self.radius * (tau + 1.0) / (2.0 * tau))
        )
        share = ((tau + 1.0) / (np.pi * tau)) ** 2
        return share * (0.25 * np.pi**2 + np.pi * first + second)

    def _damping_share(self) -> Scalar:
        """k_d, interference factor of the body for the roll damping (Barrowman 3-56), with the
        common factor (tau - 1)^2 of both terms of the fraction divided out."""
        short = self.span / self.radius
        tau = 1.0 + short
        root, tip = self.root_chord, self.tip_chord
        upper = (root - tip) * _log_remainder(short) + tip / tau
        return 1.0 + 6.0 * upper / ((root + 2.0 * tip) * tau + 2.0 * root + tip)


# Below these values the two functions are evaluated by their series.
SMALL_ANGLE, SHORT_SPAN = 0.4, 0.5
# (a - sin(2 a)/2)/a^3 and (a^2 - a sin(2 a) - 2 cos(a)^2 log(cos(a)))/a^4 by powers of a^2.
FIRST = tuple((-1) ** k * 4.0 ** (k + 1) / math.factorial(2 * k + 3) for k in range(10))
SECOND = (
    *(1.0 / 2.0, -1.0 / 18.0, 1.0 / 180.0, 1.0 / 18900.0, 6.46678424456202234e-5),
    *(1.48117608435068753e-5, 4.02948021995641043e-6, 1.13673423491177753e-6),
    *(3.33079663577294729e-7, 1.00635290464072116e-7, 3.11928205464706577e-8),
    *(9.87940927953885597e-9, 3.18722841433881858e-9),
)


def _interference(a: Scalar) -> tuple[Scalar, Scalar]:
    """f = (a - sin(2 a)/2)/sin(a)^2 and g = (a^2 - a sin(2 a) - 2 cos(a)^2 log(cos(a)))/sin(a)^2,
    for 0 < a < pi/2."""
    near = a < SMALL_ANGLE
    # Each branch has an argument at which it is finite, also where the other one is taken.
    x = jnp.where(near, a, 0.5 * SMALL_ANGLE)
    share = (x / jnp.sin(x)) ** 2
    first_near = share * x * _power_series(FIRST, x * x)
    second_near = share * x * x * _power_series(SECOND, x * x)
    x = jnp.where(near, 1.0, a)
    s, c = jnp.sin(x), jnp.cos(x)
    first = (x - s * c) / (s * s)
    second = (x * x - 2.0 * x * s * c - 2.0 * c * c * jnp.log(c)) / (s * s)
    return jnp.where(near, first_near, first), jnp.where(near, second_near, second)


def _log_remainder(x: Scalar) -> Scalar:
    """(x - log(1 + x))/x^2, 1/2 at zero, for x >= 0: with log(1 + x) = 2 artanh(z)."""
    z = x / (2.0 + x)
    near = x < SHORT_SPAN
    small = jnp.where(near, z, 0.0)
    powers = tuple(1.0 / (2 * k + 3) for k in range(14))
    by_series = 0.5 * (1.0 - small) - 0.5 * (1.0 - small) ** 2 * small * _power_series(
        powers, small * small
    )
    large = jnp.where(near, 1.0, x)
    return jnp.where(near, by_series, (large - jnp.log1p(large)) / (large * large))


def _power_series(coefficients: Sequence[float], x: Scalar) -> Scalar:
    """The sum of c_k x^k."""
    total = jnp.zeros_like(x)
    for c in reversed(coefficients):
        total = total * x + c
    return total


# One part or several, of fields that take both.
Fins: TypeAlias = FinSet | tuple[FinSet, ...] | None
RadiusChanges: TypeAlias = RadiusChange | tuple[RadiusChange, ...] | None
Part = TypeVar("Part", bound=AbstractSurface)


def _as_parts(x: object) -> object:
    return tuple(x) if isinstance(x, list) else x


def parts_field(doc: str) -> Any:
    """A field of a vehicle that accepts one part, several or none."""
    return eqx.field(converter=_as_parts, default=None, metadata={"doc": doc})


FINS_DOC = "the fins, of one set or of several"
RADIUS_CHANGES_DOC = "a change of the body's radius, such as a tail or a shoulder, or several"


def several(parts: Part | tuple[Part, ...] | None) -> tuple[Part, ...]:
    """The parts of a field that accepts one, several or none."""
    if parts is None:
        return ()
    return parts if isinstance(parts, tuple) else (parts,)


def surfaces_of(
    nose: NoseCone | None, fins: Fins, tail: RadiusChanges
) -> tuple[AbstractSurface, ...]:
    """All parts that give a normal force."""
    return (*several(nose), *several(fins), *several(tail))


def roll_of(fins: Sequence[FinSet], mach: Scalar) -> tuple[Scalar | None, Scalar | None]:
    """Forcing, m^3, and damping, m^4, of the roll by all sets of fins, as those of `FinSet`; `None`
    without any."""
    forcings = [x for one in fins if (x := one.roll_forcing(mach)) is not None]
    dampings = [one.roll_damping(mach) for one in fins]
    return (
        sum(forcings[1:], forcings[0]) if forcings else None,
        sum(dampings[1:], dampings[0]) if dampings else None,
    )

"""The path of the angular velocity in a free asymmetric body, and how often it closes.

    A > B > C,   P = (B - C)(2TA - h^2),   Q = (A - B)(h^2 - 2TC),   P - Q = (A - C)(2TB - h^2)

    N^2 = max(P, Q) / (ABC),   k^2 = min(P, Q) / max(P, Q),   k'^2 = |P - Q| / max(P, Q)
    period = 4 K / N

For P > Q the polhode circles the axis of least inertia: omega_A ~ cn(Nt), omega_B ~ sn(Nt), omega_C
~ dn(Nt); for P < Q it circles the axis of greatest inertia, and cn and dn change places. P = Q is
the separatrix: an infinite period, and N is the rate of the exponential approach to the turn about
the intermediate axis.

    symbol    meaning                                             unit
    A, B, C   principal moments of inertia, in falling order      kg m^2
    T         kinetic energy                                      J
    h         angular momentum                                    kg m^2/s
    N         argument of the elliptic functions per second       1/s
    k         their modulus                                       1
    2T/h      distance of the invariable plane from the centre    rad/s

Source: Thomson 5.10 (Poinsot), 5.11-5, -9 (elliptic functions), 5.12 (stability). The differences
above are not formed from T and h, but as 2TA - h^2 = (A - B) B omega_B^2 + (A - C) C omega_C^2 and
analogously. Only 2TB - h^2 is a true difference, and near the separatrix it loses digits as the
motion itself does.
"""

__all__ = ["Polhode"]

from typing import NamedTuple, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Vector, check
from ..core.checks import is_concrete
from ..core.elliptic import complete_first
from ..core.listed import no_method
from ..core.printing import printed
from ..core.safe import safe_divide, safe_sqrt
from ..core.squares import unit_factor
from ..core.structure import HashedModule
from ..core.vectors import components, cross, dot, norm


@final
@printed(rate="1/s", vertices="rad/s", plane_distance="rad/s", herpolhode="rad/s")
class Polhode(HashedModule):
    """The closed curve of omega in a free body.

    - `rate`, 1/s: N, the rate of the argument of the elliptic functions.
    - `modulus_squared`: k^2, the squared modulus of the elliptic functions.
    - `complement`: k'^2 = 1 - k^2.
    - `complementary_modulus`: k'. Next to the separatrix it is above zero in float32, where its
      square underflows.
    - `about_least`: whether the curve encircles the axis of least inertia, otherwise that of
      greatest inertia.
    - `vertices`: two points of the polhode, rad/s, body axes, components not negative: where the
      intermediate component vanishes, and where the outer component of the axis not circled does.
      All else of Poinsot's construction follows from them.
    - `plane_distance`: 2T/h, rad/s, of the invariable plane from the centre.
    - `herpolhode`: distances, rad/s, of the two vertices from the foot of that plane's normal."""

    rate: Float[Array, "*#runs"]
    modulus_squared: Float[Array, "*#runs"]
    complement: Float[Array, "*#runs"]
    complementary_modulus: Float[Array, "*#runs"]
    about_least: Bool[Array, "*#runs"]
    vertices: tuple[Float[Array, "3 *#runs"], Float[Array, "3 *#runs"]]
    plane_distance: Float[Array, "*#runs"]
    herpolhode: tuple[Float[Array, "*#runs"], Float[Array, "*#runs"]]

    @classmethod
    def of(cls, moments: Vector, omega: Vector) -> "Polhode":
        """The polhode through `omega`, rad/s, in a body with the principal `moments`, kg m^2, in
        any order.

        Raises `InputError` for a moment of zero: the spin of a rod is not on a polhode."""
        if is_concrete(moments):
            check(np.asarray(moments) > 0.0, "Polhode.of: moments", moments, "positive")
        moments = jnp.stack(
            [moment + jnp.zeros_like(rate) for moment, rate in zip(moments, omega, strict=True)]
        )
        # The polhode of a faster or a heavier body has the same form.
        factor = unit_factor(*components(omega))
        omega = factor * omega
        moments = unit_factor(*components(moments)) * moments
        # The formulas take A > B > C; a body may name its axes in any order, run by run.
        order = jnp.argsort(-moments, axis=0)
        a, b, c = jnp.take_along_axis(moments, order, axis=0)
        rates = jnp.take_along_axis(omega, order, axis=0)
        below, above, middle = _differences((a, b, c), rates)
        p, q = (b - c) * below.value, (a - b) * above.value
        # p - q = (a - c) middle, whose sign is exact next to the separatrix.
        most = jnp.maximum(p, q)
        about_least = middle.scaled > 0.0
        two_t = dot(moments * omega, omega)
        h = norm(moments * omega)
        ends = _vertices((a, b, c), (below, above, middle), about_least)
        # |v x h| / h, because |v|^2 - (2T/h)^2 has no digits near a steady turn.
        near, far = (safe_divide(norm(cross(v, jnp.stack([a, b, c]) * v)), h) for v in ends)
        # The inverse of a permutation is its argsort.
        back = jnp.argsort(order, axis=0)
        first, second = (jnp.take_along_axis(v, back, axis=0) for v in ends)
        # The root of the complement, whose square underflows first.
        root = safe_sqrt(safe_divide((a - c) * jnp.abs(middle.scaled), most)) / middle.factor
        return cls(
            rate=safe_sqrt(most / (a * b * c)) / factor,
            modulus_squared=safe_divide(jnp.minimum(p, q), most),
            complement=jnp.where(
                most == 0.0, 1.0, safe_divide((a - c) * jnp.abs(middle.value), most)
            ),
            complementary_modulus=jnp.where(most == 0.0, 1.0, root),
            about_least=about_least,
            vertices=(first / factor, second / factor),
            plane_distance=safe_divide(two_t, h) / factor,
            herpolhode=(near / factor, far / factor),
        )

    @property
    def period(self) -> Scalar:
        """Time, s, in which omega returns in the body; infinite, with derivatives of zero, on the
        separatrix, about the intermediate axis and in a body with three equal moments."""
        # Of three equal moments the rate vanishes, on the separatrix the complement.
        endless = (self.rate == 0.0) | (self.complementary_modulus == 0.0)
        rate, k = (jnp.where(endless, 1.0, x) for x in (self.rate, self.complementary_modulus))
        # K = R_F(0, k'^2, 1).
        return jnp.where(endless, jnp.inf, 4.0 * complete_first(1.0 + k, k) / rate)

    @property
    @no_method
    def herpolhode_radii(self) -> tuple[Scalar, Scalar]:
        """Distance, rad/s, of the two vertices from the foot of the invariable plane's normal
        (Thomson 5.10-19)."""
        return self.herpolhode


class _Difference(NamedTuple):
    """A sum of squares of two rates, times the squared `factor` that brings them to the size of
    one: in float32 the squares of small rates are zero."""

    scaled: Scalar
    factor: Scalar | float

    @property
    def value(self) -> Scalar:
        return self.scaled / self.factor / self.factor


def _differences(moments: tuple[Scalar, Scalar, Scalar], rates: Vector) -> tuple[_Difference, ...]:
    """2TA - h^2, h^2 - 2TC and 2TB - h^2, in falling order of the moments."""
    a, b, c = moments
    w_a, w_b, w_c = rates

    def of(left: Scalar, w_left: Scalar, right: Scalar, w_right: Scalar) -> _Difference:
        factor = unit_factor(w_left, w_right)
        w_left, w_right = factor * w_left, factor * w_right
        return _Difference(left * w_left * w_left + right * w_right * w_right, factor)

    return (
        of((a - b) * b, w_b, (a - c) * c, w_c),
        of((a - c) * a, w_a, (b - c) * b, w_b),
        of((b - c) * c, w_c, (b - a) * a, w_a),
    )


def _vertices(moments, differences, about_least) -> tuple[Vector, Vector]:
    """The polhode's points with omega_B = 0 and with omega_A = 0 (about the least axis) or omega_C
    = 0 (greatest), in the order of the moments."""
    (a, b, c), (below, above, middle) = moments, differences
    zero = jnp.zeros_like(a)

    def rate(difference, moment, apart, sign=1.0):
        # Rounding may make a difference negative where the point is on an axis.
        scaled = jnp.maximum(sign * difference.scaled, 0.0)
        return safe_sqrt(safe_divide(scaled, moment * apart)) / difference.factor

    first = jnp.stack([rate(above, a, a - c), zero, rate(below, c, a - c)])
    least = jnp.stack([zero, rate(above, b, b - c), rate(middle, c, b - c)])
    greatest = jnp.stack([rate(middle, a, a - b, -1.0), rate(below, b, a - b), zero])
    return first, jnp.where(about_least, least, greatest)

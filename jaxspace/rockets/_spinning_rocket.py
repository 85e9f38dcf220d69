"""A spinning rocket whose propellant burns: rates and angle of attack in closed form, for radii of
gyration that stay.

    xi = 1 - a t,   a = m'/m_0 > 0,   p = rho/k_z,   r = k_z/k
    omega_z = n xi^(p^2 - 1)
    Phi     = int omega_z dt = (n/a) (1 - xi^(p^2))/p^2
    w_xy    = w_xy(0) xi^(l^2/k^2 + p^2 r^2/2 - 1) e^(-i (1 - r^2) Phi)      (Ex. 7.9-1, corrected)
    theta_XY = theta_0 + int w_xy e^(i Phi) dt,      theta_xy = theta_XY e^(-i Phi)        (7.10)

    symbol    meaning                                                            unit
    n         spin at the start                                                  rad/s
    k, k_z    radii of gyration across and along the axis                        m
    l, rho    distance of the exits behind the centre of mass, radius of their ring   m
    Phi       angle of spin                                                      rad
    w_xy      omega_x + i omega_y, body axes                                     rad/s
    theta_XY  complex angle of attack in inertial axes; theta_xy in body axes    rad

With the three ratios l/k, p and r a slender body, k_z = 0, is ordinary: r = 0. The spin of a rod (a
body without a moment about its axis) is constant in flight, because p = 1. Its axis moves along a
straight line; for r > 0 it spirals about i w_xy(0)/(n r^2) for rho = k_z.

Source: Thomson 7.9, 7.10; errata: the exponent of Phi is imaginary, and the factor to inertial axes
is e^(i Phi). The angle of attack is small-angle theory: its error grows as the cube of the angle.
"""

from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractParameters, NumberField, Scalar, argument, constructor, quantity
from ..core.types import as_float, precision_of
from ..rotations.tilt import check_axes
from .jet_damping import _power, spin_angle

# Nodes of one panel, and the panels of the quadrature of the angle of attack.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
PANELS = 64


@final
class SpinningRocket(AbstractParameters):
    """Rates and angle of attack of a spinning rocket with jet damping; complex numbers are arrays
    (2, *runs)."""

    spin: NumberField = quantity("rad/s", doc="n, at the start")
    burn_fraction_rate: NumberField = quantity(
        "1/s", non_negative=True, doc="share of the initial mass that leaves in a second"
    )
    lever_over_gyration: NumberField = quantity(
        "", non_negative=True, doc="l/k: distance of the exits over transverse radius of gyration"
    )
    ring_over_gyration: NumberField = quantity(
        "", non_negative=True, default=0.0, doc="rho/k_z: ring of the exits over spin radius"
    )
    gyration_ratio: NumberField = quantity(
        "", non_negative=True, default=0.0, doc="k_z/k; zero for a slender body"
    )

    @classmethod
    @constructor(
        sets=("lever_over_gyration", "ring_over_gyration", "gyration_ratio"),
        gyration=argument("m", positive=True, doc="k, across the axis"),
        spin_gyration=argument("m", positive=True, doc="k_z, about the axis"),
        lever=argument("m", non_negative=True, doc="l, of the exits behind the centre of mass"),
        ring=argument("m", non_negative=True, default=0.0, doc="rho, radius of the ring of exits"),
    )
    def of_lengths(
        cls,
        spin: Scalar,
        burn_fraction_rate: Scalar,
        gyration: Scalar,
        spin_gyration: Scalar,
        lever: Scalar,
        ring: Scalar = 0.0,
    ) -> "SpinningRocket":
        """The rocket from its radii of gyration and the place of the exits.

        **Arguments**

        - `spin`: rad/s; `burn_fraction_rate`: m'/m_0, 1/s.
        - `gyration` k, `spin_gyration` k_z, `lever` l, `ring` rho: m.
        """
        return cls(
            spin,
            burn_fraction_rate,
            lever / gyration,
            ring / spin_gyration,
            spin_gyration / gyration,
        )

    def mass_ratio(self, time: Scalar) -> Scalar:
        """m/m_0 after `time`, s."""
        return 1.0 - self.burn_fraction_rate * as_float(time)

    def spin_rate(self, time: Scalar) -> Scalar:
        """omega_z, rad/s, after `time`, s."""
        # The exhaust takes spin with rho^2, the shrinking inertia returns it with k_z^2.
        return self.spin * self._ratio_to(time, as_float(self.ring_over_gyration) ** 2 - 1.0)

    def spin_angle(self, time: Scalar) -> Scalar:
        """Phi, rad, after `time`, s."""
        ring = self.ring_over_gyration
        return spin_angle(time, self.spin, self.burn_fraction_rate, ring)

    def damping(self, time: Scalar) -> Scalar:
        """|w_xy| over its value at the start, after `time`, s."""
        ring = self.ring_over_gyration * self.gyration_ratio
        exponent = self.lever_over_gyration**2 + 0.5 * ring * ring - 1.0
        return self._ratio_to(time, exponent)

    def _ratio_to(self, time: Scalar, exponent: Scalar) -> Scalar:
        """(m/m_0)^exponent, with the digits of its logarithm where little has burnt."""
        burnt = self.burn_fraction_rate * as_float(time)
        little = burnt < 0.5
        # The difference 1 - burnt would lose the digits of the little that has burnt.
        near = jnp.exp(exponent * jnp.log1p(-jnp.where(little, burnt, 0.0)))
        return jnp.where(little, near, _power(jnp.where(little, 1.0, 1.0 - burnt), exponent))

    def transverse_rate(
        self, time: Scalar, start: Float[Array, "2 *#runs"]
    ) -> Float[Array, "2 *#runs"]:
        """w_xy in body axes, rad/s, after `time`, s, from its value `start` (Thomson Ex. 7.9-1)."""
        # The transverse rate turns in the body against the spin.
        angle = -(1.0 - self.gyration_ratio**2) * self.spin_angle(time)
        return self.damping(time) * turned(as_float(start), angle)

    def complex_tilt(
        self,
        time: Scalar,
        rate: Float[Array, "2 *#runs"],
        start: Float[Array, "2 *#runs"] | None = None,
        axes: str = "inertial",
    ) -> Float[Array, "2 *#runs"]:
        """The complex tilt of the axis (`rotations.tilt`), rad, after a `time`, s (Thomson 7.10).

        **Arguments**

        - `time`: s.
        - `rate`: w_xy at the start, rad/s; `start`: theta_XY there, rad, zero by default.
        - `axes`: "inertial" for theta_XY, "body" for theta_xy.

        **Returns** real and imaginary part, by quadrature with a thousand nodes: to rounding as
        long as the slow angle r^2 Phi stays below 500 rad and some of the mass is left.

        **Raises** `InputError` for other axes.
        """
        check_axes(axes)
        time, rate = as_float(time), as_float(rate)
        kind = precision_of(self, time, rate)
        rank = max(jnp.ndim(time), *(jnp.ndim(x) for x in (self.spin, self.burn_fraction_rate)))
        edges = (np.arange(PANELS)[:, None] + 0.5 * (1.0 + _NODES)) / PANELS
        weights = np.broadcast_to(0.5 * _WEIGHTS / PANELS, edges.shape)
        # In the precision of the rocket: nodes in 64 bits would make all of the quadrature so.
        u, w = (jnp.asarray(x.reshape(-1, *(1,) * rank), kind) for x in (edges, weights))
        slow = self.gyration_ratio**2 * self.spin_angle(u * time)
        size = w * self.damping(u * time) * time
        sums = jnp.stack(
            [jnp.sum(size * jnp.cos(slow), axis=0), jnp.sum(size * jnp.sin(slow), axis=0)]
        )
        moved = jnp.stack(
            [rate[0] * sums[0] - rate[1] * sums[1], rate[0] * sums[1] + rate[1] * sums[0]]
        )
        total = moved if start is None else as_float(start) + moved
        return total if axes == "inertial" else turned(total, -self.spin_angle(time))


def turned(number: Float[Array, "2 *#runs"], angle: Scalar) -> Float[Array, "2 *#runs"]:
    """A complex number, as real and imaginary part, times e^(i angle)."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * number[0] - s * number[1], s * number[0] + c * number[1]])

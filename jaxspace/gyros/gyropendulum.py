"""Gyropendulum and vertical gyro: a gyro that indicates the vertical of a vehicle.

    A theta'' = -H phi' - Wl (theta + a_1/g) - H k (phi + a_2/g)
    A phi''   =  H theta' - Wl (phi + a_2/g) + H k (theta + a_1/g)

    symbol      meaning                                                            unit
    theta, phi  tilts of the axis from the vertical, about two horizontal axes     rad
    H, A        spin momentum, moment of inertia across the axis                   kg m^2/s, kg m^2
    Wl          weight times the depth of the mass centre below the pivot          N m
    k           rate at which erection motors bring the axis to the plumb line     1/s
    a_1, a_2    accelerations of the pivot that tilt the plumb line                m/s^2

With H / Wl = sqrt(R / g) the period is that of Schuler, 2 pi sqrt(R / g), and motion over the earth
does not disturb the vertical. Without pendulosity, Wl = 0, it is the vertical gyro.

Source: Thomson 6.5, problems 7 to 10.
Valid for small tilts: a run with more than `SMALL_ANGLE` has the status `OUTSIDE_MODEL`.
"""

__all__ = ["schuler_frequency", "schuler_period"]

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.limits import Limit
from ..core.listed import no_method
from ..core.printing import printed
from ..core.square_roots import sqrt
from ._linear import LinearFlow, linear_rate, rows
from ._small_angle import small_angle


@formula(gravity=NOT_NEGATIVE, radius=POSITIVE)
def schuler_frequency(gravity: Scalar, radius: Scalar) -> Scalar:
    """sqrt(g / R), rad/s (Thomson 6.11-12).

    **Arguments**

    - `gravity`: m/s^2, (*runs,).
    - `radius`: of the earth, m, (*runs,)."""
    return jnp.sqrt(gravity / radius)


@formula(gravity=POSITIVE, radius=POSITIVE)
def schuler_period(gravity: Scalar, radius: Scalar) -> Scalar:
    """2 pi sqrt(R / g), s: 84.4 minutes on the earth.

    **Arguments**

    - `gravity`, `radius`: as in `schuler_frequency`."""
    return 2.0 * jnp.pi / schuler_frequency(gravity, radius)


@final
@printed()
class GyropendulumState(eqx.Module):
    """Tilts from the vertical and their rates; also the rates of all."""

    theta: NumberField = quantity("rad", doc="tilt about the first axis")
    phi: NumberField = quantity("rad", doc="tilt about the second axis")
    theta_rate: NumberField = quantity("rad/s", doc="rate of theta")
    phi_rate: NumberField = quantity("rad/s", doc="rate of phi")


@final
class Gyropendulum(AbstractSystem):
    """A gyropendulum, or a vertical gyro with `weight_moment` zero. State: `GyropendulumState`."""

    spin_momentum: NumberField = quantity("kg m^2/s", positive=True, doc="H")
    transverse_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="A, across the axis, about the pivot"
    )
    weight_moment: NumberField = quantity(
        "N m", default=0.0, doc="Wl, weight times depth of the mass centre below the pivot"
    )
    erection_rate: NumberField = quantity(
        "1/s", non_negative=True, default=0.0, doc="k, of the erection motors"
    )
    acceleration_theta: NumberField = quantity(
        "m/s^2", default=0.0, doc="a_1, of the pivot, as it tilts the plumb line in theta"
    )
    acceleration_phi: NumberField = quantity(
        "m/s^2", default=0.0, doc="a_2, of the pivot, as it tilts the plumb line in phi"
    )
    gravity: NumberField = quantity("m/s^2", positive=True, default=9.80665, doc="g")

    def vector_field(self, t: Scalar, y: GyropendulumState) -> GyropendulumState:
        del t
        return linear_rate(*self._matrices(), y)

    def limits(self, t: Scalar, y: GyropendulumState) -> Sequence[Limit]:
        del t
        return small_angle("theta", y.theta), small_angle("phi", y.phi)

    def invariants(self, t: Scalar, y: GyropendulumState) -> dict[str, Array]:
        """Nothing is conserved with erection motors on."""
        del t, y
        return {}

    def closed_form(self) -> LinearFlow:
        return LinearFlow(*self._matrices())

    @property
    @no_method
    def frequencies(self) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of the precession and of the nutation, without erection:
        (sqrt(H^2 + 4 A Wl) -+ H) / (2 A)."""
        H, A = self.spin_momentum, self.transverse_inertia
        root = sqrt(H * H + 4.0 * A * self.weight_moment)
        # By the product of the roots, because their difference loses all digits of the slow one.
        return 2.0 * self.weight_moment / (root + H), (root + H) / (2.0 * A)

    def tuned(self, radius: Scalar) -> "Gyropendulum":
        """This gyropendulum with the spin momentum for Schuler's period on a sphere of `radius`,
        m."""
        ratio = 1.0 / schuler_frequency(self.gravity, radius)
        # Exactly: the precession has this frequency, so that Wl = H p + A p^2.
        momentum = self.weight_moment * ratio - self.transverse_inertia / ratio
        return eqx.tree_at(lambda s: s.spin_momentum, self, momentum)

    def _matrices(self) -> tuple[Array, Array]:
        H, A, k = self.spin_momentum, self.transverse_inertia, self.erection_rate
        w = self.weight_moment / A
        e = H * k / A
        h = H / A
        one, two = self.acceleration_theta / self.gravity, self.acceleration_phi / self.gravity
        matrix = rows(
            (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0), (-w, -e, 0.0, -h), (e, -w, h, 0.0)
        )
        return matrix, rows((0.0,), (0.0,), (-w * one - e * two,), (e * one - w * two,))[:, 0]

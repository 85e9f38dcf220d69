"""Despin by yo-yo: two masses on cords wound about a spinning body unwind, are released, and carry
its spin away.

    w = w0 (C - phi^2) / (C + phi^2)              phi' = w0,   C = I / (m R^2) + 1
    l_f = R sqrt(C (w0 - w_f) / (w0 + w_f))       cord for the final rate w_f
    l_0 = R sqrt(C) = sqrt(R^2 + I / m)           cord for no spin at all, whatever the first rate
    F = 4 I C w0^2 phi / (R (C + phi^2)^2)    tension of all cords, greatest at phi = sqrt(C/3)

    symbol   meaning                                                  unit
    I        axial inertia of the body without the masses             kg m^2
    R        radius on which the cords are wound                      m
    m        all the masses together                                  kg
    l, phi   free length of a cord, angle unwound: l = R phi          m, rad
    w0, w    spin of the body, at first and now                       rad/s
    F        tension                                                  N

Source: Thomson 7.5-10..16 (in 7.5-2..9 every phi' that is squared or multiplies R must be phi).
Valid for a symmetric set of light cords in the plane of the mass centre, released in the tangential
position, on a body that spins about its axis of symmetry.
"""

__all__ = ["cord_length", "zero_spin_cord_length"]

from typing import ClassVar, final

import jax.numpy as jnp

from ..bodies import AbstractJump, BodyState
from ..core import InputError, NumberField, Scalar, quantity
from ..core.formula import POSITIVE, formula
from ..core.safe import end_sqrt
from ..core.types import as_float
from ..core.vectors import axis


def inertia_ratio(I: Scalar, R: Scalar, m: Scalar) -> Scalar:  # noqa: E741
    """C = I / (m R^2) + 1 (Thomson 7.5-10)."""
    return I / (m * R * R) + 1.0


@formula(I=POSITIVE, R=POSITIVE, m=POSITIVE)
def cord_length(w0: Scalar, w_f: Scalar, I: Scalar, R: Scalar, m: Scalar) -> Scalar:  # noqa: E741
    """The cord l_f, m, that slows the spin from `w0` to `w_f`, rad/s (Thomson 7.5-15).

    At w_f = w0, where no cord is needed, the derivatives with respect to the two rates are infinite
    (endpoint derivative convention of `core/safe.py`), those with respect to the body are zero.

    **Arguments**

    - `w0`, `w_f`: spin before and after, rad/s.
    - `I`: moment of inertia about the axis, without the masses, kg m^2.
    - `R`: radius of the drum, m.
    - `m`: all the masses together, kg."""

    def radicand(w0, w_f, I, R, m):  # noqa: E741
        return inertia_ratio(I, R, m) * (w0 - w_f) / (w0 + w_f)

    return R * end_sqrt(radicand, *(as_float(x) for x in (w0, w_f, I, R, m)))


@formula(I=POSITIVE, R=POSITIVE, m=POSITIVE)
def zero_spin_cord_length(I: Scalar, R: Scalar, m: Scalar) -> Scalar:  # noqa: E741
    """The cord l_0, m, that stops the spin, whatever its rate (Thomson 7.5-16).

    **Arguments**

    - `I`, `R`, `m`: as of `cord_length`."""
    return jnp.sqrt(R * R + I / m)


@final
class YoYo(AbstractJump):
    """A yo-yo as a jump of the state: called on the state before the unwinding it returns the state
    after the release.

    The unwinding takes the time l / (R w0), `unwinding_time`; the jump is instantaneous and does
    not change the attitude. The spin axis is z: the rate about it is multiplied by (C - phi^2)/(C +
    phi^2) with phi = l/R, and the rates across it stay the same. A mass in the state is reduced by
    the mass released."""

    needs: ClassVar[frozenset[str]] = frozenset({"omega"})

    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, shared="body.inertia.2", doc="I, of the body without the yo-yo"
    )
    radius: NumberField = quantity("m", positive=True, doc="R, on which the cords are wound")
    mass: NumberField = quantity("kg", positive=True, doc="m, of all masses released together")
    cord_length: NumberField = quantity("m", positive=True, doc="l, of one cord")

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        """The state after the release. Raises `InputError` for a state without omega."""
        del t
        if y.omega is None:
            raise InputError(
                f"The state has {', '.join(y.present) or 'no parts'}: it must have omega."
            )
        lost = self.spin_rate(self.cord_length / self.radius, y.omega[2]) - y.omega[2]
        mass = None if y.mass is None else y.mass - self.mass
        return BodyState(
            y.position, y.velocity, y.attitude, y.omega + lost * axis(2, lost), mass, y.parts
        )

    @property
    def inertia_ratio(self) -> Scalar:
        """C, 1."""
        return inertia_ratio(self.axial_inertia, self.radius, self.mass)

    def spin_rate(self, phi: Scalar, w0: Scalar) -> Scalar:
        """w, rad/s, when the angle `phi`, rad, is unwound (Thomson 7.5-12)."""
        C = self.inertia_ratio
        return w0 * (C - phi * phi) / (C + phi * phi)

    def tension(self, phi: Scalar, w0: Scalar) -> Scalar:
        """F, N, of all cords together when the angle `phi`, rad, is unwound; greatest at phi =
        sqrt(C/3)."""
        C = self.inertia_ratio
        return 4.0 * self.axial_inertia * C * w0 * w0 * phi / (self.radius * (C + phi * phi) ** 2)

    def mass_speed(self, phi: Scalar, w0: Scalar) -> Scalar:
        """Speed, m/s, of the masses when the angle `phi`, rad, is unwound (Thomson 7.5-2, with phi'
        = w0)."""
        w = self.spin_rate(phi, w0)
        return self.radius * jnp.sqrt(w * w + (phi * (w + w0)) ** 2)

    def unwinding_time(self, w0: Scalar) -> Scalar:
        """Time, s, from the first motion to the release: l / (R w0), since phi' = w0 (Thomson
        7.5-11)."""
        return self.cord_length / (self.radius * w0)

"""Drift of the spin axis by internal damping: the angular momentum stays, the energy falls, and the
body turns towards the rotation of least energy.

    T = h^2/(2 C) [cos^2 + (C/A) sin^2]                                      of theta
    theta' = Q / [(h^2/C) (1 - C/A) sin cos]                                 Q = -T' > 0
    theta' = K sin cos^2 / [(1 - R^2 cos^2)^2 + alpha^2]                     of a damping part
    K t = [(1 + alpha^2) sec + R^4 cos + ((1 - R^2)^2 + alpha^2) ln tan(theta/2)]  between angles

    K = s gamma/(48 pi E) (m l^2 xi/I)^2 (V/C) (C/A)^4 w0^3      two disks on an elastic tube
    K = s N gamma (C/A)^2 w0^3 J^2/(pi C M W1^2)                 N whip antennas

    symbol    meaning                                                            unit
    theta     angle between the axis of symmetry and h, from 0 to a right angle  rad
    A, C      moments of inertia across and along the axis                       kg m^2
    h, w0     angular momentum; h/C                                              kg m^2/s, rad/s
    T, Q      energy of rotation, dissipation                                    J, W
    K         drift constant, with the sign s of A - C: negative for C > A,      1/s
              where the axis goes back to h
    R, alpha  w0 (or the frequency of the load at theta = 0) over the natural    1
              frequency of the damping part; its structural damping, gamma/(2 pi)
    gamma     hysteretic factor: loss per cycle over the greatest energy         1
    E, I, V   modulus, moment of the section and volume of the tube              Pa, m^4, m^3
    m, l, xi  mass of a disk, length and radius                                  kg, m, m
    M, W1, J  modal mass, natural frequency and first moment of an antenna       kg, rad/s, kg m

Source: Thomson 7.6-8 (with the dissipation -dT/dt), 7.6 example 1 (f), Problem 9; 9.8 example 2.
R = alpha = 0 is the tube, whose damping does not resonate; its drift is fastest at tan^2 = 1/2.
Valid where the loss per cycle is small, and up to a right angle, which is reached after an infinite
time.
"""

__all__ = [
    "FASTEST_DRIFT",
    "antenna_drift_constant",
    "drift_by_dissipation",
    "drift_energy",
    "structural_damping",
    "tube_drift_constant",
]

import math
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractClosedForm, AbstractSystem, NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.types import as_float

FASTEST_DRIFT = math.atan(math.sqrt(0.5))
"""Angle, rad, at which the drift by structural damping without resonance is fastest."""
# Enough halvings for a bracket of any floating-point numbers to shrink to rounding.
_HALVINGS = 60


@formula(A=POSITIVE, C=POSITIVE)
def drift_energy(theta: Scalar, A: Scalar, C: Scalar, h: Scalar) -> Scalar:
    """Energy of rotation, J, of a symmetric body of the angular momentum `h`, kg m^2/s, whose axis
    is at an angle `theta`, rad, to it (Thomson 7.6-6).

    **Arguments**

    - `theta`: angle of the axis from the angular momentum, rad.
    - `A`, `C`: moments of inertia across the axis and about it, kg m^2.
    - `h`: angular momentum, kg m^2/s."""
    s, c = jnp.sin(theta), jnp.cos(theta)
    return 0.5 * h * h * (c * c / C + s * s / A)


@formula(A=POSITIVE, C=POSITIVE, dissipation=NOT_NEGATIVE)
def drift_by_dissipation(
    theta: Scalar, A: Scalar, C: Scalar, h: Scalar, dissipation: Scalar
) -> Scalar:
    """Rate theta' of the axis for a given loss of energy (Thomson 7.6-8).

    **Arguments**

    - `theta`: rad, (*runs,), neither 0 nor a right angle.
    - `A`, `C`: kg m^2, not equal.
    - `h`: angular momentum, kg m^2/s.
    - `dissipation`: Q, W, positive.

    **Returns** theta', rad/s, (*runs,): positive for C < A.
    """
    # By the difference of the moments, because that of their reciprocals has lost digits.
    difference = (A - C) / (A * C)
    return dissipation / (h * h * difference * jnp.sin(theta) * jnp.cos(theta))


@formula(
    gamma=NOT_NEGATIVE,
    modulus=POSITIVE,
    disk_mass=POSITIVE,
    length=POSITIVE,
    radius=POSITIVE,
    section=POSITIVE,
    volume=POSITIVE,
    A=POSITIVE,
    C=POSITIVE,
)
def tube_drift_constant(
    gamma: Scalar,
    modulus: Scalar,
    disk_mass: Scalar,
    length: Scalar,
    radius: Scalar,
    section: Scalar,
    volume: Scalar,
    A: Scalar,
    C: Scalar,
    w0: Scalar,
) -> Scalar:
    """K of two disks on an elastic tube (Thomson 7.6, example 1 (f)).

    **Arguments**, each (*runs,)

    - `gamma`: hysteretic factor.
    - `modulus`: E, Pa.
    - `disk_mass`, `length`, `radius`: m, kg, l, m, and xi, m.
    - `section`, `volume`: I, m^4, and V, m^3, of the tube.
    - `A`, `C`: kg m^2.
    - `w0`: h/C, rad/s.

    **Returns** K, 1/s; zero where A = C, because no load changes there.
    """
    stress = disk_mass * length * length * radius / section
    size = gamma / (48.0 * math.pi * modulus) * stress * stress * (volume / C)
    return jnp.sign(as_float(A - C)) * size * (C / A) ** 4 * w0**3


@formula(
    count=NOT_NEGATIVE,
    gamma=NOT_NEGATIVE,
    modal_mass=POSITIVE,
    natural_frequency=POSITIVE,
    A=POSITIVE,
    C=POSITIVE,
)
def antenna_drift_constant(
    count: Scalar,
    gamma: Scalar,
    modal_mass: Scalar,
    natural_frequency: Scalar,
    first_moment: Scalar,
    A: Scalar,
    C: Scalar,
    w0: Scalar,
) -> Scalar:
    """K of whip antennas along the axis (Thomson 9.8, example 2).

    **Arguments**, each (*runs,)

    - `count`: N.
    - `gamma`: hysteretic factor.
    - `modal_mass`, `natural_frequency`, `first_moment`: M, kg, W1, rad/s, and J, kg m.
    - `A`, `C`: kg m^2.
    - `w0`: h/C, rad/s.

    **Returns** K, 1/s.
    """
    per_body = (C / A) ** 2 * w0**3 / (math.pi * C)
    shape = first_moment * first_moment / (modal_mass * natural_frequency**2)
    return jnp.sign(as_float(A - C)) * count * gamma * per_body * shape


@formula(gamma=NOT_NEGATIVE)
def structural_damping(gamma: Scalar) -> Scalar:
    """alpha = gamma/(2 pi), from the hysteretic factor (Thomson, Problem 7.6-9)."""
    return gamma / (2.0 * math.pi)


@final
@printed()
class DriftState(eqx.Module):
    """Angle of the axis; also its rate."""

    angle: NumberField = quantity("rad", doc="theta, between the axis and h")


@final
class AttitudeDrift(AbstractSystem):
    """The drift of the axis by internal damping. State: `DriftState`.

    The motion is known in closed form: its time by `drift_time`, its angle by a root."""

    drift_constant: NumberField = quantity("1/s", doc="K")
    frequency_ratio: NumberField = quantity(
        "", non_negative=True, default=0.0, doc="R, of the load at theta = 0 to the damping part"
    )
    damping: NumberField = quantity(
        "", non_negative=True, default=0.0, doc="alpha, structural damping at resonance"
    )

    def rate(self, theta: Scalar) -> Scalar:
        """theta', rad/s, at `theta`, rad (Thomson 7.6 (f), 9.8 example 2)."""
        c = jnp.cos(theta)
        detuning = 1.0 - (self.frequency_ratio * c) ** 2
        below = detuning * detuning + self.damping * self.damping
        return self.drift_constant * jnp.sin(theta) * c * c / below

    def vector_field(self, t: Scalar, y: DriftState) -> DriftState:
        del t
        return DriftState(self.rate(y.angle))

    def invariants(self, t: Scalar, y: DriftState) -> dict[str, Array]:
        del t, y
        # Energy falls; the angular momentum is not part of the state.
        return {}

    def closed_form(self) -> AbstractClosedForm:
        return _Drift(self)

    def drift_time(self, start: Scalar, end: Scalar) -> Scalar:
        """Time, s, from the angle `start` to `end`, rad, (*runs,), both above 0 and below a right
        angle; negative where the drift goes the other way."""
        ratio = jnp.log(jnp.tan(0.5 * end) / jnp.tan(0.5 * start))
        a, r4, log = self._weights()
        # As products, so that no digit is lost between near angles.
        apart = 2.0 * jnp.sin(0.5 * (end + start)) * jnp.sin(0.5 * (end - start))
        secants = apart / (jnp.cos(start) * jnp.cos(end))
        return (log * ratio + a * secants - r4 * apart) / self.drift_constant

    def angle_after(self, duration: Scalar, start: Scalar) -> Scalar:
        """The angle, rad, a `duration`, s (negative: before), after `start`, rad, (*runs,)."""
        s = self.drift_constant * duration
        a, r4, log = self._weights()
        start = as_float(start)
        tangent = jnp.tan(0.5 * start)
        cosine = jnp.cos(start)
        # x = ln of the ratio of tan(theta/2): a start on the axis needs no logarithm of zero.
        limit = -jnp.log(jnp.where(tangent > 0.0, tangent, 1.0))
        limit = jnp.where(tangent > 0.0, jnp.maximum(limit, 0.0), jnp.inf)

        def excess(x: Scalar) -> tuple[Scalar, Scalar]:
            """K t at x minus K times the duration, and its slope, both times cos^2 of the angle
            there, which is zero where they are infinite."""
            square = (tangent * jnp.exp(x)) ** 2
            moved = tangent * tangent * jnp.expm1(2.0 * x) * (1.0 + cosine)
            c = (1.0 - square) / (1.0 + square)
            below = log * x - r4 * moved / (1.0 + square) - s
            secants = moved * c / (cosine * (1.0 + square))
            ratio2 = self.frequency_ratio**2
            return below * c * c + a * secants, (1.0 - ratio2 * c * c) ** 2 + self.damping**2

        # By halving, because near resonance the curve is flat and Newton's steps alone diverge.
        def halved(_, ends):
            low, high = ends
            x = 0.5 * (low + high)
            above = excess(x)[0] >= 0.0
            return jnp.where(above, low, x), jnp.where(above, x, high)

        low = jnp.where(s < 0.0, (s - r4) / log, 0.0)
        high = jnp.where(s < 0.0, 0.0, jnp.minimum((s + r4) / log, limit))
        ends = jax.lax.stop_gradient(jnp.broadcast_arrays(low, high))
        x = 0.5 * sum(jax.lax.fori_loop(0, _HALVINGS, halved, tuple(ends)))
        # A step of Newton's carries the derivatives of the first order, two those of the second.
        x = jax.lax.stop_gradient(x)
        for _ in range(2):
            over, slope = excess(x)
            # After a long time the distance to a right angle is below rounding.
            x = jnp.minimum(x - over / slope, limit)
        return 2.0 * jnp.arctan(tangent * jnp.exp(x))

    def _weights(self) -> tuple[Scalar, Scalar, Scalar]:
        """1 + alpha^2, R^4, (1 - R^2)^2 + alpha^2."""
        r2, loss = self.frequency_ratio**2, self.damping**2
        return 1.0 + loss, r2 * r2, (1.0 - r2) ** 2 + loss


@final
class _Drift(AbstractClosedForm):
    drift: AttitudeDrift

    def flow(self, duration: Scalar, y: DriftState) -> DriftState:
        return DriftState(self.drift.angle_after(duration, y.angle))

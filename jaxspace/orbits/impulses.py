"""Changes of an orbit by an impulse: along the path, in the plane with a fixed line of apsides,
out of the plane; and the impulse as a jump of a mission.

    with C = e cos f, S = e sin f and w = g (2 + g), g = dv/v, an impulse along the path gives
    C' = C + (1 + C) w,  S' = S (1 + w),  p' = p (1 + w)
    df = atan2(-w sin f, e + w (e + cos f))      to first order -2 g sin f / e
    de = e' - e                                  to first order 2 g (e + cos f)
    1/a' - 1/a = -w (1 + 2 C + e^2) / p

    symbol  meaning                                            unit
    f, e    true anomaly, eccentricity; ': after the impulse   rad, 1
    p, a    semi-latus rectum, semi-major axis                 m
    v, dv   speed, its increment                               m/s

Source: Thomson 4.13-1..11 (finite impulses), 4.14-1..8 (small ones). The exact differences are
computed without cancellation: they are accurate for the smallest impulse.
"""

__all__ = [
    "OrbitChange",
    "apse_line_impulse",
    "eccentricities_through",
    "plane_change_impulse",
    "small_tangential_impulse",
    "tangential_impulse",
]

from typing import ClassVar, NamedTuple, final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractJump, BodyState
from ..core import InputError, NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.safe import safe_atan2, safe_divide, safe_sqrt
from ..core.square_roots import inverse_sqrt
from ..core.squares import safe_hypot
from ..core.types import as_float
from ..core.vectors import cross, scale, unit


@printed(true_anomaly="rad", semi_major_axis="m")
class OrbitChange(NamedTuple):
    """Changes of the elements by an impulse, each (*runs,): of `eccentricity`, `true_anomaly`, rad,
    and `semi_major_axis`, m. The line of apsides turns by minus the change of the anomaly."""

    eccentricity: Scalar
    true_anomaly: Scalar
    semi_major_axis: Scalar


@formula(semi_latus_rectum=POSITIVE, eccentricity=NOT_NEGATIVE)
def tangential_impulse(
    semi_latus_rectum: Scalar, eccentricity: Scalar, true_anomaly: Scalar, gain: Scalar
) -> OrbitChange:
    """Exact change of an orbit due to an impulse along the path.

    **Arguments**, each (*runs,)

    - `semi_latus_rectum`: m; `eccentricity`; `true_anomaly`: rad.
    - `gain`: increment of the speed over the speed, above -1.

    **Returns** the changes. On a circle the anomaly is undefined: its change is measured from the
    direction of `true_anomaly` to the new periapsis; the derivative with respect to `eccentricity`
    does not exist there.
    """
    p, e = as_float(semi_latus_rectum), as_float(eccentricity)
    cosine, sine = jnp.cos(true_anomaly), jnp.sin(true_anomaly)
    w = gain * (2.0 + gain)
    C, S = e * cosine, e * sine
    speed2 = 1.0 + 2.0 * C + e * e
    new_C = C + (1.0 + C) * w
    new_S = S * (1.0 + w)
    new_e = safe_sqrt(new_C * new_C + new_S * new_S)
    # By the difference of the squares, which is exact for a small impulse. Where a circle remains a
    # circle, the sum to divide by is zero.
    de = safe_divide(w * (2.0 * (C + e * e) + w * speed2), new_e + e)
    # Next to an apse, or next to a circle, the derivative of this quotient by e cancels.
    side = jnp.where(new_C < 0.0, -1.0, 1.0)
    turned = new_S * safe_divide(new_S, new_e + side * new_C)
    apart = jnp.where(
        side * cosine < 0.0, 1.0 - side * cosine, sine * sine / (1.0 + jnp.abs(cosine))
    )
    de = jnp.where(e * sine * sine < jnp.abs(w), side * (1.0 + C) * w - e * apart + turned, de)
    # Without the factor e of both sides, so that a circle retains the direction of its anomaly.
    df = safe_atan2(-w * sine, e + w * (cosine + e))
    # By 1/a, whose change is exact: a difference of the axes has no digits for a small impulse.
    per_a = (1.0 - e) * (1.0 + e) / p
    da = w * speed2 / p / (per_a * (per_a - w * speed2 / p))
    return OrbitChange(de, df, da)


@formula(semi_latus_rectum=POSITIVE, eccentricity=NOT_NEGATIVE)
def small_tangential_impulse(
    semi_latus_rectum: Scalar, eccentricity: Scalar, true_anomaly: Scalar, gain: Scalar
) -> OrbitChange:
    """First-order change of an orbit due to a small impulse along the path (Thomson 4.14-5..7).

    The change of the anomaly is infinite on a circle.

    **Arguments**

    - `semi_latus_rectum`, `eccentricity`, `true_anomaly`, `gain`: as in `tangential_impulse`.

    **Returns** an `OrbitChange`, as `tangential_impulse` does."""
    e = as_float(eccentricity)
    f = true_anomaly
    per_a = (1.0 - e) * (1.0 + e)
    speed2 = 1.0 + 2.0 * e * jnp.cos(f) + e * e
    return OrbitChange(
        2.0 * (e + jnp.cos(f)) * gain,
        -2.0 * jnp.sin(f) / e * gain,
        2.0 * speed2 * semi_latus_rectum / (per_a * per_a) * gain,
    )


@formula(semi_latus_rectum=POSITIVE, eccentricity=NOT_NEGATIVE, mu=POSITIVE)
def apse_line_impulse(
    semi_latus_rectum: Scalar,
    eccentricity: Scalar,
    true_anomaly: Scalar,
    new_eccentricity: Scalar,
    mu: Scalar,
) -> tuple[Scalar, Scalar]:
    """The impulse that changes the eccentricity and does not turn the line of apsides (Thomson
    4.13).

    **Arguments**, each (*runs,)

    - `semi_latus_rectum`: m; `eccentricity`; `true_anomaly`: rad, of the place of the impulse.
    - `new_eccentricity`: a negative one puts the periapsis on the other side.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the increments outwards and across the radius, along the motion, m/s, (*runs,).
    """
    p = as_float(semi_latus_rectum)
    e = as_float(eccentricity)
    e2 = as_float(new_eccentricity)
    c, s = jnp.cos(true_anomaly), jnp.sin(true_anomaly)
    near, near2 = 1.0 + e * c, 1.0 + e2 * c
    unit_speed = jnp.sqrt(mu * near / p)
    # Both conics pass the same place, p'/p = near2/near: differences of square roots, as such.
    across = unit_speed * c * (e2 - e) / (jnp.sqrt(near2) + jnp.sqrt(near))
    outwards = unit_speed * s * (e2 * inverse_sqrt(near2) - e * inverse_sqrt(near))
    return outwards, across


@formula(radius=POSITIVE)
def eccentricities_through(
    radius: Scalar, true_anomaly: Scalar, semi_major_axis: Scalar
) -> tuple[Scalar, Scalar]:
    """The two conics of a given size through a place, `radius`, m, at the `true_anomaly`, rad
    (Thomson 4.13).

    **Arguments**

    - `radius`: distance of the place from the centre, m.
    - `true_anomaly`: of the place, rad.
    - `semi_major_axis`: m.

    **Returns** their eccentricities, the smaller one first, (*runs,); a negative one has its
    periapsis on the other side. NaN where there is none."""
    ratio = radius / as_float(semi_major_axis)
    half = 0.5 * ratio * jnp.cos(true_anomaly)
    root = jnp.sqrt(half * half + 1.0 - ratio)
    return -half - root, -half + root


@formula(speed=NOT_NEGATIVE, new_speed=NOT_NEGATIVE)
def plane_change_impulse(speed: Scalar, new_speed: Scalar, angle: Scalar) -> Scalar:
    """Size of the impulse that turns the velocity by an angle and changes its length.

    **Arguments**, each (*runs,)

    - `speed`, `new_speed`: before and after, m/s.
    - `angle`: between the velocities, rad; at a node the change of inclination.

    **Returns** the size, m/s, (*runs,); its derivative is zero where it is zero.
    """
    # By half the angle, because the law of cosines loses the digits of a small one.
    sine = jnp.sin(0.5 * as_float(angle))
    change = new_speed - as_float(speed)
    return safe_hypot(change, 2.0 * sine * safe_sqrt(speed * new_speed))


@final
class Impulse(AbstractJump):
    """An instantaneous change of the velocity, as a jump between two phases of a mission: the sum
    of its components. Position, attitude and mass are unchanged."""

    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    along: NumberField = quantity("m/s", default=0.0, doc="increment along the velocity")
    radial: NumberField = quantity("m/s", default=0.0, doc="increment outwards")
    transverse: NumberField = quantity(
        "m/s", default=0.0, doc="increment across the radius in the plane of the motion"
    )
    normal: NumberField = quantity(
        "m/s", default=0.0, doc="increment along r x v, normal to the plane of the motion"
    )
    inertial: Float[Array, "3 *#runs"] | None = quantity(
        "m/s", optional=True, doc="increment in inertial axes"
    )

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        """The state after the impulse. Raises `InputError` for a state without position and
        velocity."""
        del t
        if y.position is None or y.velocity is None:
            raise InputError(
                f"The state has {', '.join(y.present) or 'no parts'}: it must have position and "
                "velocity."
            )
        outwards, up = unit(y.position), unit(cross(y.position, y.velocity))
        # With the runs of the state, whose shape a jump does not change.
        one = jnp.ones_like(y.position[0])
        velocity = (
            y.velocity
            + scale(self.along * one, unit(y.velocity))
            + scale(self.radial * one, outwards)
            + scale(self.transverse * one, cross(up, outwards))
            + scale(self.normal * one, up)
        )
        if self.inertial is not None:
            velocity = velocity + scale(one, self.inertial)
        return BodyState(y.position, velocity, y.attitude, y.omega, y.mass, y.parts)

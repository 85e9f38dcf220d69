"""Gyrocompass: a pendulous gyro that seeks the meridian, on a ship that moves and rolls.

    I_h w_h' = M_h - H w_e + I_e w_e w_u
    I_e w_e' = M_e - I_h w_u w_h + H w_h - tan(alpha) [(I_e - I_h) w_h w_e - M_u]
    w_u = W.u + psi' sin(alpha),   w_h = W.h - alpha',   w_e = W.e + psi' cos(alpha)
    g M_u = wl f.h,   g M_h = -wl f.u,   g M_e = we f.u

With W_L the part of W that is horizontal along the axis, the axis rests at

    tan(alpha) = H W_U / (wl + H W_L),    H W.h = we sin(alpha)

Small motions, with a = H W_N and b = wl + H W_N:

    I_h alpha'' = H psi' - b alpha + H W_U,    I_e psi'' = -H alpha' - a psi - we alpha - H W_E

    symbol      meaning                                                              unit
    alpha, psi  elevation of the rotor's axis; its azimuth, positive to the west     rad
    u, h, e     along the axis; horizontal across it; across both: right-handed      1
    H           spin momentum                                                        kg m^2/s
    I_h, I_e    moments of all that turns with the axis, about h and e               kg m^2
    wl, we      weight of the bail times its depth below the axis, times its
                offset to the east, which damps                                      N m
    W           angular velocity of east, north and up: of the earth and the ship    rad/s
    f           gravity minus the acceleration of the ship                           m/s^2

Source: Thomson 6.4, 6.5 (in 6.5-11 the first root contains (C phi')^4); the heading error: problems
6.5-5 and -6.
Valid for a constant spin momentum, gimbals without friction, and an axis away from the vertical,
where the azimuth does not exist (gimbal lock): a run whose axis passes it has the status
`OUTSIDE_MODEL`. The pin of the bail pushes the axis along u only, and a follow-up ring supports the
rest of its weight: gravity itself has no moment about the vertical and would not damp. Latitude,
speed and course of the ship are constant; at a pole the meridian is undefined.
"""

import math
from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, argument, constructor, quantity
from ..core.limits import Limit
from ..core.listed import no_method
from ..core.printing import printed
from ..core.square_roots import sqrt
from ..core.types import as_float
from ._linear import LinearFlow, rows

STANDARD_GRAVITY = 9.80665

# Number of substitutions of the two equations of the equilibrium into each other.
REST_STEPS = 4


@final
@printed()
class GyrocompassState(eqx.Module):
    """Elevation and azimuth of the axis, and their rates; also the rates of all."""

    tilt: NumberField = quantity("rad", doc="alpha, elevation of the axis")
    azimuth: NumberField = quantity("rad", doc="psi, of the axis, west of north")
    tilt_rate: NumberField = quantity("rad/s", doc="rate of the tilt")
    azimuth_rate: NumberField = quantity("rad/s", doc="rate of the azimuth")


@final
class Gyrocompass(AbstractSystem):
    """A gyrocompass, ashore by default. State: `GyrocompassState`, preferably created with
    `state`."""

    spin_momentum: NumberField = quantity("kg m^2/s", positive=True, doc="H")
    tilt_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I_h, about the horizontal axis"
    )
    azimuth_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I_e, about the axis across both"
    )
    pendulous_moment: NumberField = quantity(
        "N m", positive=True, doc="wl, weight of the bail times its depth"
    )
    latitude: NumberField = quantity(
        "rad", low=-0.5 * math.pi, high=0.5 * math.pi, doc="of the ship"
    )
    damping_moment: NumberField = quantity(
        "N m", default=0.0, doc="we, weight of the bail times its offset to the east"
    )
    speed: NumberField = quantity("m/s", default=0.0, doc="of the ship")
    course: NumberField = quantity("rad", default=0.0, doc="of the ship, from north towards east")
    roll_acceleration: NumberField = quantity(
        "m/s^2", default=0.0, doc="amplitude, horizontal, of the compass on a rolling ship"
    )
    roll_frequency: NumberField = quantity("rad/s", default=1.0, doc="of the rolling")
    roll_direction: NumberField = quantity(
        "rad", default=0.0, doc="of the acceleration, from north towards east"
    )
    radius: NumberField = quantity(
        "m", positive=True, default=6371e3, doc="radius of the earth", shared="planet.radius"
    )
    earth_rate: NumberField = quantity(
        "rad/s",
        default=7.292115e-5,
        doc="rotation rate of the earth",
        shared="planet.rotation_rate",
    )
    gravity: NumberField = quantity("m/s^2", positive=True, default=STANDARD_GRAVITY, doc="g")

    def vector_field(self, t: Scalar, y: GyrocompassState) -> GyrocompassState:
        sa, ca = jnp.sin(y.tilt), jnp.cos(y.tilt)
        sp, cp = jnp.sin(y.azimuth), jnp.cos(y.azimuth)

        def components(east: Scalar, north: Scalar, up: Scalar) -> tuple[Scalar, Scalar, Scalar]:
            level = north * cp - east * sp
            return ca * level + sa * up, -(east * cp + north * sp), ca * up - sa * level

        u, h, e = components(*self.frame_rate)
        w_u = u + y.azimuth_rate * sa
        w_h = h - y.tilt_rate
        w_e = e + y.azimuth_rate * ca
        f_u, f_h, _ = components(*self._plumb(t))
        bail, offset = self.pendulous_moment, self.damping_moment
        moment_u = bail * f_h
        I_h, I_e, H = self.tilt_inertia, self.azimuth_inertia, self.spin_momentum
        w_h_rate = (-bail * f_u - H * w_e + I_e * w_e * w_u) / I_h
        # The vertical ring supports the axis against moments about it.
        held = ((I_e - I_h) * w_h * w_e - moment_u) * sa / ca
        w_e_rate = (offset * f_u - I_h * w_u * w_h + H * w_h - held) / I_e
        # h and e turn with the angles: h by -(ca u - sa e) psi', e by -sa h psi' - u alpha'.
        h_rate = -(ca * u - sa * e) * y.azimuth_rate
        e_rate = -sa * h * y.azimuth_rate - u * y.tilt_rate
        turn = w_e_rate - e_rate + y.azimuth_rate * y.tilt_rate * sa
        return GyrocompassState(y.tilt_rate, y.azimuth_rate, h_rate - w_h_rate, turn / ca)

    def limits(self, t: Scalar, y: GyrocompassState) -> Sequence[Limit]:
        del t
        # At the vertical the azimuth is undefined.
        least = float(jnp.finfo(y.tilt.dtype).tiny)
        return (Limit("the cosine of tilt", "", jnp.cos(y.tilt), least),)

    def invariants(self, t: Scalar, y: GyrocompassState) -> dict[str, Array]:
        """Nothing is conserved: damping and the ship's motion change the energy."""
        del t, y
        return {}

    @staticmethod
    @constructor(
        tilt=argument(
            "rad",
            low=-0.5 * math.pi,
            high=0.5 * math.pi,
            default=0.0,
            doc="alpha, elevation of the axis",
        ),
        azimuth=argument("rad", default=0.0, doc="psi, of the axis, west of north"),
        tilt_rate=argument("rad/s", default=0.0, doc="rate of the tilt"),
        azimuth_rate=argument("rad/s", default=0.0, doc="rate of the azimuth"),
    )
    def state(
        tilt: Scalar = 0.0,
        azimuth: Scalar = 0.0,
        tilt_rate: Scalar = 0.0,
        azimuth_rate: Scalar = 0.0,
    ) -> GyrocompassState:
        """The state with these angles, rad, and rates, rad/s."""
        given = (as_float(x) for x in (tilt, azimuth, tilt_rate, azimuth_rate))
        return GyrocompassState(*jnp.broadcast_arrays(*given))

    @property
    @no_method
    def frame_rate(self) -> tuple[Scalar, Scalar, Scalar]:
        """W, rad/s, of the local east, north and up."""
        north, east = self.speed * jnp.cos(self.course), self.speed * jnp.sin(self.course)
        s, c = jnp.sin(self.latitude), jnp.cos(self.latitude)
        turn = self.earth_rate + east / (self.radius * c)
        return -north / self.radius, turn * c, turn * s

    @property
    def rest_tilt(self) -> Scalar:
        """The elevation alpha at which the axis rests, rad (Thomson 6.4); NaN with the azimuth."""
        return self._rest()[0]

    @property
    def rest_azimuth(self) -> Scalar:
        """The azimuth psi at which the axis rests, rad west of north: the heading error of the
        ship's motion and the offset of the damping together (Thomson 6.5-16, there for a small
        one); NaN where the offset is too large for a rest."""
        return self._rest()[1]

    @property
    def heading_error(self) -> Scalar:
        """The angle by which the ship's speed deflects the meridian of the compass to the west,
        rad: tan(gamma) = v cos(course) / (R Omega cos(latitude) + v sin(course))."""
        east, north, _ = self.frame_rate
        return jnp.arctan2(-east, north)

    @property
    @no_method
    def frequencies(self) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of the slow oscillation about the meridian and of the
        nutation, both without damping (Thomson 6.5-11)."""
        H = self.spin_momentum
        inertias = self.tilt_inertia * self.azimuth_inertia
        a = H * self.frame_rate[1]
        b = self._stiffness()
        total = (H * H + a * self.tilt_inertia + b * self.azimuth_inertia) / inertias
        product = a * b / inertias
        fast = 0.5 * (total + jnp.sqrt(total * total - 4.0 * product))
        # By the product of the roots, because their difference has no digit of the slow one.
        return jnp.sqrt(product / fast), jnp.sqrt(fast)

    @property
    def slow_frequency(self) -> Scalar:
        """Angular frequency, rad/s, of the slow oscillation without the inertias and the damping:
        sqrt(W_N b / H)."""
        return jnp.sqrt(self.frame_rate[1] * self._stiffness() / self.spin_momentum)

    @property
    def damping_ratio(self) -> Scalar:
        """Damping ratio of the slow oscillation: we / (2 H) over its frequency (Thomson 6.5-15)."""
        return 0.5 * self.damping_moment / (self.spin_momentum * self.slow_frequency)

    @property
    def clamped_frequency(self) -> Scalar:
        """Angular frequency, rad/s, in azimuth with the tilt clamped (Thomson 6.5, problem 3)."""
        return jnp.sqrt(self.spin_momentum * self.frame_rate[1] / self.azimuth_inertia)

    def small_motion(self, t: Scalar, y: GyrocompassState) -> GyrocompassState:
        """The state a time `t`, s, after `y`, by the linear equations, exactly: nutation and slow
        motion together (Thomson 6.5-9)."""
        H, I_h, I_e = self.spin_momentum, self.tilt_inertia, self.azimuth_inertia
        east, north, up = self.frame_rate
        matrix = rows(
            (0.0, 0.0, 1.0, 0.0),
            (0.0, 0.0, 0.0, 1.0),
            (-self._stiffness() / I_h, 0.0, 0.0, H / I_h),
            (-self.damping_moment / I_e, -H * north / I_e, -H / I_e, 0.0),
        )
        drive = rows((0.0,), (0.0,), (H * up / I_h,), (-H * east / I_e,))[:, 0]
        return LinearFlow(matrix, drive).flow(t, y)

    def slow_motion(self, t: Scalar, tilt: Scalar, azimuth: Scalar) -> tuple[Scalar, Scalar]:
        """Tilt and azimuth, rad, a time `t`, s, later, without the nutation (Thomson 6.5-3, -14):
        an ellipse of the axis's end, a spiral with damping."""
        east, north, up = self.frame_rate
        matrix = rows(
            (-self.damping_moment / self.spin_momentum, -north),
            (self._stiffness() / self.spin_momentum, 0.0),
        )
        drive = rows((-east,), (-up,))[:, 0]
        tilt, azimuth = LinearFlow(matrix, drive).flow(t, (as_float(tilt), as_float(azimuth)))
        return tilt, azimuth

    def _rest(self) -> tuple[Scalar, Scalar]:
        """Tilt and azimuth, rad, of the rest on a ship that does not roll, by the moments of H and
        of the bail; the moments of the inertias are smaller by the earth's rate over the spin,
        1e-7."""
        east, north, up = self.frame_rate
        level = sqrt(east * east + north * north)
        H = self.spin_momentum
        across = 0.0 * level
        # Without damping the first step is exact, with it each one divides the error by 1e5.
        for _ in range(REST_STEPS):
            along = jnp.sqrt((level - across) * (level + across))
            tilt = jnp.arctan2(H * up, self.pendulous_moment + H * along)
            across = self.damping_moment / H * jnp.sin(tilt)
        return tilt, self.heading_error - jnp.arcsin(across / level)

    def _stiffness(self) -> Scalar:
        return self.pendulous_moment + self.spin_momentum * self.frame_rate[1]

    def _plumb(self, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """f / g, to the east, north and up."""
        size = self.roll_acceleration / self.gravity * jnp.cos(self.roll_frequency * t)
        east, north = jnp.sin(self.roll_direction), jnp.cos(self.roll_direction)
        # Apparent gravity: a bail hangs along gravity minus the acceleration of its support.
        return -size * east, -size * north, -1.0

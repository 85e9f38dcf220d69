"""Inertial navigator on the rotating ellipsoidal earth in level axes: strapdown or gimballed.

    v' = C f + g(phi, h) - (2 Omega + rho) x v - (0, 0, k_1 (v_u - v_u*) + k_2 (h - h*))
    phi' = v_n / (M + h),   lambda' = v_e / ((N + h) cos(phi)),   h' = v_u
    C' = C [omega] - [Omega + rho] C
    strapdown   f = (1 + S_a) f_B + b,  omega = (1 + S_g) omega_B + e          C: body to level axes
    gimballed   the same with instruments that a table keeps level; e turns the table

    symbol              meaning                                                   unit
    phi, lambda, h      computed latitude, longitude, height                      rad, m
    v                   velocity over the ground: east, north, up                 m/s
    C                   computed attitude; for a table, its tilt
    f_B, omega_B        readings of ideal accelerometers and gyros                m/s^2, rad/s
    b, e                bias of the accelerometers, drift of the gyros            m/s^2, rad/s
    S_a, S_g            errors of scale                                           1
    Omega, rho          rate of the earth, of level axes over it                  rad/s
    h*, v_u*, k_1, k_2  reading of an altimeter, its gains                        m, m/s, 1/s, 1/s^2

The vehicle moves on a path (see `felt_on`) that the navigator does not know. `errors` gives the
errors of 6.11 in the form of `NavigationErrors`, whose equations are the derivative of these on a
sphere.

Source: Thomson 6.10, 6.11; Titterton and Weston, Strapdown Inertial Navigation Technology, 3, 12.
Level axes do not exist at a pole. Without an altimeter the height is unstable (6.11).
"""

import math
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, Vector, argument, constructor, quantity
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.square_roots import sqrt
from ..core.types import as_float, precision_of
from ..core.vectors import cross
from ..rotations import Quaternion
from ._earth import Earth
from ._shapes import ZERO, Three
from ._vehicle import Felt, Path, Place, felt_on
from .navigation_errors import NavigationErrors, NavigationErrorState

Given = Three | tuple[float, float, float]


@final
@printed()
class NavigatorState(eqx.Module):
    """State of a navigator; also its rates.

    - `attitude`: C, the computed attitude, from body to level axes (east, north, up)."""

    latitude: NumberField = quantity("rad", doc="phi, geodetic")
    longitude: NumberField = quantity("rad", doc="lambda, to the east")
    height: NumberField = quantity("m", doc="h, above the ellipsoid")
    velocity: Three = quantity("m/s", doc="v, over the ground: east, north, up")
    attitude: Quaternion  # pyright: ignore[reportGeneralTypeIssues]


@final
class InertialNavigator(AbstractSystem):
    """A navigator in a vehicle on a parallel, a steady course or any path, strapdown by default.
    State: `NavigatorState`, preferably created with `state`.

    - `path`: a function from the time, s, to a `Place`, which replaces the course given by the
      parameters.
    - `anomaly`: a function from latitude, longitude, rad, and height, m, to the difference of the
      real gravity from that of the ellipsoid, m/s^2, (3, *runs) in level axes: deflections of the
      vertical times -g, and anomaly. It is unknown to the navigator.
    - `gimballed`: whether the instruments are on a levelled table."""

    latitude: NumberField = quantity(
        "rad", low=-0.5 * math.pi, high=0.5 * math.pi, doc="of the vehicle at t = 0"
    )
    longitude: NumberField = quantity("rad", default=0.0, doc="of the vehicle at t = 0")
    height: NumberField = quantity("m", default=0.0, doc="of the vehicle at t = 0")
    east_speed: NumberField = quantity("m/s", default=0.0, doc="at the time zero")
    north_speed: NumberField = quantity("m/s", default=0.0, doc="at the time zero")
    climb: NumberField = quantity("m/s", default=0.0, doc="rate of the height")
    heading: NumberField = quantity("rad", default=0.0, doc="of the body, from north to east")
    roll_amplitude: NumberField = quantity(
        "rad", default=0.0, doc="of an oscillation about the body's x axis"
    )
    roll_frequency: NumberField = quantity("rad/s", default=1.0, doc="of the oscillation")
    accelerometer_bias: Three = quantity("m/s^2", default=ZERO, doc="b")
    gyro_drift: Three = quantity("rad/s", default=ZERO, doc="e, excess of the rate that gyros show")
    accelerometer_scale: Three = quantity(
        "", default=ZERO, doc="S_a, scale-factor errors of the accelerometers"
    )
    gyro_scale: Three = quantity("", default=ZERO, doc="S_g, of a body's gyros")
    altitude_rate_gain: NumberField = quantity(
        "1/s", default=0.0, doc="k_1, gain of the altimeter on the vertical speed"
    )
    altitude_gain: NumberField = quantity(
        "1/s^2", default=0.0, doc="k_2, gain of the altimeter on the height"
    )
    # By default the ellipsoid of WGS 84, with the second zonal harmonic of EGM96.
    radius: NumberField = quantity(
        "m", positive=True, default=6378137.0, doc="equatorial radius", shared="planet.radius"
    )
    flattening: NumberField = quantity(
        "", low=0.0, high=0.5, default=1.0 / 298.257223563, doc="of the ellipsoid"
    )
    mu: NumberField = quantity(
        "m^3/s^2",
        positive=True,
        default=3.986004418e14,
        doc="gravitational parameter of the earth",
        shared="planet.mu",
    )
    j2: NumberField = quantity(
        "", default=1.08262668e-3, doc="second zonal harmonic", shared="planet.j2"
    )
    earth_rate: NumberField = quantity(
        "rad/s",
        default=7.292115e-5,
        doc="rotation rate of the earth",
        shared="planet.rotation_rate",
    )
    path: Path | None = None
    anomaly: Callable[[Scalar, Scalar, Scalar], Vector] | None = None
    gimballed: bool = eqx.field(static=True, default=False)

    def vector_field(self, t: Scalar, y: NavigatorState) -> NavigatorState:
        earth = self.earth
        felt = self.felt(t)
        force, turn = self._measured(felt, y.attitude)
        # Shared parameters broadcast against those of each run.
        rank = max(force.ndim, turn.ndim, y.velocity.ndim, jnp.ndim(y.latitude) + 1) - 1
        velocity = with_rank(y.velocity, rank)
        earth_rate = with_rank(earth.angular_velocity(y.latitude), rank)
        transport = with_rank(earth.transport_rate(y.latitude, y.height, y.velocity), rank)
        gravity = with_rank(earth.gravity(y.latitude, y.height), rank)
        rate = with_rank(force, rank) + gravity - cross(2.0 * earth_rate + transport, velocity)
        up = with_rank(jnp.asarray(ZERO[:2] + (1.0,), rate.dtype), rank)
        aided = self.altitude_rate_gain * (y.velocity[2] - felt.velocity[2])
        aided = aided + self.altitude_gain * (y.height - felt.place.height)
        north, east, climb = earth.place_rates(y.latitude, y.height, y.velocity)
        turn = with_rank(turn, rank) - y.attitude.rotate_back(earth_rate + transport)
        return NavigatorState(north, east, climb, rate - aided * up, y.attitude.rate(turn))

    def invariants(self, t: Scalar, y: NavigatorState) -> dict[str, Array]:
        """Nothing is conserved with faults of the instruments."""
        del t, y
        return {}

    @constructor(
        position=argument("m", shape=(3,), default=ZERO, doc="error: east, north, up"),
        velocity=argument("m/s", shape=(3,), default=ZERO, doc="error over the ground"),
        tilt=argument(
            "rad",
            low=-math.pi,
            high=math.pi,
            shape=(3,),
            default=ZERO,
            doc="error of the attitude, a turn",
        ),
    )
    def state(
        self, position: Given = ZERO, velocity: Given = ZERO, tilt: Given = ZERO
    ) -> NavigatorState:
        """The state of a navigator with these errors in level axes, (3, *runs), at the time
        zero."""
        felt = self.felt(0.0)
        earth = self.earth
        given = position, velocity, tilt
        kind = precision_of(self, *given)
        (east, north, up), v, turn = (as_float(x).astype(kind) for x in given)
        place = felt.place
        along, across = earth.curvature_radii(place.latitude)
        level = (across + place.height) * jnp.cos(place.latitude)
        turned = Quaternion.from_rotation_vector(turn)
        true = Quaternion.identity() if self.gimballed else felt.attitude
        parts = (place.latitude + north / (along + place.height), place.longitude + east / level)
        attitude = turned.then(true)
        rank = max(v.ndim, felt.velocity.ndim, attitude.wxyz.ndim) - 1
        v = with_rank(v, rank) + with_rank(felt.velocity, rank)
        return NavigatorState(*parts, place.height + up, v, attitude)

    @property
    def earth(self) -> Earth:
        """The earth on which it navigates."""
        return Earth(self.radius, self.flattening, self.mu, self.j2, self.earth_rate)

    def felt(self, t: Scalar) -> Felt:
        """The motion of the vehicle at `t`, s, and the readings of perfect instruments."""
        return felt_on(self._course if self.path is None else self.path, self.earth, t)

    def errors(self, t: Scalar, y: NavigatorState) -> NavigationErrorState:
        """The exact errors of the navigator's state in the true level axes; the tilt is the error
        of its attitude in inertial space."""
        felt = self.felt(t)
        place = felt.place
        true = Quaternion.identity() if self.gimballed else felt.attitude
        here = NavigatorState(*place[:3], felt.velocity, true)
        level, computed = (_level(p.latitude, p.longitude) for p in (here, y))
        # In inertial space, because the two sets of level axes differ themselves.
        result, known = self._inertial(y, computed), self._inertial(here, level)
        rank = result[1].ndim - 1
        r, v = (a - with_rank(b, rank) for a, b in zip(result, known, strict=True))
        position = level.rotate_back(r)
        velocity = level.rotate_back(v) - cross(with_rank(felt.level_rate, rank), position)
        tilt = computed.then(y.attitude).then(level.then(true).inverse()).rotation_vector()
        return NavigationErrorState(position, velocity, level.rotate_back(tilt))

    def error_equations(self, t: Scalar = 0.0) -> NavigationErrors:
        """The linear error equations of 6.11 with the coefficients of the time `t`, s: exact to
        first order for a body with constant heading on a parallel of a sphere."""
        felt = self.felt(t)
        north, up = self.earth.from_centre(felt.place.latitude, felt.place.height)
        radius = sqrt(north * north + up * up)
        faults = (self.accelerometer_bias, self.gyro_drift)
        turn = Quaternion.identity() if self.gimballed else felt.attitude
        bias, drift = (turn.rotate(x) for x in faults)
        return NavigationErrors(
            radius,
            self.mu / radius**2,
            felt.level_rate,
            felt.specific_force,
            bias,
            drift,
            self.altitude_rate_gain,
            self.altitude_gain,
        )

    def _course(self, t: Scalar) -> Place:
        place = self.latitude, self.height
        speed = jnp.broadcast_arrays(self.east_speed, self.north_speed, self.climb)
        north, east, up = self.earth.place_rates(*place, jnp.stack(speed))
        roll = self.roll_amplitude * jnp.sin(self.roll_frequency * t)
        still = 0.0 * t
        return Place(
            self.latitude + north * t,
            self.longitude + east * t,
            self.height + up * t,
            self.heading + still,
            still,
            roll,
        )

    def _measured(self, felt: Felt, attitude: Quaternion) -> tuple[Vector, Vector]:
        """The specific force in the computed level axes, and the rate of the axes that `attitude`
        rotates, in these axes."""
        force = felt.specific_force
        if self.anomaly is not None:
            place = felt.place
            more = self.anomaly(place.latitude, place.longitude, place.height)
            # Specific force is acceleration minus gravity, so that the anomaly is subtracted.
            force = force - with_rank(more, force.ndim - 1)
        if self.gimballed:
            # The table has the axes of the instruments.
            sensed = attitude.rotate(force)
            sensed = _plus(sensed, self.accelerometer_scale, self.accelerometer_bias)
            drift = attitude.rotate_back(self.gyro_drift)
            return sensed, with_rank(felt.level_rate, drift.ndim - 1) + drift
        sensed = felt.attitude.rotate_back(force)
        turn = felt.attitude.rotate_back(felt.level_rate)
        turn = turn + with_rank(felt.body_rate, turn.ndim - 1)
        sensed = _plus(sensed, self.accelerometer_scale, self.accelerometer_bias)
        return attitude.rotate(sensed), _plus(turn, self.gyro_scale, self.gyro_drift)

    def _inertial(self, y: NavigatorState, level: Quaternion) -> tuple[Vector, Vector]:
        """Position and velocity in inertial axes that coincide with those of the earth now."""
        p, z = self.earth.from_axis(y.latitude, y.height)
        r = jnp.stack(jnp.broadcast_arrays(p * jnp.cos(y.longitude), p * jnp.sin(y.longitude), z))
        spin = jnp.stack(jnp.broadcast_arrays(-r[1], r[0], 0.0 * r[2]))
        v = level.rotate(y.velocity)
        return with_rank(r, v.ndim - 1), v + with_rank(self.earth_rate * spin, v.ndim - 1)


def _level(latitude: Scalar, longitude: Scalar) -> Quaternion:
    """The attitude from level axes to those of the earth."""
    # East to y, north to z, up to x; then turned to the latitude and to the longitude.
    half = 0.5 + 0.0 * latitude
    swap = Quaternion(jnp.stack([half, half, half, half]))
    return Quaternion.about(2, longitude).then(Quaternion.about(1, -latitude)).then(swap)


def _plus(x: Vector, scale: Vector, bias: Vector) -> Vector:
    rank = max(x.ndim, scale.ndim, bias.ndim) - 1
    x, scale, bias = (with_rank(a, rank) for a in (x, scale, bias))
    return x + scale * x + bias

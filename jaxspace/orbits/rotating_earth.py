"""Frames of a planet that rotates about the z axis, and its plumb line.

    local frame: x south, y east, z up      w = W (-cos(lat), 0, sin(lat))
    navigation frame: x east, y north, z up
        w = (-lat', (lon' + W) cos(lat), (lon' + W) sin(lat))
    tan(d) = k sin(lat) cos(lat) / (1 - k cos^2(lat)),  k = W^2 R^3 / mu

    symbol     meaning                                                    unit
    lat, lon   geocentric latitude, longitude                             rad
    W          rate of the planet                                         rad/s
    w          angular velocity of the frame, in its axes                 rad/s
    R          radius                                                     m
    mu         gravitational parameter                                    m^3/s^2
    d          plumb line against the line to the centre                  rad

Source: Thomson 2.6, problem 2.6-1, problems 3-9 to 3-12.
The planet is a sphere: the plumb line follows from its attraction and rotation only.
"""

__all__ = ["local_frame", "navigation_rates", "planet_frame", "plumb_line_deviation"]

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.squares import quotient
from ..core.vectors import axis, cross, scale
from ..rotations import MovingFrame, Quaternion


@formula
def planet_frame(angle: Scalar, rate: Scalar) -> MovingFrame:
    """The frame fixed to a planet that rotates about the z axis.

    **Arguments**

    - `angle`: turned from the inertial axes, rad, (*runs,).
    - `rate`: of the planet, rad/s, (*runs,).

    **Returns** a `MovingFrame` with the centre as its origin: its `to_inertial` and `from_inertial`
    change between the axes of the planet and inertial ones.
    """
    angle = jnp.asarray(angle)
    return MovingFrame(Quaternion.about(2, angle), scale(rate, axis(2, angle)))


@formula(radius=POSITIVE)
def local_frame(latitude: Scalar, longitude: Scalar, radius: Scalar, rate: Scalar) -> MovingFrame:
    """The frame of a place on a rotating planet: x south, y east, z up (Thomson 2.6).

    **Arguments**, each (*runs,)

    - `latitude`: geocentric, rad.
    - `longitude`: from the inertial x axis at this instant, rad.
    - `radius`: distance of the place from the centre, m.
    - `rate`: of the planet, rad/s.

    **Returns** a `MovingFrame` with the place as its origin.
    """
    latitude, longitude = jnp.broadcast_arrays(jnp.asarray(latitude), jnp.asarray(longitude))
    # The axis of the planet, tilted by the colatitude: z then points up and x to the south.
    down = Quaternion.about(1, 0.5 * jnp.pi - latitude)
    attitude = Quaternion.about(2, longitude).then(down)
    spin = scale(rate, axis(2, longitude))
    position = scale(radius, attitude.rotate(axis(2, longitude)))
    velocity = cross(spin, position)
    return MovingFrame(
        attitude,
        attitude.rotate_back(spin),
        jnp.zeros_like(spin),
        position,
        velocity,
        cross(spin, velocity),
    )


@formula
def navigation_rates(
    latitude: Scalar,
    latitude_rate: Scalar,
    longitude_rate: Scalar,
    rate: Scalar,
    latitude_acceleration: Scalar = 0.0,
    longitude_acceleration: Scalar = 0.0,
) -> tuple[Vector, Vector]:
    """Angular velocity of the axes east, north, up of a vehicle, and its rate (Thomson, problems
    3-9, 3-12).

    **Arguments**, each (*runs,)

    - `latitude`: geocentric, rad.
    - `latitude_rate`, `longitude_rate`: of the vehicle over the planet, rad/s.
    - `rate`: of the planet, rad/s.
    - `latitude_acceleration`, `longitude_acceleration`: rad/s^2.

    **Returns** w, rad/s, and w', rad/s^2, (3, *runs), in these axes: the `omega` and `omega_rate`
    of a `MovingFrame`.
    """
    c, s = jnp.cos(latitude), jnp.sin(latitude)
    turn = longitude_rate + rate
    omega = jnp.broadcast_arrays(-latitude_rate, turn * c, turn * s)
    omega_rate = jnp.broadcast_arrays(
        -latitude_acceleration,
        longitude_acceleration * c - turn * latitude_rate * s,
        longitude_acceleration * s + turn * latitude_rate * c,
    )
    return jnp.stack(omega), jnp.stack(omega_rate)


@formula(mu=POSITIVE, radius=POSITIVE)
def plumb_line_deviation(latitude: Scalar, mu: Scalar, radius: Scalar, rate: Scalar) -> Scalar:
    """Angle between the plumb line and the line to the centre (Thomson, problem 2.6-1).

    **Arguments**, each (*runs,)

    - `latitude`: geocentric, rad.
    - `mu`: gravitational parameter, m^3/s^2.
    - `radius`: distance from the centre, m.
    - `rate`: of the planet, rad/s.

    **Returns** d, rad, (*runs,): positive on the northern half, where the plumb line meets the axis
    south of the centre. It is greatest where cos(2 lat) = k / (2 - k).
    """
    k = quotient(rate * rate * radius, mu) * radius * radius
    c, s = jnp.cos(latitude), jnp.sin(latitude)
    return jnp.arctan2(k * s * c, 1.0 - k * c * c)

"""Readings of perfect instruments in a vehicle on a known path.

    f = v' + (2 Omega + rho) x v - g           in level axes
    omega_B = omega_NB + C_BN (Omega + rho)    in body axes

    symbol       meaning                                                      unit
    f            specific force                                               m/s^2
    v            velocity over the ground: east, north, up                    m/s
    Omega, rho   rate of the earth; of level axes over it                     rad/s
    omega_NB     rate of the body relative to level axes                      rad/s

Body axes point forwards, to the right and downwards. Everything follows from the path by its
derivatives, so that any smooth function of time is a vehicle.

Source: Thomson 2.6, 6.10; Titterton and Weston, Strapdown Inertial Navigation Technology, 3.5.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.vectors import cross
from ..rotations import Quaternion
from ._earth import Earth


@printed(latitude="rad", longitude="rad", height="m", heading="rad", pitch="rad", roll="rad")
class Place(NamedTuple):
    """Place and attitude of a vehicle, each (*runs,): latitude, longitude, rad, and height,
    m; heading from north to east, pitch and roll, rad."""

    latitude: Scalar
    longitude: Scalar
    height: Scalar
    heading: Scalar
    pitch: Scalar
    roll: Scalar

    @property
    def attitude(self) -> Quaternion:
        """The attitude from body axes to level axes."""
        turned = Quaternion.about(2, self.heading).then(Quaternion.about(1, self.pitch))
        # North, east, down as seen from east, north, up: half a turn about the line between.
        half = jnp.sqrt(0.5) + 0.0 * self.heading
        swap = Quaternion(jnp.stack([0.0 * half, half, half, 0.0 * half]))
        return swap.then(turned.then(Quaternion.about(0, self.roll)))

    def body_rate(self, rate: "Place") -> Vector:
        """Angular velocity relative to level axes, rad/s, in body axes, from the rates of the
        angles (Thomson 3.5)."""
        s, c = jnp.sin(self.roll), jnp.cos(self.roll)
        turn = rate.heading * jnp.cos(self.pitch)
        parts = (
            rate.roll - rate.heading * jnp.sin(self.pitch),
            rate.pitch * c + turn * s,
            turn * c - rate.pitch * s,
        )
        return jnp.stack(jnp.broadcast_arrays(*parts))


Path = Callable[[Scalar], Place]


class Felt(NamedTuple):
    """Motion of the vehicle: place, velocity over the ground, its rate and the rate of the level
    axes; the body's attitude and its rate relative to level axes, in body axes."""

    place: Place
    velocity: Vector
    specific_force: Vector
    level_rate: Vector
    attitude: Quaternion
    body_rate: Vector


def felt_on(path: Path, earth: Earth, t: Scalar) -> Felt:
    """Readings of perfect instruments in a vehicle on a path at the time `t`, s; vectors in level
    axes, (3, *runs)."""
    t = jnp.asarray(t)
    one = jnp.ones_like(t)

    def velocity(t: Scalar) -> tuple[Vector, tuple[Place, Place]]:
        place, rate = jax.jvp(path, (t,), (one,))
        along, across = earth.curvature_radii(place.latitude)
        east = (across + place.height) * jnp.cos(place.latitude) * rate.longitude
        north = (along + place.height) * rate.latitude
        return jnp.stack(jnp.broadcast_arrays(east, north, rate.height)), (place, rate)

    # Velocity and acceleration by one nested derivative, which also returns the place and its
    # rates.
    v, v_rate, (place, rate) = jax.jvp(velocity, (t,), (one,), has_aux=True)
    rank = v.ndim - 1
    turn = with_rank(earth.angular_velocity(place.latitude), rank)
    transport = with_rank(earth.transport_rate(place.latitude, place.height, v), rank)
    gravity = with_rank(earth.gravity(place.latitude, place.height), rank)
    force = v_rate + cross(2.0 * turn + transport, v) - gravity

    omega = place.body_rate(rate)
    return Felt(place, v, force, turn + transport, place.attitude, omega)

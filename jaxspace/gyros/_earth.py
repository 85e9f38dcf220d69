"""The rotating ellipsoidal earth in level axes: east, north, and up along its normal.

    N = a / w,  M = N (1 - e^2) / w^2,  w = sqrt(1 - e^2 sin^2(phi)),  e^2 = f (2 - f)
    p = (N + h) cos(phi),   z = (N (1 - e^2) + h) sin(phi)
    r = (0, -N e^2 sin(phi) cos(phi), a w + h)                            in level axes
    G = -mu/r^3 {[1 + k (1 - 5 z^2/r^2)] r + 2 k z e_z},   k = 3/2 J_2 (a/r)^2
    g = G + Omega^2 p e_p

    symbol          meaning                                              unit
    phi, h          geodetic latitude, height above the ellipsoid        rad, m
    a, f, e         equatorial radius, flattening, eccentricity          m, 1, 1
    M, N            radii of curvature along the meridian and across it  m
    p, z            distance from the axis, height above the equator     m
    r               position from the centre of the earth                m
    e_p, e_z        directions of p and z                                1
    mu, J_2, Omega  gravitational parameter, second zonal, rate          m^3/s^2, 1, rad/s
    G, g            attraction; gravity, along which a plumb line hangs  m/s^2

Source: Thomson 2.6, 6.11; Titterton and Weston, Strapdown Inertial Navigation Technology, 3.7.
With f = J_2 = 0 the earth is the sphere of the book.
"""

from typing import NamedTuple

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.square_roots import inverse_sqrt
from ..core.squares import quotient


class Earth(NamedTuple):
    """The constants of an earth: a, f, mu, J_2 and its rate, each (*runs,)."""

    radius: Scalar
    flattening: Scalar
    mu: Scalar
    j2: Scalar
    rate: Scalar

    def curvature_radii(self, latitude: Scalar) -> tuple[Scalar, Scalar]:
        """M and N, m, at a latitude, rad."""
        e2 = self.flattening * (2.0 - self.flattening)
        w2 = 1.0 - e2 * jnp.sin(latitude) ** 2
        across = self.radius * inverse_sqrt(w2)
        return across * (1.0 - e2) / w2, across

    def from_axis(self, latitude: Scalar, height: Scalar) -> tuple[Scalar, Scalar]:
        """p and z, m, of a place."""
        _, across = self.curvature_radii(latitude)
        # 1 - e^2 = (1 - f)^2, in which nothing cancels.
        polar = across * (1.0 - self.flattening) ** 2
        return (across + height) * jnp.cos(latitude), (polar + height) * jnp.sin(latitude)

    def from_centre(self, latitude: Scalar, height: Scalar) -> tuple[Scalar, Scalar]:
        """The components of the position to the north and upwards, m, in level axes."""
        s, c = jnp.sin(latitude), jnp.cos(latitude)
        e2 = self.flattening * (2.0 - self.flattening)
        w2 = 1.0 - e2 * s * s
        across = self.radius * inverse_sqrt(w2)
        return -across * e2 * s * c, across * w2 + height

    def gravity(self, latitude: Scalar, height: Scalar) -> Vector:
        """Gravity, m/s^2, in level axes, (3, *runs)."""
        s, c = jnp.sin(latitude), jnp.cos(latitude)
        # By p and z, the slopes along the meridian would be differences of those of large terms.
        r_north, r_up = self.from_centre(latitude, height)
        p, z = c * r_up - s * r_north, s * r_up + c * r_north
        r2 = r_north * r_north + r_up * r_up
        fall = quotient(self.mu, r2 * jnp.sqrt(r2))
        oblate = 1.5 * self.j2 * self.radius**2 / r2
        central = fall * (1.0 + oblate * (1.0 - 5.0 * z * z / r2))
        polar, outwards = 2.0 * fall * oblate * z, self.rate**2 * p
        north = -central * r_north - c * polar - s * outwards
        up = -central * r_up - s * polar + c * outwards
        # Nothing to the east: the field is the same all around the axis.
        return jnp.stack(jnp.broadcast_arrays(0.0 * up, north, up))

    def angular_velocity(self, latitude: Scalar) -> Vector:
        """The earth's angular velocity, rad/s, in level axes."""
        east = 0.0 * latitude
        parts = (east, self.rate * jnp.cos(latitude), self.rate * jnp.sin(latitude))
        return jnp.stack(jnp.broadcast_arrays(*parts))

    def place_rates(self, latitude: Scalar, height: Scalar, velocity: Vector) -> tuple[Scalar, ...]:
        """Rates of latitude and longitude, rad/s, and of height, m/s, of a velocity over the
        ground, m/s, in level axes; infinite at a pole."""
        along, across = self.curvature_radii(latitude)
        east, north, up = velocity
        return north / (along + height), east / ((across + height) * jnp.cos(latitude)), up

    def transport_rate(self, latitude: Scalar, height: Scalar, velocity: Vector) -> Vector:
        """Angular velocity of moving level axes relative to the earth, rad/s, in level axes."""
        north, east, _ = self.place_rates(latitude, height, velocity)
        parts = (-north, east * jnp.cos(latitude), east * jnp.sin(latitude))
        return jnp.stack(jnp.broadcast_arrays(*parts))

"""Ballistic flight from a sphere back to it: range, height, time, and the aim for a given range.

    lambda = r v^2 / mu
    tan(phi/2) = lambda s c / (1 - lambda c^2)          s, c: sine and cosine of beta
    t = 2 sqrt(r^3/mu) (psi + sqrt(lambda (2 - lambda)) s) / (2 - lambda)^(3/2)
    psi = atan2(sqrt(lambda (2 - lambda)) s, 1 - lambda)
    phi_max = 2 asin(lambda / (2 - lambda))             at beta = pi/4 - phi/4
    sin(phi/2) T^2 - lambda cos(phi/2) T + (1 - lambda) sin(phi/2) = 0        T = tan(beta)

    symbol  meaning                                                  unit
    r       radius of the sphere, on which flight begins and ends    m
    v       speed at burnout                                         m/s
    beta    flight-path angle at burnout, above the horizontal       rad
    phi     range: angle at the centre between both ends             rad
    t       duration                                                 s
    psi     eccentric anomaly from the highest point                 rad

Source: Thomson 4.17-1..6.
Valid in vacuum, about a sphere that attracts like a point mass. Its rotation enters through the
velocity of the site and the motion of the ground during the flight.
"""

__all__ = [
    "BallisticFlight",
    "BallisticImpact",
    "ballistic_angles",
    "ballistic_flight",
    "ballistic_impact",
    "least_energy_launch",
    "longest_range",
]

from typing import NamedTuple

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.safe import end_sqrt, safe_atan2, safe_sqrt
from ..core.squares import quotient
from ..core.types import as_float
from ..core.vectors import cross, dot, norm


@printed(range_angle="rad", height="m", duration="s")
class BallisticFlight(NamedTuple):
    """A flight that begins and ends on a sphere, each (*runs,): `range_angle` at the centre, rad;
    `height` of its highest point above the sphere, m; `duration`, s."""

    range_angle: Scalar
    height: Scalar
    duration: Scalar


@printed(latitude="rad", longitude="rad", range_angle="rad", height="m", duration="s")
class BallisticImpact(NamedTuple):
    """End of a flight over a rotating sphere, each (*runs,): `latitude`, and `longitude` east
    of the site within (-pi, pi], rad; `range_angle` along the ground, rad; `height` above the
    sphere, m; `duration`, s."""

    latitude: Scalar
    longitude: Scalar
    range_angle: Scalar
    height: Scalar
    duration: Scalar


@formula(radius=POSITIVE, speed=NOT_NEGATIVE, mu=POSITIVE)
def ballistic_flight(
    radius: Scalar, speed: Scalar, flight_path_angle: Scalar, mu: Scalar
) -> BallisticFlight:
    """Range, height and time of a flight, in inertial space (Thomson 4.17-1..6).

    **Arguments**, each (*runs,)

    - `radius`: of the sphere, m.
    - `speed`: at burnout, m/s; `flight_path_angle`: above the horizontal, rad, between zero and a
      right angle.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** range angle, rad, up to 2 pi, height, m, and duration, s. NaN where the flight does
    not return, from the escape speed on.
    """
    r = as_float(radius)
    lam = quotient(r * speed * speed, mu)
    s, c = jnp.sin(flight_path_angle), jnp.cos(flight_path_angle)
    closed = lam < 2.0
    # Only the range is finite beyond the escape speed: NaN here applies to all three results.
    lam = jnp.where(closed, lam, jnp.nan)
    p = lam * c * c
    cosine = 1.0 - p
    sine = lam * s * c
    half = safe_atan2(sine, cosine)
    e = safe_sqrt(cosine * cosine + sine * sine)
    # (r_a - r) / r = (e - cosine) / (1 - e), of which neither difference is formed where the flight
    # is short or steep: e^2 - cosine^2 = sine^2, 1 - e^2 = lambda (2 - lambda) c^2.
    short = cosine > 0.0
    low = lam * s * s * (1.0 + e) / ((2.0 - lam) * jnp.where(short, e + cosine, 1.0))
    wide = (e - cosine) * (1.0 + e) / (jnp.where(short, 1.0, p) * (2.0 - lam))
    height = r * jnp.where(short, low, wide)
    # psi + e sin psi, with psi the eccentric anomaly from the highest point.
    outwards = jnp.sqrt(lam * (2.0 - lam)) * s
    psi = jnp.arctan2(outwards, 1.0 - lam)
    duration = (
        2.0 * r * jnp.sqrt(quotient(r, mu)) * (psi + outwards) / ((2.0 - lam) * jnp.sqrt(2.0 - lam))
    )
    return BallisticFlight(2.0 * half, height, duration)


@formula(radius=POSITIVE, speed=NOT_NEGATIVE, range_angle=NOT_NEGATIVE, mu=POSITIVE)
def ballistic_angles(
    radius: Scalar, speed: Scalar, range_angle: Scalar, mu: Scalar
) -> tuple[Scalar, Scalar]:
    """The two flight-path angles that reach a range with a given speed: the low arc and the high
    one.

    **Arguments**, each (*runs,)

    - `radius`: of the sphere, m; `speed`: at burnout, m/s.
    - `range_angle`: rad, between zero and 2 pi.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the low and the high angle, rad, (*runs,). NaN beyond the longest range, and for the
    low one above the circular speed, where it would lead through the sphere. At the longest range
    both coincide, and their derivatives are infinite.
    """
    r = as_float(radius)
    lam = quotient(r * speed * speed, mu)
    sine, cosine = jnp.sin(0.5 * as_float(range_angle)), jnp.cos(0.5 * as_float(range_angle))
    lam, sine, cosine = jnp.broadcast_arrays(lam, sine, cosine)
    # lambda^2 cos^2 - 4 sin^2 (1 - lambda), as a product.
    root = end_sqrt(lambda l, s: (l - s * (2.0 - l)) * (l + s * (2.0 - l)), lam, sine)
    middle = lam * cosine
    # One root is the sum without a difference, the other follows from their product. Where lambda >
    # 1 and cosine < 0 only the high arc exists.
    ahead = middle >= 0.0
    long = jnp.where(ahead, middle + root, root - middle)
    short = 2.0 * sine * jnp.abs(1.0 - lam)
    low = jnp.arctan2(2.0 * sine * (1.0 - lam), long)
    high = jnp.where(ahead, jnp.arctan2(long, 2.0 * sine), jnp.arctan2(short, long))
    reached = ahead | (lam > 1.0)
    return jnp.where(ahead & (lam <= 1.0), low, jnp.nan), jnp.where(reached, high, jnp.nan)


@formula(radius=POSITIVE, range_angle=NOT_NEGATIVE, mu=POSITIVE)
def least_energy_launch(radius: Scalar, range_angle: Scalar, mu: Scalar) -> tuple[Scalar, Scalar]:
    """The slowest launch that reaches a range: speed, m/s, and flight-path angle, rad, (*runs,)
    (Thomson 4.17).

    **Arguments**, each (*runs,)

    - `radius`: of the sphere, m; `range_angle`: rad, up to pi; at zero the slope of the speed is
      infinite.
    - `mu`: gravitational parameter, m^3/s^2.
    """
    phi = as_float(range_angle)
    sine = jnp.sin(0.5 * phi)
    circular = jnp.sqrt(mu / as_float(radius))
    # At a range of zero `end_sqrt` makes the slope by the range infinite, and that by mu zero.
    speed = circular * end_sqrt(lambda s: 2.0 * s / (1.0 + s), sine)
    return speed, 0.25 * (jnp.pi - phi)


@formula(radius=POSITIVE, speed=NOT_NEGATIVE, mu=POSITIVE)
def longest_range(radius: Scalar, speed: Scalar, mu: Scalar) -> tuple[Scalar, Scalar]:
    """The longest range of a speed below the circular one, and the angle for it: both in rad,
    (*runs,) (Thomson 4.17).

    **Arguments**, each (*runs,)

    - `radius`: of the sphere, m; `speed`: at burnout, m/s.
    - `mu`: gravitational parameter, m^3/s^2.

    NaN above the circular speed, with which every place is reached; at that speed the slope is
    infinite."""
    lam = jnp.asarray(quotient(as_float(radius) * speed * speed, mu))
    phi = 2.0 * jnp.arctan2(lam, 2.0 * end_sqrt(lambda l: 1.0 - l, lam))
    return phi, 0.25 * (jnp.pi - phi)


@formula(radius=POSITIVE, speed=NOT_NEGATIVE, mu=POSITIVE)
def ballistic_impact(
    radius: Scalar,
    speed: Scalar,
    flight_path_angle: Scalar,
    azimuth: Scalar,
    latitude: Scalar,
    mu: Scalar,
    rotation_rate: Scalar = 0.0,
) -> BallisticImpact:
    """End of a flight on a rotating sphere (Thomson 4.17, problem 7).

    **Arguments**, each (*runs,)

    - `radius`: of the sphere, m.
    - `speed`, m/s, `flight_path_angle` and `azimuth`, from north to east, rad: of the velocity at
      burnout relative to the ground.
    - `latitude`: of the site, rad.
    - `mu`: gravitational parameter, m^3/s^2.
    - `rotation_rate`: of the sphere about its pole, eastwards, rad/s.

    **Returns** the place relative to the site, range along the ground, height and duration.
    """
    r = as_float(radius)
    level = speed * jnp.cos(flight_path_angle)
    north = level * jnp.cos(azimuth)
    # The velocity is relative to the ground, which moves eastwards itself.
    east = level * jnp.sin(azimuth) + rotation_rate * r * jnp.cos(latitude)
    # The zero broadcasts it over the runs of the azimuth and of the rate.
    up = speed * jnp.sin(flight_path_angle) + 0.0 * east
    along = safe_atan2(east, north)
    across = jnp.cos(along) * north + jnp.sin(along) * east
    flight = ballistic_flight(r, jnp.hypot(up, across), jnp.arctan2(up, across), mu)
    sine, cosine = jnp.sin(flight.range_angle), jnp.cos(flight.range_angle)
    s, c = jnp.sin(latitude), jnp.cos(latitude)
    # In axes whose x axis is in the meridian of the site at burnout.
    x = cosine * c - sine * jnp.cos(along) * s
    y = sine * jnp.sin(along)
    z = cosine * s + sine * jnp.cos(along) * c
    longitude = jnp.arctan2(y, x) - rotation_rate * flight.duration
    # By sine and cosine, because the planet may have turned by any angle since.
    longitude = jnp.arctan2(jnp.sin(longitude), jnp.cos(longitude))
    flat = jnp.hypot(x, y)
    end = jnp.stack([flat * jnp.cos(longitude), flat * jnp.sin(longitude), z])
    start = jnp.stack(jnp.broadcast_arrays(c + 0.0 * z, 0.0 * z, s + 0.0 * z))
    # By both products, because an arc cosine loses the digits of a short range.
    ground = safe_atan2(norm(cross(start, end)), dot(start, end))
    return BallisticImpact(jnp.arctan2(z, flat), longitude, ground, flight.height, flight.duration)

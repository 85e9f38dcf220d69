"""Precession of the Earth's axis
Precession of the equinoxes

The gravity of the Moon and the Sun acts on the Earth's equatorial bulge
(5.15): the pole circles that of the ecliptic in 26,000 years, opposite to the
spin, and nutates twice a month and twice a year. Left: the path among the
stars, one dot per 2,000 years; right: the motion within the first year,
without the secular part: loops of half a month on the ellipse of half a
year."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.precession_of_earth import (
    luni_solar_nutation,
    luni_solar_rate,
)

jaxspace.enable_x64()
year, month, spin, bulge = 365.25 * 86400.0, 27.32 * 86400.0, 7.292e-5, 0.0032
theta = jnp.radians(23.45)
pulls = {"sun": (1.0, year), "moon": (1.0 / 81.0, month)}
rate = sum(
    luni_solar_rate(f, tau, bulge, theta, spin) for f, tau in pulls.values()
)
whole = 2.0 * jnp.pi / abs(rate) / year
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 4.0))
t = jnp.linspace(0.0, whole, 400)
path = jnp.degrees(theta) * jnp.exp(1j * (rate * year * t + jnp.pi / 2.0))
left.plot(path.real, path.imag)
dots = jnp.arange(0.0, whole, 2000.0)
dots = jnp.degrees(theta) * jnp.exp(1j * (rate * year * dots + jnp.pi / 2.0))
left.plot(dots.real, dots.imag, "o", color="C0", ms=4)
left.plot(0.0, 0.0, "k+", ms=9)
left.annotate(
    "pole of the ecliptic", (0.0, 0.0), (0.0, -4.0), ha="center", size=8
)
left.set(xlabel="deg", ylabel="deg", aspect="equal")
left.set_title(f"Precession with a period of {whole:,.0f} years")

t = jnp.linspace(0.0, 1.0, 2000) * year
psi = dtheta = 0.0
for f, tau in pulls.values():
    along, across = luni_solar_nutation(f, tau, bulge, theta, spin)
    psi = psi + along * jnp.sin(4.0 * jnp.pi * t / tau)
    dtheta = dtheta + across * jnp.cos(4.0 * jnp.pi * t / tau)
second = jnp.degrees(1.0) * 3600.0
right.plot(psi * jnp.sin(theta) * second, dtheta * second, lw=1.0)
right.set(xlabel="along the circle, arcsec", ylabel="change of θ, arcsec")
right.set(aspect="equal", title="Nutation within one year")
plt.show()

"""Low-thrust transfer with the Q-law
From a low orbit to geostationary altitude with one newton

The Q-law steers the thrust of a scene file (case A of Petropoulos, 2004).
Left: the spiral of two weeks; right: the semi-major axis compared with that
of a slow spiral of circular orbits. At the end the law corrects the
eccentricity, which takes some hours."""

from pathlib import Path

import matplotlib.pyplot as plt

import jaxspace
from jaxspace.core.vectors import dot, norm
from jaxspace.orbits.low_thrust import spiral_radius
from jaxspace.rockets.rocket_equation import rocket_equation

jaxspace.enable_x64()
path = Path("examples") / "scenes" / "low_orbit_to_geostationary.toml"
file = jaxspace.load(path)
run = file.nominal_mission(samples=12000).phases[0]
mu, u = file.values["planet"]["mu"], 30400.615  # m^3/s^2, m/s
y, days = run.states, run.ts / 86400.0
r, v, mass = y.position, y.velocity, y.mass

a = 1.0 / (2.0 / norm(r) - dot(v, v) / mu)
slow = spiral_radius(a[0], rocket_equation(u, mass[0] / mass), mu)
figure, (left, right) = plt.subplots(1, 2, figsize=(6.8, 3.2))
left.plot(*r[:2] / 1e6, lw=0.4)
left.set(xlabel="x, 1000 km", ylabel="y, 1000 km", aspect="equal")
right.plot(days, a / 1e6, label="simulated")
right.plot(days, slow / 1e6, "k--", lw=1.0, label="circular orbits")
right.axhline(42.0, color="0.6", lw=1.0, label="target")
right.set(xlabel="time, days", ylabel="semi-major axis, 1000 km")
right.legend()
print("arrives after, days", days[-1], "with, kg", mass[-1])
plt.show()

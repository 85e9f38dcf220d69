"""The orbit of GEOS-3 from one radar pass over Kaena Point, Hawaii, on 29 January 1995.

Measurements and instrument errors: Vallado, Fundamentals of Astrodynamics and Applications, example
10-4: range in km, azimuth and elevation in degrees. The magnitudes of position and velocity found
there are 7216.76 km and 7432.6 m/s."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxspace
from jaxspace import Accuracy, BodyState, Scene, simulate
from jaxspace.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from jaxspace.estimation import fit
from jaxspace.orbits import Oblateness, PointGravity, Station
from jaxspace.orbits.elements import elements_from_state
from jaxspace.solvers import Tsit5

jaxspace.enable_x64()

# Seconds after 02:38, azimuth, elevation, range.
PASS = np.array(
    """
 37 60.4991 16.1932 2047.502   49 62.1435 17.2761 1984.677   62 64.0566 18.5515 1918.489
 74 65.8882 19.7261 1859.320   86 67.9320 20.9351 1802.186   98 70.1187 22.1319 1747.290
110 72.5159 23.3891 1694.891  123 75.3066 24.7484 1641.201  135 78.1000 25.9799 1594.770
147 81.1197 27.1896 1551.640  159 84.3708 28.3560 1512.085  171 87.8618 29.4884 1476.415
183 91.5955 30.5167 1444.915  195 95.5524 31.4474 1417.880  207 99.7329 32.2425 1395.563
219 104.0882 32.8791 1378.202 231 108.6635 33.3788 1366.010 243 113.2254 33.5998 1359.100
""".split(),
    float,
).reshape(-1, 4)
ts = PASS[:, 0] - PASS[0, 0]
BIAS = {"azimuth": 0.0081, "elevation": 0.0045, "range": 80e-3}
NOISE = {"azimuth": 0.0224, "elevation": 0.0139, "range": 92.5e-3}
data = dict(zip(("azimuth", "elevation", "range"), PASS.T[1:], strict=True))
data = {name: jnp.asarray(x - BIAS[name]) for name, x in data.items()}

# Greenwich sidereal angle at the first measurement, from the days since 2000 January 1.5.
days = 2449746.5 + (2 * 3600 + 38 * 60 + 37) / 86400 - 2451545.0
sidereal = np.radians((280.46061837 + 360.98564736629 * days) % 360.0)
station = Station(
    latitude=np.radians(21.5748),
    longitude=np.radians(-158.2706),
    altitude=300.2,
    radius=RADIUS_EARTH,
    flattening=1 / 298.257,
    rate=7.292115e-5,
    angle=sidereal,
)
scene = Scene([PointGravity(MU_EARTH), Oblateness(MU_EARTH, J2_EARTH, RADIUS_EARTH)])
accuracy = Accuracy(1e-9, method=Tsit5(), max_steps=256)


def readings(y0):
    """What the radar reads of the orbit from `y0` on."""
    path = simulate(scene, y0, ts, accuracy=accuracy, throw=False).states.position
    seen = station.look_angles(jnp.asarray(ts), path)
    azimuth, elevation = jnp.degrees(seen.azimuth), jnp.degrees(seen.elevation)
    return {"azimuth": azimuth, "elevation": elevation, "range": 1e-3 * seen.distance}


guess = BodyState(jnp.array([5.7e6, 2.7e6, 3.4e6]), jnp.array([4.2e3, -1.8e3, -5.6e3]))
found = fit(readings, data, guess, noise=NOISE)
print(found)
orbit = elements_from_state(found.parameters.position, found.parameters.velocity, MU_EARTH)
a = orbit.semi_latus_rectum / (1.0 - orbit.eccentricity**2)
inclination = float(jnp.degrees(orbit.inclination))
print(f"semi-major axis {float(a) / 1e3:.0f} km, inclination {inclination:.2f} deg")
for name, tests in found.tests.items():
    print(f"{name:9s} p-values: mean {tests.mean:.2f}, whiteness {tests.whiteness:.2f}")
print(f"p-value of chi^2 {found.p_value:.2f}")
lengths = [float(jnp.linalg.norm(x)) for x in jax.tree.leaves(found.parameters)]
# Different geopotential and axes: half a kilometre, and the standard deviation of the speed.
assert abs(lengths[0] - 7216.76e3) < 500.0 and abs(lengths[1] - 7432.62) < 2.0
# GEOS-3: 840 km and 115 degrees (NASA); the pass of three minutes determines the speed to 2
# m/s.
assert found.converged and abs(float(a) - 7.22e6) < 3e4 and abs(inclination - 115.0) < 0.2

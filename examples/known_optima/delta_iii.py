"""The ascent of a Delta III with nine boosters to a transfer orbit: 37 design variables, four
phases.

Six boosters and the first stage, three boosters and the first stage, the first stage, the second
stage; in an atmosphere that rotates with the Earth. Published: 7529.71 kg after 924.139 s (Benson,
A Gauss Pseudospectral Transcription for Optimal Control, MIT 2005; Rao et al., GPOPS, ACM
Transactions on Mathematical Software 37, 2010, multiple-stage launch vehicle ascent, whose
constants these are).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from known import report

from jaxspace.core import AbstractSystem
from jaxspace.core.vectors import cross, dot, norm
from jaxspace.optimization import Criterion, minimise
from jaxspace.simulation import Mission, Phase, simulate_compact

# Mass in orbit, kg, and time, s.
PUBLISHED, PUBLISHED_TIME = 7529.7123, 924.139
# Earth: m^3/s^2, m, rad/s.
MU, EARTH, SPIN = 3.986012e14, 6378145.0, 7.29211585e-5
# Atmosphere: kg/m^3, m; drag coefficient times area, m^2.
DENSITY, SCALE_HEIGHT, DRAG_AREA = 1.225, 7200.0, 0.5 * 4.0 * np.pi
SPEED = float(np.sqrt(MU / EARTH))
SECONDS = EARTH / SPEED
FORCE = SECONDS / SPEED / 1e3
# Propellant in kg, thrust in N and burn time in s of a booster and of both stages.
BOOSTER, FIRST, SECOND = (17010, 628500, 75.2), (95550, 1083100, 261), (16820, 110094, 700)
ENGINES = (((6, BOOSTER), (1, FIRST)), ((3, BOOSTER), (1, FIRST)), ((1, FIRST),), ((1, SECOND),))
SWITCHES = np.array([0.0, 75.2, 150.4, 261.0]) / SECONDS
DROPPED = np.array([6 * 2280.0, 3 * 2280.0, 104380.0 - 95550.0, 0.0]) / 1e3
START_MASS = (9 * 19290.0 + 104380.0 + 19300.0 + 4164.0) / 1e3
LATITUDE = np.radians(28.5)
# Orbit: semi-major axis, m, eccentricity, inclination, node and argument of the perigee.
ORBIT = (24361140.0, 0.7308, *np.radians([28.5, 269.8, 130.5]))


class DeltaIII(AbstractSystem):
    """Position, velocity and mass in radii of the earth, circular speeds and tonnes; the thrust
    points along a vector that is a polynomial in the time of the phase."""

    thrust: Array
    flow: Array
    span: Array
    vectors: Array

    def vector_field(self, t, y):
        r, v, m = y[:3], y[3:6], y[6]
        d = norm(r)
        x = 2.0 * (t - self.span[0]) / (self.span[1] - self.span[0]) - 1.0
        u = jnp.polyval(self.vectors, x)
        air = v - SPIN * SECONDS * jnp.stack([-r[1], r[0], 0.0 * d])
        density = DENSITY * jnp.exp(-(d - 1.0) * EARTH / SCALE_HEIGHT)
        drag = 0.5 * density * DRAG_AREA * EARTH / 1e3 * norm(air) * air
        a = -r / d**3 + (self.thrust * u / norm(u) - drag) / m
        return jnp.concatenate([v, a, -self.flow[None]])

    def invariants(self, t, y):
        return {}


def target_orbit():
    """Angular momentum, eccentricity, and the unit vectors along both, of the orbit of transfer."""
    a, e, i, O, w = ORBIT
    c, s = np.cos, np.sin
    P = [c(O) * c(w) - s(O) * s(w) * c(i), s(O) * c(w) + c(O) * s(w) * c(i), s(w) * s(i)]
    W = [s(O) * s(i), -c(O) * s(i), c(i)]
    return np.sqrt(a / EARTH * (1.0 - e * e)), e, np.array(W), np.array(P)


def problem(x):
    """Least time of the second stage, which is greatest mass, to five elements of the orbit."""
    marks = [*(jnp.asarray(t) for t in SWITCHES), x["end"]]
    phases = []
    for k, engines in enumerate(ENGINES):
        thrust = sum(n * p[1] for n, p in engines) * FORCE
        flow = sum(n * p[0] / p[2] for n, p in engines) * SECONDS / 1e3
        span = jnp.stack(marks[k : k + 2])
        system = DeltaIII(jnp.asarray(thrust), jnp.asarray(flow), span, x["vectors"][k])
        drop = lambda t, y, k=k: y.at[6].add(-DROPPED[k])  # noqa: E731
        phases.append(Phase(system, marks[k + 1] - marks[k], drop, name=str(k)))
    place = np.array([np.cos(LATITUDE), 0.0, np.sin(LATITUDE)])
    speed = SPIN * SECONDS * np.cos(LATITUDE)
    y0 = jnp.asarray([*place, 0.0, speed, 0.0, START_MASS])
    flight = simulate_compact(Mission(phases), y0, steps=20)
    r, v = flight.final[:3], flight.final[3:6]
    h = cross(r, v)
    e = cross(v, h) - r / norm(r)
    size, eccentricity, W, P = target_orbit()
    Q = np.cross(W, P)
    # h along P and Q, and e out of its line: five conditions in all.
    wanted = [dot(h, W) - size, dot(h, P), dot(h, Q), dot(e, P) - eccentricity, dot(e, Q)]
    report = (1e3 * flight.final[6], x["end"] * SECONDS, flight.error)
    return Criterion(0.1 * x["end"], jnp.stack(wanted), report=report)


def search():
    """From a rough guess of upwards and then eastwards, and 920 s."""
    up, east = np.array([0.88, 0.0, 0.48]), np.array([0.0, 1.0, 0.0])
    vectors = np.zeros((4, 3, 3))
    for k, (rise, along) in enumerate([(1.0, 0.5), (0.6, 0.8), (0.3, 1.0), (-0.2, 1.0)]):
        vectors[k, -1] = rise * up + along * east
    start = {"end": jnp.asarray(920.0 / SECONDS), "vectors": jnp.asarray(vectors)}
    sizes = {"end": jnp.asarray(0.05), "vectors": jnp.full(vectors.shape, 0.5)}
    options = {"scale": sizes, "tolerance": 3e-6, "max_steps": 400}
    return minimise(problem, start, **options)


def optimum(found):
    """The mass in orbit, kg."""
    return float(found.criterion.report[0])


if __name__ == "__main__":
    report("Delta III, final mass in kg", PUBLISHED, search, optimum)

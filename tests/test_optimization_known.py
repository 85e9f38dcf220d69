"""Ascents and transfers whose optima are published, found by gradients through fixed steps.

The whole of each, compilation included, takes seconds: the problem and its Jacobian are one small
program.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from jaxspace.core import AbstractSystem, cross, dot, norm
from jaxspace.optimization import Criterion, minimise
from jaxspace.simulation import Mission, Phase, fly_compact

pytestmark = pytest.mark.sweep


class Goddard(AbstractSystem):
    """h' = v, v' = (T - D)/m - 1/h^2, m' = -T/c with D = 310 v^2 exp(-500 (h - 1)), c = 1/2; the
    thrust is a polynomial in the time since `begins`, over `lasts`."""

    thrust: Array
    begins: Array
    lasts: Array

    def vector_field(self, t, y):
        h, v, m = y
        T = jnp.polyval(self.thrust, 2.0 * (t - self.begins) / self.lasts - 1.0)
        drag = 310.0 * v * v * jnp.exp(-500.0 * (h - 1.0))
        return jnp.stack([v, (T - drag) / m - 1.0 / (h * h), -2.0 * T])

    def invariants(self, t, y):
        return {}


def goddard(x):
    """Full thrust, a part of it, none: from (1, 0, 1) to the greatest height with 0.6 left."""
    full, arc, coast, thrust = x["full"], x["arc"], x["coast"], x["thrust"]
    zero = jnp.zeros(())
    phases = [
        Phase(Goddard(jnp.array([3.5]), zero, full), full, name="full"),
        Phase(Goddard(thrust, full, arc), arc, name="arc"),
        Phase(Goddard(jnp.zeros(1), full + arc, coast), coast, name="coast"),
    ]
    flight = fly_compact(Mission(phases), jnp.array([1.0, 0.0, 1.0]), steps=12)
    h, _, m = flight.final
    nodes = jnp.polyval(thrust, jnp.linspace(-1.0, 1.0, 9))
    return Criterion(-h, 10.0 * (m - 0.6), jnp.concatenate([nodes, 3.5 - nodes]), flight.error)


def test_goddards_rocket():
    """Final altitude 1.01283 (Bryson and Ho; Betts), relative error 1e-5. Between both thrusts lies
    an arc that no switching function decides, here a polynomial of five."""
    start = {
        "full": jnp.asarray(0.03),
        "arc": jnp.asarray(0.05),
        "coast": jnp.asarray(0.1),
        "thrust": jnp.zeros(6).at[-1].set(1.5),
    }
    low = jax.tree.map(lambda x: jnp.full(x.shape, 1e-3), start) | {"thrust": jnp.full(6, -jnp.inf)}
    high = {"full": 0.1, "arc": 0.2, "coast": 0.3, "thrust": np.inf}
    high = jax.tree.map(lambda x, b: jnp.full(x.shape, b), start, high)
    # The altitude is flat in the last coefficients: 1e-6 of the slope leaves 1e-10 of it.
    found = minimise(goddard, start, bounds=(low, high), method="sqp", tolerance=2e-6)
    assert found.converged, found.sentence()
    np.testing.assert_allclose(-found.criterion.objective, 1.01283, rtol=1e-5)
    assert found.criterion.report < 1e-6


class Burn(AbstractSystem):
    """Planar motion under mu = 1 with the acceleration a along phi + omega (t - begins), from the
    local horizontal."""

    a: Array
    phi: Array
    omega: Array
    begins: Array

    def vector_field(self, t, y):
        r, v = y[:2], y[2:]
        d = jnp.hypot(*r)
        angle = self.phi + self.omega * (t - self.begins)
        up = r / d
        level = jnp.stack([-up[1], up[0]])
        a = self.a * (jnp.cos(angle) * level + jnp.sin(angle) * up)
        return jnp.concatenate([v, a - r / d**3])

    def invariants(self, t, y):
        return {}


RADIUS, ACCELERATION = 42164.0 / 6678.0, 20.0


def transfer(x):
    """Two burns and a coast between them, from the circle of radius 1 to that of `RADIUS`."""
    zero, a = jnp.zeros(()), jnp.asarray(ACCELERATION)
    second = x["burn"][0] + x["coast"]
    phases = [
        Phase(Burn(a, x["phi"][0], x["omega"][0], zero), x["burn"][0], name="first"),
        Phase(Burn(zero, zero, zero, zero), x["coast"], name="coast"),
        Phase(Burn(a, x["phi"][1], x["omega"][1], second), x["burn"][1], name="second"),
    ]
    end = fly_compact(Mission(phases), jnp.array([1.0, 0.0, 0.0, 1.0]), steps=30).final
    r, v = end[:2], end[2:]
    d = jnp.hypot(*r)
    level = (r[0] * v[1] - r[1] * v[0]) / d
    miss = jnp.stack([d - RADIUS, (r @ v) / d, level - RADIUS**-0.5])
    return Criterion(ACCELERATION * jnp.sum(x["burn"]), miss)


def test_a_transfer_from_a_poor_start():
    """Burns 15 and 32 % too long, half a radian off the horizontal, a coast 18 % short. With
    twenty times the weight as thrust, the losses over Hohmann's impulses are below 1e-5."""
    start = {
        "burn": jnp.array([0.4, 0.25]) / ACCELERATION,
        "coast": jnp.asarray(18.0),
        "phi": jnp.array([0.5, -0.5]),
        "omega": jnp.zeros(2),
    }
    sizes = {"burn": 0.1 / ACCELERATION, "coast": 1.0, "phi": 1.0, "omega": 1.0}
    sizes = jax.tree.map(lambda x, s: jnp.full(x.shape, s), start, sizes)
    found = minimise(transfer, start, method="sqp", scale=sizes, tolerance=1e-6)
    assert found.converged, found.sentence()
    a = 0.5 * (1.0 + RADIUS)
    hohmann = np.sqrt(2.0 - 1.0 / a) - 1.0 + RADIUS**-0.5 - np.sqrt(2.0 / RADIUS - 1.0 / a)
    assert 0.0 < found.criterion.objective / hohmann - 1.0 < 1e-5


# Benson 2005; Rao et al., GPOPS (ACM Trans. Math. Softw. 37, 2010), launch vehicle ascent.
MU, EARTH, SPIN = 3.986012e14, 6378145.0, 7.29211585e-5
SPEED = float(np.sqrt(MU / EARTH))
SECONDS = EARTH / SPEED
FORCE = SECONDS / SPEED / 1e3
# Propellant in kg, thrust in N and burn time in s of a booster and of both stages.
BOOSTER, FIRST, SECOND = (17010, 628500, 75.2), (95550, 1083100, 261), (16820, 110094, 700)
ENGINES = (((6, BOOSTER), (1, FIRST)), ((3, BOOSTER), (1, FIRST)), ((1, FIRST),), ((1, SECOND),))
SWITCHES = np.array([0.0, 75.2, 150.4, 261.0]) / SECONDS
DROPPED = np.array([6 * 2280.0, 3 * 2280.0, 104380.0 - 95550.0, 0.0]) / 1e3
START_MASS = (9 * 19290.0 + 104380.0 + 19300.0 + 4164.0) / 1e3


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
        density = 1.225 * jnp.exp(-(d - 1.0) * EARTH / 7200.0)
        drag = 0.5 * density * 0.5 * 4.0 * np.pi * EARTH / 1e3 * norm(air) * air
        a = -r / d**3 + (self.thrust * u / norm(u) - drag) / m
        return jnp.concatenate([v, a, -self.flow[None]])

    def invariants(self, t, y):
        return {}


def target_orbit():
    """Angular momentum and eccentricity vector of the orbit of transfer."""
    a, e = 24361140.0 / EARTH, 0.7308
    i, O, w = np.radians([28.5, 269.8, 130.5])  # noqa: E741
    c, s = np.cos, np.sin
    P = [c(O) * c(w) - s(O) * s(w) * c(i), s(O) * c(w) + c(O) * s(w) * c(i), s(w) * s(i)]
    W = [s(O) * s(i), -c(O) * s(i), c(i)]
    return np.sqrt(a * (1.0 - e * e)), e, np.array(W), np.array(P)


def ascent(x):
    """Least time of the second stage, which is greatest mass, to five elements of the orbit."""
    marks = [*(jnp.asarray(t) for t in SWITCHES), x["end"]]
    phases = []
    for k, engines in enumerate(ENGINES):
        thrust = sum(n * p[1] for n, p in engines) * FORCE
        flow = sum(n * p[0] / p[2] for n, p in engines) * SECONDS / 1e3
        system = DeltaIII(
            *map(jnp.asarray, (thrust, flow)), jnp.stack(marks[k : k + 2]), x["vectors"][k]
        )
        drop = lambda t, y, k=k: y.at[6].add(-DROPPED[k])  # noqa: E731
        phases.append(Phase(system, marks[k + 1] - marks[k], drop, name=str(k)))
    latitude = np.radians(28.5)
    place = np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    speed = SPIN * SECONDS * np.cos(latitude)
    y0 = jnp.asarray([*place, 0.0, speed, 0.0, START_MASS])
    flight = fly_compact(Mission(phases), y0, steps=20)
    r, v = flight.final[:3], flight.final[3:6]
    h = cross(r, v)
    e = cross(v, h) - r / norm(r)
    size, eccentricity, W, P = target_orbit()
    Q = np.cross(W, P)
    # h along P and Q, and e out of its line: five conditions in all.
    wanted = [dot(h, W) - size, dot(h, P), dot(h, Q), dot(e, P) - eccentricity, dot(e, Q)]
    report = (1e3 * flight.final[6], x["end"] * SECONDS, flight.error)
    return Criterion(0.1 * x["end"], jnp.stack(wanted), report=report)


def test_the_ascent_of_a_delta_iii():
    """37 unknowns in four phases, from a rough guess of upwards and then eastwards: the published
    final mass, 7529.71 kg at 924.139 s, to 1e-6."""
    up, east = np.array([0.88, 0.0, 0.48]), np.array([0.0, 1.0, 0.0])
    vectors = np.zeros((4, 3, 3))
    for k, (rise, along) in enumerate([(1.0, 0.5), (0.6, 0.8), (0.3, 1.0), (-0.2, 1.0)]):
        vectors[k, -1] = rise * up + along * east
    start = {"end": jnp.asarray(920.0 / SECONDS), "vectors": jnp.asarray(vectors)}
    sizes = {"end": jnp.asarray(0.05), "vectors": jnp.full(vectors.shape, 0.5)}
    found = minimise(ascent, start, method="sqp", scale=sizes, tolerance=3e-6, max_steps=400)
    assert found.converged, found.sentence()
    mass, end, error = found.criterion.report
    np.testing.assert_allclose(mass, 7529.7123, rtol=1e-6)
    np.testing.assert_allclose(end, 924.139, atol=2e-3)
    assert error < 1e-8


# Thrust, N, exhaust velocity, m/s, propellant, kg, and dropped mass, kg, of three stages; the last
# burns what it needs. In units of the target's radius and speed, and of the lift-off mass.
TARGET, LIFT_OFF = 6378137.0 + 185e3, 20e3
UNIT = float(np.sqrt(3.986004418e14 / TARGET))
TIME = TARGET / UNIT
THREE = ((300e3, 2600.0, 12e3, 1200.0), (110e3, 2900.0, 4200.0, 450.0), (25e3, 3100.0, 0.0, 0.0))
PUSH = [F * TIME / UNIT / LIFT_OFF for F, *_ in THREE]
JET = [u / UNIT for _, u, *_ in THREE]
BURNS = [m * u / F / TIME for F, u, m, _ in THREE[:2]]
LEFT = [m / LIFT_OFF for *_, m in THREE]


class Stage(AbstractSystem):
    """(x, y, vx, vy, m) under gravity; the thrust points along a polynomial in the time of the
    burn."""

    push: Array
    jet: Array
    begins: Array
    lasts: Array
    vectors: Array

    def vector_field(self, t, y):
        r, v, m = y[:2], y[2:4], y[4]
        along = jnp.polyval(self.vectors, 2.0 * (t - self.begins) / self.lasts - 1.0)
        a = self.push / m * along / jnp.hypot(*along)
        return jnp.concatenate([v, a - r / jnp.hypot(*r) ** 3, (-self.push / self.jet)[None]])

    def invariants(self, t, y):
        return {}


def launch(x):
    """Two burns, a coast and a third burn from rest on the ground into the circle; least is the
    length of the third burn."""
    zero, one = jnp.zeros(()), jnp.ones(())
    lasts = [*map(jnp.asarray, BURNS), x["coast"], x["last"]]
    pushes = [*map(jnp.asarray, PUSH[:2]), zero, jnp.asarray(PUSH[2])]
    jets = [*map(jnp.asarray, JET[:2]), one, jnp.asarray(JET[2])]
    begins, phases = zero, []
    for k, (push, jet, span) in enumerate(zip(pushes, jets, lasts, strict=True)):
        drop = lambda t, y, k=k: y.at[4].add(-LEFT[k])  # noqa: E731
        system = Stage(push, jet, begins, span, x["vectors"][k])
        phases.append(Phase(system, span, drop if k < 2 else None, name=str(k)))
        begins = begins + span
    start = jnp.array([6378137.0 / TARGET, 0.0, 0.0, 0.0, 1.0])
    flight = fly_compact(Mission(phases), start, steps=16)
    r, v = flight.final[:2], flight.final[2:4]
    d = jnp.hypot(*r)
    miss = jnp.stack([d - 1.0, (r @ v) / d, (r[0] * v[1] - r[1] * v[0]) / d - 1.0])
    return Criterion(x["last"], miss, report=(flight.final[4], flight.error))


def primer_flight(x):
    """State and costates of position and velocity where the launch of Pontryagin's conditions ends,
    and the Hamiltonian of the coast, for the first costates of position (2) and the x of the
    velocity's, its y being 1, and the lengths of the coast and the last burn."""
    state = [6378137.0 / TARGET, 0.0, 0.0, 0.0, *x[:3], 1.0]
    spans = [(PUSH[0], JET[0], BURNS[0], 1.0), (PUSH[1], JET[1], BURNS[1], 0.0)]
    mass, flown, hamiltonian = (
        1.0,
        [*spans, (0.0, 1.0, x[3], 0.0), (PUSH[2], JET[2], x[4], 0.0)],
        0.0,
    )
    for k, (push, jet, span, _) in enumerate(flown):

        def rate(t, y, push=push, jet=jet, mass=mass):
            r, v, q, p = y[:2], y[2:4], y[4:6], y[6:]
            d = np.hypot(*r)
            a = push / (mass - push / jet * t) * p / np.hypot(*p)
            return [*v, *(a - r / d**3), *(p / d**3 - 3.0 * r * (p @ r) / d**5), *(-q)]

        if k == 2:
            y = np.array(state)
            hamiltonian = y[4:6] @ y[2:4] - y[6:] @ y[:2] / np.hypot(*y[:2]) ** 3
        ode = solve_ivp(rate, (0.0, span), state, rtol=1e-11, atol=1e-11, method="DOP853")
        state = ode.y[:, -1]
        mass -= push / jet * span + (LEFT[k] if k < 2 else 0.0)
    return state, hamiltonian


def conditions(x):
    """The circle, a coast of the best length, and an end anywhere on the circle."""
    y, hamiltonian = primer_flight(x)
    r, v, q, p = y[:2], y[2:4], y[4:6], y[6:]
    # The torque of the costates is zero, because the end may turn about the centre.
    turn = r[0] * q[1] - r[1] * q[0] + v[0] * p[1] - v[1] * p[0]
    return [np.hypot(*r) - 1.0, r @ v, r[0] * v[1] - r[1] * v[0] - 1.0, turn, hamiltonian]


def test_a_three_stage_launch_with_a_coast():
    """To a circle at 185 km: the mass that arrives, by gradients from a guess of upwards and then
    eastwards, against Pontryagin's conditions solved by SciPy; 1e-5 is wanted."""
    vectors = np.zeros((4, 3, 2))
    for k, (rise, along) in enumerate([(1.0, 0.4), (0.5, 1.0), (0.0, 1.0), (0.0, 1.0)]):
        vectors[k, -1] = [rise, along]
    start = {
        "vectors": jnp.asarray(vectors),
        "coast": jnp.asarray(100.0 / TIME),
        "last": jnp.asarray(195.0 / TIME),
    }
    sizes = {"vectors": 0.5, "coast": 100.0 / TIME, "last": 100.0 / TIME}
    sizes = jax.tree.map(lambda x, s: jnp.full(x.shape, s), start, sizes)
    low = {"vectors": -np.inf, "coast": 0.0, "last": 0.1 / TIME}
    high = {"vectors": np.inf, "coast": 0.5, "last": 235.0 / TIME}
    bounds = tuple(jax.tree.map(lambda x, b: jnp.full(x.shape, b), start, b) for b in (low, high))
    found = minimise(
        launch, start, bounds=bounds, method="sqp", scale=sizes, tolerance=1e-6, max_steps=400
    )
    assert found.converged, found.sentence()
    first = np.array([np.polyval(c, -1.0) for c in np.moveaxis(found.x["vectors"][0], 1, 0)])
    bend = np.array(
        [np.polyval(np.polyder(c), -1.0) for c in np.moveaxis(found.x["vectors"][0], 1, 0)]
    )
    tangent = first[0] / first[1]
    # The slope of the tangent is -(q_x - q_y tangent) over the velocity's costate.
    slope = 2.0 / BURNS[0] * (bend[0] * first[1] - first[0] * bend[1]) / first[1] ** 2
    guess = [-slope, 0.0, tangent, float(found.x["coast"]), float(found.x["last"])]
    best, _, ok, text = fsolve(conditions, guess, full_output=True, xtol=1e-12)
    assert ok == 1, text
    mass = (
        1.0
        - sum(PUSH[k] / JET[k] * BURNS[k] + LEFT[k] for k in (0, 1))
        - PUSH[2] / JET[2] * best[4]
    )
    reached, error = found.criterion.report
    np.testing.assert_allclose(reached, mass, rtol=1e-5)
    assert error < 1e-7 and best[3] > 0.0

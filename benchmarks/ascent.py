"""A dispersed two-stage ascent of a point mass through the atmosphere: jaxspace and Runge-Kutta
implementations in NumPy and Numba.

Twelve seconds upwards, a kick, a gravity turn until the first stage is burnt out and dropped, and
the second stage's burn. The peers take steps of one second, as such programs do; ours is cut at the
known times and steps as its tolerance asks. `times numpy` compares the machine, or the cores that
the row names, with NumPy's one core; `of one core` core with core.

NumPy takes the runs in blocks of the size that is fastest for it: smaller ones pay for each call,
larger ones leave the cache. The errors are those of the first block.

Wanted: 40 times NumPy at its own error on the machine, 60 as a goal."""

import types
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxspace import BodyState, Mission, Phase, Scene
from jaxspace.bodies import Load
from jaxspace.core.vectors import axis, cross, norm
from jaxspace.orbits import PointGravity
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, simulate_mission_batch
from jaxspace.solvers import DOP853

from ._measure import in_turn, on_one_device, optional, worst

RUNS = 65536
BLOCK = 16384
# The tolerance at which DOP853 errs by about as much as the peers.
AT_PEERS = 1.5e-5
MU, RADIUS, SPIN, G0 = 3.986004418e14, 6378137.0, 7.292115e-5, 9.80665
DENSITY, HEIGHT, AREA = 1.225, 8500.0, 5.0
KICK_TIME, LIFT_OFF_MASS = 12.0, 550e3
STAGES = (
    (7.6e6, 300.0, 150.0, 25e3),
    (0.95e6, 345.0, 330.0, 0.0),
)  # thrust, N; specific impulse, s; burnt out, s; dropped, kg


def dispersed() -> np.ndarray:
    """Factors of thrust, specific impulse and drag, the angle of the kick, rad, and the factor of
    the density: (5, runs)."""
    g = np.random.default_rng(3).standard_normal((5, RUNS))
    return np.stack(
        [
            1 + 4e-3 * g[0],
            1 + 3e-3 * g[1],
            1 + 0.05 * g[2],
            np.deg2rad(0.7 + 0.02 * g[3]),
            1 + 0.05 * g[4],
        ]
    )


def air(position: Array) -> Array:
    """The velocity of the air, which turns with the earth."""
    return cross(SPIN * axis(2, position[2]), position)


class Drag(eqx.Module):
    """Drag in an exponential atmosphere that turns with the earth."""

    factor: Float[Array, "*#runs"]

    def __call__(self, t, y, body):
        u = y.velocity - air(y.position)
        density = DENSITY * jnp.exp((RADIUS - norm(y.position)) / HEIGHT)
        return Load(force_N=(-0.5 * density * self.factor * AREA * norm(u)) * u)


class Engine(eqx.Module):
    """Thrust upwards, or along the velocity in the air."""

    thrust: Float[Array, "*#runs"]
    exhaust_speed: Float[Array, "*#runs"]
    upwards: bool = eqx.field(static=True)

    def __call__(self, t, y, body):
        along = y.position if self.upwards else y.velocity - air(y.position)
        return Load(
            force_N=(self.thrust / norm(along)) * along, mass_rate=-self.thrust / self.exhaust_speed
        )


class Kick(eqx.Module):
    """The velocity in the air turned by an angle about the axis of the earth."""

    angle: Float[Array, "*#runs"]

    def __call__(self, t, y):
        wind = air(y.position)
        u, c, s = y.velocity - wind, jnp.cos(self.angle), jnp.sin(self.angle)
        turned = jnp.stack([c * u[0] - s * u[1], s * u[0] + c * u[1], u[2]])
        return BodyState(y.position, turned + wind, mass=y.mass)


class Drop(eqx.Module):
    """The empty stage falls off."""

    def __call__(self, t, y):
        return BodyState(y.position, y.velocity, mass=y.mass - STAGES[0][3])


def mission(p: np.ndarray) -> Mission:
    """The ascent for these factors."""
    f_thrust, f_impulse, f_drag, angle, f_density = (jnp.asarray(x) for x in p)

    def scene(stage: int, upwards: bool) -> Scene:
        thrust, impulse, _, _ = STAGES[stage]
        drag = Custom(Drag(f_drag * f_density))
        engine = Engine(thrust * f_thrust, impulse * G0 * f_impulse, upwards)
        return Scene(
            (
                PointGravity(MU),
                drag,
                Custom(engine),
            )
        )

    first, second = STAGES[0][2], STAGES[1][2]
    return Mission(
        [
            Phase(scene(0, True), KICK_TIME, Kick(angle), "rise"),
            Phase(scene(0, False), first - KICK_TIME, Drop(), "first stage"),
            Phase(scene(1, False), second, None, "second stage"),
        ]
    )


def rates(y, p, stage, upwards):
    """The same equations for the peers: y of seven numbers, or of seven arrays of runs."""
    x, yy, z, vx, vy, vz, m = y
    thrust, exhaust_speed = STAGES[stage][0] * p[0], STAGES[stage][1] * G0 * p[1]
    r = np.sqrt(x * x + yy * yy + z * z)
    ux, uy = vx + SPIN * yy, vy - SPIN * x
    u = np.sqrt(ux * ux + uy * uy + vz * vz)
    drag = -0.5 * DENSITY * p[4] * np.exp((RADIUS - r) / HEIGHT) * p[2] * AREA * u / m
    pull, push = -MU / (r * r * r), thrust / m
    along_u, along_r = (drag, pull + push / r) if upwards else (drag + push / u, pull)
    ax, ay, az = along_r * x + along_u * ux, along_r * yy + along_u * uy, along_r * z + along_u * vz
    return (vx, vy, vz, ax, ay, az, -thrust / exhaust_speed)


def moved(y, h, k):
    """y + h k."""
    return (
        y[0] + h * k[0],
        y[1] + h * k[1],
        y[2] + h * k[2],
        y[3] + h * k[3],
        y[4] + h * k[4],
        y[5] + h * k[5],
        y[6] + h * k[6],
    )


def kicked(y, angle):
    """The velocity in the air turned by an angle about the axis of the earth."""
    x, yy, z, vx, vy, vz, m = y
    ux, uy, c, s = vx + SPIN * yy, vy - SPIN * x, np.cos(angle), np.sin(angle)
    return (x, yy, z, c * ux - s * uy - SPIN * yy, s * ux + c * uy + SPIN * x, vz, m)


def flight(p, dt):
    """The state at the end by the classical method of order 4, for the factors p of one run or
    arrays of them."""
    zero = 0.0 * p[0]
    y = (RADIUS + zero, zero, zero, zero, SPIN * RADIUS + zero, zero, LIFT_OFF_MASS + zero)
    for leg in range(3):
        stage, upwards = leg // 2, leg == 0
        span = KICK_TIME if leg == 0 else STAGES[0][2] - KICK_TIME if leg == 1 else STAGES[1][2]
        n = round(span / dt)
        h = span / n
        for _ in range(n):
            k1 = rates(y, p, stage, upwards)
            k2 = rates(moved(y, 0.5 * h, k1), p, stage, upwards)
            k3 = rates(moved(y, 0.5 * h, k2), p, stage, upwards)
            k4 = rates(moved(y, h, k3), p, stage, upwards)
            y = moved(moved(moved(moved(y, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4)
        if leg == 0:
            y = kicked(y, p[3])
        if leg == 1:
            y = (y[0], y[1], y[2], y[3], y[4], y[5], y[6] - STAGES[0][3])
    return y


def by_numba(p, dt=1.0):
    """The same loop compiled, one run after the other on every core: a call that returns (7,
    runs)."""
    import numba

    source = {f.__name__: f for f in (rates, moved, kicked, flight)}
    space = dict(globals())
    for name, function in source.items():
        space[name] = numba.njit(fastmath=True)(types.FunctionType(function.__code__, space, name))
    one = space["flight"]

    @numba.njit(parallel=True, fastmath=True)
    def fly(p, dt, out):
        for i in numba.prange(p.shape[1]):
            end = one((p[0, i], p[1, i], p[2, i], p[3, i], p[4, i]), dt)
            for k in range(7):
                out[k, i] = end[k]
        return out

    return lambda: fly(p, dt, np.empty((7, p.shape[1])))


def start(p: np.ndarray) -> tuple[Mission, BodyState]:
    """The ascents for these factors, and their state on the ground."""
    o = jnp.zeros(p.shape[1])
    r = jnp.stack([RADIUS + o, o, o])
    v = jnp.stack([o, SPIN * RADIUS + o, o])
    return mission(p), BodyState(r, v, mass=LIFT_OFF_MASS + o)


def measure() -> dict:
    """Error of the final position and speed of every way."""
    p = dispersed()
    system, y0 = start(p)
    alone = on_one_device(y0)

    def ours(rtol, method: Any = "auto", y0=alone):
        accuracy = Accuracy(rtol=rtol, method=method)
        return simulate_mission_batch(system, y0, 0.0, accuracy=accuracy).final.position

    calls = {
        f"ours, {rtol:.0e}": lambda rtol=rtol: ours(rtol) for rtol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
    }
    # At about the error of the peers, on one core and on all.
    for where, y in (("one core", alone), ("every core", y0)):
        calls[f"ours, DOP853, {where}, {AT_PEERS:.1e}"] = lambda y=y: ours(AT_PEERS, DOP853(), y)
    pieces = np.split(p, RUNS // BLOCK, axis=1)
    calls["numpy, order 4, 1 s"] = lambda: np.concatenate(
        [np.stack(flight(piece, 1.0)[:3]) for piece in pieces], axis=1
    )
    if optional("numba") is not None:
        compiled = by_numba(p)
        calls["numba, order 4, 1 s, all cores"] = lambda: compiled()[:3]
    reference = np.stack(flight(pieces[0], 0.05)[:3])
    rows = in_turn(calls, RUNS)
    peer = rows["numpy, order 4, 1 s"]
    for name, call in calls.items():
        row = rows[name]
        row["worst_relative_error"] = worst(np.asarray(call())[:, :BLOCK], reference)
        row["times_numpy"] = row["runs_per_second"] / peer["runs_per_second"]
        row["of_one_core"] = row["runs_per_cpu_second"] / peer["runs_per_cpu_second"]
    return rows

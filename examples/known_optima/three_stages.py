"""Three stages and a coast from rest on the ground to a circular orbit at 185 km with maximum mass.

The Earth does not rotate and has no atmosphere. The rocket is a constructed example without a
published optimum: `REFERENCE` follows from Pontryagin's conditions, which
tests/optimization/test_optimization_known.py solves independently with SciPy (the conditions:
Bryson and Ho, Applied Optimal Control).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from known import report

from jaxspace.constants import MU_EARTH
from jaxspace.core import AbstractSystem
from jaxspace.optimization import Criterion, minimise
from jaxspace.simulation import Mission, Phase, simulate_compact

REFERENCE = 660.6643902  # kg
# Thrust, N, exhaust velocity, m/s, propellant, kg, and dropped mass, kg, of three stages; the last
# burns as long as required. In units of the target's radius and speed, and of the lift-off mass.
GROUND, LIFT_OFF = 6378137.0, 20e3
TARGET = GROUND + 185e3
UNIT = float(np.sqrt(MU_EARTH / TARGET))
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


def problem(x):
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
    start = jnp.array([GROUND / TARGET, 0.0, 0.0, 0.0, 1.0])
    flight = simulate_compact(Mission(phases), start, steps=16)
    r, v = flight.final[:2], flight.final[2:4]
    d = jnp.hypot(*r)
    miss = jnp.stack([d - 1.0, (r @ v) / d, (r[0] * v[1] - r[1] * v[0]) / d - 1.0])
    return Criterion(x["last"], miss, report=(flight.final[4], flight.error))


def search():
    """From a rough guess of upwards and then eastwards, a coast of 100 s and a burn of 195 s."""
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
    options = {"scale": sizes, "tolerance": 1e-6, "max_steps": 400}
    return minimise(problem, start, bounds=bounds, **options)


def optimum(found):
    """The mass that arrives, kg."""
    return LIFT_OFF * float(found.criterion.report[0])


if __name__ == "__main__":
    report("Three stages to 185 km, final mass in kg", REFERENCE, search, optimum)

"""Linear-tangent steering: from rest to a height of 5 and a velocity of (45, 0) in minimum time.

The acceleration is 100, and its angle is free: here a polynomial of time, whose coefficients and
duration are optimised. At the optimum the tangent of the angle is linear in time, which is not used
here. Published: 0.5545709 (Betts, Practical Methods for Optimal Control and Estimation Using
Nonlinear Programming, linear tangent steering).
"""

import jax.numpy as jnp
from jaxtyping import Array
from known import report

from jaxspace.core import AbstractSystem
from jaxspace.optimization import Criterion, minimise
from jaxspace.simulation import Mission, Phase, simulate_compact

PUBLISHED = 0.5545709
ACCELERATION, HEIGHT, SPEED = 100.0, 5.0, 45.0
TERMS = 8


class Steered(AbstractSystem):
    """(x, y, vx, vy) under a constant acceleration along a polynomial in the time over `lasts`."""

    angle: Array
    lasts: Array

    def vector_field(self, t, y):
        phi = jnp.polyval(self.angle, 2.0 * t / self.lasts - 1.0)
        return jnp.stack([y[2], y[3], ACCELERATION * jnp.cos(phi), ACCELERATION * jnp.sin(phi)])

    def invariants(self, t, y):
        return {}


def problem(x):
    """Least is the duration, at the height and the velocity wanted."""
    system = Steered(x["angle"], x["lasts"])
    flight = simulate_compact(Mission([Phase(system, x["lasts"])]), jnp.zeros(4), steps=20)
    _, height, along, up = flight.final
    miss = jnp.stack([height / HEIGHT - 1.0, along / SPEED - 1.0, up / SPEED])
    return Criterion(x["lasts"], miss, report=flight.error)


def search():
    """From a straight line of thrust, 30 degrees upwards."""
    start = {"angle": jnp.zeros(TERMS).at[-1].set(0.5), "lasts": jnp.asarray(0.7)}
    return minimise(problem, start, tolerance=1e-8)


def optimum(found):
    """The least time."""
    return float(found.objective)


if __name__ == "__main__":
    report("Linear-tangent steering, time", PUBLISHED, search, optimum, within=1e-7)

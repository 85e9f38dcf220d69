"""Goddard's rocket with drag: maximum height with three fifths of the mass remaining.

Units: the Earth's radius, its surface gravity and the lift-off mass are 1. The arcs of full,
partial and zero thrust follow each other; on the intermediate singular arc no switching function
determines the thrust, which is a polynomial here. Published: final altitude 1.01283 (Bryson and Ho,
Applied Optimal Control; the constants as in Betts, Practical Methods for Optimal Control and
Estimation Using Nonlinear Programming, and in Dolan, More and Munson, COPS 3.0, rocket).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from known import report

from jaxspace.core import AbstractSystem
from jaxspace.optimization import Criterion, minimise
from jaxspace.simulation import Mission, Phase, simulate_compact

PUBLISHED = 1.01283
# Drag D = 310 v^2 exp(-500 (h - 1)), maximum thrust, exhaust velocity, final mass.
DRAG, DECAY, THRUST, JET, LEFT = 310.0, 500.0, 3.5, 0.5, 0.6


class Goddard(AbstractSystem):
    """h' = v, v' = (T - D)/m - 1/h^2, m' = -T/c; the thrust T is a polynomial in the time since
    `begins`, over `lasts`."""

    thrust: Array
    begins: Array
    lasts: Array

    def vector_field(self, t, y):
        h, v, m = y
        T = jnp.polyval(self.thrust, 2.0 * (t - self.begins) / self.lasts - 1.0)
        drag = DRAG * v * v * jnp.exp(-DECAY * (h - 1.0))
        return jnp.stack([v, (T - drag) / m - 1.0 / (h * h), -T / JET])

    def invariants(self, t, y):
        return {}


def problem(x):
    """Full thrust, a part of it, none: from (1, 0, 1) to the greatest height with 0.6 left."""
    full, arc, coast, thrust = x["full"], x["arc"], x["coast"], x["thrust"]
    zero = jnp.zeros(())
    phases = [
        Phase(Goddard(jnp.array([THRUST]), zero, full), full, name="full"),
        Phase(Goddard(thrust, full, arc), arc, name="arc"),
        Phase(Goddard(jnp.zeros(1), full + arc, coast), coast, name="coast"),
    ]
    flight = simulate_compact(Mission(phases), jnp.array([1.0, 0.0, 1.0]), steps=12)
    h, _, m = flight.final
    nodes = jnp.polyval(thrust, jnp.linspace(-1.0, 1.0, 9))
    within = jnp.concatenate([nodes, THRUST - nodes])
    return Criterion(-h, 10.0 * (m - LEFT), within, flight.error)


def search():
    """From a constant thrust on the arc, and rough lengths of the three phases."""
    start = {
        "full": jnp.asarray(0.03),
        "arc": jnp.asarray(0.05),
        "coast": jnp.asarray(0.1),
        "thrust": jnp.zeros(6).at[-1].set(1.5),
    }
    low = jax.tree.map(lambda x: jnp.full(x.shape, 1e-3), start) | {"thrust": jnp.full(6, -jnp.inf)}
    high = {"full": 0.1, "arc": 0.2, "coast": 0.3, "thrust": np.inf}
    high = jax.tree.map(lambda x, b: jnp.full(x.shape, b), start, high)
    # The altitude is flat in the last coefficients: a gradient of 1e-6 leaves an error of 1e-10.
    return minimise(problem, start, bounds=(low, high), tolerance=2e-6)


def optimum(found):
    """The greatest height."""
    return -float(found.objective)


if __name__ == "__main__":
    report("Goddard's rocket, final altitude", PUBLISHED, search, optimum)

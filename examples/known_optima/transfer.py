"""Two burns and a coast from a low orbit to geostationary orbit, from a poor initial guess.

Units: the gravitational parameter and the radius of the low orbit, 6678 km, are 1. With a thrust of
twenty times the weight the velocity increment is close to that of Hohmann's two impulses, whose
closed form is the minimum for two impulses (Hohmann, Die Erreichbarkeit der Himmelskoerper, 1925).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from known import report

from jaxspace.core import AbstractSystem
from jaxspace.optimization import Criterion, minimise
from jaxspace.simulation import Mission, Phase, simulate_compact

RADIUS, ACCELERATION = 42164.0 / 6678.0, 20.0
AXIS = 0.5 * (1.0 + RADIUS)
# Both impulses, in circular speeds of the low orbit.
HOHMANN = float(np.sqrt(2.0 - 1.0 / AXIS) - 1.0 + RADIUS**-0.5 - np.sqrt(2.0 / RADIUS - 1.0 / AXIS))


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


def problem(x):
    """Two burns and a coast between them, from the circle of radius 1 to that of `RADIUS`."""
    zero, a = jnp.zeros(()), jnp.asarray(ACCELERATION)
    second = x["burn"][0] + x["coast"]
    phases = [
        Phase(Burn(a, x["phi"][0], x["omega"][0], zero), x["burn"][0], name="first"),
        Phase(Burn(zero, zero, zero, zero), x["coast"], name="coast"),
        Phase(Burn(a, x["phi"][1], x["omega"][1], second), x["burn"][1], name="second"),
    ]
    end = simulate_compact(Mission(phases), jnp.array([1.0, 0.0, 0.0, 1.0]), steps=30).final
    r, v = end[:2], end[2:]
    d = jnp.hypot(*r)
    level = (r[0] * v[1] - r[1] * v[0]) / d
    miss = jnp.stack([d - RADIUS, (r @ v) / d, level - RADIUS**-0.5])
    return Criterion(ACCELERATION * jnp.sum(x["burn"]), miss)


def search():
    """From burns 15 and 32 % too long, half a radian off the horizontal, and a coast 18 %
    short."""
    start = {
        "burn": jnp.array([0.4, 0.25]) / ACCELERATION,
        "coast": jnp.asarray(18.0),
        "phi": jnp.array([0.5, -0.5]),
        "omega": jnp.zeros(2),
    }
    sizes = {"burn": 0.1 / ACCELERATION, "coast": 1.0, "phi": 1.0, "omega": 1.0}
    sizes = jax.tree.map(lambda x, s: jnp.full(x.shape, s), start, sizes)
    return minimise(problem, start, scale=sizes, tolerance=1e-6)


def optimum(found):
    """The velocity of both burns, in circular speeds of the low orbit."""
    return float(found.objective)


if __name__ == "__main__":
    report("Two-burn transfer, velocity", HOHMANN, search, optimum)

"""The circular restricted problem of three bodies, with its five points of equilibrium, of which no
state of floating-point numbers is exactly one."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import brentq

from jaxspace.core import AbstractSystem

# Moon over both, by the masses of DE440.
EARTH_MOON = 0.01215058560962404


class Place(eqx.Module):
    """Place and velocity in the rotating plane, in units of the distance and the angular rate."""

    r: Float[Array, "2 *#runs"]
    v: Float[Array, "2 *#runs"]


@final
class RestrictedBody(AbstractSystem):
    """x'' = 2 y' + dU/dx, y'' = -2 x' + dU/dy, U = r^2 / 2 + (1 - m) / d1 + m / d2."""

    ratio: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        m = self.ratio
        x, up = y.r
        d1, d2 = (x + m) ** 2 + up**2, (x - 1.0 + m) ** 2 + up**2
        a, b = (1.0 - m) / (d1 * jnp.sqrt(d1)), m / (d2 * jnp.sqrt(d2))
        along = x + 2.0 * y.v[1] - a * (x + m) - b * (x - 1.0 + m)
        return Place(y.v, jnp.stack([along, up - 2.0 * y.v[0] - (a + b) * up]))

    def invariants(self, t, y):
        return {}


def lagrange_points(m: float) -> np.ndarray:
    """L1 to L5, (2, 5)."""

    def force(x):
        d1, d2 = x + m, x - 1.0 + m
        return x - (1.0 - m) * d1 / abs(d1) ** 3 - m * d2 / abs(d2) ** 3

    moon = 1.0 - m
    axes = [(0.5, moon - 1e-3), (moon + 1e-3, 1.5), (-1.5, -0.5)]
    x = [brentq(force, *ends, xtol=1e-16, rtol=1e-15) for ends in axes]
    return np.array([[*x, 0.5 - m, 0.5 - m], [0.0, 0.0, 0.0, np.sqrt(0.75), -np.sqrt(0.75)]])


def linearised(point: np.ndarray, m: float) -> np.ndarray:
    """The matrix of the motion about a point of equilibrium, (4, 4)."""
    x, y = point
    hessian = np.eye(2)
    for mass, along in ((1.0 - m, x + m), (m, x - 1.0 + m)):
        d = np.array([along, y])
        r = np.linalg.norm(d)
        hessian = hessian + mass * (3.0 * np.outer(d, d) / r**5 - np.eye(2) / r**3)
    turn = np.array([[0.0, 2.0], [-2.0, 0.0]])
    return np.block([[np.zeros((2, 2)), np.eye(2)], [hessian, turn]])

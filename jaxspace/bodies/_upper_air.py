"""Density and molar mass of the U.S. Standard Atmosphere, 1976, above 86 km, as cubic splines.

The nodes are the solution of the standard's equations for six gases (Eqs. 32 to 41: diffusion of
nitrogen, oxygen, argon, helium and hydrogen, with eddies below 115 km), integrated in steps of
5 m. The helium is raised by 0.12 percent, which reproduces the printed table within its last digit
up to 1000 km. Nodes are denser at 100 and 110 km, where its coefficients have kinks.

Source: U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), 1.3.
"""

from typing import final

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from ..core import Scalar
from ..core.tables import within

# Height, km; density, kg/m^3; molar mass, kg/kmol.
_NODES = np.array(
    [
        *((86, 6.95788e-06, 28.9521), (88, 4.87510e-06, 28.9392), (90, 3.41631e-06, 28.9108)),
        (92, 2.39257e-06, 28.8593),
        *((94, 1.66989e-06, 28.7824), (96, 1.16197e-06, 28.6814), (98, 8.07085e-07, 28.5537)),
        *((99, 6.72498e-07, 28.4783), (100, 5.60405e-07, 28.3952), (101, 4.69533e-07, 28.3049)),
        *((102, 3.93529e-07, 28.2079), (104, 2.76876e-07, 27.9966), (106, 1.95349e-07, 27.7657)),
        *((108, 1.38137e-07, 27.5204), (109.5, 1.06259e-07, 27.331), (110, 9.7073e-08, 27.2677)),
        *((111, 8.11092e-08, 27.1423), (113, 5.81073e-08, 26.9012), (116, 3.72000e-08, 26.5759)),
        *((120, 2.22207e-08, 26.2043), (125, 1.29075e-08, 25.8027), (130, 8.15206e-09, 25.4358)),
        *((140, 3.83114e-09, 24.7492), (150, 2.07558e-09, 24.1027), (165, 9.75006e-10, 23.1914)),
        *((180, 5.19404e-10, 22.3421), (200, 2.54063e-10, 21.3036), (230, 1.02919e-10, 19.9522)),
        *((260, 4.74239e-11, 18.8489), (300, 1.91573e-11, 17.7255), (350, 7.01347e-12, 16.7351)),
        *((400, 2.80262e-12, 15.9836), (450, 1.18433e-12, 15.2466), (500, 5.21523e-13, 14.3295)),
        *((550, 2.38433e-13, 13.0910), (600, 1.13671e-13, 11.5047), (650, 5.71198e-14, 9.7172)),
        *((700, 3.06980e-14, 7.9978), (750, 1.78841e-14, 6.5787), (800, 1.13603e-14, 5.5435)),
        *((900, 5.76044e-15, 4.4044), (1000, 3.56155e-15, 3.9409)),
    ]
)
# Slopes at both ends, 1/km and kg/kmol/km.
_SLOPES = np.array([(-0.177943, -4.22136e-3), (-4.1312e-3, -2.95301e-3)])


def summed(weights: np.ndarray, terms: Array) -> Scalar:
    """sum_k w_k x_k of `terms`, (terms, *runs)."""
    # As a product of a vector and a matrix, which the compiler vectorises, unlike a sum over a
    # leading axis; a product of two matrices would call a library.
    return jnp.tensordot(weights.astype(terms.dtype), terms, 1, precision=lax.Precision.HIGHEST)


@final
class Climb:
    """Cubic splines of the height at the same nodes, as sums: each interval adds its change."""

    def __init__(self, nodes: np.ndarray, values: np.ndarray, slopes: np.ndarray):
        """The twice differentiable splines through the `values`, (splines, nodes), with the
        `slopes`, (splines, 2), at their ends; they start at zero, and end with the last node."""
        widths = np.diff(nodes)
        mean = np.diff(values) / widths
        # Equal curvatures on both sides of each inner node; the slopes at the ends are given.
        matrix = np.eye(nodes.size)
        right = np.empty_like(values)
        right[:, 0], right[:, -1] = slopes.T
        for k in range(1, nodes.size - 1):
            before, after = 1.0 / widths[k - 1], 1.0 / widths[k]
            matrix[k, k - 1 : k + 2] = before, 2.0 * (before + after), after
            right[:, k] = 3.0 * (mean[:, k - 1] * before + mean[:, k] * after)
        m = np.linalg.solve(matrix, right.T).T
        self.nodes = nodes
        self.widths = widths
        second = (3.0 * mean - 2.0 * m[:, :-1] - m[:, 1:]) / widths
        third = (m[:, :-1] + m[:, 1:] - 2.0 * mean) / widths**2
        # Of the powers of what is passed of each interval.
        self.weights = np.concatenate([m[:, :-1], second, third], axis=1)

    def __call__(self, x: Scalar) -> list[Scalar]:
        """The changes from the first node to `x`, (*runs,), of each spline; zero before it."""
        dtype = jnp.result_type(x, float)
        starts, widths = (
            a.reshape(-1, *(1,) * jnp.ndim(x)).astype(dtype) for a in (self.nodes[:-1], self.widths)
        )
        # A search and a gather for each run cost more than the few operations of each interval.
        passed = within(x - starts, 0.0, widths)
        square = passed * passed
        powers = jnp.concatenate([passed, square, square * passed])
        return [summed(row, powers) for row in self.weights]


# By the height above 86 km, km: the changes of ln rho and of the molar mass, kg/kmol.
_ABOVE = _NODES[:, 0] - 86.0
_CLIMB = Climb(_ABOVE, np.stack([np.log(_NODES[:, 1]), _NODES[:, 2]]), _SLOPES)


def upper_changes(above: Scalar) -> tuple[Scalar, Scalar]:
    """The changes of ln rho and of the molar mass, kg/kmol, from 86 km to a height `above` it, km,
    (*runs,).

    Beyond the last node the density has its last slope. The molar mass is constant there, because a
    linear one would become negative."""
    log_density, molar_mass = _CLIMB(above)
    beyond = jnp.maximum(above - _ABOVE[-1].item(), 0.0)
    return log_density + _SLOPES[0, 1].item() * beyond, molar_mass


# Table 8: 1 - M / M_0 from 80 to 86 km.
_RATIO_HEIGHTS = np.arange(80e3, 87e3, 1e3)
_RATIO_LOSSES = np.array([0.0, 1.1e-5, 5.9e-5, 1.30e-4, 2.14e-4, 3.06e-4, 4.21e-4])


def molar_mass_ratio(height: Scalar) -> Scalar:
    """M / M_0 up to 86 km, linear between the heights, m, of table 8; then its last value."""
    dtype = jnp.result_type(height, float)
    starts = _RATIO_HEIGHTS[:-1].reshape(-1, *(1,) * jnp.ndim(height)).astype(dtype)
    passed = within(height - starts, 0.0, 1e3)
    return 1.0 - summed(np.diff(_RATIO_LOSSES) / 1e3, passed)

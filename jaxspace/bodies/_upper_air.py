"""Density and molar mass of the U.S. Standard Atmosphere, 1976, above 80 km, in pieces.

Up to 86 km the molar mass is linear between the heights of table 8. Above, the logarithm of the
density and the molar mass are cubic splines, whose nodes are the solution of the standard's
equations for six gases (Eqs. 32 to 41: diffusion of nitrogen, oxygen, argon, helium and hydrogen,
with eddies below 115 km), integrated in steps of 5 m. The helium is raised by 0.12 percent, which
reproduces the printed table within its last digit up to 1000 km. Nodes are denser at 100 and
110 km, where its coefficients have kinks.

Source: U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), 1.3.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..core import Scalar
from .atmosphere import MOLAR_MASS

MIXED = 80e3  # m, up to which M = M_0

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
# Slopes at both ends of ln rho, 1/km, and of the molar mass, kg/kmol/km.
_SLOPES = np.array([(-0.177943, -4.22136e-3), (-4.1312e-3, -2.95301e-3)])
# Table 8: 1 - M / M_0 at each kilometre from 80 to 86.
_LOSSES = np.array([0.0, 1.1e-5, 5.9e-5, 1.30e-4, 2.14e-4, 3.06e-4, 4.21e-4])


def _spline(values: np.ndarray, slopes: np.ndarray) -> Float[np.ndarray, "4 intervals"]:
    """The coefficients, by powers of the way into each interval, of the twice differentiable cubic
    spline through the `values` at the nodes with the `slopes` at its ends."""
    widths = np.diff(_NODES[:, 0])
    mean = np.diff(values) / widths
    # Equal curvatures on both sides of each inner node; the slopes at the ends are given.
    matrix = np.eye(values.size)
    right = np.empty_like(values)
    right[0], right[-1] = slopes
    for k in range(1, values.size - 1):
        before, after = 1.0 / widths[k - 1], 1.0 / widths[k]
        matrix[k, k - 1 : k + 2] = before, 2.0 * (before + after), after
        right[k] = 3.0 * (mean[k - 1] * before + mean[k] * after)
    m = np.linalg.solve(matrix, right)
    second = (3.0 * mean - 2.0 * m[:-1] - m[1:]) / widths
    third = (m[:-1] + m[1:] - 2.0 * mean) / widths**2
    return np.stack([values[:-1], m[:-1], second, third])


def _pieces() -> tuple[Float[np.ndarray, " joints"], Float[np.ndarray, "9 pieces"]]:
    """Start of each segment except the first, km above 80 km, and its numbers: the reference
    height, and the coefficients of the change of ln rho and of M / M_0."""
    start = _NODES[0]
    logarithms = np.log(_NODES[:, 1] / start[1])
    ratios = 1.0 - _LOSSES[-1] + (_NODES[:, 2] - start[2]) / MOLAR_MASS
    mixing = np.zeros((8, _LOSSES.size - 1))
    mixing[4:6] = 1.0 - _LOSSES[:-1], -np.diff(_LOSSES)
    splines = np.concatenate(
        [_spline(logarithms, _SLOPES[0]), _spline(ratios, _SLOPES[1] / MOLAR_MASS)]
    )
    # Below 80 km nothing changes. Beyond the last node the density has its last slope; the molar
    # mass is constant there, because a linear one would become negative.
    below, beyond = np.zeros((2, 8, 1))
    below[4] = 1.0
    beyond[[0, 1, 4], 0] = logarithms[-1], _SLOPES[0, 1], ratios[-1]
    begins = np.concatenate([np.arange(80.0, 86.0), _NODES[:, 0]]) - 80.0
    from_heights = np.append(0.0, begins)
    rows = np.concatenate([below, mixing, splines, beyond], axis=1)
    return begins, np.concatenate([from_heights[None], rows])


_BEGINS, _PIECES = _pieces()


def upper_changes(height: Scalar) -> tuple[Scalar, Scalar]:
    """The change of ln rho from 86 km on, and M / M_0, at a `height`, m, (*runs,).

    At a joint of two pieces the slope is that of the upper one."""
    x = (height - MIXED) * 1e-3
    begins = _BEGINS.astype(x.dtype).reshape(-1, *(1,) * x.ndim)
    # The segment of each run. A sum over all segments, without a search, is a program of twice the
    # length, and every derivative of a flight through the air contains several of them.
    number = jnp.sum(x >= begins, axis=0)
    start, *powers = (
        jnp.asarray(_PIECES.astype(x.dtype)).at[:, number].get(mode="promise_in_bounds")
    )
    passed = x - start
    logarithm, ratio = (
        a + passed * (b + passed * (c + passed * d)) for a, b, c, d in (powers[:4], powers[4:])
    )
    return logarithm, ratio

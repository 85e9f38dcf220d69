"""Bending modes of a uniform beam: exact roots and shapes.

    w = (beta)^2 / L^2 sqrt(EI / mu),   phi(x) of the argument beta x / L
    clamped-free     cos(b) cosh(b) = -1        free-free, clamped-clamped  cos(b) cosh(b) = 1
    clamped-pinned   tan(b) = tanh(b)           pinned-pinned               sin(b) = 0

    symbol   meaning                                      unit
    b        beta, root of the mode                       1
    EI, mu   bending stiffness, mass per length           N m^2, kg/m

The hyperbolic functions of the shapes are combined into decaying exponentials from both ends, which
no order of the mode makes large. Shapes have the mean square 1 along the beam; a free-free beam has
|phi| = 2 at its ends.

Source: Thomson 9.8, 9.12-5 and -6; Rayleigh, Theory of Sound, 8.
"""

import math
from collections.abc import Callable
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError, Scalar

Ends = Literal["clamped-free", "free-free", "clamped-clamped", "clamped-pinned", "pinned-pinned"]
# Of the roots far out: (n + this) pi.
PHASES = {
    "clamped-free": -0.5,
    "free-free": 0.5,
    "clamped-clamped": 0.5,
    "clamped-pinned": 0.25,
    "pinned-pinned": 0.0,
}
NEWTON = 12
NODES = 24


def beam_roots(ends: Ends, count: int) -> Float[np.ndarray, " count"]:
    """The first `count` roots beta of a uniform beam with these ends, without rigid motions.

    **Raises** `InputError` for other ends."""
    if ends not in PHASES:
        raise InputError(f"ends is {ends!r}: it must be one of {', '.join(PHASES)}.")
    x = (np.arange(1, count + 1) + PHASES[ends]) * np.pi
    if ends == "pinned-pinned":
        return x
    sign = 1.0 if ends == "clamped-free" else -1.0
    for _ in range(NEWTON):
        if ends == "clamped-pinned":
            tanh = np.tanh(x)
            value = np.sin(x) - np.cos(x) * tanh
            slope = np.cos(x) + np.sin(x) * tanh - np.cos(x) * (1.0 - tanh**2)
        else:
            # Over cosh: cos(x) cosh(x) itself would overflow in high modes.
            sech = 1.0 / np.cosh(x)
            value = np.cos(x) + sign * sech
            slope = -np.sin(x) - sign * sech * np.tanh(x)
        x = x - value / slope
    return x


def beam_shape(ends: Ends, root: float, x: Scalar, derivative: int = 0) -> Scalar:
    """The shape of a mode, or a derivative of it.

    **Arguments**

    - `ends`: as in `beam_roots`; "clamped-..." is clamped at x = 0.
    - `root`: of the mode, from `beam_roots`.
    - `x`: along the beam in units of its length, from 0 to 1, of any shape.
    - `derivative`: 0 to 3, with respect to `x`.

    **Returns** the value, with the mean square 1 over the beam.
    """
    if ends == "pinned-pinned":
        return root**derivative * math.sqrt(2.0) * jnp.sin(root * x + 0.5 * math.pi * derivative)
    # In e^-b alone: cosh and sinh of high modes cancel to nothing, or overflow.
    b, e = root, math.exp(-root)
    s, c = math.sin(b), math.cos(b)
    # phi = (cosh -+ cos) - sigma (sinh -+ sin); sigma differs from 1 by terms of e^-b.
    free = ends == "free-free"
    if ends == "clamped-free":
        below = 1.0 - e * e + 2.0 * e * s
        sigma = (1.0 + e * e + 2.0 * e * c) / below
        rise = -2.0 * (e + c - s) / below
    else:
        below = 1.0 - e * e - 2.0 * e * s
        sigma = (1.0 + e * e - 2.0 * e * c) / below
        rise = 2.0 * (c - s - e) / below
    z = b * x
    # 1/2 (1 - sigma) e^z from the far end, 1/2 (1 + sigma) e^-z from the near one.
    grown = 0.5 * rise * jnp.exp(z - b)
    decayed = 0.5 * (1.0 + sigma) * jnp.exp(-z) * (-1.0) ** derivative
    turn = z + 0.5 * math.pi * derivative
    wave = jnp.cos(turn) - sigma * jnp.sin(turn)
    return b**derivative * (grown + decayed + (wave if free else -wave))


def beam_integral(function: Callable[[Array], Array], start: Scalar, end: Scalar) -> Array:
    """The integral of a function of the place between two places, each (*runs,), by Gauss: to
    rounding for modes of which the interval holds few waves.

    **Arguments**

    - `function`: of the place, with the axis of places first.
    - `start`, `end`: the two places, (*runs,)."""
    x, weights = np.polynomial.legendre.leggauss(NODES)
    half = 0.5 * (end - start)
    shape = (NODES,) + (1,) * jnp.ndim(half)
    x, weights = (jnp.asarray(a, jnp.result_type(half)).reshape(shape) for a in (x, weights))
    return half * jnp.sum(weights * function(start + half * (x + 1.0)), axis=0)

"""Bending modes of a beam: exact roots and shapes of a uniform one, of one span or two, and assumed
modes of any other.

    w = (beta)^2 / L^2 sqrt(EI / mu),   phi(x) of the argument beta x / L
    clamped-free     cos(b) cosh(b) = -1        free-free, clamped-clamped  cos(b) cosh(b) = 1
    clamped-pinned   tan(b) = tanh(b)           pinned-pinned               sin(b) = 0

    two spans, with a pin in between    S_1 M_2 + M_1 S_2 = 0
    assumed modes                       (K - w^2 M) q = 0,  y = sum of phi_i q_i
                                        K_ij = integral of EI phi_i'' phi_j'' dx
                                        M_ij = integral of mu phi_i phi_j dx

    symbol   meaning                                      unit
    b        beta, root of the mode                       1
    EI, mu   bending stiffness, mass per length           N m^2, kg/m
    S, M     slope and moment at the pin of a span whose  1
             other end is as it is

The hyperbolic functions of the shapes are combined into exponentials that decay from both ends,
which stay small for modes of any order. Shapes have the mean square 1 along the beam; a free-free
beam has |phi| = 2 at its ends.

The roots of two spans are those of sum phi_i(c)^2 / (b_i^4 - b^4) = 0 over the modes of the beam
without its pin at c; they are located between the roots of that beam.

Source: Thomson 9.8, 9.12-5 and -6, 9.12 problems 6 (assumed modes) and 7 (beam on a pin); Rayleigh,
Theory of Sound, 8.
"""

__all__ = ["assumed_modes", "beam_integral", "beam_roots", "beam_shape"]

import math
from collections.abc import Callable
from types import ModuleType
from typing import Literal, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.formula import POSITIVE, formula
from ..core.safe import safe_sqrt
from ..core.types import as_float

Ends = Literal["clamped-free", "free-free", "clamped-clamped", "clamped-pinned", "pinned-pinned"]
# Of NumPy or of JAX, whichever computes.
Number: TypeAlias = float | np.ndarray | Array
# The phases of high roots: (n + phase) pi.
PHASES = {
    "clamped-free": -0.5,
    "free-free": 0.5,
    "clamped-clamped": 0.5,
    "clamped-pinned": 0.25,
    "pinned-pinned": 0.0,
}
NEWTON = 12
HALVINGS = 60
NODES = 24


def beam_roots(ends: Ends, count: int, support: float | None = None) -> Float[np.ndarray, " count"]:
    """The first `count` roots beta of a uniform beam with these ends, without rigid motions.

    **Arguments**

    - `ends`: those of the beam; "clamped-..." is clamped at x = 0.
    - `count`: number of modes.
    - `support`: the position of a pin between the ends, in units of the length, which creates two
      spans; `None` for one.

    **Raises** `InputError` for other ends, and for a pin that is not between them."""
    if ends not in PHASES:
        raise InputError(f"ends is {ends!r}: it must be one of {', '.join(PHASES)}.")
    if support is not None:
        return _two_span_roots(ends, count, _inside(support))
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
            # Divided by cosh: cos(x) cosh(x) itself would overflow in high modes.
            sech = _sech(x)
            value = np.cos(x) + sign * sech
            slope = -np.sin(x) - sign * sech * np.tanh(x)
        x = x - value / slope
    return x


@formula
def beam_shape(
    ends: Ends, root: float, x: Scalar, derivative: int = 0, support: float | None = None
) -> Scalar:
    """The shape of a mode, or a derivative of it.

    **Arguments**

    - `ends`: as in `beam_roots`; "clamped-..." is clamped at x = 0.
    - `root`: of the mode, from `beam_roots`.
    - `x`: along the beam in units of its length, from 0 to 1, of any shape.
    - `derivative`: 0 to 3, with respect to `x`.
    - `support`: as in `beam_roots`. The pin has a force: the third derivative jumps there, and is
      that of the first span.

    **Returns** the value, with the mean square 1 over the beam.

    **Raises** `InputError` for a pin that is not between the ends.
    """
    if support is not None:
        return _two_span_shape(ends, root, as_float(x), derivative, _inside(support))
    if ends == "pinned-pinned":
        return root**derivative * math.sqrt(2.0) * jnp.sin(root * x + 0.5 * math.pi * derivative)
    # In e^-b alone: cosh and sinh of high modes cancel to nothing, or overflow.
    b = root
    e = math.exp(-root)
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


def _sech(x: Number) -> Number:
    e = np.exp(-x)  # cosh(x) overflows in high modes
    return 2.0 * e / (1.0 + e * e)


def _inside(support: float) -> float:
    place = float(support)
    if not 0.0 < place < 1.0:
        raise InputError(
            f"support is {support}: it must be between 0 and 1, in units of the beam's length."
        )
    return place


def _at_pin(end: str, z: Number) -> tuple[Number, Number]:
    """Slope and moment, over cosh(z), at the pin of a span of the length z = b c, with the other
    end as in `end`."""
    s = np.sin(z)
    c = np.cos(z)
    tanh = np.tanh(z)
    sech = _sech(z)
    if end == "pinned":
        return c * tanh - s, -2.0 * s * tanh
    sign = 1.0 if end == "clamped" else -1.0
    return 2.0 * (sign * c - sech), 2.0 * sign * (c * tanh - s)


def _two_span_roots(ends: Ends, count: int, support: float) -> Float[np.ndarray, " count"]:
    first, last = ends.split("-")

    def determinant(b: Number) -> Number:
        slope, moment = _at_pin(first, b * support)
        slope_2, moment_2 = _at_pin(last, b * (1.0 - support))
        return slope * moment_2 + moment * slope_2

    # A pin raises each root, at most to the next root of the beam without it; a rigid motion counts
    # as the first.
    highest = beam_roots(ends, count + 1)[-1] + 0.01
    grid = np.arange(0.25, highest, 0.01)
    values = np.asarray(determinant(grid))
    below = np.flatnonzero(values[:-1] * values[1:] < 0.0)[:count]
    low, high = grid[below], grid[below + 1]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        right = np.asarray(determinant(middle)) * values[below] > 0.0
        low, high = np.where(right, middle, low), np.where(right, high, middle)
    return 0.5 * (low + high)


def _span(end: str, z: Number, s: float, derivative: int, at: ModuleType) -> Number:
    """The shape, over cosh(s), of a span of the length s at the distance z from its end; or its
    derivative by z. Zero at the pin, z = s. `at` is the module that computes."""
    below = 1.0 + math.exp(-2.0 * s)
    # cosh(z) and sinh(z) over cosh(s), and sinh(s - z) over it: none of them grows.
    rise, fall = at.exp(z - s) / below, (-1.0) ** derivative * at.exp(-z - s) / below
    grown, odd = rise + fall, rise - fall
    back = (-1.0) ** derivative * at.exp(-z) / below - at.exp(z - 2.0 * s) / below
    turn = z + 0.5 * math.pi * derivative
    cos = math.cos(s)
    sin = math.sin(s)
    tanh = math.tanh(s)
    sech = float(_sech(s))
    if end == "pinned":
        return tanh * at.sin(turn) - sin * odd
    sign = -1.0 if end == "clamped" else 1.0
    waves = sin * at.cos(turn) - cos * at.sin(turn)
    mixed = sin * grown - cos * odd + tanh * at.cos(turn) - at.sin(turn)
    return back + sech * waves + sign * mixed


def _two_span_shape(ends: Ends, root: float, x: Scalar, derivative: int, support: float) -> Scalar:
    first, last = ends.split("-")
    b = float(root)
    spans = (first, b * support), (last, b * (1.0 - support))
    (slope, moment), (slope_2, moment_2) = (_at_pin(*span) for span in spans)
    # Slope and moment are continuous at the pin: the condition with more digits is used.
    by_slope, by_moment = (slope_2, -slope), (moment_2, moment)
    shares = max(by_slope, by_moment, key=lambda pair: math.hypot(*pair))
    # The sign in which the first span starts upwards from its end.
    shares = tuple(float(np.copysign(1.0, shares[0]) * share) for share in shares)
    nodes, weights = np.polynomial.legendre.leggauss(NODES + math.ceil(root))
    mean = sum(
        0.5
        * s
        / b
        * share**2
        * np.sum(weights * _span(end, 0.5 * s * (1.0 + nodes), s, 0, np) ** 2)
        for (end, s), share in zip(spans, shares, strict=True)
    )
    left = x <= support
    # Each span only at its own positions: beyond its pin it would grow without bound.
    near = _span(*(first, b * jnp.where(left, x, 0.0)), spans[0][1], derivative, jnp)
    far = _span(*(last, b * jnp.where(left, 0.0, 1.0 - x)), spans[1][1], derivative, jnp)
    far = (-1.0) ** derivative * shares[1] * far
    return b**derivative / math.sqrt(mean) * jnp.where(left, shares[0] * near, far)


@formula(length=POSITIVE)
def assumed_modes(
    shapes: Callable[[Scalar], Array],
    length: Scalar,
    stiffness: Scalar | Callable[[Scalar], Scalar],
    mass_per_length: Scalar | Callable[[Scalar], Scalar],
) -> tuple[Array, Array]:
    """Frequencies of a beam that bends in a sum of assumed shapes (Thomson 9.12 problem 6).

    **Arguments**

    - `shapes`: phi_i of the place x in units of the length, a function from (places,) to
      (shapes, places); any smooth, linearly independent functions that satisfy the clamps and pins
      of the beam.
    - `length`: m.
    - `stiffness`: EI, N m^2, or a function of x, from (places,) to (places, *runs).
    - `mass_per_length`: mu, kg/m, or such a function.

    **Returns** the frequencies w, rad/s, (modes, *runs), the slowest first, none below that of the
    exact mode; and the amplitudes q_i of the shapes in each mode, (shapes, modes, *runs), for a
    modal mass of 1 kg. The derivatives of equal frequencies are not defined.

    **Raises** `InputError` for a length that is not positive, or shapes without an axis of shapes.
    """
    x, weights = np.polynomial.legendre.leggauss(NODES)
    length = as_float(length)
    x, weights = (jnp.asarray(a, length.dtype) for a in (0.5 * (x + 1.0), 0.5 * weights))

    def slope(x: Scalar) -> Array:
        return jax.jvp(shapes, (x,), (jnp.ones_like(x),))[1]

    phi = shapes(x)
    if jnp.ndim(phi) != 2 or phi.shape[1] != NODES:
        raise InputError(
            f"shapes(x) has the shape {jnp.shape(phi)} for x of {x.shape}: it must be "
            f"(shapes, places)."
        )
    bend = jax.jvp(slope, (x,), (jnp.ones_like(x),))[1]

    def form(density: Scalar | Callable[[Scalar], Scalar], functions: Array) -> Array:
        along = density(x) if isinstance(density, Callable) else as_float(density)[None]
        # The axes of runs first, as the solution of symmetric matrices has them.
        along = jnp.moveaxis(along, 0, -1)[..., None, :] * weights
        return (along * functions) @ functions.T

    M = form(mass_per_length, phi) * length[..., None, None]
    K = form(stiffness, bend) / length[..., None, None] ** 3
    root = jnp.linalg.cholesky(M)
    half = solve_triangular(root, K, lower=True)
    both = solve_triangular(root, jnp.swapaxes(half, -1, -2), lower=True)
    squares, vectors = jnp.linalg.eigh(both)
    shares = solve_triangular(jnp.swapaxes(root, -1, -2), vectors, lower=False)
    frequencies = jnp.moveaxis(safe_sqrt(squares), -1, 0)
    return frequencies, jnp.moveaxis(shares, (-2, -1), (0, 1))


@formula
def beam_integral(function: Callable[[Array], Array], start: Scalar, end: Scalar) -> Array:
    """The integral of a function of the place between two places, each (*runs,), by Gauss: exact to
    rounding where the interval contains few waves of the mode.

    **Arguments**

    - `function`: of the place, with the axis of places first.
    - `start`, `end`: the two places, (*runs,)."""
    x, weights = np.polynomial.legendre.leggauss(NODES)
    half = 0.5 * (end - start)
    shape = (NODES,) + (1,) * jnp.ndim(half)
    x, weights = (jnp.asarray(a, jnp.result_type(half)).reshape(shape) for a in (x, weights))
    return half * jnp.sum(weights * function(start + half * (x + 1.0)), axis=0)

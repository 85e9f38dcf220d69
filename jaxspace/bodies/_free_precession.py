"""The precession of a free body about its angular momentum, in the letters of `_free_rotation`.

    psi = h t/I_3 - third(t; M, rho) + arg Z
    Z = |z(0)|^2 c d - i h G/I_3 S D - I_3^2 a_3 omega_1 omega_2 omega_3 S (1 + M S^2)
    M = (I_2 - I_3) G / (I_2 I_3^2),   rho = h/I_3 - h/I_1,   G = h^2 - 2T I_3

Source: van Zon and Schofield (2007), J. Comput. Phys. 225, 145.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp

from ..core import Flag, Scalar, Vector
from ..core.barrier import barrier
from ..core.elliptic import complete_third
from ..core.jacobi import Jacobi, third
from ..core.safe import safe_atan2


class ArrangedBody(NamedTuple):
    """A body and its initial state along the arranged principal axes: I_i, omega, and x, y, x -
    y."""

    moments: Vector
    omega: Vector
    x: Scalar
    y: Scalar
    difference: Scalar

    @classmethod
    def of(cls, moments: Vector, omega: Vector) -> "ArrangedBody":
        p = rate_products(moments) * omega * omega
        return cls(moments, omega, p[1] - p[0], p[1] - p[2], p[2] - p[0])


def rate_coefficients(moments: Vector) -> tuple[Scalar, Scalar, Scalar]:
    """a_1, a_2, a_3."""
    i = moments
    return (i[1] - i[2]) / i[0], (i[2] - i[0]) / i[1], (i[0] - i[1]) / i[2]


def rate_products(moments: Vector) -> Vector:
    """a_2 a_3, a_3 a_1, a_1 a_2."""
    a1, a2, a3 = rate_coefficients(moments)
    return jnp.stack([a2 * a3, a3 * a1, a1 * a2])


class Scaled(NamedTuple):
    """c, d, 1 and S over the greater of c and d: near the separatrix both are as small as the tilt
    of the spin, and their squares, and those of derivatives, would leave the range of numbers."""

    c: Scalar
    d: Scalar
    one: Scalar
    s: Scalar
    denominator: Scalar

    @classmethod
    def of(cls, body: ArrangedBody, phase: Jacobi) -> "Scaled":
        greater = jnp.where(body.difference < 0.0, phase.c, phase.d)
        one = 1.0 / greater
        c = phase.c / greater
        d = phase.d / greater
        s = phase.s * one
        # D is a sum of non-negative terms.
        return cls(c, d, one, s, d * d - rate_products(body.moments)[2] * (body.omega[2] * s) ** 2)


def angle_between(start: Vector, reached: Vector) -> Scalar:
    """arg(z(t) / z(0)) within a quarter period."""
    return jnp.arctan2(
        reached[0] * start[1] - reached[1] * start[0], reached[0] * start[0] + reached[1] * start[1]
    )


def precession(
    body: ArrangedBody, phase: Jacobi, scaled: Scaled, duration: Scalar, h: Scalar
) -> Scalar:
    """psi of the third axis, and the whole half turns of z, rad.

    For M > sqrt(xy) the third integral passes to the pole xy/M, for which third(M) = rho t - arg(c
    d + i rho S) - third(xy/M)."""
    (i1, i2, i3), (w1, w2, w3), (s, c, d) = body.moments, body.omega, phase[:3]
    gain = (i1 - i3) * i1 * w1 * w1 + (i2 - i3) * i2 * w2 * w2
    pole = (i2 - i3) * gain / (i2 * i3 * i3)
    strength = h / i3 - h / i1
    other = pole * pole > body.x * body.y
    near = jnp.where(other, body.x * body.y / jnp.where(other, pole, 1.0), pole)
    transverse = (i1 * w1) ** 2 + (i2 * w2) ** 2
    # Z, like D over the square of the greater of c and d.
    triple = (w1 * scaled.one) * w2 * (w3 * scaled.s)
    real = transverse * scaled.c * scaled.d - i3 * (i1 - i2) * triple * (1.0 + pole * s * s)
    imaginary = -h / i3 * gain * s * scaled.denominator
    re, im = jnp.where(other, c * d, 1.0), jnp.where(other, strength * s, 0.0)
    angle = safe_atan2(imaginary * re + real * im, real * re - imaginary * im)
    rest = jnp.where(other, 1.0, -1.0)
    rate = h / jnp.where(other, i1, i3)
    # At the smaller of M and xy/M, for which the third integral is well conditioned.
    within = third(s, c, d, 1.0 + near * s * s, near * strength)
    whole, returns = _quarter(body, phase, near, strength)
    within, whole = barrier((within, whole), everywhere=True)
    sense = jnp.where(other, 0.0, -jnp.sign(gain)) + jnp.where(
        body.difference < 0.0, jnp.sign(w3 * gain), 0.0
    )
    period = jnp.where(returns, 2.0 * rest * whole + math.pi * sense, 0.0)
    return rate * duration + rest * within + angle + phase.half_periods * period


def _quarter(
    body: ArrangedBody, phase: Jacobi, pole: Scalar, strength: Scalar
) -> tuple[Scalar, Flag]:
    """The third integral over a quarter period, rad, where the duration is longer, and whether it
    is."""
    returns = phase.half_periods != 0.0
    circled = body.difference < 0.0
    top = jnp.where(returns, jnp.where(circled, body.y, body.x), 1.0)
    least = jnp.sqrt(
        jnp.where(returns, jnp.where(circled, -body.difference, body.difference) / top, 1.0)
    )
    share = pole / top
    size = strength * share / (3.0 * jnp.sqrt(top))
    return size * complete_third(1.0 + least, least, 1.0 + share), returns

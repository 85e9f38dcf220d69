"""Two-body motion as a closed form that systems and effects offer: `kepler_flow` of a state."""

import math
from typing import final

import jax
import jax.numpy as jnp

from ..bodies import BodyState
from ..core import AbstractClosedForm, Flag, Scalar, Vector
from ..core.square_roots import sqrt
from ..core.squares import quotient
from ..core.vectors import cross, dot
from .kepler import conic_flow


@final
class KeplerMotion(AbstractClosedForm):
    """Motion about a fixed point mass of gravitational parameter `mu`, m^3/s^2, on every conic."""

    mu: Scalar

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        assert y.position is not None and y.velocity is not None
        position, velocity = conic_flow(y.position, y.velocity, duration, self.mu)
        return BodyState(position=position, velocity=velocity)

    @property
    def range_of_validity(self) -> str:
        return "The motion is along a straight line through the centre, and passes r = 0"

    def outside(self, duration: Scalar, y: BodyState) -> Flag:
        """Whether the motion is along a straight line through the centre and passes the centre."""
        assert y.position is not None and y.velocity is not None
        # A truth value has no derivative.
        args = jax.lax.stop_gradient((y.position, y.velocity, self.mu, duration))
        r, v, mu, duration = args
        h = cross(r, v)
        eps = 64.0 * float(jnp.finfo(r.dtype).eps)
        straight = dot(h, h) <= eps * eps * dot(r, r) * dot(v, v)
        # Elliptic and hyperbolic functions only for the rare run that needs them.
        return jax.lax.cond(
            jnp.any(straight),
            lambda: straight & _passes_centre(r, v, mu, duration),
            lambda: jnp.zeros_like(straight),
        )


def _passes_centre(r: Vector, v: Vector, mu: Scalar, duration: Scalar) -> Flag:
    """Whether a straight motion passes the centre within the `duration`, s.

    With E (or H) the eccentric anomaly of the straight ellipse (hyperbola), e = 1, the time since
    the passage is (E - sin E) / n, (sinh H - H) / n, and on the parabola sqrt(2 r^3/mu) / 3."""
    distance = sqrt(dot(r, r))
    outwards = dot(r, v)
    alpha = 2.0 / distance - quotient(dot(v, v), mu)
    flat = jnp.abs(alpha) * distance < 1e-6
    size = jnp.where(flat, 1.0, jnp.abs(alpha))
    rate = size * jnp.sqrt(mu * size)
    sine = outwards * jnp.sqrt(quotient(size, mu))
    anomaly = jnp.arctan2(sine, 1.0 - distance * size)
    parabola = jnp.sign(outwards) * distance * jnp.sqrt(quotient(2.0 * distance, mu)) / 3.0
    ellipse = (anomaly - jnp.sin(anomaly)) / rate
    hyperbola = (sine - jnp.arcsinh(sine)) / rate
    since = jnp.where(flat, parabola, jnp.where(alpha > 0.0, ellipse, hyperbola))
    # On an ellipse it comes back after each period.
    comes_back = ~flat & (alpha > 0.0)
    turns = jnp.where(comes_back, rate / (2.0 * math.pi), 1.0)
    before, after = since * turns, (since + duration) * turns
    again = jnp.floor(before) != jnp.floor(after)
    return jnp.where(comes_back, again, (before < 0.0) != (after < 0.0))

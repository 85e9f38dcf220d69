"""Forced oscillator with a spring that softens or stiffens: Duffing's equation.

    m y'' + c y' + k y - b y^3 = F sin(p t)
    (K - m p^2)^2 + c^2 p^2 = (F/a)^2,   K = k - 3/4 b a^2      resonance curve by harmonic balance

    symbol   meaning                                     unit
    m, c, k  mass, damping, stiffness                    kg, N s/m, N/m
    b        cubic coefficient: positive softens         N/m^3
    F, p     amplitude and angular frequency of force    N, rad/s
    a        amplitude of y                              m

Source: Thomson 6.3, problems 3 and 4.
"""

__all__ = ["DuffingOscillator", "DuffingState"]

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.listed import no_method
from ..core.printing import printed
from ..core.safe import end_sqrt, safe_sqrt
from ..core.types import as_float

# The number of Newton's steps, each of which doubles the digits.
STEPS = 60


@final
@printed()
class DuffingState(eqx.Module):
    """Deflection and velocity; also the rates of both."""

    position: NumberField = quantity("m", doc="y")
    velocity: NumberField = quantity("m/s", doc="rate of y")


@final
class DuffingOscillator(AbstractSystem):
    """A forced oscillator with a cubic spring. State: `DuffingState`."""

    mass: NumberField = quantity("kg", positive=True, doc="m")
    stiffness: NumberField = quantity("N/m", doc="k")
    softening: NumberField = quantity("N/m^3", doc="b, positive softens")
    force: NumberField = quantity("N", default=0.0, doc="F, amplitude of the force")
    frequency: NumberField = quantity("rad/s", default=0.0, doc="p, of the force")
    damping: NumberField = quantity("N s/m", default=0.0, doc="c")

    def vector_field(self, t: Scalar, y: DuffingState) -> DuffingState:
        push = self.force * jnp.sin(self.frequency * t)
        spring = (self.stiffness - self.softening * y.position**2) * y.position
        rate = (push - self.damping * y.velocity - spring) / self.mass
        return DuffingState(y.velocity, rate)

    def invariants(self, t: Scalar, y: DuffingState) -> dict[str, Array]:
        """Nothing is conserved: the force does work on the mass."""
        del t, y
        return {}

    @property
    @no_method
    def first_order(self) -> tuple[Scalar, Scalar]:
        """Amplitudes, m, of sin(p t) and of sin(3 p t) without damping, to first order in b."""
        p2 = self.frequency**2
        linear = self.force / (self.stiffness - self.mass * p2)
        cube = self.softening * linear**3
        first = linear + 0.75 * cube / (self.stiffness - self.mass * p2)
        return first, -0.25 * cube / (self.stiffness - 9.0 * self.mass * p2)

    def resonance_frequencies(self, amplitude: Scalar) -> tuple[Scalar, Scalar]:
        """The angular frequencies p, rad/s, below and above the backbone p^2 = K/m at which the
        motion has the amplitude a, m, by harmonic balance with the damping: the whole resonance
        curve, its unstable part included. The `frequency` of the oscillator is not used.

        NaN where there is none: beyond the peak, and below p = 0. Where both coincide, at the peak,
        their slopes are infinite (endpoint derivative convention of `core/safe.py`)."""
        a = as_float(amplitude)
        stiffness = self.stiffness - 0.75 * self.softening * a * a

        def radicand(mass, damping, stiffness, force):
            lost = damping * damping
            return lost * (lost - 4.0 * mass * stiffness) + (2.0 * mass * force) ** 2

        apart = end_sqrt(radicand, self.mass, self.damping, stiffness, self.force / a)
        middle = 2.0 * self.mass * stiffness - self.damping * self.damping
        scale = jnp.sqrt(2.0) * self.mass
        lower, upper = middle - apart, middle + apart
        root = end_sqrt(lambda x: x, lower), end_sqrt(lambda x: x, upper)
        return root[0] / scale, root[1] / scale

    def harmonic_balance(self, guess: Scalar | None = None) -> Scalar:
        """The amplitude a, m, of the sin(p t) term without damping: (k - m p^2) a - 3/4 b a^3 = F.

        **Arguments**

        - `guess`: near one of the up to three roots, m; by default near the linear one, and beyond
          the jump, where that has met its neighbour, near the one that is left.

        **Returns** the root; its derivatives are not finite where two roots meet (the jump)."""
        stiffness = self.stiffness - self.mass * self.frequency**2

        def newton(a: Array, stiffness: Scalar, softening: Scalar, force: Scalar) -> Array:
            cube = 0.75 * softening * a * a
            return a - ((stiffness - cube) * a - force) / (stiffness - 3.0 * cube)

        given = (stiffness, self.softening, self.force)
        fixed = jax.lax.stop_gradient(given)
        start = _beside_the_root(*fixed) if guess is None else jnp.asarray(guess)
        shape = jnp.broadcast_shapes(*(jnp.shape(x) for x in (start, *fixed)))
        start = jnp.broadcast_to(start, shape)
        root = jax.lax.fori_loop(0, STEPS, lambda _, a: newton(a, *fixed), start)
        # A step more carries the first derivatives of the root, two the second ones.
        return newton(newton(jax.lax.stop_gradient(root), *given), *given)


def _beside_the_root(stiffness: Scalar, softening: Scalar, force: Scalar) -> Array:
    """An amplitude from which Newton's steps go to a root of s a - 3/4 b a^3 = F without turning.

    The amplitude of the linear motion, F/s, while there is a root on its side; beyond the jump,
    where s and b have one sign and 81 |b| F^2 > 16 |s|^3, one further out than the only root."""
    s, b, force = jnp.broadcast_arrays(stiffness, softening, force)
    s3 = jnp.abs(s) ** 3
    alone = (s * b >= 0.0) & (81.0 * jnp.abs(b) * force**2 > 16.0 * s3)
    cube = jnp.where(b == 0.0, 1.0, 0.75 * jnp.abs(b))
    out = jnp.cbrt(jnp.abs(force) / cube) + safe_sqrt(jnp.abs(s) / cube)
    linear = force / jnp.where(alone, 1.0, s)
    return jnp.where(alone, -jnp.sign(b) * jnp.sign(force) * out, linear)

"""Motion about a point mass in the variables of Kustaanheimo and Stiefel, perturbed by a potential.

The energy of the whole motion is constant, and the two-body energy follows from the position:
the parameters then obey an equation of second order by themselves. The time is a quadrature whose
large part follows from the variables: the rest is as small as the perturbation, and so is the error
of its quadrature.

    u'' = (H - V) u / 2 + |r| L(u)^T p / 2              t' = |r| = u . u
    E = H - V(r),  p = -dV/dr
    t = k u . w + int g ds                              for any constant k, because
    (u . w)' = mu/2 + |r| (E + r . p / 2)               with 4 w . w = 2 (mu + E |r|)
    g = |r| (1 - k (E + r . p / 2)) - k mu / 2          k = 1/H: |r| (V - r . p / 2)/H - mu/(2H)

    symbol  meaning                                                        unit
    k       1/H; zero about a parabola, and close to the centre            s^2/m^2
    H       energy, that of the perturbation included                      m^2/s^2
    V       potential of the perturbation                                  m^2/s^2

All other symbols as in `_kustaanheimo_stiefel.py`.

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, sections 8, 9.
"""

from typing import final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..bodies import BodyState
from ..core import AbstractRegularised, AbstractSecondOrderForm, AbstractSystem, Scalar, Vector
from ..core.barrier import barrier
from ..core.vectors import dot
from ._ks_map import dot4, ks_map, ks_transposed

# The largest mu k, in radii, for which the time is split: u . w loses precision in proportion.
FARTHEST = 100.0


def _together(x: PyTree) -> PyTree:
    """The arrays behind a barrier, so that components which read them do not compute them again.
    The first one is a vector. A single run is faster without the barrier."""
    return barrier(x) if jax.tree.leaves(x)[0].ndim > 1 else x


@final
class SecondOrderKS(AbstractSecondOrderForm):
    """The motion of `ks` about a point mass `mu`, m^3/s^2, where the accelerations of `rest` have a
    potential, in the variables (u, w, H, t), (10, *runs)."""

    ks: AbstractRegularised
    rest: AbstractSystem | None
    mu: Float[Array, "*#runs"]

    def _potential(self, r: Vector) -> Scalar:
        rest = self.rest
        if rest is None:
            return jnp.zeros_like(r[0])
        # The energy at rest: what the perturbations conserve by themselves.
        at_rest = BodyState(r, jnp.zeros_like(r))
        return rest.invariants(jnp.zeros((), r.dtype), at_rest)["energy"]

    def _of_two_bodies(self, z: Array) -> Array:
        """The same with the energy E instead of H."""
        energy = z[8] - self._potential(ks_map(z[:4], z[:4]))
        return jnp.concatenate([z[:8], energy[None], z[9:]])

    def to_regularised(self, y: BodyState) -> Array:
        z = self.ks.to_regularised(y)
        return jnp.concatenate([z[:8], (z[8] + self._potential(y.position))[None], z[9:]])

    def from_regularised(self, z: Array) -> BodyState:
        return self.ks.from_regularised(z)

    def perturbation(self, t: Scalar, z: Array) -> Vector:
        # The perturbation is part of `rates`, which need its potential as well.
        del t
        return jnp.zeros_like(z[:3])

    def derivative(self, z: Array, perturbation: Vector) -> Array:
        del perturbation
        acceleration, r = self.rates(z[:4], jnp.stack([z[8], jnp.zeros_like(z[8])]))
        return jnp.concatenate([z[4:8], acceleration, jnp.zeros_like(z[8:9]), r[None]])

    def held(self, z: Array) -> Array:
        energy = z[8]
        # Where k mu is larger than this many radii, u . w has lost as much of its precision.
        small = jnp.abs(energy) * self.clock(z[:4]) < self.mu / FARTHEST
        k = jnp.where(small, 0.0, 1.0 / jnp.where(small, 1.0, energy))
        return jnp.stack([energy, k])

    def known_time(self, q: Array, dq: Array, held: Array) -> Scalar:
        return held[1] * dot4(q, dq)

    def clock(self, q: Array) -> Scalar:
        return dot4(q, q)

    def rates(self, q: Array, held: Array) -> tuple[Array, Scalar]:
        (total, k) = held
        r = dot4(q, q)
        half = (0.5 * self.mu) * k
        if self.rest is None:
            return (0.5 * total) * q, r * (1.0 - k * total) - half
        position = _together(ks_map(q, q))
        at_rest = BodyState(position, jnp.zeros_like(position))
        p = self.rest.vector_field(jnp.zeros((), q.dtype), at_rest).velocity
        energy = total - self._potential(position)
        g = r * (1.0 - k * (energy + 0.5 * dot(position, p))) - half
        force, energy, g = _together(((0.5 * r) * p, 0.5 * energy, g))
        return energy * q + ks_transposed(q, force), g

    def fictitious_time(self, duration: Scalar, z: Array) -> Scalar:
        return self.ks.fictitious_time(duration, self._of_two_bodies(z))

    def step_scale(self, sigma: Scalar, z: Array) -> Scalar:
        return self.ks.step_scale(sigma, z)

    def size(self, x: Array, z0: Array, z1: Array) -> Scalar:
        # By the energy of the whole motion: the perturbation hardly changes a scale.
        return self.ks.size(x, z0, z1)

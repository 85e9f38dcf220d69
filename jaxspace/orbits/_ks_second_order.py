"""Motion about a point mass in the variables of Kustaanheimo and Stiefel, perturbed by a potential.

The energy of the whole motion is constant, and that of the two bodies follows from the position:
the parameters then obey an equation of second order by themselves, and the time is a quadrature.

    u'' = (H - V) u / 2 + |r| L(u)^T p / 2              t' = u . u
    E = H - V(r),  p = -dV/dr

    symbol  meaning                                                        unit
    H       energy, that of the perturbation included                      m^2/s^2
    V       potential of the perturbation                                  m^2/s^2

All other symbols as in `_kustaanheimo_stiefel.py`.

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, sections 8, 9.
"""

from typing import final

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..bodies import BodyState
from ..core import (
    AbstractRegularised,
    AbstractSecondOrderForm,
    AbstractSystem,
    Scalar,
    Vector,
    barrier,
)
from ._ks_map import dot4, ks_map, ks_transposed


def _together(x: PyTree) -> PyTree:
    """The arrays, computed once for all components that read them; for a single run it would cost
    more to hold them."""
    return barrier(x) if jax.tree.leaves(x)[-1].ndim > 1 else x


@final
class SecondOrderKS(AbstractSecondOrderForm):
    """The motion of `ks`, where the accelerations of `rest` have a potential, in the variables
    (u, w, H, t), (10, *runs)."""

    ks: AbstractRegularised
    rest: AbstractSystem | None

    def _potential(self, r: Vector) -> Scalar:
        rest = self.rest
        if rest is None:
            return jnp.zeros_like(r[0])
        # The energy at rest: what the perturbations conserve by themselves.
        at_rest = BodyState(r, jnp.zeros_like(r))
        return rest.invariants(jnp.zeros((), r.dtype), at_rest)["energy"]

    def _of_two_bodies(self, z: Array) -> Array:
        """The same with the energy E in the place of H."""
        energy = z[8] - self._potential(ks_map(z[:4], z[:4]))
        return jnp.concatenate([z[:8], energy[None], z[9:]])

    def to_regularised(self, y: BodyState) -> Array:
        z = self.ks.to_regularised(y)
        return jnp.concatenate([z[:8], (z[8] + self._potential(y.position))[None], z[9:]])

    def from_regularised(self, z: Array) -> BodyState:
        return self.ks.from_regularised(z)

    def perturbation(self, t: Scalar, z: Array) -> Vector:
        # It is in the rates, because these need its potential, too.
        del t
        return jnp.zeros_like(z[:3])

    def derivative(self, z: Array, perturbation: Vector) -> Array:
        del perturbation
        acceleration, r = self.rates(z[:4], z[8:9])
        return jnp.concatenate([z[4:8], acceleration, jnp.zeros_like(z[8:9]), r[None]])

    def rates(self, q: Array, c: Array) -> tuple[Array, Scalar]:
        r = dot4(q, q)
        if self.rest is None:
            return (0.5 * c[0]) * q, r
        position = _together(ks_map(q, q))
        at_rest = BodyState(position, jnp.zeros_like(position))
        p = self.rest.vector_field(jnp.zeros((), q.dtype), at_rest).velocity
        energy, half = _together((0.5 * (c[0] - self._potential(position)), (0.5 * r) * p))
        return energy * q + ks_transposed(q, half), r

    def fictitious_time(self, duration: Scalar, z: Array) -> Scalar:
        return self.ks.fictitious_time(duration, self._of_two_bodies(z))

    def size(self, x: Array, z0: Array, z1: Array) -> Scalar:
        # By the energy of the whole motion: its perturbation changes little of a scale.
        return self.ks.size(x, z0, z1)

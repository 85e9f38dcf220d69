"""Motion about a point mass in the variables of Kustaanheimo and Stiefel.

They are regular on every orbit, and through a collision.

    r = L(u) u,  v = 2 L(u) w / |r|                     dt/ds = |r| = u . u
    u' = w
    w' = E u / 2 + |r| L(u)^T p / 2                     oscillators: E is constant where p = 0
    E' = 2 w . L(u)^T p,  t' = u . u                    ': d/ds

    symbol  meaning                                                        unit
    s       fictitious time; sqrt(-2E) s is the eccentric anomaly          s/m
    u       four parameters of the position, first three rows of L(u) u    m^(1/2)
    w       u'                                                             m^(3/2)/s
    E       energy of the two-body motion, v^2/2 - mu/|r|                  m^2/s^2
    p       acceleration other than that of the point mass                 m/s^2
    t       time                                                           s

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, sections 8, 9, 19.
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import AbstractRegularised, AbstractSystem, Scalar, Vector
from ..core.square_roots import sqrt
from ..core.squares import quotient
from ..core.structure import once_per_structure
from ..core.tracing import depending_on
from ..core.vectors import dot, inverse_norm
from ._ks_map import dot4, ks_map, ks_parameters, ks_transposed
from ._ks_second_order import SecondOrderKS
from .kepler import universal_anomaly


@final
class KustaanheimoStiefel(AbstractRegularised):
    """Motion about a point mass `mu`, m^3/s^2, with the accelerations of `rest`, in the variables
    (u, w, E, t), (10, *runs)."""

    mu: Float[Array, "*#runs"]
    rest: AbstractSystem | None

    @property
    def attraction(self) -> Scalar:
        return self.mu

    def to_regularised(self, y: BodyState) -> Array:
        u = ks_parameters(y.position)
        energy = 0.5 * dot(y.velocity, y.velocity) - self.mu * inverse_norm(y.position)
        return jnp.concatenate(
            [u, 0.5 * ks_transposed(u, y.velocity), jnp.stack([energy, jnp.zeros_like(energy)])]
        )

    def from_regularised(self, z: Array) -> BodyState:
        return _state_of(z)

    def perturbation(self, t: Scalar, z: Array) -> Vector:
        if self.rest is None:
            return jnp.zeros_like(z[:3])
        return self.rest.vector_field(t, self.from_regularised(z)).velocity

    def derivative(self, z: Array, perturbation: Vector) -> Array:
        u, w, energy = z[:4], z[4:8], z[8]
        r = dot4(u, u)
        if self.rest is None:
            # The pure oscillator: no product with a perturbation that is zero.
            return jnp.concatenate([w, (0.5 * energy) * u, jnp.stack([jnp.zeros_like(r), r])])
        force = ks_transposed(u, perturbation)
        return jnp.concatenate(
            [w, 0.5 * (energy * u + r * force), jnp.stack([2.0 * dot4(w, force), r])]
        )

    def fictitious_time(self, duration: Scalar, z: Array) -> Scalar:
        u, w = z[:4], z[4:8]
        r = dot4(u, u)
        # r . v = dr/ds, because dt/ds = |r|.
        climb = 2.0 * dot4(u, w)
        unit = sqrt(quotient(r, self.mu))
        beta = quotient(-2.0 * z[8] * r, self.mu)
        sigma = quotient(climb, unit * self.mu)
        # Rounding may leave a small negative number on a straight line, where p is zero.
        p = jnp.maximum(quotient(4.0 * dot4(w, w), self.mu) - sigma * sigma, 0.0)
        return unit * universal_anomaly(sigma, beta, duration / (r * unit), p)

    def step_scale(self, sigma: Scalar, z: Array) -> Scalar:
        u, w = z[:4], z[4:8]
        r = dot4(u, u)
        # r'' = mu + 2 E r, by its series: within a step that is enough.
        y = -2.0 * z[8] * sigma * sigma
        c0 = 1.0 - y * (1.0 - y * (1.0 - y / 30.0) / 12.0) / 2.0
        c1 = 1.0 - y * (1.0 - y * (1.0 - y / 42.0) / 20.0) / 6.0
        c2 = 1.0 - y * (1.0 - y * (1.0 - y / 56.0) / 30.0) / 12.0
        ahead = r * c0 + sigma * (2.0 * dot4(u, w) * c1 + (0.5 * self.mu) * sigma * c2)
        # A scale is positive, also where the series, too far ahead, is not.
        return jnp.maximum(ahead, 0.01 * r)

    def size(self, x: Array, z0: Array, z1: Array) -> Scalar:
        # The larger of both ends: u may be zero at one of them, in a collision.
        r = jnp.maximum(dot4(z0[:4], z0[:4]), dot4(z1[:4], z1[:4]))
        w2 = jnp.maximum(dot4(z0[4:8], z0[4:8]), dot4(z1[4:8], z1[4:8]))
        energy = jnp.maximum(jnp.abs(z0[8]), jnp.abs(z1[8]))
        # On an ellipse of constant size: w itself is small about the apoapsis.
        w2 = w2 + 0.5 * energy * r
        # E is zero on a parabola: a hundredth of the attraction is used to scale the error of E.
        energy = energy + 0.01 * self.mu / r
        of_energy = x[8] / energy
        return jnp.sqrt(dot4(x[:4], x[:4]) / r + dot4(x[4:8], x[4:8]) / w2 + of_energy * of_energy)

    def second_order(self, z: jax.ShapeDtypeStruct) -> SecondOrderKS | None:
        if self.rest is None or _has_potential(self.rest, z):
            return SecondOrderKS(self, self.rest, self.mu)
        return None


def _state_of(z: Array) -> BodyState:
    u, w = z[:4], z[4:8]
    return BodyState(ks_map(u, u), (2.0 / dot4(u, u)) * ks_map(u, w))


@once_per_structure
def _has_potential(rest: AbstractSystem, z: jax.ShapeDtypeStruct) -> bool:
    """Whether the accelerations of `rest` conserve an energy and depend on the position only.

    The effects declare the first; the second is read from the traced functions."""
    y = jax.eval_shape(_state_of, z)
    time = jax.ShapeDtypeStruct((), z.dtype)
    shapes, static = eqx.partition(rest, lambda x: isinstance(x, jax.ShapeDtypeStruct))

    def both(t: Scalar, v: Vector, r: Vector, arrays: AbstractSystem) -> tuple[Array, ...]:
        system = eqx.combine(arrays, static)
        invariants = system.invariants(t, BodyState(r, jnp.zeros_like(r)))
        a = system.vector_field(t, BodyState(r, v)).velocity
        return (a, invariants["energy"]) if "energy" in invariants else (a,)

    jaxpr = jax.make_jaxpr(both)(time, y.velocity, y.position, shapes).jaxpr
    moved = depending_on(jaxpr, jaxpr.invars[:2])
    return len(jaxpr.outvars) == 2 and not any(x in moved for x in jaxpr.outvars)

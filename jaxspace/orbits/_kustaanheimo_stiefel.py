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
    p       acceleration by all that is not the point mass                 m/s^2
    t       time                                                           s

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, sections 8, 9, 19.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import AbstractRegularised, AbstractSystem, Scalar, Vector, depending_on, dot
from ._kepler import universal_anomaly

if TYPE_CHECKING:
    from ._ks_second_order import SecondOrderKS


def ks_parameters(r: Vector) -> Float[Array, "4 *#runs"]:
    """Some u, m^(1/2), of the position `r`, m: L(u) u = r."""
    x, y, z = r[0], r[1], r[2]
    # A circle of u belongs to one position. The u with u4 = 0 is taken where x >= 0, and the one
    # with u3 = 0 elsewhere, because the divisor below is then never close to zero.
    ahead = x >= 0.0
    first = jnp.sqrt(0.5 * (jnp.sqrt(dot(r, r)) + jnp.where(ahead, x, -x)))
    b = 0.5 * y / first
    c = 0.5 * z / first
    zero = jnp.zeros_like(x)
    return jnp.where(ahead, jnp.stack([first, b, c, zero]), jnp.stack([b, first, zero, c]))


# The three vectors of the rows of L(u) are u with its components exchanged in pairs, with signs.
# Written so, they need no reordering component by component, which compiles to slow code.
_SIGNS = np.array([[1.0, -1.0, -1.0, 1.0], [1.0, 1.0, -1.0, -1.0], [1.0, 1.0, 1.0, 1.0]])


def _row(u: Array, k: int) -> Array:
    """The row number `k` of L(u): component i is that number (i xor k) of u, with a sign."""
    axes = [axis for axis, bit in ((1, 1), (0, 2)) if k & bit]
    pairs = u.reshape(2, 2, *u.shape[1:])
    signs = jnp.asarray(_SIGNS[k].reshape(4, *(1,) * (u.ndim - 1)), u.dtype)
    return signs * jnp.flip(pairs, axes).reshape(u.shape)


def ks_map(u: Array, w: Array) -> Vector:
    """The first three rows of L(u) w; the position for w = u."""
    return jnp.stack([dot4(_row(u, k), w) for k in range(3)])


def ks_transposed(u: Array, p: Vector) -> Float[Array, "4 *#runs"]:
    """L(u)^T p, for a vector p without a fourth component."""
    return _row(u, 0) * p[0] + (_row(u, 1) * p[1] + _row(u, 2) * p[2])


def dot4(u: Array, w: Array) -> Scalar:
    """u . w of four components."""
    (a, b, c, d), (e, f, g, h) = u, w
    # Written out, because a reduction over four components hinders the compiler's fusion.
    return (a * e + b * f) + (c * g + d * h)


@final
class KustaanheimoStiefel(AbstractRegularised):
    """Motion about a point mass `mu`, m^3/s^2, with the accelerations of `rest`, in the variables
    (u, w, E, t), (10, *runs)."""

    mu: Float[Array, "*#runs"]
    rest: AbstractSystem | None

    def to_regularised(self, y: BodyState) -> Array:
        u = ks_parameters(y.position)
        energy = 0.5 * dot(y.velocity, y.velocity) - self.mu / jnp.sqrt(dot(y.position, y.position))
        return jnp.concatenate(
            [u, 0.5 * ks_transposed(u, y.velocity), jnp.stack([energy, jnp.zeros_like(energy)])]
        )

    def from_regularised(self, z: Array) -> BodyState:
        u, w = z[:4], z[4:8]
        return BodyState(ks_map(u, u), (2.0 / dot4(u, u)) * ks_map(u, w))

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
        unit = jnp.sqrt(r / self.mu)
        beta = -2.0 * z[8] * r / self.mu
        sigma = climb / (unit * self.mu)
        # Rounding may leave a small negative number on a straight line, where p is zero.
        p = jnp.maximum(4.0 * dot4(w, w) / self.mu - sigma * sigma, 0.0)
        return unit * universal_anomaly(sigma, beta, duration / (r * unit), p)

    def size(self, x: Array, z0: Array, z1: Array) -> Scalar:
        # The larger of both ends: u may be zero at one of them, in a collision.
        r = jnp.maximum(dot4(z0[:4], z0[:4]), dot4(z1[:4], z1[:4]))
        w2 = jnp.maximum(dot4(z0[4:8], z0[4:8]), dot4(z1[4:8], z1[4:8]))
        energy = jnp.maximum(jnp.abs(z0[8]), jnp.abs(z1[8]))
        # On an ellipse of constant size: w itself is small about the apoapsis.
        w2 = w2 + 0.5 * energy * r
        # E is zero on a parabola, whose energy is judged by a hundredth of the attraction.
        energy = energy + 0.01 * self.mu / r
        of_energy = x[8] / energy
        return jnp.sqrt(dot4(x[:4], x[:4]) / r + dot4(x[4:8], x[4:8]) / w2 + of_energy * of_energy)

    def second_order(self, z: jax.ShapeDtypeStruct) -> "SecondOrderKS | None":
        from ._ks_second_order import SecondOrderKS

        if self.rest is None or _has_potential(self.rest, self.from_regularised, z):
            return SecondOrderKS(self)
        return None


def _has_potential(
    rest: AbstractSystem, state: Callable[[Array], BodyState], z: jax.ShapeDtypeStruct
) -> bool:
    """Whether the accelerations of `rest` keep an energy, and depend on the position alone.

    The latter as the traced functions show it; what keeps the energy, its effects say."""
    y = jax.eval_shape(state, z)
    time = jax.ShapeDtypeStruct((), z.dtype)
    arrays, static = eqx.partition(rest, eqx.is_array)
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), arrays)

    def both(t: Scalar, v: Vector, r: Vector, arrays: AbstractSystem) -> tuple[Array, ...]:
        system = eqx.combine(arrays, static)
        kept = system.invariants(t, BodyState(r, jnp.zeros_like(r)))
        a = system.vector_field(t, BodyState(r, v)).velocity
        return (a, kept["energy"]) if "energy" in kept else (a,)

    jaxpr = jax.make_jaxpr(both)(time, y.velocity, y.position, shapes).jaxpr
    moved = depending_on(jaxpr, jaxpr.invars[:2])
    return len(jaxpr.outvars) == 2 and not any(x in moved for x in jaxpr.outvars)

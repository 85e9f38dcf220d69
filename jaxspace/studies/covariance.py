"""Mean and covariance of a state along a run under white noise, to first order.

    y' = f(t, y) + w,     E[w(t) w(s)^T] = Q delta(t - s)
    m' = f(t, m)
    U' = A U,                 A = df/dy at m
    G' = A G + G A^T + Q,     P = U D U^T + G
    L' = A L,                 P = L L^T without noise

    symbol  meaning                                                      unit
    m, P    mean and covariance, in local coordinates                    of the state, squared
    U, D    factors of the covariance at the start (`_factors`)
    G       covariance that the process noise adds, zero at the start    that of P
    L       a root of P                                                  of the state
    Q       spectral density of the process noise                        that of P, 1/s
    A       matrix of the linearised motion of the error                 1/s

The error of a quaternion q is the small rotation e in body axes, q = m exp(e/2); its matrix A
contains that the body axes turn with the mean.

Source: Maybeck, Stochastic Models, Estimation, and Control, 4.9; for attitude Markley and
Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, 6.2.
"""

__all__ = ["MeanCovariance", "MeanRoot", "Uncertain", "UncertainRoot"]

from collections.abc import Callable, Sequence
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..core import AbstractSystem, Flag, Scalar, State
from ..core.limits import Limit
from ..core.printing import printed
from ._factors import Factors, factors_of
from .coordinates import Coordinates

Noise = Float[ArrayLike, "n n"] | Callable[[Scalar, Any], Array] | None


@final
@printed()
class MeanCovariance(eqx.Module):
    """The state of `Uncertain`: a mean and the covariance of its local coordinates.

    - `mean`: the mean state.
    - `columns`, `weights`: factors of the covariance without that of the process noise.
    - `added`: the covariance that process noise has added; `None` without noise."""

    mean: State
    columns: Float[Array, "n k *#runs"]
    weights: Float[Array, "k *#runs"]
    added: Float[Array, "n n *#runs"] | None = None

    @property
    def covariance(self) -> Float[Array, "n n *#runs"]:
        """P, (n, n, *runs): no variance is negative."""
        P = Factors(self.columns, self.weights).product
        return P if self.added is None else P + factors_of(self.added).product


@final
class Uncertain(AbstractSystem):
    """Any system with the covariance of its state, as a system accepted by every verb. `about`
    makes the state.

    - `system`: the one that moves.
    - `noise`: the spectral density Q (n, n) of its process noise, or a function (t, y) -> (n, n) of
      it; `None` for none.
    - `delayed`: whether an additional constant coordinate is the delay of a run, s."""

    system: AbstractSystem
    noise: Any = None
    delayed: bool = eqx.field(static=True, default=False)

    def about(self, mean: State, known: Factors) -> MeanCovariance:
        """The state of a mean whose covariance has these factors."""
        if self.noise is None:
            return MeanCovariance(mean, *known)
        n, _, *runs = known.columns.shape
        return MeanCovariance(mean, *known, jnp.zeros((n, n, *runs), known.columns.dtype))

    def vector_field(self, t: Scalar, y: MeanCovariance) -> MeanCovariance:
        A = self._still(error_matrix(self.system, t, y.mean, y.columns.ndim - 2))
        columns = jnp.einsum("ij...,jk...->ik...", A, y.columns)
        mean, still = self.system.vector_field(t, y.mean), jnp.zeros_like(y.weights)
        if y.added is None:
            return MeanCovariance(mean, columns, still)
        AG = jnp.einsum("ij...,jk...->ik...", A, y.added)
        # G is symmetric, so that G A^T is the transpose of A G: one product serves both.
        rate = AG + jnp.swapaxes(AG, 0, 1)
        Q = jnp.asarray(self.noise(t, y.mean) if callable(self.noise) else self.noise)
        rate = rate + self._still(Q.reshape(Q.shape + (1,) * (rate.ndim - Q.ndim)))
        return MeanCovariance(mean, columns, still, rate)

    def _still(self, matrix: Array) -> Array:
        """A matrix of the errors, with zeros for the coordinate that does not move."""
        if not self.delayed:
            return matrix
        return jnp.pad(matrix, ((0, 1), (0, 1), *((0, 0),) * (matrix.ndim - 2)))

    def invariants(self, t: Scalar, y: MeanCovariance) -> dict[str, Array]:
        return self.system.invariants(t, y.mean)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.system.breaks()

    def limits(self, t: Scalar, y: MeanCovariance) -> Sequence[Limit]:
        return self.system.limits(t, y.mean)

    def outside(self, t: Scalar, y: MeanCovariance) -> Flag | None:
        return self.system.outside(t, y.mean)


@final
@printed()
class MeanRoot(eqx.Module):
    """The state of `UncertainRoot`: a mean and a square root of the covariance of its local
    coordinates.

    - `mean`: the mean state.
    - `root`: a matrix R, (n, k, *runs), with the covariance R R^T."""

    mean: State
    root: Float[Array, "n k *#runs"]


@final
class UncertainRoot(AbstractSystem):
    """Any system together with a square root of the covariance of its state, without process noise.
    Variances of any ratio are accurate, and never negative.

    - `system`: the system whose state is uncertain."""

    system: AbstractSystem

    def vector_field(self, t: Scalar, y: MeanRoot) -> MeanRoot:
        A = error_matrix(self.system, t, y.mean, y.root.ndim - 2)
        rate = jnp.einsum("ij...,jk...->ik...", A, y.root)
        return MeanRoot(self.system.vector_field(t, y.mean), rate)

    def invariants(self, t: Scalar, y: MeanRoot) -> dict[str, Array]:
        return self.system.invariants(t, y.mean)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.system.breaks()

    def limits(self, t: Scalar, y: MeanRoot) -> Sequence[Limit]:
        return self.system.limits(t, y.mean)

    def outside(self, t: Scalar, y: MeanRoot) -> Flag | None:
        return self.system.outside(t, y.mean)


def error_matrix(
    system: AbstractSystem, t: Scalar, y: State, run_axes: int
) -> Float[Array, "n n *runs"]:
    """A, 1/s, (n, n, *runs): e' = A e for a small error e of the state `y` at the time `t`, s."""
    coordinates = Coordinates.of(y, run_axes)
    runs = coordinates.trailing[0]
    zero = jnp.zeros((coordinates.count, *runs), coordinates.dtype)

    def off(y: State, e: Array) -> State:
        """The tangent of the state that an error e is: dy = T(y) e."""
        return jax.jvp(coordinates.at(y).moved, (zero,), (e,))[1]

    def column(e: Array) -> Array:
        e = jnp.broadcast_to(e.reshape(-1, *(1,) * run_axes), zero.shape)
        rate, change = jax.jvp(lambda y: system.vector_field(t, y), (y,), (off(y, e),))
        # T e' = (df/dy) T e - T' e: where T depends on the state, as on a group, it moves too.
        _, turn = jax.jvp(lambda y: off(y, e), (y,), (rate,))
        return coordinates.components(jax.tree.map(jnp.subtract, change, turn))

    return jax.vmap(column, out_axes=1)(jnp.eye(coordinates.count, dtype=coordinates.dtype))

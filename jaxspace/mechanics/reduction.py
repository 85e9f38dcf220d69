"""A Lagrangian without its cyclic coordinates (Routh), and the canonical equations (Hamilton).

    R(t, q, v) = L - sum of p_c v_c,   v_c from p_c = dL/dv_c           c: cyclic coordinates
    H(t, q, p) = p . v - L,   q' = dH/dp,   p' = -dH/dq + Q

Source: Thomson 9.8; Goldstein, Classical Mechanics, 8.1, 8.3.
"""

__all__ = ["routh"]

from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractSystem, InputError, Scalar, quantity
from ..core.formula import formula
from ..core.printing import printed
from ._description import GeneralisedState
from ._equations import mass_matrix, momenta, solve
from ._lagrangian import AbstractLagrangian, Lagrangian


@final
class _Routhian(eqx.Module):
    """R of the remaining coordinates; the parameters are the momenta of the cyclic ones."""

    system: AbstractLagrangian
    remaining: tuple[int, ...] = eqx.field(static=True)
    left_out: tuple[int, ...] = eqx.field(static=True)

    def __call__(self, t: Scalar, q: Array, v: Array, constants: Array) -> Scalar:
        c = jnp.array(self.left_out)
        shape = (len(self.system.names), *q.shape[1:])
        remaining = jnp.array(self.remaining)
        # The value of a cyclic coordinate does not matter.
        q_all = jnp.zeros(shape, q.dtype).at[remaining].set(q)
        v_all = jnp.zeros(shape, v.dtype).at[remaining].set(v)
        p = momenta(self.system.lagrangian, t, q_all, v_all)[c]
        m = mass_matrix(self.system.lagrangian, t, q_all, v_all)[c][:, c]
        constants = constants.reshape(constants.shape + (1,) * (p.ndim - constants.ndim))
        rates = solve(m, (constants - p)[:, None])[:, 0]
        v_all = v_all.at[c].set(rates)
        return self.system.lagrangian(t, q_all, v_all) - jnp.sum(constants * rates, axis=0)


@formula
def routh(system: AbstractLagrangian, y: GeneralisedState, t: Scalar = 0.0) -> Lagrangian:
    """The system reduced to its non-cyclic coordinates, with the momenta of the cyclic ones as
    constants.

    **Arguments**

    - `system`: without forces, friction and constraints.
    - `y`, `t`: the state and the time, s, that give the momenta.

    **Returns** the reduced system; its state contains the non-cyclic coordinates of `y`, in their
    order.

    **Raises** `InputError` where no coordinate is cyclic, or all are."""
    cyclic = set(system.cyclic)
    left_out = tuple(i for i, name in enumerate(system.names) if name in cyclic)
    remaining = tuple(i for i, name in enumerate(system.names) if name not in cyclic)
    if not left_out or not remaining:
        raise InputError(
            f"{len(left_out)} of the {len(system.names)} coordinates are cyclic: at least one must "
            "be, but not all."
        )
    constants = system.momenta(t, y)[jnp.array(left_out)]
    return Lagrangian(
        _Routhian(system, remaining, left_out), tuple(system.names[i] for i in remaining), constants
    )


@final
@printed()
class CanonicalState(eqx.Module):
    """Generalised coordinates and momenta; also the rates of both."""

    coordinates: Float[Array, "n *#runs"] = quantity("", doc="q, generalised coordinates")
    momenta: Float[Array, "n *#runs"] = quantity("", doc="p, generalised momenta")


@final
class Hamiltonian(AbstractSystem):
    """The canonical equations of a Hamiltonian H(t, q, p, parameters).

    - `function`: H, J; q and p are (n, *runs), the result (*runs,).
    - `parameters`: any tree of numbers, each a scalar or (*runs,).

    `Hamiltonian.of` makes it from a Lagrangian. State: `CanonicalState`."""

    function: Callable[..., Scalar]
    parameters: Any = None

    @classmethod
    def of(cls, system: AbstractLagrangian) -> "Hamiltonian":
        """The Hamiltonian p . v - L of a Lagrangian whose rates enter up to their squares."""
        return cls(_legendre, system)

    def vector_field(self, t: Scalar, y: CanonicalState) -> CanonicalState:
        # The gradient of the sum over runs is that of each, for none depends on another.
        slopes = jax.grad(
            lambda q, p: jnp.sum(self.function(t, q, p, self.parameters)), argnums=(0, 1)
        )(y.coordinates, y.momenta)
        return CanonicalState(slopes[1], -slopes[0])

    def invariants(self, t: Scalar, y: CanonicalState) -> dict[str, Array]:
        """None is known in general: H is constant only where it does not depend on the time."""
        del t, y
        return {}

    def energy(self, t: Scalar, y: CanonicalState) -> Scalar:
        """H, J."""
        return self.function(t, y.coordinates, y.momenta, self.parameters)


def _legendre(t: Scalar, q: Array, p: Array, system: AbstractLagrangian) -> Scalar:
    # Evaluated at rest, because the rates are unknown: with at most squares of the rates the matrix
    # is the same.
    still = jnp.zeros_like(p)
    m = mass_matrix(system.lagrangian, t, q, still)
    v = solve(m, (p - momenta(system.lagrangian, t, q, still))[:, None])[:, 0]
    return jnp.sum(p * v, axis=0) - system.lagrangian(t, q, v)
